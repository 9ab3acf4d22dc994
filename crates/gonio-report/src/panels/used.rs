//! Picture of used and ignored pixels, with the reasons.

use glam::Vec3;
use gonio::picture::Plane;
use gonio::scene::PixelStatus;

use super::view::View;
use super::{PANEL, Subject};
use crate::canvas::{self, PAPER};

/// Factor by which the photograph is darkened outside of the used pixels.
const SHADE: f32 = 0.2;

/// Reason for ignoring pixels.
#[derive(Clone, Copy)]
pub struct IgnoreReason {
    /// Name in a few words.
    pub label: &'static str,
    /// Colour of the pixels in the picture, linear.
    pub colour: Vec3,
    statuses: &'static [PixelStatus],
}

impl IgnoreReason {
    /// Whether the reason covers this status.
    pub fn marks(&self, status: PixelStatus) -> bool {
        self.statuses.contains(&status)
    }
}

/// All reasons except being outside the object. If several pixels of the photograph share a pixel
/// of the picture, the picture shows the first reason that occurs.
pub const IGNORE_REASONS: [IgnoreReason; 7] = [
    IgnoreReason {
        label: "negative, NaN or infinite",
        colour: Vec3::new(0.9, 0.02, 0.6),
        statuses: &[PixelStatus::Negative, PixelStatus::NotFinite],
    },
    IgnoreReason {
        label: "outlier (hot, dead)",
        colour: Vec3::new(0.02, 0.75, 0.8),
        statuses: &[PixelStatus::Outlier],
    },
    IgnoreReason { label: "dark speck", colour: Vec3::new(0.05, 0.7, 0.1), statuses: &[PixelStatus::Speck] },
    IgnoreReason { label: "clipped", colour: Vec3::new(0.95, 0.08, 0.05), statuses: &[PixelStatus::Clipped] },
    IgnoreReason {
        label: "another colour or paint",
        colour: Vec3::new(0.03, 0.22, 0.95),
        statuses: &[PixelStatus::OtherColour],
    },
    IgnoreReason { label: "at an edge", colour: Vec3::new(0.85, 0.55, 0.02), statuses: &[PixelStatus::Edge] },
    IgnoreReason { label: "no valid normal", colour: Vec3::new(0.3, 0.3, 0.3), statuses: &[PixelStatus::NoNormal] },
];

/// Draws the photograph with marks on ignored pixels, dark outside of the used pixels. Returns
/// `None` if the observations have no statuses.
pub(super) fn draw(subject: &Subject<'_>, view: &View<'_>, photograph: &Plane<Vec3>) -> Option<Plane<Vec3>> {
    let statuses = subject.detection.observations.statuses.as_ref()?;
    let side = PANEL;
    Some(Plane::from_fn(side, side, |x, y| {
        let found = || view.behind(x, y, side, statuses.size()).map(|at| statuses[at]);
        if let Some(mark) = IGNORE_REASONS.iter().find(|mark| found().any(|status| mark.marks(status))) {
            return mark.colour;
        }
        let used = found().any(PixelStatus::is_used);
        if used { photograph[(x, y)] } else { SHADE * photograph[(x, y)] }
    }))
}

/// Lists the reasons that occur, each with its number of pixels.
pub fn reasons(statuses: &Plane<PixelStatus>) -> Vec<(IgnoreReason, usize)> {
    let count = |mark: &IgnoreReason| statuses.as_slice().iter().filter(|status| mark.marks(**status)).count();
    IGNORE_REASONS.iter().map(|mark| (*mark, count(mark))).filter(|(_, count)| *count > 0).collect()
}

/// Adds a legend of the colours to the picture.
pub fn with_legend(picture: &Plane<Vec3>, statuses: &Plane<PixelStatus>) -> Plane<Vec3> {
    let mut lines = legend(statuses);
    lines.push((PAPER, "dark: outside the object, or at grazing angles".to_owned()));
    canvas::with_legend(picture, 0, &lines)
}

/// Returns the colours and lines of the legend: the reasons that occur, with numbers of pixels.
pub(crate) fn legend(statuses: &Plane<PixelStatus>) -> Vec<(Vec3, String)> {
    let line = |(mark, count): (IgnoreReason, usize)| (mark.colour, format!("{}: {count} pixels", mark.label));
    reasons(statuses).into_iter().map(line).collect()
}
