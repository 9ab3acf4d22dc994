//! Pictures in memory: linear RGB radiance with an optional coverage channel.
//!
//! Row 0 is the top row. Values are linear and on an arbitrary scale; what file they came from, and how they were
//! coded there, is the business of `gonio-io`.

use glam::Vec3;

/// A rectangular array of pixels, row-major, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane<T> {
    width: usize,
    height: usize,
    data: Vec<T>,
}

impl<T> Plane<T> {
    /// Wraps `data`, `width * height` pixels in row-major order.
    ///
    /// # Panics
    /// If the length of `data` is not `width * height`.
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Self {
        assert_eq!(data.len(), width * height, "a plane of {width}x{height} pixels");
        Self { width, height, data }
    }

    /// The plane whose pixel at column `x`, row `y` is `f(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> T) -> Self {
        let data = (0..width * height).map(|i| f(i % width, i / width)).collect();
        Self { width, height, data }
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// All pixels, row-major.
    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    /// All pixels, row-major.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The plane with every pixel mapped by `f`.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Plane<U> {
        Plane { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Plane<T> {
    type Output = T;
    /// The pixel at `(column, row)`.
    fn index(&self, (x, y): (usize, usize)) -> &T {
        debug_assert!(x < self.width && y < self.height);
        &self.data[y * self.width + x]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Plane<T> {
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        debug_assert!(x < self.width && y < self.height);
        &mut self.data[y * self.width + x]
    }
}

/// A picture: linear RGB radiance, and how much of each pixel the object covers where the file says so.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Linear RGB radiance.
    pub rgb: Plane<Vec3>,
    /// Coverage in 0..=1, of the same size as `rgb`.
    pub alpha: Option<Plane<f32>>,
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
}
