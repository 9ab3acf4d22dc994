//! Tables and lights as the viewer of `gonio-report` takes them: logarithms in sixteen bits.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use serde_json::{Value, json};

/// The largest code; zero stands for zero.
const LARGEST: f64 = 65_535.0;

/// A material for the viewer, its tables linear RGB.
pub fn material(name: &str, tables: &[BivariateTable; 3]) -> Value {
    let [r, g, b] = tables.each_ref().map(BivariateTable::as_slice);
    let values: Vec<f32> = r.iter().zip(g).zip(b).flat_map(|((r, g), b)| [*r, *g, *b]).collect();
    named(name, pack(&values))
}

/// A lat-long light for the viewer.
pub fn light(name: &str, radiance: &Plane<Vec3>) -> Value {
    let values: Vec<f32> = radiance.as_slice().iter().flat_map(Vec3::to_array).collect();
    let mut packed = named(name, pack(&values));
    packed["width"] = json!(radiance.width());
    packed["height"] = json!(radiance.height());
    packed
}

fn named(name: &str, mut packed: Value) -> Value {
    packed["name"] = json!(name);
    packed
}

/// `low`, `high` and codes in base64: code `c` stands for two to the power of `low + (high - low) (c - 1) / 65534`.
fn pack(values: &[f32]) -> Value {
    let logs = || values.iter().filter(|v| **v > 0.0).map(|v| f64::from(*v).log2());
    let low = logs().fold(f64::INFINITY, f64::min);
    let high = logs().fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = if low <= high { (low, high.max(low + 1e-6)) } else { (0.0, 1.0) };
    let code = |v: f32| {
        if v > 0.0 { (1.0 + (f64::from(v).log2() - low) / (high - low) * (LARGEST - 1.0)).round() as u16 } else { 0 }
    };
    let bytes: Vec<u8> = values.iter().flat_map(|v| code(*v).to_le_bytes()).collect();
    json!({ "low": low, "high": high, "codes": STANDARD.encode(bytes) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_to_a_part_in_a_thousand() {
        let values = [0.0, 1e-4, 0.3, 1.0, 2e4];
        let packed = pack(&values);
        let (low, high) = (packed["low"].as_f64().unwrap(), packed["high"].as_f64().unwrap());
        let bytes = STANDARD.decode(packed["codes"].as_str().unwrap()).unwrap();
        for (code, value) in bytes.chunks_exact(2).zip(values) {
            let code = u16::from_le_bytes([code[0], code[1]]);
            let back = if code == 0 { 0.0 } else { (low + (high - low) * f64::from(code - 1) / 65_534.0).exp2() };
            assert!((back - f64::from(value)).abs() <= 1e-3 * f64::from(value), "{back} for {value}");
        }
    }

    #[test]
    fn black_is_black() {
        let packed = pack(&[0.0; 3]);
        assert_eq!(STANDARD.decode(packed["codes"].as_str().unwrap()).unwrap(), [0; 6]);
    }
}
