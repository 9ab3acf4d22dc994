//! Lists of directional lights.
//!
//! A text file has a line `x y z r g b` for each light: the direction towards the light in camera
//! space, and its irradiance. Lines that begin with `#` are comments.

use std::path::Path;

use glam::{DVec3, Vec3};

use crate::Error;
use crate::guard::read_whole;

/// Largest file, in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Reads a list of lights: unit directions with their irradiance.
///
/// # Errors
/// If the file cannot be read, a line does not hold six numbers, or there are no lights.
pub fn read_lights(path: impl AsRef<Path>) -> Result<Vec<(DVec3, Vec3)>, Error> {
    let path = path.as_ref();
    let bytes = read_whole(path, MAX_BYTES)?;
    decode_lights(path, &bytes)
}

/// Decodes a list of lights. `path` is only used in error messages.
///
/// # Errors
/// Errors of [`read_lights`].
pub fn decode_lights(path: &Path, bytes: &[u8]) -> Result<Vec<(DVec3, Vec3)>, Error> {
    let text = std::str::from_utf8(bytes).map_err(|_| Error::damaged(path, "is not text"))?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let light = |(at, line): (usize, &str)| {
        light(line).ok_or_else(|| {
            let advice = "write x y z r g b: a direction and a non-negative irradiance";
            Error::invalid(path, format!("line {} is not a directional light", at + 1), advice)
        })
    };
    let lights = lines.map(light).collect::<Result<Vec<_>, Error>>()?;
    if lights.is_empty() {
        return Err(Error::invalid(path, "contains no lights", "write one directional light per line"));
    }
    Ok(lights)
}

fn light(line: &str) -> Option<(DVec3, Vec3)> {
    let numbers: Vec<f64> = line.split_whitespace().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let [x, y, z, r, g, b] = numbers[..] else { return None };
    let direction = DVec3::new(x, y, z).try_normalize()?;
    let irradiance = DVec3::new(r, g, b).as_vec3();
    (irradiance.is_finite() && irradiance.min_element() >= 0.0).then_some((direction, irradiance))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_directions_with_irradiance() {
        let text = b"# lights\n0 3 4  1 0.5 0.25\n\n-1 0 0 0 0 1\n";
        let lights = decode_lights(Path::new("lights.txt"), text).unwrap();
        let [(first, warm), (second, blue)] = lights[..] else { panic!("{lights:?}") };
        assert!((first - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-12 && warm == Vec3::new(1.0, 0.5, 0.25));
        assert!((second - DVec3::NEG_X).length() < 1e-12 && blue == Vec3::Z);
    }

    #[test]
    fn errors_name_the_line() {
        for bad in ["1 2 3", "0 0 0 1 1 1", "0 0 1 -1 1 1", "0 0 1 nan 1 1", "a b c d e f"] {
            let text = format!("0 0 1 1 1 1\n{bad}\n");
            let error = decode_lights(Path::new("lights.txt"), text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains("lights.txt") && error.contains("line 2"), "{error}");
        }
        assert!(decode_lights(Path::new("lights.txt"), b"# none\n").is_err());
        assert!(decode_lights(Path::new("lights.txt"), &[0xff, 0xfe]).is_err());
    }
}
