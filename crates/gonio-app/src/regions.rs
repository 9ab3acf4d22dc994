//! Estimates several materials in one photograph: labelled regions or several balls.

use std::collections::BTreeMap;

use glam::Vec3;
use gonio::estimate::{Beside, Stage, estimate_together};
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::scene::{Circle, Observations, outline_of_ball, separate_balls};
use gonio_io::picture::{ReadOptions, encode_png};
use gonio_report::combined::{Shown, side_by_side};
use gonio_report::regions::{Row, page, painted};
use serde_json::{Value, json};

use crate::answer::{Found, InferenceContext, InferenceResult, assemble, of_one, solve};
use crate::mask::disk_of;
use crate::results::{MATERIALS, REPORT, RESULT};
use crate::scene::read_mask;
use crate::{
    Form, Method, Photograph, PhotographSource, Problem, ProgressLog, Scene, Settings, Source, Warning, notes,
};

/// Largest number of regions in a photograph.
pub(crate) const MOST: usize = 16;

/// Share of the labelled pixels below which a colour is not a label but a blend of two.
const LEAST: f64 = 0.005;

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
    pub answer: InferenceResult,
    /// Albedo relative to that of the brightest region, in 0..=1; `None` under a known light, where
    /// the result has `exposure.albedo`.
    pub relative_albedo: Option<f64>,
}

/// The materials of a photograph.
pub struct Several {
    /// The regions.
    pub regions: Vec<Region>,
    /// Contents of `result.json`.
    pub notes: Value,
    /// Picture of the regions and a sphere of each material, as linear display values.
    pub overview: Option<Plane<Vec3>>,
    /// The page `report.html`, if requested.
    pub page: Option<String>,
}

/// A region before inference.
pub(crate) struct Part {
    pub(crate) name: String,
    pub(crate) mask: Plane<f32>,
    form: Form,
}

/// Result for a photograph of one material or of several.
pub enum Inferred {
    /// One material.
    One(Box<InferenceResult>),
    /// Several materials.
    Several(Several),
}

/// Infers the materials in a photograph: of the given regions, of several balls, or of one object.
///
/// # Errors
/// See [`infer`](crate::infer) and [`infer_regions`].
pub fn infer_all(
    model: (&Model, &str),
    mut scene: Scene,
    regions: Option<&Regions>,
    settings: &Settings<'_>,
    progress_log: &ProgressLog<'_>,
) -> Result<Inferred, Problem> {
    if let Some(regions) = regions {
        return Ok(Inferred::Several(infer_regions(model, scene, regions, settings, progress_log)?));
    }
    let (mut asked, mut warnings) = (InferenceContext::of(model, settings)?, Vec::new());
    scene = asked.with_mirror_ball(scene, None, settings, &mut warnings, progress_log)?;
    if may_be_several(&scene) && settings.method.search().is_none() {
        progress_log.at("reading", 0.0);
        let photograph = scene.shots.read(&scene.reading, scene.clip, &mut warnings)?;
        // The mask is read again, with its warnings, when it is used.
        let mask = read_mask(scene.mask.clone(), photograph.picture.rgb.size(), &mut Vec::new())?;
        let several = separate_balls(&photograph.picture, mask.as_ref()).len() > 1;
        scene.shots = PhotographSource::Read(photograph);
        if several {
            return Ok(Inferred::Several(of_regions(
                &asked,
                scene,
                &Regions::Balls,
                settings,
                warnings,
                progress_log,
            )?));
        }
    }
    Ok(Inferred::One(Box::new(of_one(&asked, scene, settings, warnings, progress_log)?)))
}

/// Whether a scene can contain several separate balls.
pub(crate) fn may_be_several(scene: &Scene) -> bool {
    matches!((&scene.shape.form, &scene.shape.camera), (Form::Sphere(None), None))
}

impl Part {
    /// Returns the scene of this region only.
    pub(crate) fn scene(&self, whole: &Scene, photograph: &Photograph) -> Scene {
        Scene {
            shots: PhotographSource::Read(photograph.clone()),
            mask: Some(Source::Here(self.mask.clone())),
            // The mask of each region separates the materials.
            keep_colours: true,
            // The checks that `force` skips apply to whole objects, not to regions.
            force: true,
            shape: crate::Shape { form: self.form.clone(), ..whole.shape.clone() },
            ..whole.clone()
        }
    }
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
) -> Result<Several, Problem> {
    if settings.method.search().is_some() {
        return Err(Problem::new("several materials require the method learnt or known-light"));
    }
    let (mut asked, mut warnings) = (InferenceContext::of(model, settings)?, Vec::new());
    let scene = asked.with_mirror_ball(scene, Some(regions), settings, &mut warnings, progress_log)?;
    of_regions(&asked, scene, regions, settings, warnings, progress_log)
}

fn of_regions(
    asked: &InferenceContext<'_>,
    scene: Scene,
    regions: &Regions,
    settings: &Settings<'_>,
    mut warnings: Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<Several, Problem> {
    progress_log.at("reading", 0.0);
    let photograph = scene.shots.clone().read(&scene.reading, scene.clip, &mut warnings)?;
    let mask = read_mask(scene.mask.clone(), photograph.picture.rgb.size(), &mut warnings)?;
    let parts = parts(&photograph.picture, mask.as_ref(), &scene, regions)?;
    let mut looked = Vec::new();
    for part in &parts {
        let one = part.scene(&scene, &photograph);
        let mut own = Vec::new();
        let of = |problem: Problem| problem.within(&format!("region {}", part.name));
        let seen = asked.look(one, settings, &mut own, progress_log).map_err(of)?;
        looked.push((seen, own));
    }
    let linear = scene.reading.linear;
    // All regions share the reference of the photograph.
    let rule = looked.first().map_or(asked.rule, |(seen, _)| asked.rule_of(seen)).0;
    let together = match settings.method {
        Method::Learnt => {
            let all: Vec<&Observations> = looked.iter().map(|(seen, _)| &seen.detection.observations).collect();
            let ask = settings.estimate(rule);
            let begin = |stage: Stage| progress_log.at(stage.name(), 0.0);
            let found = estimate_together(&asked.model, &all, &ask, &begin)
                .map_err(|(at, error)| Problem::of(&scene.name, error).within(&format!("region {}", parts[at].name)))?;
            found.into_iter().map(Some).collect()
        }
        _ => vec![None; parts.len()],
    };
    let mut done = Vec::new();
    for ((part, (seen, mut own)), beside) in parts.iter().zip(looked).zip(together) {
        let relative_albedo = beside.as_ref().map(|beside: &Beside| beside.relative_albedo);
        let found = match beside {
            Some(Beside { estimate, relative_albedo }) => {
                let ask = settings.estimate(rule);
                let mut found = Found::blind(estimate, (&seen, &scene.name), notes::settings(&ask, linear), &mut own);
                found.sections["relative_albedo"] = json!(relative_albedo);
                found
            }
            None => solve(asked, &seen, (&scene.name, linear), settings, &mut own, progress_log)
                .map_err(|problem| problem.within(&format!("region {}", part.name)))?,
        };
        let found = found.scaled_by_reference(&seen, &scene.name, &mut own);
        let answer = assemble(asked, seen, found, &scene.name, settings, own, progress_log);
        done.push(Region { name: part.name.clone(), answer, relative_albedo });
    }
    Ok(Several::of(&scene.name, &photograph.picture, &parts, done, &warnings, settings))
}

/// Returns the regions with their masks.
pub(crate) fn parts(
    picture: &Picture,
    mask: Option<&Plane<f32>>,
    scene: &Scene,
    regions: &Regions,
) -> Result<Vec<Part>, Problem> {
    let size = picture.rgb.size();
    let ball =
        |at: usize, mask: Plane<f32>, circle| Part { name: (at + 1).to_string(), mask, form: Form::Sphere(circle) };
    match regions {
        Regions::Labels(source) => {
            let inside = mask.or(picture.alpha.as_ref());
            let labels = read_labels(source, size, &scene.name)?;
            // All regions of a ball share its outline.
            let form = match (&scene.shape.form, &scene.shape.camera) {
                (Form::Sphere(None), None) => Form::Sphere(Some(
                    outline_of_ball(picture, mask).map_err(|error| Problem::of_scene(&scene.name, &error))?.0,
                )),
                (Form::Outline, _) => {
                    return Err(Problem::new(
                        "an outline cannot be inflated for each region; specify the shape of the object by normals or a mesh",
                    ));
                }
                (form, _) => form.clone(),
            };
            let part = |(name, own): (String, Plane<bool>)| {
                let mask = Plane::from_fn(size.0, size.1, |x, y| {
                    if own[(x, y)] { inside.map_or(1.0, |mask| mask[(x, y)]) } else { 0.0 }
                });
                Part { name, mask, form: form.clone() }
            };
            Ok(labels.into_iter().map(part).collect())
        }
        Regions::Circles(circles) => {
            Ok(circles.iter().enumerate().map(|(at, circle)| ball(at, disk_of(circle, size), Some(*circle))).collect())
        }
        Regions::Balls => {
            let found = separate_balls(picture, mask);
            if found.len() > MOST {
                let problem = format!(
                    "detected {} balls, more than the limit of {MOST}; select balls by a mask or circles",
                    found.len()
                );
                return Err(Problem::of(&scene.name, problem));
            }
            Ok(found.into_iter().enumerate().map(|(at, mask)| ball(at, mask, None)).collect())
        }
    }
}

/// Reads an image of labels. Returns the name of each label, and the pixels whose neighbours all
/// have the same label.
fn read_labels(
    source: &Source<Plane<Vec3>>,
    size: (usize, usize),
    image: &str,
) -> Result<Vec<(String, Plane<bool>)>, Problem> {
    let name = source.name("the labels");
    let labels = match source {
        Source::Here(labels) => labels.clone(),
        Source::File(path) => {
            let options = ReadOptions { linear: true, ..ReadOptions::default() };
            gonio_io::picture::read_unconverted(path, &options)?.picture.rgb
        }
    };
    if labels.size() != size {
        let ((w, h), (pw, ph)) = (labels.size(), size);
        return Err(Problem::of(
            name,
            format!("the labels are {w}x{h} pixels, but {image} is {pw}x{ph}; use labels of the same size"),
        ));
    }
    let code = |v: Vec3| v.to_array().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8);
    let codes = labels.map(|v| code(*v));
    let mut counts: BTreeMap<[u8; 3], usize> = BTreeMap::new();
    codes.as_slice().iter().filter(|code| **code != [0; 3]).for_each(|code| *counts.entry(*code).or_default() += 1);
    let total: usize = counts.values().sum();
    let kept: Vec<[u8; 3]> =
        counts.into_iter().filter(|(_, count)| *count as f64 >= LEAST * total as f64).map(|(code, _)| code).collect();
    match kept.len() {
        0 => return Err(Problem::of(name, "is black; assign an index or colour to each region")),
        n if n > MOST => {
            let problem = format!(
                "contains {n} colours; use one colour for each of at most {MOST} regions, without antialiasing"
            );
            return Err(Problem::of(name, problem));
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

impl Several {
    fn of(
        image: &str,
        picture: &Picture,
        parts: &[Part],
        regions: Vec<Region>,
        warnings: &[Warning],
        settings: &Settings<'_>,
    ) -> Self {
        let warnings: Vec<String> = warnings.iter().map(|warning| warning.worded(settings.words)).collect();
        let gloss = |region: &Region| region.answer.material.as_ref().map(|material| material.gloss);
        let notes = json!({
            "format": "gonio-regions",
            "version": 1,
            "gonio": env!("CARGO_PKG_VERSION"),
            "image": image,
            "method": settings.method.name(),
            "regions": regions.iter().map(|region| json!({
                "name": region.name,
                "folder": region.name,
                "relative_albedo": region.relative_albedo,
                "gloss": gloss(region),
                "misfit": region.answer.left.1,
                "warnings": region.answer.warnings,
            })).collect::<Vec<_>>(),
            "warnings": warnings,
            "note": "each region has its own folder of results; relative_albedo: albedo at normal incidence, relative to that of \
                     the brightest region, since all regions are under one light",
        });
        let overview = settings.pictures.then(|| {
            let masks: Vec<&Plane<f32>> = parts.iter().map(|part| &part.mask).collect();
            let (map, colours) = painted(picture, &masks);
            let spheres: Vec<Shown> = regions
                .iter()
                .map(|region| Shown {
                    label: format!("region {}", region.name),
                    tables: region.answer.colouring.field().tables(&region.answer.table),
                })
                .collect();
            side_by_side((&map, "regions"), &spheres, &colours, &format!("{image} | {} materials", spheres.len()))
        });
        let page = overview.as_ref().filter(|_| settings.report).map(|overview| {
            let rows: Vec<Row> = regions
                .iter()
                .map(|region| Row {
                    name: region.name.clone(),
                    gloss: gloss(region),
                    nearest: region.answer.material.as_ref().and_then(|m| m.neighbours.first()).map(|n| n.name.clone()),
                    relative_albedo: region.relative_albedo,
                    misfit: region.answer.left.1,
                    warnings: region.answer.warnings.clone(),
                })
                .collect();
            page(image, overview, &rows)
        });
        Self { regions, notes, overview, page }
    }

    /// Returns names and contents of all files; those of a region are in a folder with its name.
    ///
    /// # Errors
    /// If the numbers cannot be written as JSON.
    pub fn files(&self) -> Result<Vec<(String, Vec<u8>)>, Problem> {
        let notes = serde_json::to_string_pretty(&self.notes)
            .map_err(|error| Problem::of("cannot encode the result as JSON", error))?;
        let mut files = vec![(RESULT.to_owned(), notes.into_bytes())];
        files.extend(self.overview.as_ref().map(|overview| (MATERIALS.to_owned(), encode_png(overview))));
        files.extend(self.page.as_ref().map(|page| (REPORT.to_owned(), page.clone().into_bytes())));
        for region in &self.regions {
            let own = region.answer.files()?.encode();
            files.extend(own.into_iter().map(|(name, bytes)| (format!("{}/{name}", region.name), bytes)));
        }
        Ok(files)
    }
}
