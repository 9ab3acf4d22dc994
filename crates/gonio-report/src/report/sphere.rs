//! Data of the interactive sphere: materials and lights, in the form that `viewer/viewer.js` takes.

use glam::Vec3;
use gonio::lighting::LightGrid;
use gonio::picture::Plane;
use gonio::reflectance::{BivariateTable, CELLS};
use serde_json::{Value, json};

use super::packed::packed;
use crate::panels::{Subject, builtin_lights};

/// Rows of the lights. More rows would hardly change the sphere, but enlarge the page.
const ROWS: usize = 64;

/// Returns the data of the viewer as JSON that can be embedded in HTML.
pub(super) fn data(subject: &Subject<'_>) -> String {
    let mut materials = vec![material("estimate", &subject.coloured(subject.table))];
    if let Some(found) = subject.material {
        let names = ["dull end (5 %)", "glossy end (95 %)"];
        materials.extend(
            names.into_iter().zip(&found.ends.tables).map(|(name, end)| material(name, &subject.coloured(end))),
        );
    }
    let mut lights: Vec<Value> = builtin_lights(ROWS).iter().map(|(name, map)| light(name, map.radiance())).collect();
    let seen = match (subject.light, subject.known_light) {
        (Some(grid), _) => Some(("estimated light", lit(grid))),
        (None, Some(map)) => Some(("known light", shrunk(map.radiance()))),
        (None, None) => None,
    };
    lights.extend(seen.map(|(name, map)| light(name, &map)));
    // A closing tag within a name would end the script.
    json!({ "materials": materials, "lights": lights }).to_string().replace('<', "\\u003c")
}

/// Encodes a material from linear RGB tables.
pub fn material(name: &str, tables: &[BivariateTable; 3]) -> Value {
    let values = (0..CELLS).flat_map(|c| [0, 1, 2].map(|channel| tables[channel].as_slice()[c]));
    named(name, packed(values))
}

/// Encodes a light from a lat-long map in linear RGB.
pub fn light(name: &str, map: &Plane<Vec3>) -> Value {
    let mut light = named(name, packed(map.as_slice().iter().flat_map(|p| p.to_array())));
    light["width"] = json!(map.width());
    light["height"] = json!(map.height());
    light
}

fn named(name: &str, mut value: Value) -> Value {
    value["name"] = json!(name);
    value
}

/// Returns the estimated light as a map for the viewer.
pub fn lit(grid: &LightGrid) -> Plane<Vec3> {
    grid.to_lat_long(ROWS).map(|p| p.max(Vec3::ZERO))
}

/// Reduces a large map to the number of rows of the other lights.
fn shrunk(map: &Plane<Vec3>) -> Plane<Vec3> {
    if map.height() <= 2 * ROWS { map.clone() } else { crate::panels::resize(map, 2 * ROWS, ROWS) }
}
