//! Reads a photograph, detects its object and samples the image on it.

use std::sync::Arc;

use gonio::picture::{Picture, Plane};
use gonio::scene::{Detection, ObjectShape, ObservationSettings, SceneError, SceneWarning, outline_of_ball};
use gonio::shape::Camera;
use gonio::sphere::OctahedralMap;
use gonio_io::result::Observations;

use crate::document::{self, ShapeOrigin};
use crate::inpaint::inpaint_ball;
use crate::mask::{alike, resampled};
use crate::{
    AppError, MeasuredReference, Photograph, PhotographSource, ProgressLog, Reading, Reference, Shape, Source, Warning,
};

/// A photograph and the known properties of its object.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name of the photograph in messages.
    pub name: String,
    /// Source of the photograph.
    pub photograph: PhotographSource,
    /// Options for reading its files.
    pub reading: Reading,
    /// Radiance at which the camera clips; detected if `None`.
    pub clip: Option<f32>,
    /// Mask of the object; detected if `None`.
    pub mask: Option<Source<Plane<f32>>>,
    /// Treat the object as one material: also use pixels of another colour or paint.
    pub one_material: bool,
    /// Estimate although shape or light contradict the photograph.
    pub force: bool,
    /// The shape.
    pub shape: Shape,
    /// Neutral reference in the photograph, for colour and scale of the light.
    pub reference: Option<Reference>,
}

/// A scene with its files in memory.
pub(crate) struct LoadedScene {
    pub(crate) photograph: Arc<Photograph>,
    pub(crate) mask: Option<Plane<f32>>,
    pub(crate) object: ObjectShape,
    /// The camera; `None` for an orthographic one.
    pub(crate) camera: Option<Camera>,
    pub(crate) names: InputNames,
    /// Whether integer values of the photograph are linear radiance.
    pub(crate) linear: bool,
    pub(crate) reference: Option<Reference>,
    one_material: bool,
    force: bool,
    origin: ShapeOrigin,
}

/// A region of a photograph before its inference.
pub(crate) struct RegionMask {
    pub(crate) name: String,
    pub(crate) mask: Plane<f32>,
    pub(crate) object: ObjectShape,
}

/// A photograph with a detected object.
pub struct ObservedScene {
    /// The photograph.
    pub photograph: Arc<Photograph>,
    /// The object and the observations on it.
    pub detection: Detection,
    /// The reference in the photograph.
    pub reference: Option<MeasuredReference>,
    /// Whether to estimate although shape or light contradict the photograph.
    pub force: bool,
    origin: ShapeOrigin,
    /// Whether self-shadowing was computed.
    shadowed: bool,
}

impl ObservedScene {
    /// Returns the section `observations` of the result.
    pub fn observations(&self) -> Observations {
        document::observations(&self.detection, &self.origin, self.shadowed)
    }
}

/// Settings of an observation that depend on the method.
#[derive(Clone, Copy, Default)]
pub(crate) struct Observing {
    /// Points and weights.
    pub(crate) settings: ObservationSettings,
    /// Map and side of the grid on which self-shadowing is computed; `None` ignores it.
    pub(crate) shadows: Option<(OctahedralMap, usize)>,
}

impl Scene {
    /// Reads the files. Reports the stage `reading`.
    ///
    /// # Errors
    /// If a file cannot be read, or mask and photograph do not match.
    pub(crate) fn load(
        self,
        warnings: &mut Vec<Warning>,
        progress_log: &ProgressLog<'_>,
    ) -> Result<LoadedScene, AppError> {
        progress_log.report("reading", 0.0);
        let photograph = self.photograph.read(&self.reading, self.clip, warnings)?;
        let size = photograph.picture.rgb.size();
        let names = InputNames::of(&self.name, self.mask.as_ref(), &self.shape);
        let mask = read_mask(self.mask, size, warnings)?;
        progress_log.report("reading", 0.5);
        let camera = self.shape.camera(size)?;
        let (mut object, origin) = self.shape.object_before(camera, &self.name, size, warnings)?;
        if let (ObjectShape::Sphere(None), Some(ball)) = (&object, self.reference.as_ref().and_then(Reference::grey_ball_outline))
            // If this fails, the detection in the whole photograph explains why.
            && let Ok((circle, _)) = outline_of_ball(&inpaint_ball(&photograph.picture, &ball), mask.as_ref())
        {
            object = ObjectShape::Sphere(Some(circle));
        }
        Ok(LoadedScene {
            photograph: Arc::new(photograph),
            mask,
            object,
            camera,
            names,
            linear: self.reading.linear,
            reference: self.reference,
            one_material: self.one_material,
            force: self.force,
            origin,
        })
    }
}

impl LoadedScene {
    /// Returns the photograph.
    pub(crate) fn picture(&self) -> &Picture {
        &self.photograph.picture
    }

    /// Returns the name of the photograph in messages.
    pub(crate) fn name(&self) -> &str {
        &self.names.image
    }

    /// Detects the object, or a region of it, and samples the image on it. Reports the stage
    /// `shadows`.
    ///
    /// # Errors
    /// If the object is not detected, or it has too few usable pixels. The error names the faulty
    /// input.
    pub(crate) fn observe(
        &self,
        region: Option<&RegionMask>,
        Observing { settings, shadows }: Observing,
        warnings: &mut Vec<Warning>,
        progress_log: &ProgressLog<'_>,
    ) -> Result<ObservedScene, AppError> {
        let Photograph { picture, clip, .. } = &*self.photograph;
        let (mask, object) = match region {
            None => (self.mask.clone(), self.object.clone()),
            Some(region) => (Some(region.mask.clone()), region.object.clone()),
        };
        // The mask of each region separates the materials, and the checks that `force` skips apply
        // to whole objects.
        let (one_material, force) = (self.one_material || region.is_some(), self.force || region.is_some());
        let names = match region {
            None => &self.names,
            Some(_) => &self.names.of_region(),
        };
        let settings = ObservationSettings { clip: *clip, one_material, force, ..settings };
        let mut detection = Detection::of(picture, mask, object, &settings).map_err(|error| names.to_error(&error))?;
        warnings.extend(detection.scene_warnings.iter().map(|warning| names.warn(warning)));
        if let Some(grid) = shadows.filter(|_| detection.placed.is_some()) {
            progress_log.report("shadows", 0.0);
            detection.shadow(grid, &|x| progress_log.report("shadows", x)).map_err(|error| names.to_error(&error))?;
        }
        let given = (names.image.as_str(), picture, *clip);
        let measure = |reference: &Reference| reference.measure(given, &detection, warnings);
        let reference = self.reference.as_ref().map(measure).transpose();
        let reference = reference.map_err(|error| error.for_shape(names.takes_circle))?;
        Ok(ObservedScene {
            photograph: self.photograph.clone(),
            detection,
            reference,
            force,
            origin: self.origin.clone(),
            shadowed: shadows.is_some(),
        })
    }
}

/// Reads a mask for a photograph of `size`. A mask of another size but the same aspect ratio is
/// scaled, with a warning.
///
/// # Errors
/// If the file cannot be read, or the mask cannot be scaled.
pub(crate) fn read_mask(
    mask: Option<Source<Plane<f32>>>,
    size: (usize, usize),
    warnings: &mut Vec<Warning>,
) -> Result<Option<Plane<f32>>, AppError> {
    let Some(source) = mask else { return Ok(None) };
    let name = source.name(UNNAMED_MASK);
    let mask = match source {
        Source::File(path) => gonio_io::picture::read_mask(&path)?,
        Source::Memory(mask) => mask,
    };
    if mask.size() == size {
        return Ok(Some(mask));
    }
    let ((w, h), (pw, ph)) = (mask.size(), size);
    let message = |what: &str| {
        let text = format!("the mask is {w}x{h} pixels, but the photograph is {pw}x{ph}; {what}");
        if name == UNNAMED_MASK { text } else { format!("{name}: {text}") }
    };
    if !alike(mask.size(), size) {
        return Err(AppError::new(message(
            "use a mask of the same aspect ratio, at most eight times smaller or larger",
        )));
    }
    warnings.push(message("gonio scales the mask").into());
    Ok(Some(resampled(&mask, size)))
}

/// Name of a mask without a file in messages.
const UNNAMED_MASK: &str = "the mask";

/// Names of the inputs of a scene in messages.
#[derive(Clone)]
pub(crate) struct InputNames {
    image: String,
    mask: Option<String>,
    shape: Option<String>,
    /// Whether the shape is a normal map, to which the mask belongs.
    by_normals: bool,
    /// The depth or position map.
    positions: Option<String>,
    /// Whether the shape is a ball, whose outline the user can specify.
    pub(crate) takes_circle: bool,
}

impl InputNames {
    fn of(image: &str, mask: Option<&Source<Plane<f32>>>, shape: &Shape) -> Self {
        Self {
            image: image.to_owned(),
            mask: mask.map(|mask| mask.name(UNNAMED_MASK)),
            shape: shape.name(),
            by_normals: matches!(shape.kind, crate::ShapeKind::Normals(_)),
            positions: shape.positions_name(),
            takes_circle: matches!(shape.kind, crate::ShapeKind::Sphere(_)) && shape.camera.is_none(),
        }
    }

    /// Returns the names for a region, whose mask is not a file.
    fn of_region(&self) -> Self {
        Self { mask: Some(UNNAMED_MASK.to_owned()), ..self.clone() }
    }

    /// Returns the name of the photograph with all inputs for the shape.
    fn whole(&self) -> String {
        let image = &self.image;
        match (&self.shape, &self.mask) {
            (Some(shape), Some(mask)) if self.by_normals => format!("{image} with {shape} and {mask}"),
            (Some(shape), _) => format!("{image} with {shape}"),
            (None, _) => image.clone(),
        }
    }

    /// Returns the error, with the faulty input.
    fn to_error(&self, error: &SceneError) -> AppError {
        AppError::of_scene(self.origin(error), error).for_shape(self.takes_circle)
    }

    /// Returns the name of the faulty input.
    pub(crate) fn origin(&self, error: &SceneError) -> String {
        match error {
            // An error in the outline concerns the input from which it was detected.
            error if error.is_of_outline() => self.mask.as_ref().unwrap_or(&self.image).clone(),
            SceneError::Contradiction(_) => self.shape.as_ref().unwrap_or(&self.image).clone(),
            SceneError::PositionMap(_) => self.positions.as_ref().unwrap_or(&self.image).clone(),
            _ => self.whole(),
        }
    }

    pub(crate) fn warn(&self, warning: &SceneWarning) -> Warning {
        let text = match warning {
            SceneWarning::UnknownSemiAxis(_)
            | SceneWarning::Outline(_)
            | SceneWarning::Clipped { .. }
            | SceneWarning::Faulty { .. }
            | SceneWarning::EmptyChannel { .. }
            | SceneWarning::Outliers { .. }
            | SceneWarning::Spots { .. }
            | SceneWarning::PossibleOutliers { .. }
            | SceneWarning::OtherColour { .. }
            | SceneWarning::Pattern { .. } => {
                format!("{}: {warning}", self.image)
            }
            SceneWarning::Contradiction(_) | SceneWarning::FlatBackground { .. } => {
                format!("{}: {warning}", self.shape.as_ref().unwrap_or(&self.image))
            }
            SceneWarning::Misaligned { .. } | SceneWarning::BackFacing { .. } => format!("{}: {warning}", self.whole()),
        };
        Warning::new(text, warning.suggestions())
    }
}
