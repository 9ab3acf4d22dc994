//! Measures neutral references, which determine the colour of the light and the scale of
//! reflectance.

use glam::Vec3;
use gonio::estimate::{ALBEDO, ColouringRule};
use gonio::lighting::LightGrid;
use gonio::picture::{Picture, Plane};
use gonio::reference::{
    AbsoluteScale, BallReading, ChartReading, Corners, PatchReading, ReferenceError, ReferenceLight, check_apart, disk,
    find_chart,
};
use gonio::scene::{Circle, Detection};
use gonio::suggestion::Suggestion;
use gonio_io::result::{self, Patch, ReferenceKind};

use crate::scene::read_mask;
use crate::{AppError, ColourMode, Source, Warning};

/// Default reflectance of a white patch; white patches of charts and white cards have 0.88 to 0.92.
pub const WHITE_REFLECTANCE: f64 = 0.9;
/// Default reflectance of a grey card and of a grey ball.
pub const GREY_REFLECTANCE: f64 = 0.18;

/// Tilt in radians above which a chart does not determine the scale: foreshortening of 18 %.
const MAX_TILT: f64 = 35.0 / 180.0 * std::f64::consts::PI;
/// Chroma residual of a chart above which the primaries of the image are not those of Rec. 709.
const OTHER_PRIMARIES: f64 = 0.5;
/// Largest plausible albedo at normal incidence: 1 plus a margin for measurement errors.
pub(crate) const MAX_ALBEDO: f64 = 1.1;

/// Assumption on the colour of the light, in words.
const ASSUMPTION: &str = "the light has the colour of the reference in the image";

/// A neutral reference in a photograph.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Kind and position.
    pub target: ReferenceTarget,
    /// Diffuse reflectance of a patch or ball, in 0..=1; `None` for the default. Charts have
    /// published values.
    pub reflectance: Option<f64>,
    /// Use only the colour, because the reference does not face the camera or is not under the
    /// light of the object.
    pub colour_only: bool,
}

/// Kinds of references and their positions.
#[derive(Clone, Debug)]
pub enum ReferenceTarget {
    /// A white patch: the pixels of a disk.
    White(Circle),
    /// A grey card: the pixels where a mask is above one half.
    GreyCard(Source<Plane<f32>>),
    /// A matte grey ball with this outline.
    GreyBall(Circle),
    /// A 24-patch ColorChecker Classic with the centres of its corner patches; without them the
    /// chart is detected.
    Chart(Option<Corners>),
}

/// A measured reference.
#[derive(Clone, Debug)]
pub struct MeasuredReference {
    /// Light on the reference.
    pub light: ReferenceLight,
    /// Whether it determines the scale of reflectance.
    pub gives_scale: bool,
    kind: ReferenceKind,
}

impl Reference {
    /// Returns the outline of a grey ball.
    pub(crate) fn grey_ball_outline(&self) -> Option<Circle> {
        match self.target {
            ReferenceTarget::GreyBall(circle) => Some(circle),
            _ => None,
        }
    }

    /// Measures the reference in an image. `name` is the name of the photograph in messages, `clip`
    /// the radiance at which its channels clip, if known.
    ///
    /// # Errors
    /// If the mask of a grey card cannot be read, or the reference is unusable. The error names the
    /// faulty input.
    pub(crate) fn measure(
        &self,
        (name, picture, clip): (&str, &Picture, Option<f32>),
        detection: &Detection,
        warnings: &mut Vec<Warning>,
    ) -> Result<MeasuredReference, AppError> {
        let (rgb, size) = (&picture.rgb, picture.rgb.size());
        let to_error = |error: ReferenceError| AppError::of(name, &error).with(error.suggestions());
        let patch = |kind: fn(Patch) -> ReferenceKind, region: Plane<bool>, usual: f64| {
            check_apart(&region, |x, y| detection.contains(x, y))?;
            let read = PatchReading::of(rgb, &region, clip)?;
            let reflectance = self.reflectance.unwrap_or(usual);
            let PatchReading { colour, pixels, clipped, variation } = read;
            let kind = kind(Patch { reflectance, rgb: colour.to_array(), pixels, clipped, variation });
            let light = read.light(reflectance)?;
            Ok(MeasuredReference { light, gives_scale: !self.colour_only, kind })
        };
        match &self.target {
            ReferenceTarget::White(Circle { x, y, radius }) => disk(size, (*x, *y), *radius)
                .and_then(|region| patch(ReferenceKind::WhitePatch, region, WHITE_REFLECTANCE))
                .map_err(to_error),
            ReferenceTarget::GreyCard(mask) => {
                let of_mask = mask.name("the mask of the grey card");
                let mask = read_mask(Some(mask.clone()), size, warnings)?;
                let region = mask.map_or_else(|| rgb.map(|_| false), |mask| mask.map(|covered| *covered > 0.5));
                patch(ReferenceKind::GreyCard, region, GREY_REFLECTANCE)
                    .map_err(|error| to_error(error).within(&of_mask))
            }
            ReferenceTarget::GreyBall(circle) => self.grey_ball(rgb, *circle, clip, detection).map_err(to_error),
            ReferenceTarget::Chart(corners) => {
                let read = match corners {
                    Some(corners) => ChartReading::of(rgb, corners, clip),
                    None => find_chart(rgb, clip),
                };
                let read = read.map_err(to_error)?;
                check_apart(&read.region(size), |x, y| detection.contains(x, y)).map_err(to_error)?;
                Ok(self.chart(name, &read, warnings))
            }
        }
    }

    fn grey_ball(
        &self,
        rgb: &Plane<Vec3>,
        circle: Circle,
        clip: Option<f32>,
        detection: &Detection,
    ) -> Result<MeasuredReference, ReferenceError> {
        let region = disk(rgb.size(), (circle.x, circle.y), circle.radius)?;
        check_apart(&region, |x, y| detection.contains(x, y))?;
        let read = BallReading::of(rgb, &circle, clip)?;
        let reflectance = self.reflectance.unwrap_or(GREY_REFLECTANCE);
        let light = read.light(reflectance)?;
        let BallReading { centre, mean, pixels, clipped, residual } = read;
        let kind = ReferenceKind::GreyBall {
            circle: [circle.x, circle.y, circle.radius],
            reflectance,
            centre: centre.to_array(),
            mean: mean.to_array(),
            pixels,
            clipped,
            residual,
        };
        Ok(MeasuredReference { light, gives_scale: !self.colour_only, kind })
    }

    fn chart(&self, name: &str, read: &ChartReading, warnings: &mut Vec<Warning>) -> MeasuredReference {
        let tilt = read.tilt.to_degrees();
        let tilted = read.tilt > MAX_TILT;
        if tilted && !self.colour_only {
            warnings.push(
                format!(
                    "{name}: the colour chart is tilted by about {tilt:.0} degrees from the camera; gonio uses its colour, \
                     but not its brightness, so the BRDF is not absolute"
                )
                .into(),
            );
        }
        if read.chroma_residual > OTHER_PRIMARIES {
            warnings.push(
                format!(
                    "{name}: the colours of the chart differ from the published ones by {:.2} in log chroma; the \
                     primaries of the image are probably not those of Rec. 709, and the colours of the BRDF are distorted",
                    read.chroma_residual
                )
                .into(),
            );
        }
        let kind = ReferenceKind::ColourChart {
            corners: read.corners,
            detected: matches!(self.target, ReferenceTarget::Chart(None)),
            neutral_patches: read.neutral_patches,
            clipped_patches: read.clipped_patches,
            chroma_correlation: read.chroma_correlation,
            chroma_residual: read.chroma_residual,
            luminance_residual: read.luminance_residual,
            tilt_degrees: tilt,
        };
        MeasuredReference { light: read.light, gives_scale: !self.colour_only && !tilted, kind }
    }
}

/// Checks that a reference does not conflict with the requested colours or the known light.
///
/// # Errors
/// If another option determines the colour of the light.
pub(crate) fn check(name: &str, colours: ColourMode, light_is_known: bool) -> Result<(), AppError> {
    let problem = match (light_is_known, colours) {
        (true, _) => {
            "the environment map and the reference both determine the colour of the light; specify only one of them"
        }
        (false, ColourMode::LightChroma(_)) => {
            "the colour of the light and a reference are both specified; specify only one of them"
        }
        (false, ColourMode::Median | ColourMode::Grey) => {
            "a reference requires estimated colours; remove the reference or the other colour option"
        }
        (false, ColourMode::Estimate) => return Ok(()),
    };
    Err(AppError::of(name, problem))
}

impl MeasuredReference {
    /// Returns the rule for the colours, and the assumption on the colour of the light in words.
    pub(crate) fn rule(&self) -> (ColouringRule, &'static str) {
        (ColouringRule::Estimate { light: Some(self.light.chroma()) }, ASSUMPTION)
    }

    /// Returns the absolute scale of the reflectance for an estimated light; `None` if the
    /// reference does not determine it.
    pub(crate) fn scale(&self, light: &LightGrid) -> Option<AbsoluteScale> {
        self.light.scale(light).filter(|_| self.gives_scale)
    }

    /// Returns the section `reference` of the result.
    pub fn section(&self, scale: Option<AbsoluteScale>) -> result::Reference {
        result::Reference {
            kind: self.kind.clone(),
            white: self.light.white.to_array(),
            log_chroma: self.light.chroma().0,
            scale: scale.map(|scale| result::AbsoluteScale {
                factor: scale.factor,
                normal_albedo: ALBEDO * scale.factor,
                normal_albedo_interval_90: scale.interval(ALBEDO),
                log_sd: scale.log_sd,
            }),
        }
    }
}

/// Warns about a physically impossible scale.
pub(crate) fn too_bright(image: &str, scale: AbsoluteScale) -> Option<Warning> {
    let albedo = ALBEDO * scale.factor;
    (albedo > MAX_ALBEDO).then(|| {
        let text = format!(
            "the reference implies an albedo of {albedo:.2} at normal incidence, above the physical limit of 1; \
             possible causes are shadow on the reference, its orientation, and its reflectance"
        );
        Warning::of(image, text).with([Suggestion::ReferenceColourOnly])
    })
}
