//! Pictures and tables packed for the script of the page: sixteen-bit logarithms, which preserve
//! both a mirror's peak and its base.

use base64::Engine;
use serde_json::{Value, json};

/// Packs non-negative values as `low`, `high` (binary logarithms of the smallest and the largest
/// positive value) and `codes`: base64 of little-endian 16-bit codes. Code 0 is zero; codes 1 to
/// 65535 are evenly spaced from `low` to `high`.
pub(super) fn packed(values: impl Iterator<Item = f32> + Clone) -> Value {
    let logs = values.clone().filter(|v| *v > 0.0 && v.is_finite()).map(|v| f64::from(v).log2());
    let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), l| (low.min(l), high.max(l)));
    // Without positive values, all codes are zero.
    let (low, high) = if low <= high { (low, high.max(low + 1e-6)) } else { (0.0, 1.0) };
    let code = |v: f32| {
        let positive = v > 0.0 && v.is_finite();
        if positive { 1 + ((f64::from(v).log2() - low) / (high - low) * 65534.0).round() as u16 } else { 0 }
    };
    let bytes: Vec<u8> = values.flat_map(|v| code(v).to_le_bytes()).collect();
    json!({ "low": low, "high": high, "codes": base64::engine::general_purpose::STANDARD.encode(bytes) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packing_is_accurate_to_one_code() {
        let values = [0.0, 1e-4, 0.3, 7.0, 12_345.0, f32::NAN, -1.0];
        let packed = packed(values.into_iter());
        let (low, high) = (packed["low"].as_f64().unwrap(), packed["high"].as_f64().unwrap());
        let bytes = base64::engine::general_purpose::STANDARD.decode(packed["codes"].as_str().unwrap()).unwrap();
        let back: Vec<f64> = bytes
            .chunks_exact(2)
            .map(|b| u16::from_le_bytes([b[0], b[1]]))
            .map(|c| if c == 0 { 0.0 } else { (low + f64::from(c - 1) / 65534.0 * (high - low)).exp2() })
            .collect();
        for (v, b) in values.into_iter().zip(back) {
            let v = if v > 0.0 { f64::from(v) } else { 0.0 };
            assert!((v - b).abs() <= 3e-4 * v, "{v} {b}");
        }
    }

    #[test]
    fn zeros_have_code_zero() {
        let packed = packed([0.0_f32, 0.0].into_iter());
        assert_eq!((packed["low"].as_f64(), packed["codes"].as_str()), (Some(0.0), Some("AAAAAA==")));
    }
}
