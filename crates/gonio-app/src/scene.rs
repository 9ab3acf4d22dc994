//! Reads a photograph, detects its object and samples the image on it.

use gonio::picture::{Picture, Plane};
use gonio::scene::{Detection, Object, ObservationSettings, SceneError, SceneWarning};
use gonio::sphere::OctahedralMap;
use gonio_io::picture::InputSpace;
use gonio_io::result::{Bracket, Observations};

use crate::document::{self, ShapeOrigin};
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
    /// Also use pixels whose colour differs from the rest of the object.
    pub keep_colours: bool,
    /// Estimate although shape or light contradict the photograph.
    pub force: bool,
    /// The shape.
    pub shape: Shape,
    /// Neutral reference in the photograph, for colour and scale of the light.
    pub reference: Option<Reference>,
}

/// A scene with its detected object.
pub struct ObservedScene {
    /// The photograph.
    pub picture: Picture,
    /// The object and the observations on it.
    pub detection: Detection,
    /// The section `bracket` of the result.
    pub bracket: Option<Bracket>,
    /// Colour space of the photograph, unless it was in memory.
    pub space: Option<InputSpace>,
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

/// Contents of the files of a scene.
pub(crate) struct LoadedScene {
    pub(crate) picture: Picture,
    pub(crate) clip: Option<f32>,
    /// The section `bracket` of the result.
    pub(crate) bracket: Option<Bracket>,
    /// Colour space of the photograph.
    pub(crate) space: Option<InputSpace>,
    pub(crate) mask: Option<Plane<f32>>,
    pub(crate) object: Object,
    origin: ShapeOrigin,
    pub(crate) names: InputNames,
}

impl Scene {
    /// Reads the files. Reports the stage `reading`.
    ///
    /// # Errors
    /// If a file cannot be read, or mask and photograph do not match.
    pub(crate) fn open(
        self,
        warnings: &mut Vec<Warning>,
        progress_log: &ProgressLog<'_>,
    ) -> Result<LoadedScene, AppError> {
        progress_log.report("reading", 0.0);
        let Photograph { picture, clip, bracket, space } = self.photograph.read(&self.reading, self.clip, warnings)?;
        let size = picture.rgb.size();
        let names = InputNames::of(&self.name, self.mask.as_ref(), &self.shape);
        let mask = read_mask(self.mask, size, warnings)?;
        progress_log.report("reading", 0.5);
        let (object, origin) = self.shape.object(&self.name, size, warnings)?;
        Ok(LoadedScene { picture, clip, bracket, space, mask, object, origin, names })
    }

    /// Reads the files, detects the object and samples the image on it. `shadows` is the map and
    /// the side of the grid on which self-shadowing is computed; `None` ignores it. Reports the
    /// stages `reading` and `shadows`.
    ///
    /// # Errors
    /// If a file cannot be read, the object is not detected, or it has too few usable pixels. The
    /// error names the faulty input.
    pub fn observe(
        self,
        known: &ObservationSettings,
        shadows: Option<(OctahedralMap, usize)>,
        warnings: &mut Vec<Warning>,
        progress_log: &ProgressLog<'_>,
    ) -> Result<ObservedScene, AppError> {
        let (keep_colours, force, reference) = (self.keep_colours, self.force, self.reference.clone());
        let LoadedScene { picture, clip, bracket, space, mask, object, origin, names } =
            self.open(warnings, progress_log)?;
        let settings = ObservationSettings { clip, keep_colours, force, ..*known };
        let mut detection = Detection::of(&picture, mask, object, &settings).map_err(|error| names.blame(&error))?;
        warnings.extend(detection.scene_warnings.iter().map(|odd| names.warn(odd)));
        if let Some(grid) = shadows.filter(|_| detection.placed.is_some()) {
            progress_log.report("shadows", 0.0);
            detection.shadow(grid, &|x| progress_log.report("shadows", x)).map_err(|error| names.blame(&error))?;
        }
        let given = (names.image.as_str(), &picture, clip);
        let reference = reference.map(|reference| reference.measure(given, &detection, warnings)).transpose()?;
        let shadowed = shadows.is_some();
        Ok(ObservedScene { picture, detection, bracket, space, reference, force, origin, shadowed })
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
    let said = |what: &str| {
        let text = format!("the mask is {w}x{h} pixels, but the photograph is {pw}x{ph}; {what}");
        if name == UNNAMED_MASK { text } else { format!("{name}: {text}") }
    };
    if !alike(mask.size(), size) {
        return Err(AppError::new(said("use a mask of the same aspect ratio, at most eight times smaller or larger")));
    }
    warnings.push(said("gonio scales the mask").into());
    Ok(Some(resampled(&mask, size)))
}

/// Name of a mask without a file in messages.
const UNNAMED_MASK: &str = "the mask";

/// Names of the inputs of a scene in messages.
pub(crate) struct InputNames {
    image: String,
    mask: Option<String>,
    shape: Option<String>,
    /// The depth or position map.
    places: Option<String>,
    /// The photograph and all inputs for the shape.
    whole: String,
}

impl InputNames {
    fn of(image: &str, mask: Option<&Source<Plane<f32>>>, shape: &Shape) -> Self {
        let (mask, places) = (mask.map(|mask| mask.name(UNNAMED_MASK)), shape.places());
        let by_normals = matches!(shape.kind, crate::ShapeKind::Normals(_));
        let shape = shape.name();
        let whole = match (&shape, &mask) {
            (Some(shape), Some(mask)) if by_normals => format!("{image} with {shape} and {mask}"),
            (Some(shape), _) => format!("{image} with {shape}"),
            (None, _) => image.to_owned(),
        };
        Self { image: image.to_owned(), mask, shape, places, whole }
    }

    /// Returns the error, with the faulty input.
    fn blame(&self, error: &SceneError) -> AppError {
        AppError::of_scene(self.origin(error), error)
    }

    /// Returns the name of the faulty input.
    pub(crate) fn origin(&self, error: &SceneError) -> &str {
        match error {
            // An error in the outline concerns the input from which it was detected.
            error if error.is_of_outline() => self.mask.as_ref().unwrap_or(&self.image),
            SceneError::Contradiction(_) => self.shape.as_ref().unwrap_or(&self.image),
            SceneError::PositionMap(_) => self.places.as_ref().unwrap_or(&self.image),
            _ => &self.whole,
        }
    }

    fn warn(&self, odd: &SceneWarning) -> Warning {
        let text = match odd {
            SceneWarning::Depth(_)
            | SceneWarning::Clipped { .. }
            | SceneWarning::Faulty { .. }
            | SceneWarning::Outliers { .. }
            | SceneWarning::Isolated { .. }
            | SceneWarning::OtherColour { .. } => {
                format!("{}: {odd}", self.image)
            }
            SceneWarning::Contradiction(_) | SceneWarning::FlatBackground { .. } => {
                format!("{}: {odd}", self.shape.as_ref().unwrap_or(&self.image))
            }
            SceneWarning::Misplaced { .. } | SceneWarning::Inside { .. } => format!("{}: {odd}", self.whole),
        };
        Warning::new(text, odd.suggestions())
    }
}
