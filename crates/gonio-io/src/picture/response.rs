//! Response curves as comma-separated text.
//!
//! Each code has a line with the natural logarithms of its exposures in red, green and blue.
//!
//! ```text
//! code,red,green,blue
//! 0,-9.1,-9.1,-9.0
//! 1,-7.7,-7.7,-7.6
//! ...
//! 255,0.83,0.82,0.85
//! ```
//!
//! Codes count from 0 in steps of one, usually to 255 or 65535; for pictures of another bit depth,
//! the curve is resampled to their codes. Lines that begin with `#`, the header and empty lines are
//! skipped. A single column instead of three applies to all channels.

use std::fmt::Write;
use std::path::Path;

use gonio::bracket::Response;

use crate::{Error, guard};

/// Longest file in bytes, larger than 65536 lines of three numbers.
const MAX_BYTES: u64 = 1 << 24;

/// Reads a response curve.
///
/// The text has a line `code,red,green,blue` or `code,all` for each code from 0, with the natural
/// logarithms of its exposures. For pictures of another bit depth, the curve is resampled to their
/// codes. Lines that begin with `#` or `code` and empty lines are skipped.
///
/// # Errors
/// If the file cannot be read, a line has another form, or a curve decreases or is flat.
pub fn read_response(path: impl AsRef<Path>) -> Result<Response, Error> {
    let path = path.as_ref();
    decode_response(path, &guard::read_whole(path, MAX_BYTES)?)
}

/// Decodes a response curve held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read_response`].
pub fn decode_response(path: &Path, bytes: &[u8]) -> Result<Response, Error> {
    let advice = "use lines of code,red,green,blue, with codes from 0 and log exposures";
    let text = std::str::from_utf8(bytes).map_err(|_| Error::invalid(path, "is not text", advice))?;
    let mut curves = [const { Vec::new() }; 3];
    let lines = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim()));
    for (number, line) in lines.filter(|(_, l)| !(l.is_empty() || l.starts_with('#') || l.starts_with("code"))) {
        let wrong = || Error::invalid(path, format!("has an invalid line {number}"), advice);
        let fields: Vec<f64> =
            line.split(',').map(|f| f.trim().parse()).collect::<Result<_, _>>().map_err(|_| wrong())?;
        let (&code, values) = fields.split_first().ok_or_else(wrong)?;
        if code != curves[0].len() as f64 || code > f64::from(u16::MAX) {
            return Err(Error::invalid(path, format!("has code {code} out of order in line {number}"), advice));
        }
        let values = match *values {
            [all] => [all; 3],
            [red, green, blue] => [red, green, blue],
            _ => return Err(wrong()),
        };
        curves.iter_mut().zip(values).for_each(|(curve, value)| curve.push(value));
    }
    Response::from_curves(curves).map_err(|e| Error::invalid(path, format!("is not a response curve: {e}"), advice))
}

/// Encodes a response as text that [`read_response`] reads.
pub fn encode_response(response: &Response) -> Vec<u8> {
    let mut text = String::from("# response of a camera: natural logarithm of the exposure of each code\n");
    text.push_str("code,red,green,blue\n");
    let [red, green, blue] = [0, 1, 2].map(|channel| response.curve(channel));
    for (code, ((r, g), b)) in red.iter().zip(green).zip(blue).enumerate() {
        // Nine digits exceed the precision of any camera.
        writeln!(text, "{code},{r:.9},{g:.9},{b:.9}").expect("writing to a String cannot fail");
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Response, String> {
        decode_response(Path::new("r.csv"), text.as_bytes()).map_err(|e| e.to_string())
    }

    #[test]
    fn responses_round_trip() {
        let srgb = Response::srgb(255);
        let back = decode_response(Path::new("r"), &encode_response(&srgb)).unwrap();
        assert!((0..256).all(|k| (back.curve(1)[k] - srgb.curve(1)[k]).abs() < 1e-8));
        let one = read("code,all\n0,-3\n1, -1\n\n# end\n2,0").unwrap();
        assert_eq!((one.max(), one.curve(2)), (2, &[-3.0, -1.0, 0.0][..]));
    }

    #[test]
    fn errors_of_invalid_responses_name_the_line() {
        for (text, message) in [
            ("", "does not have 2 to 65536 codes"),
            ("0,1\n1,0", "falls"),
            ("0,1\n1,1", "is flat"),
            ("0,nan\n1,1", "not log exposures"),
            ("0,1\n2,2", "code 2 out of order in line 2"),
            ("0,1,2\n", "line 1"),
            ("0,1,2,x\n", "line 1"),
            ("hello\n", "line 1"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.starts_with("r.csv: ") && error.contains(message), "{text:?}: {error}");
        }
        assert!(decode_response(Path::new("r"), &[0xff, 0xfe, 0]).is_err());
    }
}
