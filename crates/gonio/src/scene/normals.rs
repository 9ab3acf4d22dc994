//! Observations of an object of any shape, from a normal map.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use super::cells::SurfaceGeometry;
use super::components::neighbours;
use super::observed::{COVERED, ObservedColour, check_size};
use super::repair::{repaired, without_outliers};
use super::status::{PixelClassification, classify_pixels};
use super::view::{SurfaceView, has_normal};
use super::weights::weights;
use super::{ObservationReport, ObservationSettings, Observations, PixelStatus, SceneError};
use crate::appearance::Sample;
use crate::picture::{Picture, Plane, luminance};
use crate::shape::SurfacePoint;
use crate::sphere::OctahedralMap;
use crate::transfer::MIN_POINTS;

/// Largest error of a normal's length: renderers filter normals, and 8-bit files round them.
const LENGTH_TOLERANCE: f32 = 0.05;
/// Largest share of faulty normals, which are skipped; above it, the map is rejected.
const MAX_FAULTY: f64 = 0.02;
/// Cells along a side of the grid on which directions are counted: 1.6 degrees each.
const COUNTING_SIDE: usize = 128;
/// Points per cell of the thinning grid if the whole hemisphere is visible.
const POINTS_PER_CELL: f64 = 4.0;

/// Returns the cell of the equal-area grid of `side` by `side` that contains a unit vector.
fn cell(normal: DVec3, side: usize) -> usize {
    let (u, v) = OctahedralMap::EqualArea.square(normal);
    let at = |w: f64| ((0.5 * (w + 1.0) * side as f64) as usize).min(side - 1);
    at(v) * side + at(u)
}

impl Observations {
    /// Observes a surface given by its normals under an orthographic camera.
    ///
    /// `normals` contains unit vectors in camera space: x right, y up, z towards the camera. The
    /// rest is as in [`Self::of_view`].
    ///
    /// # Errors
    /// See [`Self::of_view`].
    pub fn of_normals(
        picture: &Picture,
        normals: &Plane<Vec3>,
        coverage: Option<&Plane<f32>>,
        settings: &ObservationSettings,
    ) -> Result<Self, SceneError> {
        Self::of_view(picture, &SurfaceView { normals, camera: None, distances: None }, coverage, settings)
    }

    /// Observes a surface of any shape.
    ///
    /// If more than [`ObservationSettings::normals`] covered pixels face the camera, they are
    /// thinned evenly. The directions are divided into cells of equal area. Each cell provides the
    /// same number of pixels, or all it has, spread over the picture. The points are the pixels
    /// whose normal is less than [`ObservationSettings::max_angle`] from the view. They depend on
    /// shape and coverage, not on the radiance.
    ///
    /// A pixel is covered where `coverage` (or else the alpha channel of the picture) is 0.99 or
    /// more. Without either, every pixel with a normal is covered, except those next to a pixel
    /// without one, which the object may cover only in part. Pixels at edges of the surface, and
    /// specks far darker than all their neighbours, are ignored; [`Observations::weights`] contains
    /// the reliability of the others.
    ///
    /// # Errors
    /// * [`SceneError::Sizes`], [`SceneError::NoNormals`] and [`SceneError::Black`].
    /// * [`SceneError::NotUnit`] when more than 2 % of the normals are off by more than 0.05 in
    ///   length.
    /// * [`SceneError::FacingAway`] when more than 2 % face away from the camera.
    /// * [`SceneError::TooFewNormals`] when fewer than 50 pixels have a usable normal.
    /// * [`SceneError::TooFewPoints`] when fewer than 50 points have a value.
    /// * [`SceneError::TooFlat`] when there are fewer than 50 different directions.
    /// * [`SceneError::BadPixels`] when more than half of the points before thinning are faulty.
    pub fn of_view(
        picture: &Picture,
        surface: &SurfaceView<'_>,
        coverage: Option<&Plane<f32>>,
        settings: &ObservationSettings,
    ) -> Result<Self, SceneError> {
        let (rgb, normals) = (&picture.rgb, surface.normals);
        check_size("normal map", normals.size(), rgb.size())?;
        let coverage = coverage.or(picture.varying_alpha());
        if let Some(coverage) = coverage {
            check_size("mask", coverage.size(), rgb.size())?;
        }
        let covered = covered_pixels(normals, coverage);
        let (mut facing, mut report) = facing(surface, &covered)?;
        let least = settings.max_angle.cos();
        let within = |candidate: &&Candidate| candidate.cosine(surface) > least;
        let edges = remove_edges(&mut facing, surface, least);
        report.at_edges = edges.len();
        check_directions(facing.iter().filter(within), surface, &covered)?;

        let (width, height) = rgb.size();
        let mut region = Plane::from_fn(width, height, |_, _| false);
        for candidate in facing.iter().filter(within) {
            region.as_mut_slice()[candidate.pixel as usize] = true;
        }
        let normal = |at| normals[at].normalize_or_zero();
        let geometry = SurfaceGeometry { normal: &normal, convex: false };
        let PixelClassification { mut statuses, mut report, albedo_map, converted } =
            classify_pixels(rgb, &region, settings, &geometry, report)?;
        let rgb = converted.as_ref().unwrap_or(rgb);
        let without_outliers = without_outliers(rgb, &statuses);
        for (i, (inside, status)) in region.as_mut_slice().iter_mut().zip(statuses.as_slice()).enumerate() {
            let sound = !status.is_faulty() || *status == PixelStatus::Outlier && repaired(rgb, &statuses, i).is_some();
            *inside = *inside && sound && *status != PixelStatus::OtherColour;
        }
        let rgb = &*without_outliers;
        report.dark_outliers = remove_specks(&mut facing, rgb, &region, &mut statuses);
        edges.into_iter().for_each(|pixel| statuses.as_mut_slice()[pixel] = PixelStatus::Edge);
        for (i, (status, covered)) in statuses.as_mut_slice().iter_mut().zip(covered.as_slice()).enumerate() {
            if *covered && *status == PixelStatus::Outside && !is_sound(surface, i) {
                *status = PixelStatus::NoNormal;
            }
        }
        let dense = facing
            .iter()
            .filter(within)
            .filter_map(|c| {
                let rgb = repaired(rgb, &statuses, c.pixel as usize)?;
                Some(Sample::of(c.in_view(surface), f64::from(luminance(rgb)), 1.0).coloured(rgb))
            })
            .collect();
        // Thin before the cut at the largest angle: otherwise the cells that the cut divides would
        // be sampled too densely.
        let taken = thin(&facing, surface, settings.normals);
        let taken: Vec<Candidate> = taken.iter().filter(within).copied().collect();
        let pixels: Vec<usize> = taken.iter().map(|c| c.pixel as usize).collect();
        let centre = |i: &usize| ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let mut observations = Self::assemble(
            taken.iter().map(|c| c.point(surface)).collect(),
            pixels.iter().map(centre).collect(),
            pixels.iter().map(|pixel| observed_colour(rgb, &statuses, *pixel)).collect(),
            PixelClassification { statuses, report, albedo_map, converted: None },
        )?;
        observations.weights = weights(rgb, normals, &region, &pixels);
        observations.dense = dense;
        Ok(observations)
    }
}

/// Returns the pixels with a coverage of at least [`COVERED`].
///
/// Without a coverage, returns the pixels with a normal whose neighbours all have one.
fn covered_pixels(normals: &Plane<Vec3>, coverage: Option<&Plane<f32>>) -> Plane<bool> {
    let (width, height) = normals.size();
    Plane::from_fn(width, height, |x, y| match coverage {
        Some(coverage) => coverage[(x, y)] >= COVERED,
        None => {
            has_normal(normals[(x, y)])
                && neighbours((x, y), (width, height), true).all(|next| has_normal(normals[next]))
        }
    })
}

/// Removes the candidates at edges of the surface, and returns the pixels of those whose cosine
/// exceeds `least`.
fn remove_edges(candidates: &mut Vec<Candidate>, surface: &SurfaceView<'_>, least: f64) -> Vec<usize> {
    let width = surface.normals.width();
    let mut edges = Vec::new();
    candidates.retain(|candidate| {
        let pixel = candidate.pixel as usize;
        let is_edge = surface.is_edge(pixel % width, pixel / width);
        if is_edge && candidate.cosine(surface) > least {
            edges.push(pixel);
        }
        !is_edge
    });
    edges
}

/// Checks that there are enough candidates, with enough different directions.
fn check_directions<'a>(
    candidates: impl Iterator<Item = &'a Candidate>,
    surface: &SurfaceView<'_>,
    covered: &Plane<bool>,
) -> Result<(), SceneError> {
    let mut directions: Vec<usize> = candidates.map(|c| cell(c.in_view(surface), COUNTING_SIDE)).collect();
    let used = directions.len();
    if used < MIN_POINTS {
        let covered = covered.as_slice().iter().filter(|c| **c).count();
        return Err(SceneError::TooFewNormals { used, covered });
    }
    directions.sort_unstable();
    directions.dedup();
    if directions.len() < MIN_POINTS {
        return Err(SceneError::TooFlat { directions: directions.len() });
    }
    Ok(())
}

/// Removes the candidates that are specks, and marks those within the largest angle.
///
/// Returns the number of specks.
fn remove_specks(
    candidates: &mut Vec<Candidate>,
    rgb: &Plane<Vec3>,
    region: &Plane<bool>,
    statuses: &mut Plane<PixelStatus>,
) -> usize {
    let (count, width) = (candidates.len(), rgb.width());
    candidates.retain(|candidate| {
        let pixel = candidate.pixel as usize;
        let at = (pixel % width, pixel / width);
        let speck = statuses[at] != PixelStatus::Outlier && is_speck(rgb, region, at);
        if speck && statuses[at] != PixelStatus::Outside {
            statuses[at] = PixelStatus::Speck;
        }
        !speck
    });
    count - candidates.len()
}

/// Returns the colour that is observed at a pixel (row-major index).
fn observed_colour(rgb: &Plane<Vec3>, statuses: &Plane<PixelStatus>, pixel: usize) -> ObservedColour {
    match statuses.as_slice()[pixel] {
        PixelStatus::Clipped => ObservedColour::Clipped,
        PixelStatus::OtherColour => ObservedColour::OtherColour,
        PixelStatus::Outlier => repaired(rgb, statuses, pixel).map_or(ObservedColour::Faulty, ObservedColour::Colour),
        status if status.is_faulty() => ObservedColour::Faulty,
        _ => ObservedColour::Colour(rgb.as_slice()[pixel]),
    }
}

/// Whether a valid pixel is less than a quarter as bright as each of its neighbours in the region.
///
/// False for pixels with fewer than five such neighbours.
fn is_speck(rgb: &Plane<Vec3>, region: &Plane<bool>, at: (usize, usize)) -> bool {
    if PixelStatus::fault(rgb[at]).is_some() {
        return false;
    }
    let own = luminance(rgb[at]);
    let around = || neighbours(at, rgb.size(), true).filter(|next| region[*next]);
    around().count() >= 5 && around().all(|next| luminance(rgb[next]) > 4.0 * own)
}

/// A pixel (row-major index) that faces the camera, and its normal as in the map.
///
/// The type is small because photographs have millions of them.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    pixel: u32,
    normal: Vec3,
}

impl Candidate {
    fn point(&self, surface: &SurfaceView<'_>) -> SurfacePoint {
        SurfacePoint { normal: self.normal.as_dvec3().normalize(), view: surface.view(self.pixel as usize) }
    }

    /// Returns the cosine of the angle between normal and view.
    fn cosine(&self, surface: &SurfaceView<'_>) -> f64 {
        let SurfacePoint { normal, view } = self.point(surface);
        normal.dot(view)
    }

    /// Returns the normal in the frame of its own view.
    fn in_view(&self, surface: &SurfaceView<'_>) -> DVec3 {
        self.point(surface).in_view()
    }
}

/// Whether a pixel (row-major index) has a unit normal that faces the camera.
fn is_sound(surface: &SurfaceView<'_>, pixel: usize) -> bool {
    let normal = surface.normals.as_slice()[pixel];
    let unit = has_normal(normal) && (normal.length() - 1.0).abs() <= LENGTH_TOLERANCE;
    unit && Candidate { pixel: pixel as u32, normal }.cosine(surface) > 0.0
}

/// Collects the covered pixels whose normals are valid and face the camera, row-major.
fn facing(surface: &SurfaceView<'_>, covered: &Plane<bool>) -> Result<(Vec<Candidate>, ObservationReport), SceneError> {
    let mut report = ObservationReport::default();
    let (mut count, mut worst) = (0, 1.0_f32);
    let mut kept = Vec::new();
    let each = surface.normals.as_slice().iter().zip(covered.as_slice()).enumerate();
    for (i, (&normal, _)) in each.filter(|(_, (_, covered))| **covered) {
        if !has_normal(normal) {
            report.without_normal += 1;
            continue;
        }
        count += 1;
        let length = normal.length();
        if (length - 1.0).abs() > (worst - 1.0).abs() {
            worst = length;
        }
        if (length - 1.0).abs() > LENGTH_TOLERANCE {
            report.not_unit += 1;
            continue;
        }
        let candidate = Candidate { pixel: i as u32, normal };
        if candidate.cosine(surface) <= 0.0 {
            report.facing_away += 1;
        } else {
            kept.push(candidate);
        }
    }
    let too_many = |faulty: usize, of: usize| faulty as f64 > MAX_FAULTY * of as f64;
    let unit = count - report.not_unit;
    if count == 0 {
        Err(SceneError::NoNormals)
    } else if too_many(report.not_unit, count) {
        Err(SceneError::NotUnit { count: report.not_unit, covered: count, worst: f64::from(worst) })
    } else if too_many(report.facing_away, unit) {
        Err(SceneError::FacingAway { count: report.facing_away, covered: unit })
    } else {
        Ok((kept, report))
    }
}

/// Selects at most `most` of the candidates, evenly over the directions, and keeps their order.
fn thin(candidates: &[Candidate], surface: &SurfaceView<'_>, most: usize) -> Vec<Candidate> {
    if candidates.len() <= most {
        return candidates.to_vec();
    }
    // The visible hemisphere covers half of the square.
    let side = ((2.0 * most as f64 / POINTS_PER_CELL).sqrt() as usize).max(1);
    let mut cells: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, candidate) in candidates.iter().enumerate() {
        cells.entry(cell(candidate.in_view(surface), side)).or_default().push(i);
    }
    // Largest number that can be taken from each cell. It is at least one, because there are fewer
    // cells than requested points.
    let total = |each: usize| cells.values().map(|cell| cell.len().min(each)).sum::<usize>();
    let (mut fits, mut exceeds) = (1, candidates.len());
    while exceeds - fits > 1 {
        let middle = fits.midpoint(exceeds);
        if total(middle) <= most { fits = middle } else { exceeds = middle }
    }
    let mut taken: Vec<usize> = Vec::new();
    for cell in cells.values() {
        let count = cell.len().min(fits);
        taken.extend((0..count).map(|i| cell[(2 * i + 1) * cell.len() / (2 * count)]));
    }
    taken.sort_unstable();
    taken.into_iter().map(|i| candidates[i]).collect()
}

#[cfg(test)]
mod tests;
