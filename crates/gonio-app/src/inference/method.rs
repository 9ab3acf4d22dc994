//! The methods of estimation, and their common result.

use gonio::estimate::{
    ALBEDO, Alignment, Colouring, Estimate, EstimateError, EstimateSettings, EstimateStage, KnownLightEstimate, Light,
    MaterialEstimate, estimate_known_light, estimate_with_task,
};
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::reflectance::BivariateTable;
use gonio::scene::DetectedShape;
use gonio::suggestion::Suggestion;
use gonio_io::result::ResultDocument;
use gonio_paper::PaperSettings;
use gonio_report::report::Fits;

use super::InferenceContext;
use crate::{
    AppError, EnvironmentSource, Method, ObservedScene, ProgressLog, Settings, Warning, document, paper, reference,
};

/// Result of a method.
pub(crate) struct MethodResult {
    pub(super) table: BivariateTable,
    pub(super) scale: f64,
    pub(super) material: Option<MaterialEstimate>,
    pub(super) light: Option<LightGrid>,
    pub(super) known_light: Option<EnvironmentMap>,
    pub(super) residual: (&'static str, f64),
    pub(super) colouring: Colouring,
    /// The sections of the method.
    pub(crate) document: ResultDocument,
    /// Fitted renderer models, if available.
    pub(super) fits: Option<Fits>,
}

/// Estimates the BRDF of an object, and the light unless it is known.
pub(crate) fn solve(
    context: &InferenceContext<'_>,
    observed: &ObservedScene,
    (image, linear): (&str, bool),
    settings: &Settings<'_>,
    warnings: &mut Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<MethodResult, AppError> {
    let InferenceContext { model, known_light, .. } = context;
    let rule = &context.rule_of(observed).0;
    let observations = &observed.detection.observations;
    let begin = |stage: EstimateStage| progress_log.report(stage.name(), 0.0);
    let to_error = |error: EstimateError| AppError::of(image, error);
    match (&settings.method, known_light) {
        (Method::KnownLight(known), Some(map)) => {
            let found =
                estimate_known_light(model, observations, (map, known.alignment), rule, &begin).map_err(to_error)?;
            let known_light = Some(found.corrected(map));
            let scale = if known.absolute { found.exposure } else { 1.0 };
            for diagnostic in found.diagnostics() {
                let aligns =
                    (known.alignment != Alignment::Vertical).then(|| settings.method.light_suggestion()).flatten();
                let suggested = if diagnostic.is_misfit() { suggestions(observed, aligns) } else { Vec::new() };
                warnings.push(Warning::of(image, diagnostic).with(suggested));
            }
            if known.absolute && scale * ALBEDO > reference::MAX_ALBEDO {
                let cause = match known.map {
                    EnvironmentSource::Map(_) => "photograph and environment map do not have the same scale",
                    EnvironmentSource::MirrorBall(_) => "the specified reflectance of the mirror ball is too high",
                };
                let albedo = scale * ALBEDO;
                let text = format!(
                    "the absolute albedo at normal incidence is {albedo:.2}, above the physical limit of 1; {cause}"
                );
                warnings.push(Warning::of(image, text));
            }
            let mut document = document::new(settings.method.name());
            document::set_known_light(&mut document, &found, known, linear);
            let KnownLightEstimate { material, misfit, colouring, .. } = found;
            let of_table = MethodResult::new(material.table.clone(), ("misfit", misfit), colouring, document);
            Ok(MethodResult { scale, material: Some(material), known_light, ..of_table })
        }
        (Method::Learnt, _) => {
            let estimate_settings = settings.estimate(*rule);
            let wanted = settings.pictures && settings.report;
            let fit = |material: &MaterialEstimate, colouring: &Colouring| {
                let roughness = Some(material.highlight.roughness());
                wanted.then(|| Fits::of(&colouring.field().tables(&material.table), roughness, false))
            };
            let (found, fits) =
                estimate_with_task(model, observations, &estimate_settings, &begin, fit).map_err(to_error)?;
            Ok(MethodResult {
                fits,
                ..MethodResult::blind(found, (observed, image), (&estimate_settings, linear), warnings)
            })
        }
        (method, known_light) => {
            let Some(paper) = method.paper() else {
                return Err(AppError::new("this method requires a known light; specify one, or use another method"));
            };
            let how = (settings, &PaperSettings { side: settings.side, ..paper.clone() });
            let found = paper::infer((model, image), how, known_light.as_ref(), observations, warnings, progress_log)?;
            let colouring = Colouring::of(model, observations, &found.table, rule);
            let paper::PaperResult { table, light, noise, mut document } = found;
            let light = light.map(|grid| grid.coloured(colouring.light()));
            document.settings.linear = Some(linear);
            let of_table = MethodResult::new(table, ("noise", noise), colouring, document);
            Ok(MethodResult { light, known_light: known_light.clone(), ..of_table })
        }
    }
}

impl MethodResult {
    /// Creates a result with a scale of 1 and without a light, uncertainty and fits.
    fn new(
        table: BivariateTable,
        residual: (&'static str, f64),
        colouring: Colouring,
        document: ResultDocument,
    ) -> Self {
        let (material, light, known_light, fits) = (None, None, None, None);
        Self { table, scale: 1.0, material, light, known_light, residual, colouring, document, fits }
    }

    /// Converts an estimate under unknown light; its diagnostics become warnings about the
    /// photograph `image`. `linear` is true if integer values were read as linear radiance.
    pub(crate) fn blind(
        found: Estimate,
        (observed, image): (&ObservedScene, &str),
        (settings, linear): (&EstimateSettings, bool),
        warnings: &mut Vec<Warning>,
    ) -> Self {
        for diagnostic in found.diagnostics() {
            let suggested = if diagnostic.is_misfit() { suggestions(observed, None) } else { Vec::new() };
            warnings.push(Warning::of(image, diagnostic).with(suggested));
        }
        let mut document = document::new(Method::Learnt.name());
        document::set_estimate(&mut document, &found, settings, linear);
        let light = found.light_in_colour();
        let Estimate { material, light: Light { misfit, .. }, colouring, .. } = found;
        let of_table = Self::new(material.table.clone(), ("misfit", misfit), colouring, document);
        Self { material: Some(material), light: Some(light), ..of_table }
    }

    /// Scales the estimate by the reference in the photograph, if the reference determines a scale.
    pub(crate) fn scaled_by_reference(
        mut self,
        observed: &ObservedScene,
        image: &str,
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let Some(reference) = &observed.reference else { return self };
        let scale = match (&self.light, &self.material) {
            (Some(light), Some(_)) => reference.scale(light),
            _ => None,
        };
        if let (Some(scale), Some(material)) = (scale, &self.material) {
            warnings.extend(reference::too_bright(image, scale));
            self.scale = scale.factor;
            // The fits were at another scale.
            self.fits = None;
            let albedo = ALBEDO * scale.factor;
            self.document.posterior = Some(document::posterior(material, albedo));
            self.document.reflectance = document::reflectance(Some(albedo));
        }
        self.document.reference = Some(reference.section(scale));
        self
    }
}

/// Returns suggestions for a photograph that its shape and the estimate do not reproduce, the most
/// probable first.
pub(super) fn suggestions(observed: &ObservedScene, of_light: Option<Suggestion>) -> Vec<Suggestion> {
    let of_shape = match &observed.detection.placed {
        Some(placed) if placed.default_camera => vec![Suggestion::Camera, Suggestion::Pose],
        Some(_) => vec![Suggestion::Pose],
        None if observed.detection.circle().is_some() => vec![Suggestion::Outline],
        None if matches!(observed.detection.shape, DetectedShape::Outline(_)) => {
            vec![Suggestion::Mesh, Suggestion::Normals]
        }
        None => Vec::new(),
    };
    of_light.into_iter().chain(of_shape).collect()
}
