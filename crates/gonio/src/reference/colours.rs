//! Published colours of the ColorChecker Classic.

use glam::{DMat3, DVec3};

/// Number of columns of the chart, in its upright position.
pub(super) const COLUMNS: usize = 6;
/// Number of rows of the chart.
pub(super) const ROWS: usize = 4;
/// Number of patches.
pub(super) const PATCHES: usize = COLUMNS * ROWS;
/// Index of the first neutral patch, white; the five greys follow.
pub(super) const FIRST_NEUTRAL: usize = 18;

/// CIE L*a*b* of the patches under D50, row by row from the top left. The last row is neutral, from
/// white to black.
///
/// These are the values of X-Rite for charts made from 2005 to October 2014. Newer charts differ by
/// 1.4 in L* for white, by 0.5 on average.
const LAB: [[f64; 3]; PATCHES] = [
    [37.986, 13.555, 14.059],
    [65.711, 18.130, 17.810],
    [49.927, -4.880, -21.925],
    [43.139, -13.095, 21.905],
    [55.112, 8.844, -25.399],
    [70.719, -33.397, -0.199],
    [62.661, 36.067, 57.096],
    [40.020, 10.410, -45.964],
    [51.124, 48.239, 16.248],
    [30.325, 22.976, -21.587],
    [72.532, -23.709, 57.255],
    [71.941, 19.363, 67.857],
    [28.778, 14.179, -50.297],
    [55.261, -38.342, 31.370],
    [42.101, 53.378, 28.190],
    [81.733, 4.039, 79.819],
    [51.935, 49.986, -14.574],
    [51.038, -28.631, -28.638],
    [96.539, -0.425, 1.186],
    [81.257, -0.638, -0.335],
    [66.766, -0.734, -0.504],
    [50.867, -0.153, -0.270],
    [35.656, -0.421, -1.231],
    [20.461, -0.079, -0.973],
];

/// Returns the reflectance of the patches as linear RGB (Rec. 709), row by row.
///
/// Reflectance is the radiance under a white light relative to that of a perfect white surface. The
/// neutral patches reflect 0.91, 0.59, 0.36, 0.19, 0.09 and 0.03. A channel of a colour outside the
/// gamut is negative.
pub fn patch_colours() -> [DVec3; PATCHES] {
    LAB.map(|[l, a, b]| {
        let y = (l + 16.0) / 116.0;
        let xyz = DVec3::new(y + a / 500.0, y, y - b / 200.0)
            .to_array()
            .map(|f| if f > 6.0 / 29.0 { f.powi(3) } else { 3.0 * (6.0_f64 / 29.0).powi(2) * (f - 4.0 / 29.0) });
        rgb_of_d50() * (DVec3::from_array(xyz) * D50)
    })
}

/// White point D50.
const D50: DVec3 = DVec3::new(0.964_22, 1.0, 0.825_21);

/// Returns the matrix from XYZ under D50 to linear RGB (Rec. 709), with Bradford adaptation.
fn rgb_of_d50() -> DMat3 {
    DMat3::from_cols_array_2d(&[
        [3.133_856_1, -0.978_768_4, 0.071_945_3],
        [-1.616_866_7, 1.916_141_5, -0.228_991_4],
        [-0.490_614_6, 0.033_454_0, 1.405_242_7],
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::srgb_encode;

    #[test]
    fn colours_match_the_published_srgb_codes() {
        // Codes published by BabelColor for the same chart, rounded and clipped to the gamut.
        let published = [
            (0, [115, 81, 67]),
            (6, [224, 124, 47]),
            (12, [35, 63, 147]),
            (13, [67, 149, 74]),
            (14, [180, 49, 57]),
            (15, [238, 198, 20]),
            (18, [245, 245, 243]),
            (21, [122, 122, 121]),
            (23, [50, 50, 50]),
        ];
        let colours = patch_colours();
        for (patch, want) in published {
            let got = colours[patch].as_vec3().to_array().map(|v| 255.0 * srgb_encode(v));
            let off = got.iter().zip(want).map(|(got, want)| (got - want as f32).abs()).fold(0.0, f32::max);
            assert!(off < 4.0, "{patch}: {got:?} {want:?}");
        }
    }

    #[test]
    fn neutral_patches_have_the_known_reflectances() {
        let colours = patch_colours();
        for (at, want) in [0.91, 0.59, 0.36, 0.19, 0.09, 0.031].into_iter().enumerate() {
            let colour = colours[FIRST_NEUTRAL + at];
            assert!((colour.y / want - 1.0).abs() < 0.03, "{colour} {want}");
            assert!((colour.x / colour.y).ln().abs() < 0.06 && (colour.z / colour.y).ln().abs() < 0.06, "{colour}");
        }
    }
}
