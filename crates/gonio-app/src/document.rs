//! Sections of `result.json` ([`gonio_io::result`]) from the results of the library.

use gonio::colour::ChromaInterval;
use gonio::estimate::{
    ALBEDO, Colouring, Estimate, EstimateSettings, KnownLightEstimate, Light, LightEstimator, MaterialEstimate, WIDE,
    expected_misfit,
};
use gonio::inference::learnt::Neighbour;
use gonio::inference::light::LightProblem;
use gonio::model::Model;
use gonio::scene::{DetectedShape, Detection};
use gonio::shape::{MeshDefects, Visibility};
use gonio_io::result::{
    self, ClippedLight, Colour, ColourResidual, DetectionReport, Evidence, Exposure, GlossUnits, Highlight,
    ModelSection, Observations, PeakHeight, Posterior, Quantiles, Reflectance, Residual, ResultDocument,
    SettingsSection, Shape, SimilarMaterial, SurfacePixels, UncertainColour, WideCells,
};

use crate::results::BRDF;
use crate::{EnvironmentSource, KnownLight};

/// Returns a document of this version of gonio, without sections.
pub fn new(method: &str) -> ResultDocument {
    ResultDocument::new(method, env!("CARGO_PKG_VERSION"))
}

/// Returns the section `model`.
pub fn model(model: &Model) -> ModelSection {
    ModelSection {
        provenance: model.provenance.clone(),
        rank: Some(model.reflectance.len()),
        map: serde_json::to_value(model.light.map).ok().and_then(|name| Some(name.as_str()?.to_owned())),
    }
}

/// Sets the sections `posterior`, `reflectance`, `light`, `residual` and `settings` of an estimate.
/// `linear` is true if integer values were read as linear radiance.
pub fn set_estimate(document: &mut ResultDocument, estimate: &Estimate, settings: &EstimateSettings, linear: bool) {
    let Estimate { material, light: found, chromatic_light, .. } = estimate;
    document.posterior = Some(posterior(material, ALBEDO));
    document.reflectance = reflectance(None);
    document.light = Some(light(found));
    document.residual = Some(Residual {
        misfit: Some(found.misfit),
        expected: Some(expected_misfit(material)),
        noise_sd: Some(found.noise),
        relative_noise: Some(found.relative_noise),
        colours: chromatic_light.as_ref().map(|light| ColourResidual {
            misfit: light.misfit,
            blue_orange: light.chroma_residual[0],
            green_magenta: light.chroma_residual[1],
        }),
        ..Residual::default()
    });
    document.settings = SettingsSection {
        grid: Some(settings.side),
        linear: Some(linear),
        observations: Some(settings.observations),
        steps: Some(LightProblem::STEPS),
        ..SettingsSection::default()
    };
}

/// Sets the sections `posterior`, `reflectance`, `known_light`, `exposure`, `residual` and
/// `settings` of an estimate under a known light.
pub(crate) fn set_known_light(
    document: &mut ResultDocument,
    found: &KnownLightEstimate,
    given: &KnownLight,
    linear: bool,
) {
    let albedo = found.exposure * ALBEDO;
    let channels = found.colouring.field().tables(&found.material.table);
    let mirror_ball = match &given.map {
        EnvironmentSource::Map(_) => None,
        EnvironmentSource::MirrorBall(ball) => {
            Some(result::MirrorBall { circle: ball.circle.into(), reflectance: ball.reflectance })
        }
    };
    document.posterior = Some(posterior(&found.material, if given.absolute { albedo } else { ALBEDO }));
    document.reflectance = reflectance(given.absolute.then_some(albedo));
    document.known_light = Some(result::KnownLight {
        map: given.map.name(),
        mirror_ball,
        rows: Some(found.map_rows),
        rotation_degrees: Some(found.rotation.to_scaled_axis().to_array().map(f64::to_degrees)),
        clipped: found.gain.map(|(factor, log_sd)| ClippedLight { factor, log_sd }),
    });
    document.exposure = Some(Exposure {
        albedo: Some(albedo),
        albedo_rgb: Some(channels.each_ref().map(|table| found.exposure * table.normal_albedo())),
        ..Exposure::default()
    });
    document.residual = Some(Residual {
        misfit: Some(found.misfit),
        expected: Some(found.expected_misfit()),
        relative_noise: Some(found.noise),
        smooth_error: Some(found.discrepancy),
        channels: found.channel_misfit,
        ..Residual::default()
    });
    document.settings = SettingsSection {
        observations: Some(found.observations),
        converged: Some(found.converged),
        linear: Some(linear),
        ..SettingsSection::default()
    };
}

/// Returns the section `reflectance`. `albedo` is the measured albedo at normal incidence; `None`
/// means that the photograph does not determine it.
pub(crate) fn reflectance(albedo: Option<f64>) -> Reflectance {
    Reflectance {
        file: Some(BRDF.to_owned()),
        absolute: albedo.is_some(),
        normal_albedo: albedo.unwrap_or(ALBEDO),
        ..Reflectance::default()
    }
}

/// Returns the section `posterior` of a material from several photographs.
pub(crate) fn combined(material: &MaterialEstimate) -> Posterior {
    Posterior {
        out_of_distribution: None,
        scatter: None,
        disk_cells: None,
        filled_cells: None,
        self_shadowing: None,
        ..posterior(material, ALBEDO)
    }
}

/// Returns the section `posterior`. `albedo` is the albedo at normal incidence, assumed or
/// measured.
pub(crate) fn posterior(material: &MaterialEstimate, albedo: f64) -> Posterior {
    let similar = |n: &Neighbour| SimilarMaterial { name: n.name.clone(), weight: n.weight };
    let [at_20, at_60] = material.highlight.units.map(|units| Quantiles::from(units.map(|u| u * albedo / ALBEDO)));
    Posterior {
        highlight: Highlight {
            finish: material.finish().name().to_owned(),
            verdict: material.verdict(),
            roughness: Some(material.highlight.roughness().into()),
            ggx_alpha: Some(material.highlight.alpha.into()),
            gloss_units: Some(GlossUnits { albedo, at_20, at_60 }),
            peak_height: PeakHeight { quantiles: material.peak_height.into(), factor: material.peak_factor() },
        },
        materials: material.posterior.neighbours.iter().map(similar).collect(),
        undetermined: material.undetermined_share,
        wide: WideCells { factor: WIDE, share: material.wider_than(WIDE) },
        out_of_distribution: Some(material.out_of_distribution),
        scatter: Some(material.scatter),
        disk_cells: Some(material.disk_cells),
        filled_cells: Some(material.filled_cells),
        self_shadowing: Some(material.self_shadowing),
    }
}

fn light(light: &Light) -> result::Light {
    let (estimator, steps, converged) = match light.estimator {
        LightEstimator::NonNegative { steps, converged } => {
            ("mean without negative texels", Some(steps), Some(converged))
        }
        LightEstimator::Clamped => ("mean cut off at zero", None, None),
    };
    result::Light {
        coefficients: light.coefficients.clone(),
        sd: light.sd.clone(),
        exposure: Some(light.exposure),
        side: Some(light.grid.side()),
        observations: Some(light.observations),
        estimator: Some(estimator.to_owned()),
        steps,
        converged,
        evidence: Some(Evidence {
            objective: light.objective,
            effective: light.effective,
            converged: light.converged,
            trace: light.trace.clone(),
        }),
    }
}

/// Returns the section `colour`. `assumption` is the assumption on the colour of the light.
pub fn colour(colouring: &Colouring, assumption: &str) -> Colour {
    let found = match colouring {
        Colouring::Grey => return Colour { source: "none".into(), ..Colour::default() },
        Colouring::GreyPhotograph => return Colour { source: "grey photograph".into(), ..Colour::default() },
        Colouring::Median(chroma) => {
            return Colour { source: "median".into(), rgb: Some(chroma.rgb().to_array()), ..Colour::default() };
        }
        Colouring::Estimate(found) => found,
    };
    let part = |part: &ChromaInterval| {
        Some(UncertainColour {
            rgb: part.chroma.rgb().to_array(),
            log_chroma: part.chroma.0,
            interval_90: Some(part.interval),
            log_chroma_sd: None,
            quantile_colours: part.strip.iter().map(|chroma| chroma.rgb().to_array()).collect(),
        })
    };
    Colour {
        source: "estimate".into(),
        assumption: Some(assumption.to_owned()),
        rgb: None,
        body: part(&found.body),
        highlight: part(&found.highlight),
        light: part(&found.light),
    }
}

/// Where the shape of an object comes from.
#[derive(Clone, Debug, Default)]
pub struct ShapeOrigin {
    /// Name and defects of the mesh.
    pub mesh: Option<(String, MeshDefects)>,
    /// Name of the depth or position map.
    pub geometry: Option<String>,
}

/// Returns the section `observations`. `shadowed` is true if self-shadowing was computed.
pub fn observations(detection: &Detection, origin: &ShapeOrigin, shadowed: bool) -> Observations {
    let visibility = detection.observations.visibility.as_ref();
    let standard_error = |error: f64| error.is_finite().then_some(error);
    Observations {
        shape: shape(detection, origin),
        detection: detection.reliability.map(|reliability| DetectionReport {
            support: reliability.support,
            runner_up: reliability.runner_up,
            standard_error: standard_error(reliability.standard_error),
        }),
        surface: detection.pixels.map(|(pixels, back_facing)| SurfacePixels { pixels, back_facing }),
        visibility: (detection.placed.is_some() && shadowed)
            .then(|| result::Visibility { occluded: visibility.is_some(), bytes: visibility.map(Visibility::bytes) }),
        report: (&detection.observations.report).into(),
    }
}

fn shape(detection: &Detection, origin: &ShapeOrigin) -> Shape {
    let camera = detection.placed.as_ref().map(|placed| &placed.camera);
    let projection = camera.map(|camera| camera.projection.into());
    let normals = |defects: Option<&MeshDefects>| Shape::Normals {
        geometry: origin.geometry.clone(),
        defects: defects.map(Into::into),
        projection,
        refined: detection.estimated_normals.then(|| detection.is_refined()),
    };
    match &detection.shape {
        DetectedShape::Circle(circle) => Shape::Sphere { circle: (*circle).into() },
        DetectedShape::Ball(centre) => Shape::Ball { centre: centre.to_array(), projection },
        DetectedShape::Ellipse(ellipse, depth) => Shape::Ellipsoid { ellipse: ellipse.into(), depth_axis: *depth },
        DetectedShape::Outline(depth) => Shape::Outline { depth_factor: *depth, refined: detection.is_refined() },
        DetectedShape::Normals(defects) => normals(defects.as_ref()),
        DetectedShape::Surface => match (&origin.mesh, camera) {
            (Some((name, defects)), Some(camera)) => Shape::Mesh {
                mesh: name.clone(),
                defects: defects.into(),
                projection: camera.projection.into(),
                principal_point: [camera.principal.0, camera.principal.1],
                camera_to_world: camera.to_world.transpose().to_cols_array_2d(),
            },
            _ => normals(None),
        },
    }
}
