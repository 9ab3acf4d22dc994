//! Selection of the colour channels of an OpenEXR file by layer and channel name.

use std::path::Path;

use exr::meta::header::Header;

use super::ReadOptions;
use crate::Error;

/// Channels to read, in order, all of one layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Selection {
    pub(crate) layer: usize,
    pub(crate) channels: Vec<usize>,
}

/// Channels of one layer that share a prefix: `View.R`, `View.G` ... or, without prefix, `R`, `G`
/// ...
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Group {
    /// Prefix in lower case, without the last component; includes the name of the layer.
    pub(crate) prefix: String,
    layer: usize,
    /// [`canonical`] names of the last components, with their index in the layer.
    channels: Vec<(String, usize)>,
}

/// Kind of colour in the channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Colours {
    Rgb,
    Grey,
    /// Luminance `Y`, and the chroma channels `(R - Y) / Y` and `(B - Y) / Y`.
    Chroma,
}

/// Picture selected from a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Chosen {
    pub(super) selection: Selection,
    pub(super) colours: Colours,
    /// Name of the picture.
    pub(super) name: String,
    /// Names of the other pictures in the file.
    pub(super) others: Vec<String>,
}

impl Group {
    fn index(&self, name: &str) -> Option<usize> {
        self.channels.iter().find(|c| c.0 == name).map(|c| c.1)
    }

    /// Selects the channels of these names (lower case), if all exist.
    pub(crate) fn select(&self, names: &[&str]) -> Option<Selection> {
        let channels = names.iter().map(|n| self.index(n)).collect::<Option<_>>()?;
        Some(Selection { layer: self.layer, channels })
    }

    /// Selects the colour channels, followed by the alpha channel if there is one.
    fn colours(&self) -> Option<(Selection, Colours)> {
        // A channel Y next to X is a coordinate.
        let grey = || self.select(&["y"]).filter(|_| self.index("x").is_none()).map(|s| (s, Colours::Grey));
        let rgb = self.select(&["r", "g", "b"]).map(|s| (s, Colours::Rgb));
        let chroma = || self.select(&["y", "ry", "by"]).map(|s| (s, Colours::Chroma));
        let (mut selection, colours) = rgb.or_else(chroma).or_else(grey)?;
        selection.channels.extend(self.index("a"));
        Some((selection, colours))
    }

    /// Returns the name of the pass, the last part of the prefix.
    pub(crate) fn pass(&self) -> &str {
        self.prefix.rsplit('.').next().unwrap_or_default()
    }

    /// Returns the name used in messages and by `ReadOptions::layer`.
    fn name(&self) -> String {
        if self.prefix.is_empty() { "rgb".to_owned() } else { self.prefix.clone() }
    }
}

/// Returns the canonical lower-case name of a colour; other names are unchanged.
fn canonical(name: &str) -> &str {
    match name {
        "red" => "r",
        "green" => "g",
        "blue" => "b",
        "luminance" | "lum" | "grey" | "gray" => "y",
        "alpha" | "opacity" => "a",
        name => name,
    }
}

/// Splits a channel's name into prefix and last component. The separator is a dot; some programs
/// write `beauty_R` or `beauty/R`.
fn split(name: &str) -> (&str, &str) {
    let colour = |last: &str| matches!(canonical(last), "r" | "g" | "b" | "a");
    name.rsplit_once('.')
        .or_else(|| name.rsplit_once(['_', '/', ':', ' ']).filter(|(_, last)| colour(last)))
        .unwrap_or(("", name))
}

/// Returns the groups of all layers, in file order.
pub(crate) fn groups(headers: &[Header]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (layer, header) in headers.iter().enumerate() {
        // The name of a single part adds nothing to the channels' names.
        let part = match &header.own_attributes.layer_name {
            Some(name) if headers.len() > 1 => name.to_string().to_ascii_lowercase(),
            _ => String::new(),
        };
        for (index, channel) in header.channels.list.iter().enumerate() {
            let name = channel.name.to_string().to_ascii_lowercase();
            let (prefix, last) = split(&name);
            let prefix = [part.as_str(), prefix].into_iter().filter(|p| !p.is_empty()).collect::<Vec<_>>().join(".");
            let last = canonical(last).to_owned();
            match groups.iter_mut().find(|g| g.layer == layer && g.prefix == prefix) {
                Some(group) => group.channels.push((last, index)),
                None => groups.push(Group { prefix, layer, channels: vec![(last, index)] }),
            }
        }
    }
    groups
}

/// Selects the channels of the lowest rank, the first if several are equal.
///
/// `names` lists sets of channel names with their ranks. `pass_rank` takes a group and the first
/// name of a set. It returns a number to add to the rank, or `None` to exclude the set in this
/// group.
pub(crate) fn select_best<const N: usize>(
    headers: &[Header],
    names: &[([&str; N], u32)],
    pass_rank: impl Fn(&Group, &str) -> Option<u32>,
) -> Option<Selection> {
    let mut found: Option<(u32, Selection)> = None;
    for group in groups(headers) {
        for (names, rank) in names {
            if let (Some(selection), Some(added)) = (group.select(names), pass_rank(&group, names[0]))
                && found.as_ref().is_none_or(|f| added + rank < f.0)
            {
                found = Some((added + rank, selection));
            }
        }
    }
    found.map(|f| f.1)
}

/// Selects the colour channels of the layer that the options name. Without a name, selects the
/// channels without a prefix, else the pass of the finished picture, else the first.
pub(super) fn choose(path: &Path, headers: &[Header], options: &ReadOptions) -> Result<Chosen, Error> {
    let groups = groups(headers);
    let candidates: Vec<_> = groups.iter().filter_map(|g| g.colours().map(|c| (g, c))).collect();
    let rank = |group: &Group| match (&options.layer, group.pass()) {
        (Some(wanted), pass) => {
            let wanted = wanted.to_ascii_lowercase();
            // Matches the whole name before its last part.
            if group.name() == wanted {
                0
            } else if pass == wanted {
                1
            } else {
                u32::MAX
            }
        }
        (None, "") => 0,
        (None, "combined" | "composite" | "beauty" | "rgb" | "rgba" | "color" | "colour" | "main" | "image") => 1,
        (None, _) => 2,
    };
    let names = || candidates.iter().map(|(g, _)| g.name());
    match candidates.iter().min_by_key(|(group, _)| rank(group)) {
        Some((group, (selection, colours))) if rank(group) != u32::MAX => {
            let (name, mut others) = (group.name(), names().collect::<Vec<_>>());
            others.retain(|other| *other != name);
            Ok(Chosen { selection: selection.clone(), colours: *colours, name, others })
        }
        Some(_) => {
            let problem = format!("has no image layer {}", options.layer.as_deref().unwrap_or_default());
            let advice = format!("use one of {}", names().take(12).collect::<Vec<_>>().join(", "));
            Err(Error::invalid(path, problem, advice))
        }
        None => {
            let all: Vec<_> =
                headers.iter().flat_map(|h| &h.channels.list).take(12).map(|c| c.name.to_string()).collect();
            let problem = format!("has the channels {}, but not R, G, B or Y", all.join(", "));
            Err(Error::unsupported(path, problem, "write the channels R, G and B"))
        }
    }
}
