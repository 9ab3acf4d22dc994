//! Checks that a JPEG file is complete. Decoders fill missing parts with grey, which must not be
//! used as a photograph.

use std::path::Path;

use crate::Error;

/// Walks the segments up to the end-of-image marker.
pub(super) fn check_complete(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    match end_of_image(bytes) {
        Some(_) => Ok(()),
        None => Err(Error::damaged(path, "is a truncated JPEG file")),
    }
}

/// Returns the position after the end-of-image marker. Thumbnails in the metadata contain markers
/// too, so segments must be skipped by their lengths.
fn end_of_image(bytes: &[u8]) -> Option<usize> {
    const END_OF_IMAGE: u8 = 0xd9;
    let mut at = 2;
    loop {
        // Fill bytes (0xff) may precede a marker.
        while *bytes.get(at)? != 0xff || *bytes.get(at + 1)? == 0xff {
            at += 1;
        }
        let marker = bytes[at + 1];
        at += 2;
        match marker {
            END_OF_IMAGE => return Some(at),
            // Stuffed zeros and restart markers belong to the data of a scan; the others here have
            // no content.
            0x00 | 0x01 | 0xd0..=0xd8 => {}
            _ => {
                let length = usize::from(u16::from_be_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
                at += length.max(2);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_complete_files_pass() {
        // A header segment that contains the bytes of the marker, a scan with a stuffed zero, the
        // end.
        let whole =
            [0xff, 0xd8, 0xff, 0xe1, 0, 4, 0xff, 0xd9, 0xff, 0xda, 0, 3, 9, 1, 0xff, 0, 2, 0xff, 0xd0, 3, 0xff, 0xd9];
        assert_eq!(end_of_image(&whole), Some(whole.len()));
        for cut in 2..whole.len() {
            assert_eq!(end_of_image(&whole[..cut]), None, "{cut}");
        }
    }
}
