//! Camera settings of a photograph, from its EXIF data.

use std::io::Cursor;

use exif::{Context, In, Reader, Tag, Value};

/// Camera settings that determine the brightness of a picture; `None` if the file does not state
/// them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExposureSettings {
    /// Exposure time, seconds; positive.
    pub seconds: Option<f64>,
    /// Focal length over the diameter of the aperture; positive.
    pub f_number: Option<f64>,
    /// Sensitivity, ISO 12232; positive.
    pub iso: Option<f64>,
}

impl ExposureSettings {
    /// Reads the EXIF data of a JPEG, PNG or TIFF file. Missing and unreadable settings are `None`.
    pub fn of(bytes: &[u8]) -> Self {
        // A panic of the third-party parser on damaged data must not prevent reading the picture.
        let parse = || {
            let read = Reader::new().continue_on_error(true).read_from_container(&mut Cursor::new(bytes));
            // Some cameras omit the pointer to the next directory, which is not needed here.
            read.or_else(|error| error.distill_partial_result(|_| ())).ok()
        };
        let Some(exif) = std::panic::catch_unwind(parse).ok().flatten() else { return Self::default() };
        let number = |tag: Tag| -> Option<f64> {
            // Some programs write these tags among those of the picture instead of in the EXIF
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
