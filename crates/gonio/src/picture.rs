//! Pictures in memory: linear RGB radiance with an optional coverage channel.
//!
//! Row 0 is the top row. Values are linear and on an arbitrary scale. `gonio-io` reads them from
//! files.

use std::fmt;
use std::sync::Arc;

use glam::Vec3;

/// A rectangular array of pixels, row-major, row 0 at the top.
#[derive(Clone)]
pub struct Plane<T> {
    width: usize,
    height: usize,
    data: Pixels<T>,
}

/// Pixels in memory of another owner, which the `Arc` keeps alive.
pub type SharedBuffer<T> = Arc<dyn AsRef<[T]> + Send + Sync>;

/// Storage of the pixels.
#[derive(Clone)]
enum Pixels<T> {
    Own(Vec<T>),
    Lent(SharedBuffer<T>),
}

impl<T> Plane<T> {
    /// Wraps `data`, `width * height` pixels in row-major order.
    ///
    /// # Panics
    /// If the length of `data` is not `width * height`.
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Self {
        assert_eq!(data.len(), width * height, "a plane of {width}x{height} requires width * height pixels");
        Self { width, height, data: Pixels::Own(data) }
    }

    /// Wraps `data` like [`Self::from_vec`], but copies the pixels only before the first change.
    ///
    /// # Panics
    /// If the length of `data` is not `width * height`.
    pub fn from_shared(width: usize, height: usize, data: SharedBuffer<T>) -> Self {
        assert_eq!(
            (*data).as_ref().len(),
            width * height,
            "a plane of {width}x{height} requires width * height pixels"
        );
        Self { width, height, data: Pixels::Lent(data) }
    }

    /// Returns the plane whose pixel at column `x`, row `y` is `f(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> T) -> Self {
        Self::from_vec(width, height, (0..width * height).map(|i| f(i % width, i / width)).collect())
    }

    /// Number of columns.
    #[inline]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    #[inline]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns and rows.
    #[inline]
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// All pixels, row-major.
    #[inline]
    pub fn as_slice(&self) -> &[T] {
        match &self.data {
            Pixels::Own(data) => data,
            Pixels::Lent(data) => (**data).as_ref(),
        }
    }

    /// Returns the plane with `f` applied to every pixel.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Plane<U> {
        Plane::from_vec(self.width, self.height, self.as_slice().iter().map(f).collect())
    }
}

impl<T: Clone> Plane<T> {
    /// All pixels, row-major.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        if let Pixels::Lent(data) = &self.data {
            self.data = Pixels::Own((**data).as_ref().to_vec());
        }
        match &mut self.data {
            Pixels::Own(data) => data,
            Pixels::Lent(_) => unreachable!("lent pixels have just been copied"),
        }
    }

    /// All pixels, row-major.
    pub fn into_vec(self) -> Vec<T> {
        match self.data {
            Pixels::Own(data) => data,
            Pixels::Lent(data) => (*data).as_ref().to_vec(),
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for Plane<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, .. } = self;
        f.debug_struct("Plane").field("width", width).field("height", height).field("data", &self.as_slice()).finish()
    }
}

impl<T: PartialEq> PartialEq for Plane<T> {
    fn eq(&self, other: &Self) -> bool {
        self.size() == other.size() && self.as_slice() == other.as_slice()
    }
}

impl<T> std::ops::Index<(usize, usize)> for Plane<T> {
    type Output = T;
    /// The pixel at `(column, row)`.
    #[inline]
    fn index(&self, (x, y): (usize, usize)) -> &T {
        debug_assert!(x < self.width && y < self.height);
        &self.as_slice()[y * self.width + x]
    }
}

impl<T: Clone> std::ops::IndexMut<(usize, usize)> for Plane<T> {
    #[inline]
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        debug_assert!(x < self.width && y < self.height);
        let at = y * self.width + x;
        &mut self.as_mut_slice()[at]
    }
}

/// Linear RGB radiance, with an optional share of each pixel that the object covers.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Linear RGB radiance.
    pub rgb: Plane<Vec3>,
    /// Coverage in 0..=1, of the same size as `rgb`.
    pub alpha: Option<Plane<f32>>,
}

impl Picture {
    /// Returns the alpha channel if it has more than one value: an alpha channel of one value does
    /// not separate an object.
    pub fn varying_alpha(&self) -> Option<&Plane<f32>> {
        self.alpha.as_ref().filter(|alpha| alpha.as_slice().iter().any(|a| *a != alpha.as_slice()[0]))
    }
}

/// Luminance of a linear RGB colour with the primaries of Rec. 709 / sRGB.
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// The sRGB transfer function: linear 0..1 to coded 0..1 (IEC 61966-2-1).
pub fn srgb_encode(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// Inverse of [`srgb_encode`].
pub fn srgb_decode(coded: f32) -> f32 {
    let x = coded.clamp(0.0, 1.0);
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips() {
        for i in 0..=255 {
            let coded = i as f32 / 255.0;
            assert!((srgb_encode(srgb_decode(coded)) - coded).abs() < 1e-5, "{i}");
        }
    }

    #[test]
    fn luminance_of_white_is_one() {
        assert!((luminance(Vec3::ONE) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn planes_index_by_column_then_row() {
        let plane = Plane::from_fn(3, 2, |x, y| 10 * y + x);
        assert_eq!(plane[(2, 1)], 12);
        assert_eq!(plane.as_slice(), [0, 1, 2, 10, 11, 12]);
    }

    #[test]
    fn lent_pixels_are_copied_on_the_first_change() {
        let owner = Arc::new(vec![1, 2, 3, 4]);
        let mut plane = Plane::from_shared(2, 2, owner.clone());
        assert_eq!(plane.as_slice().as_ptr(), owner.as_ptr());
        assert_eq!(plane, Plane::from_vec(2, 2, vec![1, 2, 3, 4]));
        plane[(1, 0)] = 7;
        assert_eq!((plane.into_vec(), &owner[..]), (vec![1, 7, 3, 4], &[1, 2, 3, 4][..]));
    }
}
