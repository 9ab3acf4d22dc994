//! Fast conversion of arrays of numbers to and from little-endian bytes.

/// Appends the bytes of `values`.
pub(crate) fn put_f32(out: &mut Vec<u8>, values: &[f32]) {
    let start = out.len();
    out.resize(start + size_of_val(values), 0);
    let (places, _) = out[start..].as_chunks_mut();
    places.iter_mut().zip(values).for_each(|(place, v)| *place = v.to_le_bytes());
}

/// Appends the bytes of `values`.
pub(crate) fn put_f64(out: &mut Vec<u8>, values: &[f64]) {
    let start = out.len();
    out.resize(start + size_of_val(values), 0);
    let (places, _) = out[start..].as_chunks_mut();
    places.iter_mut().zip(values).for_each(|(place, v)| *place = v.to_le_bytes());
}

/// Reads as many complete values as `bytes` holds.
pub(crate) fn f32s(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

/// Reads as many complete values as `bytes` holds.
pub(crate) fn f64s(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect()
}

/// Reads as many complete values as `bytes` holds.
pub(crate) fn u64s(bytes: &[u8]) -> Vec<u64> {
    bytes.as_chunks().0.iter().map(|b| u64::from_le_bytes(*b)).collect()
}
