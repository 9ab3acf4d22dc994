//! Simulated photographs as samples.

use gonio::appearance::disk::{CHANNELS, GLOBALS, SIDE};
use gonio::simulation::Stock;

use crate::Samples;

/// Photographs of a stock; the targets are the coordinates of their materials in its dictionary.
pub struct Photographs<'a>(pub &'a Stock);

impl Samples for Photographs<'_> {
    fn side(&self) -> usize {
        SIDE
    }

    fn channels(&self) -> usize {
        CHANNELS
    }

    fn globals(&self) -> usize {
        GLOBALS
    }

    fn dimensions(&self) -> usize {
        self.0.dictionary().coordinates.axes.len()
    }

    fn draw(&self, index: u64, image: &mut [f32], globals: &mut [f32], target: &mut [f32]) {
        let photograph = self.0.photograph(index);
        globals.copy_from_slice(&photograph.image.write(image));
        target.iter_mut().zip(photograph.place).for_each(|(t, z)| *t = z as f32);
    }
}
