//! Simulated photographs as samples.

use gonio::appearance::disk::{CHANNELS, DISK_SIDE, GLOBALS};
use gonio::simulation::ScenePool;

use crate::Samples;

/// Number of steps after which one group of the pool is replaced.
const STEPS_PER_GROUP: usize = 60;

/// Photographs of a pool; the targets are the coordinates of their materials in its dictionary.
pub struct Photographs<'a>(pub &'a mut ScenePool);

impl Photographs<'_> {
    /// Returns the number of a group that a training of this many steps does not use.
    pub(crate) fn unused(steps: usize) -> u64 {
        // The last window starts at `steps / STEPS_PER_GROUP` and is far shorter than this.
        (steps / STEPS_PER_GROUP) as u64 + (1 << 20)
    }
}

impl Samples for Photographs<'_> {
    fn advance(&mut self, step: usize) {
        self.0.load_groups((step / STEPS_PER_GROUP) as u64);
    }

    fn side(&self) -> usize {
        DISK_SIDE
    }

    fn channels(&self) -> usize {
        CHANNELS
    }

    fn globals(&self) -> usize {
        GLOBALS
    }

    fn dimensions(&self) -> usize {
        self.0.dictionary().latent_space.axes.len()
    }

    fn draw(&self, index: u64, image: &mut [f32], globals: &mut [f32], target: &mut [f32]) {
        let photograph = self.0.photograph(index);
        globals.copy_from_slice(&photograph.image.write(image));
        target.iter_mut().zip(photograph.coordinates).for_each(|(t, z)| *t = z as f32);
    }
}
