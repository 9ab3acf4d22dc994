#![no_main]
//! Camera settings from EXIF data, alone (a TIFF) and in a JPEG. All settings must be positive
//! numbers.

use gonio_io::picture::ExposureSettings;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let mut jpeg = vec![0xff, 0xd8, 0xff, 0xe1];
    jpeg.extend((bytes.len().min(60_000) as u16 + 8).to_be_bytes());
    jpeg.extend(b"Exif\0\0");
    jpeg.extend(bytes);
    jpeg.extend([0xff, 0xd9]);
    for bytes in [bytes, &jpeg] {
        let ExposureSettings { seconds, f_number, iso } = ExposureSettings::of(bytes);
        assert!([seconds, f_number, iso].into_iter().flatten().all(|v| v > 0.0 && v.is_finite()));
    }
});
