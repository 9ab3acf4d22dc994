//! Cameras (`camera.json`) and poses of objects (`pose.json`); `docs/camera.md` describes both.

mod pose;

use std::path::Path;

use gonio::shape::{Camera, CameraError, Projection};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::{Error, guard};

pub use pose::{decode_pose, read_pose};

/// Longest file read: these files are written by hand.
const MAX_BYTES: u64 = 1 << 20;
/// Relative difference of the sides of a pixel above which it is not square.
const SQUARE: f64 = 0.01;

/// Keys of `camera.json`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    projection: Kind,
    focal_pixels: Option<f64>,
    focal_mm: Option<f64>,
    sensor_mm: Option<Sensor>,
    fov_x_degrees: Option<f64>,
    fov_y_degrees: Option<f64>,
    pixels_per_unit: Option<f64>,
    width: Option<f64>,
    height: Option<f64>,
    principal_point: Option<[f64; 2]>,
    size: Option<[usize; 2]>,
    pose: Option<pose::CameraPose>,
}

#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Orthographic,
    Perspective,
}

/// Width of the sensor, or its width and height.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Sensor {
    Width(f64),
    Both([f64; 2]),
}

/// Reads the camera of a photograph of `size`, columns and rows.
///
/// # Errors
/// If the file cannot be read, is not valid JSON, has unknown or incompatible keys, is for images
/// of another size, or does not describe a valid camera.
pub fn read_camera(path: impl AsRef<Path>, size: (usize, usize)) -> Result<Camera, Error> {
    let path = path.as_ref();
    decode_camera(path, &guard::read_whole(path, MAX_BYTES)?, size)
}

/// Decodes a camera held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read_camera`].
pub fn decode_camera(path: &Path, bytes: &[u8], size: (usize, usize)) -> Result<Camera, Error> {
    let file: File = from_json(path, bytes)?;
    if let Some([width, height]) = file.size
        && (width, height) != size
    {
        let problem = format!("is for images of {width}x{height} pixels, but the photograph has {}x{}", size.0, size.1);
        return Err(Error::invalid(path, problem, "use the camera of this image, at the same scale"));
    }
    let projection = match file.projection {
        Kind::Perspective => Projection::Perspective { focal: focal(path, &file, size)? },
        Kind::Orthographic => Projection::Orthographic { pixels_per_unit: scale(path, &file, size)? },
    };
    let centre = (0.5 * size.0 as f64, 0.5 * size.1 as f64);
    let principal = file.principal_point.map_or(centre, |[x, y]| (x, y));
    let explain = |e: CameraError| {
        let text = e.to_string();
        let (problem, advice) = text.rsplit_once("; ").unwrap_or((&text, "correct the value"));
        Error::invalid(path, problem, advice)
    };
    let camera = Camera::new(projection, principal, size).map_err(explain)?;
    match &file.pose {
        Some(pose) => camera.at(pose.to_world(path)?).map_err(explain),
        None => Ok(camera),
    }
}

/// Returns index and value of the only given key among `ways`; none or several are errors.
fn one_of<T: Copy>(path: &Path, what: &str, ways: &[(&str, Option<T>)]) -> Result<(usize, T), Error> {
    let given: Vec<usize> = (0..ways.len()).filter(|&i| ways[i].1.is_some()).collect();
    let names = || ways.iter().map(|w| w.0).collect::<Vec<_>>().join(", ");
    match given.as_slice() {
        &[i] => Ok((i, ways[i].1.expect("the selected key is given"))),
        [] => Err(Error::invalid(path, format!("does not specify the {what}"), format!("specify one of {}", names()))),
        several => {
            let both = several.iter().map(|&i| ways[i].0).collect::<Vec<_>>().join(" and ");
            Err(Error::invalid(path, format!("specifies the {what} more than once, by {both}"), "keep one of them"))
        }
    }
}

/// Rejects keys that are meaningless in addition to `beside`; `keys` pairs each key with whether it
/// is given.
fn foreign(path: &Path, beside: &str, keys: &[(&str, bool)]) -> Result<(), Error> {
    match keys.iter().find(|k| k.1) {
        Some((key, _)) => Err(Error::invalid(path, format!("has {key:?} in addition to {beside}"), "remove it")),
        None => Ok(()),
    }
}

/// Returns the focal length in pixels.
fn focal(path: &Path, file: &File, (width, height): (usize, usize)) -> Result<f64, Error> {
    let keys = [("pixels_per_unit", file.pixels_per_unit), ("width", file.width), ("height", file.height)];
    foreign(path, "a perspective projection", &keys.map(|(key, value)| (key, value.is_some())))?;
    let ways = [
        ("focal_pixels", file.focal_pixels),
        ("focal_mm", file.focal_mm),
        ("fov_x_degrees", file.fov_x_degrees),
        ("fov_y_degrees", file.fov_y_degrees),
    ];
    let (way, value) = one_of(path, "focal length", &ways)?;
    if way != 1 {
        foreign(path, &format!("{:?}", ways[way].0), &[("sensor_mm", file.sensor_mm.is_some())])?;
    }
    let (width, height) = (width as f64, height as f64);
    let of_angle = |side: f64| {
        if value > 0.0 && value < 180.0 {
            return Ok(0.5 * side / (0.5 * value.to_radians()).tan());
        }
        let problem = format!("has {:?} = {value}", ways[way].0);
        Err(Error::invalid(path, problem, "use the full angle in degrees, between 0 and 180"))
    };
    match (way, file.sensor_mm) {
        (0, _) => Ok(value),
        (1, None) => {
            let advice = "add \"sensor_mm\": the width of the sensor area of the image, or its [width, height]";
            Err(Error::invalid(path, "has \"focal_mm\" without \"sensor_mm\"", advice))
        }
        (1, Some(Sensor::Width(sensor))) => positive(path, "sensor_mm", sensor).map(|sensor| value / sensor * width),
        (1, Some(Sensor::Both([w, h]))) => {
            let across = width / positive(path, "sensor_mm", w)?;
            let down = height / positive(path, "sensor_mm", h)?;
            if (across / down - 1.0).abs() > SQUARE {
                let problem = format!(
                    "has a sensor of {w} x {h} mm for an image of {width}x{height} pixels, so that pixels are not \
                     square"
                );
                return Err(Error::invalid(path, problem, "use the sensor area of the image"));
            }
            Ok(value * 0.5 * (across + down))
        }
        (2, _) => of_angle(width),
        _ => of_angle(height),
    }
}

/// Returns the pixels per unit of length.
fn scale(path: &Path, file: &File, (width, height): (usize, usize)) -> Result<f64, Error> {
    let keys = [
        ("focal_pixels", file.focal_pixels.is_some()),
        ("focal_mm", file.focal_mm.is_some()),
        ("sensor_mm", file.sensor_mm.is_some()),
        ("fov_x_degrees", file.fov_x_degrees.is_some()),
        ("fov_y_degrees", file.fov_y_degrees.is_some()),
    ];
    foreign(path, "an orthographic projection", &keys)?;
    let ways = [("pixels_per_unit", file.pixels_per_unit), ("width", file.width), ("height", file.height)];
    Ok(match one_of(path, "scale", &ways)? {
        (0, value) => value,
        (1, value) => width as f64 / positive(path, "width", value)?,
        (_, value) => height as f64 / positive(path, "height", value)?,
    })
}

fn positive(path: &Path, key: &str, value: f64) -> Result<f64, Error> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    Err(Error::invalid(path, format!("has {key:?} = {value}"), "use a positive number"))
}

/// Parses JSON; errors state the line.
fn from_json<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, Error> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    serde_json::from_slice(bytes).map_err(|e| match e.classify() {
        serde_json::error::Category::Data => Error::invalid(path, e.to_string(), "see docs/camera.md"),
        _ => Error::damaged(path, format!("is not valid JSON ({e})")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn read(json: &str) -> Result<Camera, Error> {
        decode_camera(Path::new("camera.json"), json.as_bytes(), (600, 400))
    }

    fn focal(rest: &str) -> f64 {
        match read(&format!(r#"{{"projection": "perspective", {rest}}}"#)).unwrap().projection {
            Projection::Perspective { focal } => focal,
            Projection::Orthographic { .. } => panic!("is orthographic"),
        }
    }

    #[test]
    fn reads_focal_lengths_in_all_units() {
        assert_eq!(focal(r#""focal_pixels": 812.5"#), 812.5);
        assert_eq!(focal(r#""focal_mm": 50, "sensor_mm": 36"#), 50.0 / 36.0 * 600.0);
        assert!((focal(r#""focal_mm": 50, "sensor_mm": [36, 24]"#) - 50.0 / 36.0 * 600.0).abs() < 1e-9);
        assert!((focal(r#""fov_x_degrees": 90"#) - 300.0).abs() < 1e-9);
        assert!((focal(r#""fov_y_degrees": 90"#) - 200.0).abs() < 1e-9);
    }

    #[test]
    fn reads_scale_and_principal_point() {
        for (rest, want) in [(r#""pixels_per_unit": 90"#, 90.0), (r#""height": 8"#, 50.0), (r#""width": 8"#, 75.0)] {
            let camera = read(&format!(r#"{{"projection": "orthographic", "size": [600, 400], {rest}}}"#)).unwrap();
            assert_eq!(camera.projection, Projection::Orthographic { pixels_per_unit: want });
            assert_eq!((camera.principal, camera.size), ((300.0, 200.0), (600, 400)));
            assert_eq!(camera.to_world, glam::DMat4::IDENTITY);
        }
        let camera = read(r#"{"projection": "perspective", "focal_pixels": 9, "principal_point": [10.5, -3]}"#);
        assert_eq!(camera.unwrap().principal, (10.5, -3.0));
    }

    #[test]
    fn all_forms_of_a_pose_are_equivalent() {
        let seen = |pose: &str, place: DVec3| {
            let json = format!(r#"{{"projection": "perspective", "focal_pixels": 100, "pose": {pose}}}"#);
            let camera = read(&json).unwrap();
            camera.project(camera.to_world.inverse().transform_point3(place)).unwrap()
        };
        // The same camera in five forms: at (0, 0, 10), with +x to the right and +y at the top.
        for pose in [
            r#"{"position": [0, 0, 10], "look_at": [0, 0, 0]}"#,
            r#"{"position": [0, 0, 10], "look_at": [0, 0, 3], "up": [0, 2, 0.5]}"#,
            r#"{"camera_to_world": [[1,0,0,0],[0,1,0,0],[0,0,1,10],[0,0,0,1]]}"#,
            r#"{"camera_to_world": [[1,0,0,0],[0,-1,0,0],[0,0,-1,10]], "convention": "opencv"}"#,
            r#"{"world_to_camera": [[1,0,0,0],[0,-1,0,0],[0,0,-1,10],[0,0,0,1]], "convention": "opencv"}"#,
        ] {
            let (x, y) = seen(pose, DVec3::new(1.0, 2.0, 0.0));
            assert!((x - 310.0).abs() < 1e-9 && (y - 180.0).abs() < 1e-9, "{pose}: {x} {y}");
        }
    }

    #[test]
    fn errors_name_the_key() {
        let perspective = |rest: &str| format!(r#"{{"projection": "perspective", {rest}}}"#);
        for (json, message) in [
            (perspective(r#""focal": 50"#), "unknown field `focal`, expected one of `projection`, `focal_pixels`"),
            (
                perspective(r#""size": [600, 400]"#),
                "does not specify the focal length; specify one of focal_pixels, focal_mm",
            ),
            (perspective(r#""focal_pixels": 5, "fov_x_degrees": 4"#), "by focal_pixels and fov_x_degrees; keep one"),
            (perspective(r#""focal_mm": 50"#), "without \"sensor_mm\"; add"),
            (perspective(r#""focal_pixels": 5, "sensor_mm": 36"#), "\"sensor_mm\" in addition to \"focal_pixels\""),
            (perspective(r#""focal_mm": 50, "sensor_mm": [36, 36]"#), "so that pixels are not square"),
            (perspective(r#""focal_mm": 50, "sensor_mm": 0"#), "\"sensor_mm\" = 0; use a positive number"),
            (perspective(r#""focal_pixels": -5"#), "the focal length is -5; use a positive"),
            (perspective(r#""fov_x_degrees": 180"#), "between 0 and 180"),
            (
                perspective(r#""focal_pixels": 5, "height": 4"#),
                "has \"height\" in addition to a perspective projection; remove it",
            ),
            (
                perspective(r#""focal_pixels": 5, "size": [60, 40]"#),
                "for images of 60x40 pixels, but the photograph has 600x400",
            ),
            (perspective(r#""focal_pixels": 5, "principal_point": [1e300, 0]"#), "is invalid; use finite"),
            (perspective(r#""focal_pixels": 5, "size": [-1, 40]"#), "invalid value"),
            (
                r#"{"projection": "fisheye"}"#.into(),
                "unknown variant `fisheye`, expected `orthographic` or `perspective`",
            ),
            (r#"{"focal_pixels": 3}"#.into(), "missing field `projection`"),
            (
                r#"{"projection": "orthographic", "focal_mm": 4}"#.into(),
                "\"focal_mm\" in addition to an orthographic projection; remove it",
            ),
            (
                r#"{"projection": "orthographic"}"#.into(),
                "does not specify the scale; specify one of pixels_per_unit, width, height",
            ),
            (r#"{"projection": "#.into(), "is not valid JSON"),
            (r#"[1]"#.into(), "camera.json: "),
        ] {
            let error = read(&json).unwrap_err().to_string();
            assert!(error.contains(message) && error.starts_with("camera.json: "), "{json}: {error}");
        }
    }

    #[test]
    fn invalid_poses_are_rejected() {
        for (pose, message) in [
            (r#"{}"#, "does not specify the pose; specify one of camera_to_world, world_to_camera, position"),
            (r#"{"position": [0, 0, 1]}"#, "without \"look_at\""),
            (r#"{"look_at": [0, 0, 1]}"#, "does not specify the pose"),
            (r#"{"position": [0, 0, 1], "look_at": [0, 0, 1]}"#, "\"look_at\" at the position of the camera"),
            (r#"{"position": [0, 5, 0], "look_at": [0, 0, 0]}"#, "an invalid \"up\""),
            (
                r#"{"position": [0, 5, 0], "look_at": [0, 0, 0], "convention": "opencv"}"#,
                "\"convention\" without a matrix",
            ),
            (
                r#"{"camera_to_world": [[1,0,0,0],[0,1,0,0],[0,0,1,0]], "up": [0, 1, 0]}"#,
                "\"up\" in addition to a matrix; remove it",
            ),
            (r#"{"position": [0, 5, 0], "from": 1}"#, "unknown field `from`"),
            (r#"{"camera_to_world": [[1,0,0,0],[0,1,0,0]]}"#, "2 rows"),
            (r#"{"camera_to_world": [[1,0,0],[0,1,0],[0,0,1]]}"#, "invalid length 3"),
            (r#"{"camera_to_world": [[2,0,0,0],[0,2,0,0],[0,0,2,0]]}"#, "remove scaling"),
            (r#"{"camera_to_world": [[1,0,0,0],[0,1,0,0],[0,0,-1,0]]}"#, "mirroring"),
            (r#"{"camera_to_world": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[5,5,5,1]]}"#, "row-major"),
            (r#"{"world_to_camera": [[0,0,0,0],[0,1,0,0],[0,0,1,0]]}"#, "a singular matrix"),
            (
                r#"{"position": [0, 5, 0], "look_at": [0, 0, 0], "camera_to_world": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}"#,
                "more than once",
            ),
        ] {
            let json = format!(r#"{{"projection": "perspective", "focal_pixels": 5, "pose": {pose}}}"#);
            let error = read(&json).unwrap_err().to_string();
            assert!(error.contains(message), "{pose}: {error}");
        }
    }
}
