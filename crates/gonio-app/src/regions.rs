//! Estimates several materials in one photograph: labelled regions or several balls.

use std::collections::BTreeMap;

use glam::Vec3;
use gonio::estimate::{EstimateStage, MaterialEstimate, RegionEstimate, estimate_regions};
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::scene::{Circle, ObjectShape, Observations, outline_of_ball, separate_balls};
use gonio_io::picture::{ReadOptions, encode_png};
use gonio_io::result::{self, REGIONS_FORMAT, RegionEntry, RegionsDocument, VERSION};
use gonio_report::combined::{Shown, side_by_side};
use gonio_report::regions::{outlined, page};

use crate::inference::{InferenceContext, InferenceResult, MethodResult, assemble, of_one, solve};
use crate::reference::Reference;
use crate::results::{MATERIALS, REPORT, RESULT};
use crate::scene::{LoadedScene, RegionMask};
use crate::shape::CIRCLE_AND_CAMERA;
use crate::{AppError, Method, ProgressLog, Scene, Settings, Source, Warning};

/// Largest number of regions in a photograph.
pub(crate) const MAX_REGIONS: usize = 16;

/// Share of the labelled pixels below which a colour is not a label but a blend of two.
const MIN_LABEL_SHARE: f64 = 0.005;

/// Positions of the regions of a photograph.
#[derive(Clone, Debug)]
pub enum Regions {
    /// Image with one index or colour per region, and black elsewhere.
    Labels(Source<Plane<Vec3>>),
    /// The outlines of balls.
    Circles(Vec<Circle>),
    /// Separate balls, to be detected.
    Balls,
}

/// A region and its result.
pub struct Region {
    /// Its name: the index or colour of its label, or the number of the ball.
    pub name: String,
    /// Result of the inference.
    pub result: InferenceResult,
    /// Albedo relative to that of the brightest region, in 0..=1; `None` under a known light, where
    /// the result has `exposure.albedo`.
    pub relative_albedo: Option<f64>,
}

/// The materials of a photograph.
pub struct RegionsResult {
    /// The regions.
    pub regions: Vec<Region>,
    /// Contents of `result.json`.
    pub document: RegionsDocument,
    /// Picture of the regions and a sphere of each material, as linear display values.
    pub overview: Option<Plane<Vec3>>,
    /// The page `report.html`, if requested.
    pub page: Option<String>,
}

/// Result for a photograph of one material or of several.
pub enum InferenceOutcome {
    /// One material.
    Material(Box<InferenceResult>),
    /// Several materials.
    Regions(Box<RegionsResult>),
}

/// Infers the materials in a photograph: of the given regions, of several balls, or of one object.
///
/// # Errors
/// See [`infer`](crate::infer) and [`infer_regions`].
pub fn infer_all(
    model: (&Model, &str),
    scene: Scene,
    regions: Option<&Regions>,
    settings: &Settings<'_>,
    progress_log: &ProgressLog<'_>,
) -> Result<InferenceOutcome, AppError> {
    if let Some(regions) = regions {
        return Ok(InferenceOutcome::Regions(Box::new(infer_regions(model, scene, regions, settings, progress_log)?)));
    }
    let (mut context, mut warnings) = (InferenceContext::of(model, settings)?, Vec::new());
    let scene = context.load(scene, None, settings, &mut warnings, progress_log)?;
    if settings.method.paper().is_none() && shows_several_balls(&scene) {
        let found = of_regions(&context, &scene, &Regions::Balls, settings, warnings, progress_log)?;
        return Ok(InferenceOutcome::Regions(Box::new(found)));
    }
    Ok(InferenceOutcome::Material(Box::new(of_one(&context, &scene, settings, warnings, progress_log)?)))
}

/// Whether a scene whose ball is to be detected shows several separate balls.
pub(crate) fn shows_several_balls(scene: &LoadedScene) -> bool {
    matches!(scene.object, ObjectShape::Sphere(None)) && balls_in(scene).len() > 1
}

/// Returns the coverage of each separate ball, except for a grey ball as reference.
fn balls_in(scene: &LoadedScene) -> Vec<Plane<f32>> {
    let reference = scene.reference.as_ref().and_then(Reference::grey_ball_outline);
    let is_reference = |ball: &Plane<f32>| {
        reference.is_some_and(|circle| {
            let within = |v: f64, side: usize| (0.0..side as f64).contains(&v);
            within(circle.x, ball.width())
                && within(circle.y, ball.height())
                && ball[(circle.x as usize, circle.y as usize)] > 0.5
        })
    };
    let mut balls = separate_balls(scene.picture(), scene.mask.as_ref());
    balls.retain(|ball| !is_reference(ball));
    balls
}

/// Infers the material of each region of a photograph, under one light.
///
/// # Errors
/// See [`infer`](crate::infer). Also if labels are invalid, or the method is one of the paper's.
/// The message of an error in a region includes the name of the region.
pub fn infer_regions(
    model: (&Model, &str),
    scene: Scene,
    regions: &Regions,
    settings: &Settings<'_>,
    progress_log: &ProgressLog<'_>,
) -> Result<RegionsResult, AppError> {
    if settings.method.paper().is_some() {
        return Err(AppError::new(
            "this method estimates one material; for several materials, use the method learnt or known-light",
        ));
    }
    let (mut context, mut warnings) = (InferenceContext::of(model, settings)?, Vec::new());
    let scene = context.load(scene, Some(regions), settings, &mut warnings, progress_log)?;
    of_regions(&context, &scene, regions, settings, warnings, progress_log)
}

fn of_regions(
    context: &InferenceContext<'_>,
    scene: &LoadedScene,
    regions: &Regions,
    settings: &Settings<'_>,
    warnings: Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<RegionsResult, AppError> {
    let (name, linear) = (scene.name(), scene.linear);
    let parts = region_masks(scene, regions)?;
    let mut observed_parts = Vec::new();
    for part in &parts {
        let mut own = Vec::new();
        let observed = scene
            .observe(Some(part), context.observing(settings), &mut own, progress_log)
            .map_err(|problem| problem.within(&format!("region {}", part.name)))?;
        observed_parts.push((observed, own));
    }
    // All regions share the reference of the photograph.
    let rule = observed_parts.first().map_or(context.rule, |(observed, _)| context.rule_of(observed)).0;
    let estimate_settings = settings.estimate(rule);
    let estimates = match settings.method {
        Method::Learnt => {
            let all: Vec<&Observations> =
                observed_parts.iter().map(|(observed, _)| &observed.detection.observations).collect();
            let begin = |stage: EstimateStage| progress_log.report(stage.name(), 0.0);
            let found = estimate_regions(&context.model, &all, &estimate_settings, &begin)
                .map_err(|(at, error)| AppError::of(name, error).within(&format!("region {}", parts[at].name)))?;
            found.into_iter().map(Some).collect()
        }
        _ => vec![None; parts.len()],
    };
    let mut results = Vec::new();
    for ((part, (observed, mut own)), estimate) in parts.iter().zip(observed_parts).zip(estimates) {
        let relative_albedo = estimate.as_ref().map(|estimate: &RegionEstimate| estimate.relative_albedo);
        let found = match estimate {
            Some(RegionEstimate { estimate, relative_albedo }) => {
                let mut found =
                    MethodResult::blind(estimate, (&observed, name), (&estimate_settings, linear), &mut own);
                found.document.relative_albedo = Some(relative_albedo);
                found
            }
            None => solve(context, &observed, (name, linear), settings, &mut own, progress_log)
                .map_err(|problem| problem.within(&format!("region {}", part.name)))?,
        };
        let found = found.scaled_by_reference(&observed, name, &mut own);
        let result = assemble(context, observed, found, name, settings, own, progress_log);
        results.push(Region { name: part.name.clone(), result, relative_albedo });
    }
    Ok(RegionsResult::of(name, scene.picture(), &parts, results, &warnings, settings))
}

/// Returns the regions with their masks.
pub(crate) fn region_masks(scene: &LoadedScene, regions: &Regions) -> Result<Vec<RegionMask>, AppError> {
    let (picture, mask, name) = (scene.picture(), scene.mask.as_ref(), scene.name());
    let size = picture.rgb.size();
    let ball = |at: usize, mask: Plane<f32>, object| RegionMask { name: (at + 1).to_string(), mask, object };
    match regions {
        Regions::Labels(_) if matches!(scene.object, ObjectShape::Outline) => Err(AppError::new(
            "an outline cannot be inflated for each region; specify the shape of the object by normals or a mesh",
        )),
        Regions::Labels(source) => {
            let inside = mask.or(picture.varying_alpha());
            let labels = read_labels(source, size, name)?;
            // All regions of a ball share its outline.
            let object = match &scene.object {
                ObjectShape::Sphere(None) => {
                    let outline = outline_of_ball(picture, mask);
                    ObjectShape::Sphere(Some(outline.map_err(|error| AppError::of_scene(name, &error))?.0))
                }
                object => object.clone(),
            };
            let part = |(name, own): (String, Plane<bool>)| {
                let mask = Plane::from_fn(size.0, size.1, |x, y| {
                    if own[(x, y)] { inside.map_or(1.0, |mask| mask[(x, y)]) } else { 0.0 }
                });
                RegionMask { name, mask, object: object.clone() }
            };
            Ok(labels.into_iter().map(part).collect())
        }
        Regions::Circles(_) if scene.camera.is_some() => Err(AppError::new(CIRCLE_AND_CAMERA)),
        Regions::Circles(circles) if circles.len() > MAX_REGIONS => {
            let problem = format!("{} circles: the limit is {MAX_REGIONS}; use fewer", circles.len());
            Err(AppError::of(name, problem))
        }
        Regions::Circles(circles) => {
            let of =
                |(at, circle): (usize, &Circle)| ball(at, circle.coverage(size), ObjectShape::Sphere(Some(*circle)));
            Ok(circles.iter().enumerate().map(of).collect())
        }
        Regions::Balls => {
            let found = balls_in(scene);
            if found.len() > MAX_REGIONS {
                let problem = format!(
                    "detected {} balls, more than the limit of {MAX_REGIONS}; select balls by a mask or circles",
                    found.len()
                );
                return Err(AppError::of(name, problem));
            }
            let object = || scene.camera.map_or(ObjectShape::Sphere(None), ObjectShape::Ball);
            Ok(found.into_iter().enumerate().map(|(at, mask)| ball(at, mask, object())).collect())
        }
    }
}

/// Largest distance of a label from an 8-bit code, in codes: more than rounding, and less than one
/// code of 16 bits.
const MAX_CODE_ERROR: f32 = 1e-3;

/// Reads an image of labels. Returns the name of each label, and the pixels whose neighbours all
/// have the same label.
fn read_labels(
    source: &Source<Plane<Vec3>>,
    size: (usize, usize),
    image: &str,
) -> Result<Vec<(String, Plane<bool>)>, AppError> {
    let name = source.name("the labels");
    let labels = match source {
        Source::Memory(labels) => labels.clone(),
        Source::File(path) => {
            let options = ReadOptions { linear: true, ..ReadOptions::default() };
            gonio_io::picture::read_unconverted(path, &options)?.picture.rgb
        }
    };
    if labels.size() != size {
        let ((w, h), (pw, ph)) = (labels.size(), size);
        return Err(AppError::of(
            name,
            format!("the labels are {w}x{h} pixels, but {image} is {pw}x{ph}; use labels of the same size"),
        ));
    }
    // Rounding would merge the indices of other formats: 1 and 2 of 16 bits are 0 of 8 bits.
    let is_code = |v: f32| (0.0..=1.0).contains(&v) && (v * 255.0 - (v * 255.0).round()).abs() < MAX_CODE_ERROR;
    if !labels.as_slice().iter().all(|v| v.to_array().into_iter().all(is_code)) {
        let problem = "contains values that are not 8-bit codes; save the labels as an 8-bit image, with an index (1 to \
                       255) or a colour for each region";
        return Err(AppError::of(name, problem));
    }
    let code = |v: Vec3| v.to_array().map(|v| (v * 255.0).round() as u8);
    let codes = labels.map(|v| code(*v));
    let mut counts: BTreeMap<[u8; 3], usize> = BTreeMap::new();
    codes.as_slice().iter().filter(|code| **code != [0; 3]).for_each(|code| *counts.entry(*code).or_default() += 1);
    let total: usize = counts.values().sum();
    let kept: Vec<[u8; 3]> = counts
        .into_iter()
        .filter(|(_, count)| *count as f64 >= MIN_LABEL_SHARE * total as f64)
        .map(|(code, _)| code)
        .collect();
    match kept.len() {
        0 => return Err(AppError::of(name, "is black; assign an index or colour to each region")),
        n if n > MAX_REGIONS => {
            let problem = format!(
                "contains {n} colours; use one colour for each of at most {MAX_REGIONS} regions, without antialiasing"
            );
            return Err(AppError::of(name, problem));
        }
        _ => (),
    }
    let whole = |x: usize, y: usize, code: [u8; 3]| {
        let near = |at: usize, most: usize| at.saturating_sub(1)..(at + 2).min(most);
        near(y, size.1).all(|v| near(x, size.0).all(|u| codes[(u, v)] == code))
    };
    let region = |code: [u8; 3]| {
        let named = if code[0] == code[1] && code[1] == code[2] {
            code[0].to_string()
        } else {
            format!("{:02x}{:02x}{:02x}", code[0], code[1], code[2])
        };
        (named, Plane::from_fn(size.0, size.1, |x, y| codes[(x, y)] == code && whole(x, y, code)))
    };
    Ok(kept.into_iter().map(region).collect())
}

impl RegionsResult {
    fn of(
        image: &str,
        picture: &Picture,
        parts: &[RegionMask],
        regions: Vec<Region>,
        warnings: &[Warning],
        settings: &Settings<'_>,
    ) -> Self {
        let warnings: Vec<String> = warnings.iter().map(|warning| warning.worded(settings.words)).collect();
        let entry = |region: &Region| RegionEntry {
            name: region.name.clone(),
            verdict: region.result.material.as_ref().map(MaterialEstimate::verdict),
            folder: region.name.clone(),
            relative_albedo: region.relative_albedo,
            roughness: region.result.material.as_ref().map(|material| material.highlight.roughness().into()),
            misfit: region.result.residual.1,
            warnings: region.result.warnings.clone(),
        };
        let document = RegionsDocument {
            format: REGIONS_FORMAT.to_owned(),
            version: VERSION,
            gonio: env!("CARGO_PKG_VERSION").to_owned(),
            image: image.to_owned(),
            method: settings.method.name().to_owned(),
            regions: regions.iter().map(entry).collect(),
            warnings,
        };
        let overview = settings.pictures.then(|| {
            let masks: Vec<&Plane<f32>> = parts.iter().map(|part| &part.mask).collect();
            let (map, colours) = outlined(picture, &masks);
            let spheres: Vec<Shown> = regions
                .iter()
                .map(|region| Shown {
                    label: format!("region {}", region.name),
                    tables: region.result.colouring.field().tables(&region.result.table),
                })
                .collect();
            side_by_side((&map, "regions"), &spheres, &colours, &format!("{image} | {} materials", spheres.len()))
        });
        let page = overview.as_ref().filter(|_| settings.report).map(|overview| {
            let name =
                |region: &Region| Some(region.result.material.as_ref()?.posterior.neighbours.first()?.name.clone());
            let nearest: Vec<Option<String>> = regions.iter().map(name).collect();
            page(image, overview, &document, &nearest)
        });
        Self { regions, document, overview, page }
    }

    /// Returns names and contents of all files; those of a region are in a folder with its name.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let mut files = vec![(RESULT.to_owned(), result::encode(&self.document).into_bytes())];
        files.extend(self.overview.as_ref().map(|overview| (MATERIALS.to_owned(), encode_png(overview))));
        files.extend(self.page.as_ref().map(|page| (REPORT.to_owned(), page.clone().into_bytes())));
        for region in &self.regions {
            let own = region.result.files().encode();
            files.extend(own.into_iter().map(|(name, bytes)| (format!("{}/{name}", region.name), bytes)));
        }
        files
    }
}
