//! Spectra of red, green and blue, for spectral renderers.
//!
//! Every colour within sRGB is a mixture of these three. They are non-negative and sum to one.
//! Under D65 they have the colours red, green and blue (`tools/spectral_basis.py`, after Mallett
//! and Yuksel 2019, *Spectral Primary Decomposition for Rendering with sRGB Reflectance*).

/// Wavelengths in nm with the reflectances of the red, green and blue spectra; linear between.
pub(super) const BASIS: [(f32, [f32; 3]); 15] = [
    (380.0, [0.1918, 0.0301, 0.7781]),
    (405.0, [0.1158, 0.0033, 0.8809]),
    (430.0, [0.0388, 0.0005, 0.9608]),
    (455.0, [0.0046, 0.0004, 0.9950]),
    (480.0, [0.0014, 0.2061, 0.7924]),
    (505.0, [0.0001, 0.8917, 0.1082]),
    (530.0, [0.0002, 0.9993, 0.0006]),
    (555.0, [0.0001, 0.9991, 0.0008]),
    (580.0, [0.1149, 0.8339, 0.0513]),
    (605.0, [0.9347, 0.0610, 0.0043]),
    (630.0, [0.9986, 0.0005, 0.0009]),
    (655.0, [0.9948, 0.0017, 0.0035]),
    (680.0, [0.9705, 0.0004, 0.0291]),
    (705.0, [0.9048, 0.0258, 0.0694]),
    (730.0, [0.8313, 0.0727, 0.0960]),
];

/// Returns the reflectance of a colour at an index of [`BASIS`].
pub(super) fn at(place: usize, rgb: [f64; 3]) -> f64 {
    BASIS[place].1.iter().zip(rgb).map(|(share, value)| f64::from(*share) * value).sum()
}
