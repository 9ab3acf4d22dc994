//! Container of a model: a safetensors file with a version and a checksum in its metadata.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensorError, SafeTensors};
use serde::Serialize;

use super::Content;
use crate::{Error, little_endian};

/// Version of the format, the only one so far.
const VERSION: &str = "1";
/// Metadata entry with the hash of the file.
const HASH: &str = "blake3";
/// Placeholder for the hash while hashing.
const BLANK: [u8; 64] = [b'0'; 64];

/// Metadata of a file that is being written: sorted, so that equal models give identical files.
pub(super) type Metadata = BTreeMap<&'static str, String>;

/// A named array to be written.
pub(super) struct Tensor {
    name: Cow<'static, str>,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Tensor {
    pub(super) fn f32(name: impl Into<Cow<'static, str>>, shape: &[usize], values: &[f32]) -> Self {
        let mut bytes = Vec::new();
        little_endian::put_f32(&mut bytes, values);
        Self { name: name.into(), dtype: Dtype::F32, shape: shape.to_vec(), bytes }
    }

    pub(super) fn f64(name: impl Into<Cow<'static, str>>, shape: &[usize], values: &[f64]) -> Self {
        let mut bytes = Vec::new();
        little_endian::put_f64(&mut bytes, values);
        Self { name: name.into(), dtype: Dtype::F64, shape: shape.to_vec(), bytes }
    }
}

/// An entry of the header of a safetensors file.
#[derive(Serialize)]
#[serde(untagged)]
enum Entry<'a> {
    Metadata(&'a Metadata),
    Tensor { dtype: Dtype, shape: &'a [usize], data_offsets: (usize, usize) },
}

/// Encodes a file.
///
/// The writer of `safetensors` keeps metadata in a `HashMap`, whose order changes between runs.
/// Tensors of the widest type should come first, which keeps all tensors aligned.
pub(super) fn encode(content: Content, mut metadata: Metadata, tensors: &[Tensor]) -> Vec<u8> {
    metadata.insert("format", "gonio".into());
    metadata.insert("version", VERSION.into());
    metadata.insert("kind", content.name().into());
    metadata.insert(HASH, String::from_utf8_lossy(&BLANK).into_owned());
    let mut entries = BTreeMap::from([("__metadata__", Entry::Metadata(&metadata))]);
    let mut end = 0;
    for Tensor { name, dtype, shape, bytes } in tensors {
        let data_offsets = (end, end + bytes.len());
        end = data_offsets.1;
        entries.insert(name.as_ref(), Entry::Tensor { dtype: *dtype, shape, data_offsets });
    }
    let mut header = serde_json::to_vec(&entries).expect("strings and numbers are JSON");
    header.resize(header.len().next_multiple_of(8), b' ');
    let mut file = (header.len() as u64).to_le_bytes().to_vec();
    file.extend(header);
    // Quotes inside strings are escaped, so this can only be the entry itself.
    let entry = format!("\"{HASH}\":\"");
    let at = find(&file, entry.as_bytes()).expect("the entry is in the header") + entry.len();
    tensors.iter().for_each(|t| file.extend(&t.bytes));
    seal(&mut file, at);
    file
}

/// Computes the hash of a file with blanked digits and writes it at the index `at`.
fn seal(file: &mut [u8], at: usize) {
    file[at..at + BLANK.len()].copy_from_slice(&BLANK);
    let hash = blake3::hash(file).to_hex();
    file[at..at + BLANK.len()].copy_from_slice(hash.as_bytes());
}

/// Rounds the 32-bit numbers of an undamaged file to `digits` of their 24 binary digits.
pub(super) fn rounded(path: &Path, bytes: &[u8], content: Content, digits: u32) -> Result<Vec<u8>, Error> {
    let hash = Container::decode(path, bytes, content)?.text(HASH)?.to_owned();
    let (length, header) = SafeTensors::read_metadata(bytes).map_err(|e| unreadable(path, bytes, &e))?;
    let mut file = bytes.to_vec();
    let lost = 24 - digits.clamp(1, 24);
    let half = (1_u32 << lost) >> 1;
    for tensor in header.tensors().values().filter(|tensor| tensor.dtype == Dtype::F32) {
        let (from, to) = tensor.data_offsets;
        for number in file[8 + length + from..8 + length + to].as_chunks_mut().0 {
            let bits = u32::from_le_bytes(*number).saturating_add(half);
            *number = (bits >> lost << lost).to_le_bytes();
        }
    }
    let at = find(&file, hash.as_bytes()).ok_or_else(|| Error::damaged(path, "does not match its checksum"))?;
    seal(&mut file, at);
    Ok(file)
}

/// A file of the expected kind, checked to be undamaged.
pub(super) struct Container<'a> {
    path: &'a Path,
    content: Content,
    metadata: HashMap<String, String>,
    tensors: SafeTensors<'a>,
}

impl<'a> Container<'a> {
    pub(super) fn decode(path: &'a Path, bytes: &'a [u8], content: Content) -> Result<Self, Error> {
        let (length, header) = SafeTensors::read_metadata(bytes).map_err(|e| unreadable(path, bytes, &e))?;
        let metadata = header.metadata().clone().unwrap_or_default();
        let entry = |name: &str| metadata.get(name).map(String::as_str);
        if entry("format") != Some("gonio") {
            let problem = "is a safetensors file, but was not written by gonio";
            return Err(Error::invalid(path, problem, format!("specify {}", content.wanted())));
        }
        // Checked first, because other versions may have another layout.
        if entry("version") != Some(VERSION) {
            let found = entry("version").unwrap_or("unknown");
            let problem = format!("has format version {found}, but version {VERSION} is required");
            let advice =
                format!("use the version of gonio that wrote it, or write it again with `{}`", content.command());
            return Err(Error::unsupported(path, problem, advice));
        }
        if entry("kind") != Some(content.name()) {
            let found = entry("kind").and_then(Content::named).map_or("unknown content", Content::label);
            let problem = format!("contains {found} instead of {}", content.label());
            return Err(Error::invalid(path, problem, format!("specify {}", content.wanted())));
        }
        if !intact(&bytes[..8 + length], &bytes[8 + length..], entry(HASH)) {
            return Err(Error::damaged(path, "does not match its checksum"));
        }
        let tensors = SafeTensors::deserialize(bytes).map_err(|e| unreadable(path, bytes, &e))?;
        Ok(Self { path, content, metadata, tensors })
    }

    /// Returns an error for content that is undamaged but was written incorrectly.
    pub(super) fn wrong(&self, problem: impl Into<String>) -> Error {
        Error::invalid(self.path, problem, format!("write it again with `{}`", self.content.command()))
    }

    pub(super) fn text(&self, name: &str) -> Result<&str, Error> {
        self.metadata.get(name).map(String::as_str).ok_or_else(|| self.wrong(format!("has no metadata \"{name}\"")))
    }

    pub(super) fn json<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T, Error> {
        serde_json::from_str(self.text(name)?).map_err(|e| self.wrong(format!("has invalid metadata \"{name}\": {e}")))
    }

    /// Returns whether the metadata contain the entry `name`.
    pub(super) fn says(&self, name: &str) -> bool {
        self.metadata.contains_key(name)
    }

    pub(super) fn has_tensor(&self, name: &str) -> bool {
        self.tensors.tensor(name).is_ok()
    }

    pub(super) fn f32s(&self, name: &str, shape: &[Option<usize>]) -> Result<(Vec<usize>, Vec<f32>), Error> {
        let (shape, bytes) = self.tensor(name, Dtype::F32, shape)?;
        Ok((shape, little_endian::f32s(bytes)))
    }

    /// Returns the 32-bit tensor `name` of any shape, if there is one.
    pub(super) fn any_f32s(&self, name: &str) -> Option<(Vec<usize>, Vec<f32>)> {
        let found = self.tensors.tensor(name).ok().filter(|t| t.dtype() == Dtype::F32)?;
        Some((found.shape().to_vec(), little_endian::f32s(found.data())))
    }

    pub(super) fn f64s(&self, name: &str, shape: &[Option<usize>]) -> Result<(Vec<usize>, Vec<f64>), Error> {
        let (shape, bytes) = self.tensor(name, Dtype::F64, shape)?;
        Ok((shape, little_endian::f64s(bytes)))
    }

    /// Returns shape and bytes of a tensor; `None` accepts any length of an axis.
    fn tensor(&self, name: &str, dtype: Dtype, shape: &[Option<usize>]) -> Result<(Vec<usize>, &[u8]), Error> {
        let Ok(found) = self.tensors.tensor(name) else {
            return Err(self.wrong(format!("has no tensor \"{name}\"")));
        };
        let fits = |(found, expected): (&usize, &Option<usize>)| expected.is_none_or(|e| e == *found);
        let fits = found.shape().len() == shape.len() && found.shape().iter().zip(shape).all(fits);
        if found.dtype() != dtype || !fits {
            let expected: Vec<String> = shape.iter().map(|n| n.map_or("any".into(), |n| n.to_string())).collect();
            let got = format!("{} of shape {:?}", found.dtype(), found.shape());
            let expected = format!("{dtype} of shape [{}]", expected.join(", "));
            return Err(self.wrong(format!("has a tensor \"{name}\" of {got} instead of {expected}")));
        }
        Ok((found.shape().to_vec(), found.data()))
    }
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|w| w == what)
}

/// Returns whether `hash` is the hash of the file with the digits of the hash blanked.
fn intact(header: &[u8], data: &[u8], hash: Option<&str>) -> bool {
    let Some(hash) = hash.filter(|h| h.len() == BLANK.len()) else { return false };
    let Some(at) = find(header, hash.as_bytes()) else { return false };
    let mut hasher = blake3::Hasher::new();
    hasher.update(&header[..at]).update(&BLANK).update(&header[at + BLANK.len()..]).update(data);
    hasher.finalize().to_hex().as_str() == hash
}

fn unreadable(path: &Path, bytes: &[u8], error: &SafeTensorError) -> Error {
    // The header is JSON and follows its 8-byte length.
    if bytes.get(8) != Some(&b'{') {
        let advice = "use a file that `gonio train` wrote";
        return Error::unsupported(path, "is not a model: it does not have the header of a safetensors file", advice);
    }
    match error {
        SafeTensorError::InvalidHeaderLength => Error::damaged(path, "is truncated in its header"),
        SafeTensorError::MetadataIncompleteBuffer => Error::damaged(path, "does not have the length in its header"),
        e => Error::damaged(path, format!("has an invalid safetensors header ({e})")),
    }
}
