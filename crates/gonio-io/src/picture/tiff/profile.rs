//! The ICC profile of a TIFF file.
//!
//! The decoder of `image` rejects profiles that are long in relation to the picture, so this module
//! reads the tag.

/// Tag of the profile.
const ICC_PROFILE: u16 = 34_675;

/// Returns the ICC profile of the first picture of a TIFF or BigTIFF file, if there is one.
pub(in crate::picture) fn icc_profile(bytes: &[u8]) -> Option<&[u8]> {
    let big_endian = match bytes.get(..2)? {
        b"II" => false,
        b"MM" => true,
        _ => return None,
    };
    let number = |at: usize, length: usize| {
        let field = bytes.get(at..at.checked_add(length)?)?;
        let add = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        Some(if big_endian { field.iter().fold(0, add) } else { field.iter().rev().fold(0, add) })
    };
    let place = |at: usize, length: usize| number(at, length).and_then(|n| usize::try_from(n).ok());
    // Lengths in bytes of an offset, of the number of entries, and of an entry.
    let (offset, counter, entry) = match number(2, 2)? {
        42 => (4, 2, 12),
        43 => (8, 8, 20),
        _ => return None,
    };
    let directory = place(if offset == 4 { 4 } else { 8 }, offset)?;
    let count = place(directory, counter)?.min(bytes.len() / entry);
    let first = directory.checked_add(counter)?;
    let at =
        (0..count).map(|i| first.saturating_add(i * entry)).find(|at| number(*at, 2) == Some(ICC_PROFILE.into()))?;
    // The type must be BYTE or UNDEFINED.
    if !matches!(number(at + 2, 2)?, 1 | 7) {
        return None;
    }
    let (length, value) = (place(at + 4, offset)?, at + 4 + offset);
    let start = if length <= offset { value } else { place(value, offset)? };
    bytes.get(start..start.checked_add(length)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A directory with one other tag and the profile at the end.
    fn file(big: bool, swap: bool) -> Vec<u8> {
        let number = |value: u64, length: usize| {
            let bytes = &value.to_le_bytes()[..length];
            if swap { bytes.iter().rev().copied().collect() } else { bytes.to_vec() }
        };
        let (offset, counter) = if big { (8, 8) } else { (4, 2) };
        let mut out = if swap { b"MM".to_vec() } else { b"II".to_vec() };
        let header = if big { 16 } else { 8 };
        let end = header + counter + 2 * (4 + 2 * offset);
        out.extend(number(if big { 43 } else { 42 }, 2));
        if big {
            out.extend([number(8, 2), number(0, 2)].concat());
        }
        out.extend(number(header as u64, offset));
        out.extend(number(2, counter));
        for (tag, kind, length, value) in [(256, 4, 1, 7), (34_675, 7, 9, end as u64)] {
            out.extend([number(tag, 2), number(kind, 2), number(length, offset), number(value, offset)].concat());
        }
        out.extend(b"a profile");
        out
    }

    #[test]
    fn reads_profiles_of_all_file_variants() {
        for (big, swap) in [(false, false), (false, true), (true, false), (true, true)] {
            let bytes = file(big, swap);
            assert_eq!(icc_profile(&bytes), Some(&b"a profile"[..]), "big {big}, swapped {swap}");
            for cut in 0..bytes.len() {
                assert_eq!(icc_profile(&bytes[..cut]), None, "{cut}");
            }
            for at in 0..bytes.len() {
                let mut bad = bytes.clone();
                bad[at] = 0xff;
                let _ = icc_profile(&bad);
            }
        }
    }
}
