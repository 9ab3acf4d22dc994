//! Arrays of numpy (`.npy`): 32 and 64-bit floats, either byte order, C or Fortran order.

use std::path::Path;

use gonio::picture::Plane;

use crate::picture::ReadOptions;
use crate::{Error, guard, little_endian};

/// Longest file read, 4 GiB.
const MAX_BYTES: u64 = 1 << 32;
/// First bytes of every such file.
pub(crate) const MAGIC: &[u8] = b"\x93NUMPY";

/// An array in C order: the last axis varies fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Values, as many as the product of `shape`.
    pub values: Vec<f32>,
}

/// Reads an array of floats. 64-bit values are rounded to 32 bits, and Fortran order is converted
/// to C order.
///
/// # Errors
/// If the file cannot be read, has values of another type, or a length that does not match its
/// shape.
pub fn read(path: impl AsRef<Path>) -> Result<Array, Error> {
    let path = path.as_ref();
    decode(path, &guard::read_whole(path, MAX_BYTES)?)
}

/// Decodes an array held in memory; `path` is only used in error messages.
///
/// # Errors
/// If the bytes are not an array of floats, or their number does not match the shape.
pub fn decode(path: &Path, bytes: &[u8]) -> Result<Array, Error> {
    let (header, data) = split(bytes).ok_or_else(|| Error::damaged(path, "does not have the header of an NPY file"))?;
    let bad = |what: &str| Error::damaged(path, format!("has no valid {what} in its NPY header"));
    let kind = value_of(header, "descr").ok_or_else(|| bad("descr"))?.trim_matches(['\'', '"']);
    let fortran = match value_of(header, "fortran_order") {
        Some("True") => true,
        Some("False") => false,
        _ => return Err(bad("fortran_order")),
    };
    let shape = value_of(header, "shape").and_then(parse_shape).ok_or_else(|| bad("shape"))?;
    let (size, little) = match kind {
        "<f4" => (4, true),
        ">f4" => (4, false),
        "<f8" => (8, true),
        ">f8" => (8, false),
        _ => {
            let problem = format!("contains values of the type {kind}");
            return Err(Error::unsupported(path, problem, "save it with .astype(numpy.float32)"));
        }
    };
    let count = shape.iter().try_fold(1_usize, |n, &axis| n.checked_mul(axis));
    if count.and_then(|n| n.checked_mul(size)) != Some(data.len()) {
        return Err(Error::damaged(
            path,
            format!("has {} bytes of values, which do not match the shape {shape:?}", data.len()),
        ));
    }
    let value = |b: &[u8]| match (b, little) {
        (&[a, b, c, d], true) => f32::from_le_bytes([a, b, c, d]),
        (&[a, b, c, d], false) => f32::from_be_bytes([a, b, c, d]),
        (&[a, b, c, d, e, f, g, h], true) => f64::from_le_bytes([a, b, c, d, e, f, g, h]) as f32,
        (&[a, b, c, d, e, f, g, h], false) => f64::from_be_bytes([a, b, c, d, e, f, g, h]) as f32,
        _ => f32::NAN,
    };
    let values: Vec<f32> = data.chunks_exact(size).map(value).collect();
    let values = if fortran { to_c_order(&shape, &values) } else { values };
    Ok(Array { shape, values })
}

/// Decodes an array with the shape (height, width, N), or (height, width) if N is 1, as a picture.
/// `advice` describes the required array.
pub(crate) fn decode_pixels<T, const N: usize>(
    path: &Path,
    bytes: &[u8],
    options: &ReadOptions,
    advice: &str,
    pixel: impl Fn(&[f32; N]) -> T,
) -> Result<Plane<T>, Error> {
    let Array { shape, values } = decode(path, bytes)?;
    let (height, width) = match *shape.as_slice() {
        [height, width] if N == 1 => (height, width),
        [height, width, channels] if channels == N => (height, width),
        _ => return Err(Error::invalid(path, format!("has the shape {shape:?}"), advice)),
    };
    let (width, height) = options.check_size(path, width as u64, height as u64)?;
    Ok(Plane::from_vec(width, height, values.as_chunks().0.iter().map(pixel).collect()))
}

/// Encodes an array as 32-bit little-endian floats in C order, format version 1.0.
///
/// # Panics
/// If the number of values is not the product of the shape, or the shape has hundreds of axes.
pub fn encode(array: &Array) -> Vec<u8> {
    assert_eq!(array.shape.iter().product::<usize>(), array.values.len(), "the number of values must match the shape");
    let axes: String = array.shape.iter().map(|n| format!("{n}, ")).collect();
    let dict = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", axes.trim_end());
    // The format requires the values to start at a multiple of 64, and a line break before them.
    let length = (MAGIC.len() + 4 + dict.len() + 1).next_multiple_of(64) - MAGIC.len() - 4;
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend(u16::try_from(length).expect("the header is shorter than 64 kB").to_le_bytes());
    bytes.extend(format!("{dict:<width$}\n", width = length - 1).bytes());
    little_endian::put_f32(&mut bytes, &array.values);
    bytes
}

/// Splits a file into the text of the header and the bytes after it.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (start, length) = match *rest {
        [1, _, a, b, ..] => (4, usize::from(u16::from_le_bytes([a, b]))),
        [2 | 3, _, a, b, c, d, ..] => (6, u32::from_le_bytes([a, b, c, d]) as usize),
        _ => return None,
    };
    let (header, data) = rest.get(start..)?.split_at_checked(length)?;
    Some((std::str::from_utf8(header).ok()?, data))
}

/// Returns the text of one value of the header, a Python dictionary on one line.
fn value_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let rest = ['\'', '"'].iter().find_map(|q| header.split_once(&format!("{q}{key}{q}")))?.1;
    let rest = rest.trim_start().strip_prefix(':')?.trim_start();
    let end = if rest.starts_with('(') { rest.find(')')? + 1 } else { rest.find([',', '}'])? };
    Some(rest[..end].trim_end())
}

fn parse_shape(text: &str) -> Option<Vec<usize>> {
    let inner = text.strip_prefix('(')?.strip_suffix(')')?.trim().trim_end_matches(',');
    if inner.is_empty() {
        return Some(Vec::new());
    }
    inner.split(',').map(|n| n.trim().parse().ok()).collect()
}

/// Reorders values from Fortran order, in which the first axis varies fastest.
fn to_c_order(shape: &[usize], values: &[f32]) -> Vec<f32> {
    let mut index = vec![0; shape.len()];
    let mut strides = vec![1; shape.len()];
    for axis in 1..shape.len() {
        strides[axis] = strides[axis - 1] * shape[axis - 1];
    }
    let mut at = 0;
    let mut out = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        out.push(values[at]);
        // Increments the index, last axis first, and updates `at` accordingly.
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            at += strides[axis];
            if index[axis] < shape[axis] {
                break;
            }
            at -= strides[axis] * shape[axis];
            index[axis] = 0;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    fn file(dict: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([1, 0]);
        bytes.extend((dict.len() as u16).to_le_bytes());
        bytes.extend(dict.bytes());
        bytes.extend(data);
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Array, Error> {
        decode(Path::new("a.npy"), bytes)
    }

    #[test]
    fn arrays_round_trip() {
        for shape in [vec![2, 3, 4], vec![24], vec![1, 24, 1]] {
            let array = Array { shape, values: (0..24).map(|i| i as f32).collect() };
            let bytes = encode(&array);
            assert_eq!((bytes.len() - 96) % 64, 0);
            assert_eq!(read(&bytes).unwrap(), array);
        }
    }

    #[test]
    fn fortran_order_and_doubles_are_converted() {
        // The 2 x 3 array [[0, 1, 2], [3, 4, 5]] column by column, in big-endian doubles.
        let data: Vec<u8> = [0.0, 3.0, 1.0, 4.0, 2.0, 5.0_f64].iter().flat_map(|v| v.to_be_bytes()).collect();
        let got = read(&file("{'descr': '>f8', 'fortran_order': True, 'shape': (2, 3), }\n", &data)).unwrap();
        assert_eq!(got.shape, [2, 3]);
        assert_eq!(got.values, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn inconsistent_headers_are_rejected() {
        let header = |shape: &str| format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
        for shape in ["(3,)", "(99999999999, 99999999999)", "(-1,)", "(1, x)", "1", "()", "("] {
            let error = read(&file(&header(shape), &[0; 8])).unwrap_err();
            assert_eq!(error.kind(), Kind::Damaged, "{shape}");
        }
        let ints = file("{'descr': '<i4', 'fortran_order': False, 'shape': (2,), }", &[0; 8]);
        assert_eq!(read(&ints).unwrap_err().kind(), Kind::Unsupported);
    }
}
