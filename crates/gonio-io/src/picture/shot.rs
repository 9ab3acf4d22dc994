//! Camera settings of a photograph, from its EXIF data.

use std::io::Cursor;

use exif::{Context, In, Reader, Tag, Value};

/// Camera settings that determine the brightness of a picture; `None` where the file does not give
/// one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shot {
    /// Exposure time, seconds; positive.
    pub seconds: Option<f64>,
    /// Focal length over the diameter of the aperture; positive.
    pub f_number: Option<f64>,
    /// Sensitivity, ISO 12232; positive.
    pub iso: Option<f64>,
}

impl Shot {
    /// Reads the EXIF data of a JPEG, PNG or TIFF file; all settings are `None` where they are
    /// missing or cannot be read.
    pub fn of(bytes: &[u8]) -> Self {
        // The parser is a third party's: whatever it makes of a damaged file must not stop the
        // picture from being read.
        let parse = || {
            let read = Reader::new().continue_on_error(true).read_from_container(&mut Cursor::new(bytes));
            // Some cameras leave out the pointer to a next directory, which nothing here needs.
            read.or_else(|error| error.distill_partial_result(|_| ())).ok()
        };
        let Some(exif) = std::panic::catch_unwind(parse).ok().flatten() else { return Self::default() };
        let number = |tag: Tag| -> Option<f64> {
            // Some programs write these tags beside those of the picture instead of in the EXIF
            // directory.
            let beside = || exif.get_field(Tag(Context::Tiff, tag.number()), In::PRIMARY);
            let value = match &exif.get_field(tag, In::PRIMARY).or_else(beside)?.value {
                Value::Rational(v) => v.first()?.to_f64(),
                Value::SRational(v) => v.first()?.to_f64(),
                Value::Short(v) => f64::from(*v.first()?),
                Value::Long(v) => f64::from(*v.first()?),
                _ => return None,
            };
            value.is_finite().then_some(value)
        };
        let positive = |tag: Tag| number(tag).filter(|v| *v > 0.0);
        // APEX values: a time of 2^-v seconds, an f-number of 2^(v/2).
        let apex = |tag: Tag, scale: f64| number(tag).map(|v| (scale * v).exp2()).filter(|v| (1e-9..1e9).contains(v));
        Self {
            seconds: positive(Tag::ExposureTime).or_else(|| apex(Tag::ShutterSpeedValue, -1.0)),
            f_number: positive(Tag::FNumber).or_else(|| apex(Tag::ApertureValue, 0.5)),
            iso: positive(Tag::PhotographicSensitivity).or_else(|| positive(Tag::ISOSpeed)),
        }
    }
}
