//! Poses, as matrices or as translation, rotation and scale.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3, DVec4, EulerRot};
use serde::Deserialize;

use super::{MAX_BYTES, foreign, from_json, one_of};
use crate::{Error, guard};

/// Rows of a matrix, three or four.
type Rows = Vec<[f64; 4]>;

/// Value of `pose` in `camera.json`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraPose {
    camera_to_world: Option<Rows>,
    world_to_camera: Option<Rows>,
    position: Option<[f64; 3]>,
    look_at: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    convention: Option<Convention>,
}

/// Axis convention of a camera matrix.
#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Convention {
    /// x right, y up, looks along -z.
    Opengl,
    /// x right, y down, looks along +z.
    Opencv,
}

impl CameraPose {
    /// Returns the transformation from the camera, with y up and looking along -z, to the world.
    pub(super) fn to_world(&self, path: &Path) -> Result<DMat4, Error> {
        let ways = [
            ("camera_to_world", self.camera_to_world.as_ref().map(|_| ())),
            ("world_to_camera", self.world_to_camera.as_ref().map(|_| ())),
            ("position", self.position.map(|_| ())),
        ];
        let (way, ()) = one_of(path, "pose", &ways)?;
        if way == 2 {
            return self.looking(path);
        }
        foreign(path, "a matrix", &[("look_at", self.look_at.is_some()), ("up", self.up.is_some())])?;
        let rows = self.camera_to_world.as_ref().or(self.world_to_camera.as_ref());
        let matrix = matrix(path, rows.map_or(&[], Vec::as_slice))?;
        let to_world = if way == 0 { matrix } else { inverse(path, matrix)? };
        let flip = match self.convention {
            Some(Convention::Opencv) => DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0)),
            Some(Convention::Opengl) | None => DMat4::IDENTITY,
        };
        Ok(to_world * flip)
    }

    /// Builds the pose from `position`, `look_at` and `up`.
    fn looking(&self, path: &Path) -> Result<DMat4, Error> {
        if self.convention.is_some() {
            return Err(Error::invalid(path, "has \"convention\" without a matrix", "remove it"));
        }
        let Some(at) = self.look_at else {
            return Err(Error::invalid(
                path,
                "has \"position\" without \"look_at\"",
                "add \"look_at\": the target point",
            ));
        };
        let position = DVec3::from_array(self.position.unwrap_or_default());
        let up = self.up.map_or(DVec3::Y, DVec3::from_array);
        let Some(backward) = (position - DVec3::from_array(at)).try_normalize() else {
            return Err(Error::invalid(path, "has \"look_at\" at the position of the camera", "move \"look_at\""));
        };
        let right = up.try_normalize().map(|up| up.cross(backward)).filter(|r| r.length() > 1e-6);
        let Some(right) = right.and_then(DVec3::try_normalize) else {
            let problem = "has an invalid \"up\": zero or parallel to the viewing direction";
            return Err(Error::invalid(path, problem, "use another up direction"));
        };
        let column = |v: DVec3| v.extend(0.0);
        Ok(DMat4::from_cols(column(right), column(backward.cross(right)), column(backward), position.extend(1.0)))
    }
}

fn matrix(path: &Path, rows: &[[f64; 4]]) -> Result<DMat4, Error> {
    let last = DVec4::W.to_array();
    let (&[a, b, c] | &[a, b, c, _]) = rows else {
        return Err(Error::invalid(
            path,
            format!("has a matrix of {} rows", rows.len()),
            "use four rows of four numbers",
        ));
    };
    if let Some(row) = rows.get(3)
        && row.iter().zip(last).any(|(v, w)| (v - w).abs() > 1e-6)
    {
        let problem = format!("has a matrix whose last row is {row:?}");
        return Err(Error::invalid(
            path,
            problem,
            "use row-major order, with the translation in the last column and 0 0 0 1 in the last row",
        ));
    }
    Ok(DMat4::from_cols_array_2d(&[a, b, c, last]).transpose())
}

fn inverse(path: &Path, matrix: DMat4) -> Result<DMat4, Error> {
    let inverse = matrix.inverse();
    if matrix.determinant() != 0.0 && inverse.is_finite() {
        return Ok(inverse);
    }
    Err(Error::invalid(path, "has a singular matrix", "use a rotation and a translation"))
}

/// Keys of `pose.json`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    matrix: Option<Rows>,
    translation: Option<[f64; 3]>,
    rotation_degrees: Option<[f64; 3]>,
    quaternion_wxyz: Option<[f64; 4]>,
    quaternion_xyzw: Option<[f64; 4]>,
    scale: Option<Scale>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Scale {
    Even(f64),
    Axes([f64; 3]),
}

/// Reads the pose of an object: the matrix from object to world coordinates. It may scale and
/// mirror.
///
/// # Errors
/// If the file cannot be read, is not valid JSON, has unknown or incompatible keys, or flattens the
/// object.
pub fn read_pose(path: impl AsRef<Path>) -> Result<DMat4, Error> {
    let path = path.as_ref();
    decode_pose(path, &guard::read_whole(path, MAX_BYTES)?)
}

/// Decodes a pose held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read_pose`].
pub fn decode_pose(path: &Path, bytes: &[u8]) -> Result<DMat4, Error> {
    let file: File = from_json(path, bytes)?;
    let pose = match &file.matrix {
        Some(rows) => {
            let others = [
                ("translation", file.translation.is_some()),
                ("rotation_degrees", file.rotation_degrees.is_some()),
                ("quaternion_wxyz", file.quaternion_wxyz.is_some()),
                ("quaternion_xyzw", file.quaternion_xyzw.is_some()),
                ("scale", file.scale.is_some()),
            ];
            foreign(path, "a matrix", &others)?;
            matrix(path, rows)?
        }
        None => parts(path, &file)?,
    };
    let determinant = pose.determinant();
    if !pose.is_finite() || determinant == 0.0 || !pose.inverse().is_finite() {
        return Err(Error::invalid(path, "flattens the object or is not finite", "use a nonzero scale"));
    }
    Ok(pose)
}

/// Builds the pose from scale, rotation and translation, applied in this order.
fn parts(path: &Path, file: &File) -> Result<DMat4, Error> {
    let euler = |[x, y, z]: [f64; 3]| {
        // Rotates about x first, then y, then z, each about the axes of the world.
        DQuat::from_euler(EulerRot::ZYX, z.to_radians(), y.to_radians(), x.to_radians())
    };
    let ways = [
        ("rotation_degrees", file.rotation_degrees.map(euler)),
        ("quaternion_wxyz", file.quaternion_wxyz.map(|[w, x, y, z]| DQuat::from_xyzw(x, y, z, w))),
        ("quaternion_xyzw", file.quaternion_xyzw.map(DQuat::from_array)),
    ];
    let rotation = if ways.iter().any(|w| w.1.is_some()) {
        let (way, rotation) = one_of(path, "rotation", &ways)?;
        let length = rotation.length();
        let unit = (length - 1.0).abs() < 0.01;
        if !unit {
            let problem = format!("has {:?} with length {length}", ways[way].0);
            return Err(Error::invalid(path, problem, "use a unit quaternion with finite numbers"));
        }
        rotation.normalize()
    } else {
        DQuat::IDENTITY
    };
    let scale = match file.scale {
        None => DVec3::ONE,
        Some(Scale::Even(scale)) => DVec3::splat(scale),
        Some(Scale::Axes(scale)) => DVec3::from_array(scale),
    };
    Ok(DMat4::from_scale_rotation_translation(scale, rotation, DVec3::from_array(file.translation.unwrap_or_default())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Result<DMat4, Error> {
        decode_pose(Path::new("pose.json"), json.as_bytes())
    }

    #[test]
    fn all_forms_of_a_pose_are_equivalent() {
        // Scaled by two, turned by a quarter about z, moved along x.
        let half = 0.5_f64.sqrt();
        for json in [
            r#"{"matrix": [[0, -2, 0, 5], [2, 0, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]}"#.to_owned(),
            r#"{"translation": [5, 0, 0], "rotation_degrees": [0, 0, 90], "scale": 2}"#.to_owned(),
            format!(r#"{{"translation": [5, 0, 0], "quaternion_wxyz": [{half}, 0, 0, {half}], "scale": [2, 2, 2]}}"#),
            format!(r#"{{"translation": [5, 0, 0], "quaternion_xyzw": [0, 0, {half}, {half}], "scale": 2}}"#),
        ] {
            let moved = read(&json).unwrap().transform_point3(DVec3::new(1.0, 2.0, 3.0));
            assert!((moved - DVec3::new(1.0, 2.0, 6.0)).length() < 1e-12, "{json} {moved}");
        }
        assert_eq!(read("{}").unwrap(), DMat4::IDENTITY);
        // About x, then about z.
        let turned = read(r#"{"rotation_degrees": [90, 0, 90]}"#).unwrap().transform_point3(DVec3::Z);
        assert!((turned - DVec3::X).length() < 1e-12, "{turned}");
    }

    #[test]
    fn errors_name_the_key() {
        for (json, message) in [
            (r#"{"rotation": [1, 2, 3]}"#, "unknown field `rotation`, expected one of `matrix`"),
            (
                r#"{"matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]], "scale": 2}"#,
                "\"scale\" in addition to a matrix; remove it",
            ),
            (r#"{"quaternion_wxyz": [1, 1, 0, 0]}"#, "with length 1.4"),
            (r#"{"quaternion_wxyz": [1, 0, 0, 0], "rotation_degrees": [0, 0, 0]}"#, "more than once"),
            (r#"{"scale": 0}"#, "flattens the object"),
            (r#"{"scale": [1, 2]}"#, "pose.json: "),
            (r#"{"translation": [1, 2, 1e999]}"#, "pose.json: "),
            (r#"{"matrix": [[1,0,0,0],[0,0,0,0],[0,0,1,0]]}"#, "flattens"),
            (r#"{"matrix": []}"#, "0 rows"),
        ] {
            let error = read(json).unwrap_err().to_string();
            assert!(error.contains(message), "{json}: {error}");
        }
    }
}
