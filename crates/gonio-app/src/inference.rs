//! Estimates the BRDF and the light from a photograph.

mod method;

use std::borrow::Cow;
use std::path::Path;

use glam::Vec3;
use gonio::estimate::{
    Colouring, ColouringRule, MAX_MISFIT, MaterialEstimate, NORMAL_REFINEMENT_MISFIT, without_misleading_spots,
};
use gonio::lighting::{EnvironmentMap, LightGrid, named_light};
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::scene::ObservationSettings;
use gonio::suggestion::Suggestion;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::ReadOptions;
use gonio_io::posterior::SavedPosterior;
use gonio_io::result::ResultDocument;
use gonio_report::panels::{Panels, Subject};
use gonio_report::report::{Fits, Report};

use self::method::suggestions;
pub(crate) use self::method::{MethodResult, solve};
use crate::document;
use crate::regions::Regions;
use crate::scene::{LoadedScene, Observing};
use crate::{AppError, ObservedScene, ProgressLog, Scene, Settings, Source, Warning, combine, reference};

/// Result of an inference from one photograph.
pub struct InferenceResult {
    /// The photograph and the object in it.
    pub scene: ObservedScene,
    /// Luminance of the BRDF, scaled to an albedo of 0.5 at normal incidence (1/sr).
    pub table: BivariateTable,
    /// Factor from `table` to the BRDF in the files; 1 unless the BRDF is absolute.
    pub scale: f64,
    /// The BRDF with its uncertainty, for methods that estimate the uncertainty.
    pub material: Option<MaterialEstimate>,
    /// The estimated light, in linear RGB, on the scale of `table`.
    pub light: Option<LightGrid>,
    /// The known light with the estimated rotation and gain.
    pub known_light: Option<EnvironmentMap>,
    /// Name and value of the relative residual of the photograph, given light and BRDF.
    pub residual: (&'static str, f64),
    /// The colours of BRDF and light.
    pub colouring: Colouring,
    /// The pictures, if requested.
    pub panels: Option<Panels>,
    /// Caption of the pictures.
    pub caption: String,
    /// The page `report.html`, if requested.
    pub page: Option<String>,
    /// Contents of `result.json`.
    pub document: ResultDocument,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
    /// Posterior to combine with other photographs, for methods that estimate the uncertainty.
    pub saved: Option<SavedPosterior>,
    /// Colour space of the BRDF and the light in [`Self::files`].
    pub space: ColourSpace,
    shadows: bool,
}

/// Model, known light and rules of an inference.
pub(crate) struct InferenceContext<'a> {
    pub(crate) model: Cow<'a, Model>,
    known_light: Option<EnvironmentMap>,
    /// Rule for the colours, and the assumption on the colour of the light in words.
    pub(crate) rule: (ColouringRule, &'static str),
    observing: ObservationSettings,
}

impl<'a> InferenceContext<'a> {
    /// Checks the settings and reads the known light. `name` is the name of the model in messages.
    pub(crate) fn of((model, name): (&'a Model, &str), settings: &Settings<'_>) -> Result<Self, AppError> {
        let paper = settings.method.paper().is_some_and(|paper| paper.as_printed);
        let mut model = Cow::Borrowed(model);
        if paper {
            model.to_mut().light = gonio_io::model::lighting_of_paper()?;
        }
        settings.check(&model, name)?;
        let known_light = match settings.method.light() {
            Some(Source::File(path)) => Some(read_light(path, settings.spaces.input)?),
            Some(Source::Memory(map)) => Some(map.clone()),
            None => None,
        };
        let rule = settings.colours.rule(known_light.as_ref());
        let observing = if paper { ObservationSettings::of_paper() } else { ObservationSettings::default() };
        Ok(Self { model, known_light, rule, observing })
    }

    /// Reads the files of a scene, and the light from the mirror ball in the photograph if the
    /// settings specify one.
    pub(crate) fn load(
        &mut self,
        scene: Scene,
        regions: Option<&Regions>,
        settings: &Settings<'_>,
        warnings: &mut Vec<Warning>,
        progress_log: &ProgressLog<'_>,
    ) -> Result<LoadedScene, AppError> {
        if scene.reference.is_some() {
            let light_is_known = self.known_light.is_some() || settings.method.mirror_ball().is_some();
            reference::check(&scene.name, settings.colours, light_is_known)?;
        }
        let mut scene = scene.load(warnings, progress_log)?;
        if let Some(ball) = settings.method.mirror_ball() {
            let light = ball.light(&mut scene, regions, warnings)?;
            self.rule = settings.colours.rule(Some(&light));
            self.known_light = Some(light);
        }
        Ok(scene)
    }

    /// Returns the rule for the colours of a scene, from its reference if it has one, and the
    /// assumption on the colour of the light in words.
    pub(crate) fn rule_of(&self, observed: &ObservedScene) -> (ColouringRule, &'static str) {
        observed.reference.as_ref().map_or(self.rule, |reference| reference.rule())
    }

    /// Returns the settings of observations.
    pub(crate) fn observing(&self, settings: &Settings<'_>) -> Observing {
        let shadows = settings.shadows.then_some((self.model.light.map, settings.side));
        Observing { settings: self.observing, shadows }
    }
}

/// Estimates the BRDF of the object in a scene. The string is the name of the model in messages.
///
/// # Errors
/// If a file cannot be read, settings conflict, the object is not detected, or it has too few
/// usable pixels. The error names the faulty input.
pub fn infer(
    model: (&Model, &str),
    scene: Scene,
    settings: &Settings<'_>,
    progress_log: &ProgressLog<'_>,
) -> Result<InferenceResult, AppError> {
    let (mut context, mut warnings) = (InferenceContext::of(model, settings)?, Vec::new());
    let scene = context.load(scene, None, settings, &mut warnings, progress_log)?;
    of_one(&context, &scene, settings, warnings, progress_log)
}

/// Infers from a scene with one object; `warnings` contains those from reading the files.
pub(crate) fn of_one(
    context: &InferenceContext<'_>,
    scene: &LoadedScene,
    settings: &Settings<'_>,
    mut warnings: Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<InferenceResult, AppError> {
    let (image, linear) = (scene.name(), scene.linear);
    let mut observed = scene.observe(None, context.observing(settings), &mut warnings, progress_log)?;
    if let Some(ball) = settings.method.mirror_ball() {
        ball.check_apart(&observed.detection, image)?;
    }
    // The comparison of estimates needs the learnt posterior.
    if settings.method.paper().is_none() && context.model.learnt.is_some() {
        let cleaned = without_misleading_spots(&context.model, &observed.detection, scene.picture(), settings.side);
        if let Some(cleaned) = cleaned.map_err(|error| AppError::of(image, error))? {
            warnings.extend(cleaned.scene_warnings.last().map(|warning| scene.names.warn(warning)));
            observed.detection = cleaned;
        }
    }
    let mut own = Vec::new();
    let mut found = solve(context, &observed, (image, linear), settings, &mut own, progress_log)?;
    if let ("misfit", misfit) = found.residual
        && misfit > NORMAL_REFINEMENT_MISFIT
        && let Some(refined) = observed.detection.refined(scene.picture())
    {
        let inflated = std::mem::replace(&mut observed.detection, refined);
        let mut others = Vec::new();
        // Without a second estimate, the first one remains.
        match solve(context, &observed, (image, linear), settings, &mut others, progress_log) {
            Ok(other) if other.residual.1 < misfit => {
                (found, own) = (other, others);
            }
            _ => observed.detection = inflated,
        }
    }
    warnings.append(&mut own);
    if let ("misfit", misfit) = found.residual
        && let Some(error) = contradiction(image, misfit).filter(|_| !observed.force)
    {
        let suggested = suggestions(&observed, settings.method.light_suggestion());
        return Err(error.with(suggested).with([Suggestion::Force]));
    }
    let found = found.scaled_by_reference(&observed, image, &mut warnings);
    Ok(assemble(context, observed, found, image, settings, warnings, progress_log))
}

/// Returns the error for an estimate that does not reproduce its photograph `image`; `None` if the
/// misfit is acceptable.
pub fn contradiction(image: &str, misfit: f64) -> Option<AppError> {
    let (percent, most) = (100.0 * misfit, 100.0 * MAX_MISFIT);
    let text =
        format!("the estimate does not reproduce the photograph: the misfit is {percent:.0} % (limit {most:.0} %)");
    (misfit > MAX_MISFIT).then(|| AppError::of(image, text))
}

/// Assembles the result: pictures, report and `result.json`.
pub(crate) fn assemble(
    context: &InferenceContext<'_>,
    observed: ObservedScene,
    found: MethodResult,
    image: &str,
    settings: &Settings<'_>,
    mut warnings: Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> InferenceResult {
    let (model, (rule, assumption)) = (&context.model, &context.rule_of(&observed));
    let MethodResult { table, scale, material, light, known_light, residual, colouring, document, fits } = found;
    if matches!((rule, &colouring), (ColouringRule::Estimate { .. }, Colouring::Median(_))) {
        let problem = "the model has no colour model; the BRDF has the median colour of the photograph";
        warnings.push(Warning::of(image, problem));
    }
    let spaces = settings.spaces;
    warnings.extend(spaces.warning(image, &colouring.field().tables(&table)));
    let mut inferred = InferenceResult {
        caption: String::new(),
        panels: None,
        page: None,
        document,
        warnings: warnings.iter().map(|warning| warning.worded(settings.words)).collect(),
        space: spaces.output,
        shadows: settings.shadows,
        saved: material.as_ref().and_then(|material| combine::saved(model, image, material, &colouring)),
        scene: observed,
        table,
        scale,
        material,
        light,
        known_light,
        residual,
        colouring,
    };
    let absolute = inferred.document.reflectance.absolute;
    let fits = settings.pictures.then(|| inferred.draw(settings.report, absolute, fits, progress_log)).flatten();
    let seconds = progress_log.seconds();
    let total: f64 = seconds.iter().map(|(_, seconds)| seconds).sum();
    let (used, (residual_name, residual)) =
        (inferred.scene.detection.observations.report.used_pixels, inferred.residual);
    let method = settings.method.name();
    inferred.caption = format!("{method} | {used} pixels | {residual_name} {:.1} % | {total:.0} s", 100.0 * residual);
    let seconds = seconds.into_iter().chain([("total", total)]);
    inferred.document = ResultDocument {
        image: Some(image.to_owned()),
        model: document::model(model),
        observations: Some(inferred.scene.observations()),
        bracket: inferred.scene.photograph.bracket.clone(),
        colour: document::colour(&inferred.colouring, assumption),
        colorspace: spaces.section(inferred.scene.photograph.space.as_ref()),
        warnings: inferred.warnings.clone(),
        seconds: seconds.map(|(stage, seconds)| (stage.to_owned(), seconds)).collect(),
        ..inferred.document
    };
    inferred.page = fits.zip(inferred.panels.as_ref()).map(|(fits, panels)| {
        let name = Path::new(image).file_stem().unwrap_or_default().to_string_lossy();
        // The page escapes markup, but not control characters.
        let name = name.replace(char::is_control, " ");
        let (subject, warnings, result) = (&inferred.subject(), &inferred.warnings[..], &inferred.document);
        Report { name: &name, subject, panels, fits: &fits, warnings, result }.render()
    });
    inferred
}

impl InferenceResult {
    /// Returns the subject of the pictures.
    pub fn subject(&self) -> Subject<'_> {
        Subject {
            picture: &self.scene.photograph.picture,
            detection: &self.scene.detection,
            shadows: self.shadows,
            chroma: self.colouring.field(),
            table: &self.table,
            light: self.light.as_ref(),
            known_light: self.known_light.as_ref(),
            material: self.material.as_ref(),
        }
    }

    /// Draws the pictures. In parallel, fits renderer models if the report needs them and none
    /// exist.
    fn draw(
        &mut self,
        report: bool,
        absolute: bool,
        fits: Option<Fits>,
        progress_log: &ProgressLog<'_>,
    ) -> Option<Fits> {
        progress_log.report("drawing", 0.0);
        let subject = self.subject();
        let tables = subject.coloured(&self.table.scaled(self.scale));
        let roughness = self.material.as_ref().map(|material| material.highlight.roughness());
        let (panels, fits) = rayon::join(
            || Panels::draw(&subject, report, &|x| progress_log.report("drawing", x)),
            || fits.or_else(|| report.then(|| Fits::of(&tables, roughness, absolute))),
        );
        self.panels = Some(panels);
        fits
    }
}

/// Rows of the map of directional lights. Its pixels resolve the sharpest highlights.
const DIRECTIONAL_ROWS: usize = 1024;

/// Rows of the map of a built-in light.
const NAMED_ROWS: usize = 256;

/// Reads a lat-long environment map or a list of directional lights (`.txt`). `studio`, `sky` and
/// `lamp` are built-in lights, unless a file has that name. `space` is the colour space of files
/// that state none; `None` is linear Rec. 709.
///
/// # Errors
/// If the file cannot be read or is not a light.
pub fn read_light(path: &Path, space: Option<ColourSpace>) -> Result<EnvironmentMap, AppError> {
    if let Some(light) = path.to_str().filter(|_| !path.exists()).and_then(|name| named_light(name, NAMED_ROWS)) {
        return Ok(light);
    }
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("txt")) {
        let mut lights = gonio_io::lights::read_lights(path)?;
        if let Some(space) = space {
            let matrix = space.to_rec709().as_mat3();
            lights.iter_mut().for_each(|(_, irradiance)| *irradiance = (matrix * *irradiance).max(Vec3::ZERO));
        }
        return EnvironmentMap::of_directions(&lights, DIRECTIONAL_ROWS)
            .map_err(|error| AppError::of(path.display(), error));
    }
    let decoded = gonio_io::picture::read(path, &ReadOptions { colour_space: space, ..ReadOptions::default() })?;
    EnvironmentMap::new(decoded.picture.rgb).map_err(|error| AppError::of(path.display(), error))
}
