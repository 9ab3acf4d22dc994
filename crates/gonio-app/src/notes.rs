//! Builds the sections of `result.json`.

use gonio::colour::ChromaInterval;
use gonio::estimate::{
    ALBEDO, Colouring, Estimate, Light, LightEstimator, LitEstimate, Material, WIDE, expected_misfit,
};
use gonio::inference::learnt::Neighbour;
use gonio::inference::light::LightProblem;
use gonio::model::Model;
use gonio::scene::{Detection, Found};
use gonio::shape::{Camera, Soundness};
use serde_json::{Value, json};

use crate::KnownLight;
use crate::results::BRDF;

/// Contents of `result.json`: the common sections and those of the method.
pub struct ResultDocument<'a> {
    /// Name of the photograph in messages.
    pub image: &'a str,
    /// Name of the method.
    pub method: &'a str,
    /// The model that inferred the result.
    pub model: &'a Model,
    /// The section `observations`: [`detection`] and more.
    pub observations: Value,
    /// The section `bracket` of a merged photograph.
    pub bracket: Option<Value>,
    /// The estimated colours.
    pub colouring: &'a Colouring,
    /// Assumption on the colour of the light, in words.
    pub assumption: &'a str,
    /// Warnings, one line each.
    pub warnings: &'a [String],
    /// Seconds of each stage.
    pub seconds: Value,
    /// Sections of the method: [`estimate`] and [`settings`], or those of a method of the paper.
    pub sections: Value,
}

impl ResultDocument<'_> {
    /// Returns the contents of `result.json`.
    pub fn result(self) -> Value {
        let Self { image, method, model, observations, bracket, colouring, assumption, warnings, seconds, sections } =
            self;
        let mut result = json!({
            "format": "gonio-result",
            "version": 1,
            "gonio": env!("CARGO_PKG_VERSION"),
            "image": image,
            "method": method,
            "model": { "provenance": model.provenance, "rank": model.reflectance.len(), "map": model.light.map },
            "observations": observations,
            "colour": self::colouring(colouring, assumption),
            "warnings": warnings,
            "seconds": seconds,
        });
        if let Some(bracket) = bracket {
            result["bracket"] = bracket;
        }
        extend(&mut result, sections);
        result
    }
}

/// Adds the entries of an object to another; other values are ignored.
pub fn extend(notes: &mut Value, more: Value) {
    if let (Some(notes), Value::Object(more)) = (notes.as_object_mut(), more) {
        notes.extend(more);
    }
}

/// Returns the notes on a mesh and its camera, which extend those of [`detection`].
pub fn mesh(name: &str, soundness: &Soundness, camera: &Camera) -> Value {
    json!({
        "mesh": name, "soundness": soundness, "principal_point": camera.principal,
        "camera_to_world": camera.to_world.transpose().to_cols_array_2d(),
    })
}

/// Returns the sections `posterior`, `reflectance`, `light` and `noise` of an estimate.
pub fn estimate(estimate: &Estimate) -> Value {
    let Estimate { material, light, tint, .. } = estimate;
    let colours = tint.as_ref().map(|tint| {
        json!({
            "misfit": tint.misfit,
            "apart": { "blue_orange": tint.apart[0], "green_magenta": tint.apart[1] },
            "note": "misfit: relative root mean square residual of the channels, given BRDF and light in colour; apart: difference between \
                     the chroma of the photograph and that of the BRDF in a light of uniform colour, in natural logarithms; captured lights \
                     vary from blue to orange, and little from green to magenta",
        })
    });
    json!({
        "posterior": posterior(material, ALBEDO),
        "reflectance": {
            "quantiles": BRDF,
            "note": "brdf.npz contains the mean of the posterior and its quantiles, in 1/sr with an albedo of 0.5 at normal \
                     incidence. A photograph under unknown light does \
                     not determine the scale of reflectance.",
        },
        "light": light_notes(light),
        "noise": {
            "sd": light.noise,
            "relative": light.relative_noise,
            "misfit": light.misfit,
            "expected": expected_misfit(material),
            "note": "misfit: relative root mean square residual of the photograph, given light and material; expected: the misfit from noise \
                     and the light's resolution if the material were correct",
            "colours": colours,
        },
    })
}

/// Returns the sections `posterior`, `reflectance`, `known_light`, `exposure`, `noise` and
/// `settings` of an estimate under a known light.
pub fn under_known_light(found: &LitEstimate, ask: &KnownLight) -> Value {
    let albedo = found.exposure * ALBEDO;
    let channels = found.colouring.field().tables(&found.material.table);
    let rgb = channels.each_ref().map(|table| found.exposure * table.normal_albedo());
    let turn = found.turn.to_scaled_axis().to_array().map(f64::to_degrees);
    let gain = found.gain.map(|(gain, sd)| json!({ "factor": gain, "log_sd": sd }));
    json!({
        "posterior": posterior(&found.material, if ask.absolute { albedo } else { ALBEDO }),
        "reflectance": {
            "quantiles": BRDF,
            "absolute": ask.absolute,
            "normal_albedo": if ask.absolute { albedo } else { ALBEDO },
            "note": "brdf.npz contains the most probable BRDF and the quantiles of the posterior, in 1/sr. If absolute is true, photograph and light map have the same scale, \
                     and the BRDF is absolute. Otherwise, its albedo at normal incidence is 0.5.",
        },
        "known_light": {
            "map": ask.map.name(),
            "rows": found.map_rows,
            "turn_degrees": turn,
            "clipped": gain,
            "note": "turn_degrees: rotation vector (about x, y, z) from the light map to the estimated light; clipped: \
                     estimated ratio of the radiance of clipped pixels to their value in the map, and the standard deviation of its \
                     logarithm; light.exr is the map with both corrections",
        },
        "exposure": {
            "albedo": albedo,
            "albedo_rgb": rgb,
            "note": "albedo at normal incidence, of luminance and of red, green and blue, if photograph and light map have the same scale",
        },
        "noise": {
            "relative": found.noise,
            "discrepancy": found.discrepancy,
            "misfit": found.misfit,
            "expected": found.expected_misfit(),
            "channels": found.channel_misfit,
            "note": "channels: relative root mean square residual of red, green and blue beyond that of the luminance; \
                     relative: standard deviation of the independent error of the logarithm of the image; discrepancy: standard deviation \
                     of its smooth error; misfit: relative root mean square residual of the photograph, given light and material; \
                     expected: the misfit from noise and texture if both were correct",
        },
        "settings": { "rows": found.rows, "settled": found.settled },
    })
}

/// Changes the sections of [`estimate`] to a BRDF with this absolute albedo at normal incidence.
pub(crate) fn make_absolute(sections: &mut Value, material: &Material, albedo: f64) {
    sections["posterior"] = posterior(material, albedo);
    sections["reflectance"] = json!({
        "quantiles": BRDF,
        "absolute": true,
        "normal_albedo": albedo,
        "note": "brdf.npz contains the mean of the posterior and its quantiles, in 1/sr. The reference in the image determines the scale of \
                 brdf.npz and light.exr.",
    });
}

/// Returns the section `settings`. `linear` is true if integer values were read as linear radiance.
pub fn settings(settings: &gonio::estimate::EstimateSettings, linear: bool) -> Value {
    json!({ "grid": settings.side, "linear": linear, "rows": settings.rows, "steps": LightProblem::STEPS })
}

/// Returns the section `posterior` of a material from several photographs.
pub(crate) fn combined(material: &Material) -> Value {
    let mut notes = posterior(material, ALBEDO);
    if let Some(notes) = notes.as_object_mut() {
        for of_one in ["strangeness", "scatter", "normals", "filled", "unshadowed", "note"] {
            notes.remove(of_one);
        }
    }
    notes
}

/// Returns the section `posterior`. `albedo` is the albedo at normal incidence, assumed or
/// estimated.
fn posterior(material: &Material, albedo: f64) -> Value {
    let share = |n: &Neighbour| json!({ "name": n.name, "weight": n.weight });
    let three = |[low, median, high]: [f64; 3]| json!({ "5": low, "50": median, "95": high });
    let [low, median, high] = material.gloss;
    let [at_20, at_60] = material.highlight.units.map(|units| three(units.map(|u| u * albedo / ALBEDO)));
    json!({
        "materials": material.neighbours.iter().map(share).collect::<Vec<_>>(),
        "undetermined": material.open,
        "wide": { "factor": WIDE, "share": material.wider_than(WIDE) },
        "strangeness": material.strangeness,
        "scatter": material.scatter,
        "normals": material.normals,
        "filled": material.filled,
        "unshadowed": material.unshadowed,
        "gloss": {
            "5": low, "50": median, "95": high,
            "factor": material.gloss_factor(),
            "finish": material.finish().name(),
            "verdict": material.verdict(),
            "ggx_alpha": three(material.highlight.alpha),
            "roughness": three(material.highlight.roughness()),
            "units": { "albedo": albedo, "20": at_20, "60": at_60 },
            "note": "5, 50 and 95 % quantiles of the ratio of the BRDF along the normal to its mean at half angles above 45 degrees; \
                     factor: the 95 % quantile over the 5 % quantile; finish: the duller of the finishes by the median roughness (mirror below 0.1, gloss below 0.25, semi-gloss below 0.4, satin below 0.6, matte) and by the median gloss units at 60 degrees for an albedo of 0.5 (matte below 10, satin below 35, semi-gloss below 70); ggx_alpha: width of the GGX lobe of equal sharpness (lobes above 0.56 have 0.5 to 0.56; 1 without a highlight); \
                     roughness: square root of ggx_alpha, as in the principled BSDFs of Mitsuba and Blender; units: gloss units at 20 and 60 degrees (ASTM D523) for the albedo stated here; \
                     gloss units are proportional to the albedo, which a photograph under unknown light does not determine",
        },
        "note": "materials: the measured materials with the most similar highlight (not colour), with \
                 their share of the posterior; undetermined: share of the BRDF's cells (both angles below 80 degrees) where \
                 the 90 % interval is wider than 60 % of the prior's; wide: share of the cells whose 90 % interval \
                 spans more than this factor; strangeness: share of the encoder's features outside of their \
                 range in training; scatter: standard deviation of pixels that share a normal, relative to their mean \
                 (noise, texture, shadows and wrong normals; 0 where too few share one); normals: cells of the disk of \
                 normals; filled: cells of the disk without an observation; unshadowed: mean absolute logarithm of \
                 the factor that converts observed values to those of a sphere, for shapes with self-shadowing",
    })
}

fn light_notes(light: &Light) -> Value {
    let how = match light.estimator {
        LightEstimator::NonNegative { steps, settled } => {
            json!({ "estimator": "mean without negative texels", "steps": steps, "settled": settled })
        }
        LightEstimator::CutOff => json!({ "estimator": "mean cut off at zero" }),
    };
    json!({
        "coefficients": light.coefficients,
        "sd": light.sd,
        "exposure": light.exposure,
        "non_negative": how,
        "rows": light.rows,
        "evidence": {
            "objective": light.objective, "effective": light.effective, "converged": light.converged, "trace": light.trace,
        },
        "note": "posterior mean of the light, restricted to non-negative texels, given the posterior mean of the reflectance; \
                 radiance is exposure times the Haar synthesis of the coefficients",
    })
}

/// Returns the section `colour`. `assumption` states the assumption on the colour of the light.
fn colouring(colouring: &Colouring, assumption: &str) -> Value {
    let found = match colouring {
        Colouring::Grey => return json!({ "how": "none" }),
        Colouring::GreyPhotograph => return json!({ "how": "grey photograph" }),
        Colouring::Median(chroma) => {
            return json!({
                "how": "median",
                "rgb": chroma.rgb().to_array(),
                "note": "the median colour of the photograph, scaled to a luminance of one; it includes the colour of the light",
            });
        }
        Colouring::Estimate(found) => found,
    };
    let part = |part: &ChromaInterval| {
        json!({
            "rgb": part.chroma.rgb().to_array(),
            "log_chroma": part.chroma.0,
            "interval_90": part.interval,
            "strip": part.strip.map(|chroma| chroma.rgb().to_array()),
        })
    };
    json!({
        "how": "estimate",
        "assumption": assumption,
        "body": part(&found.body),
        "highlight": part(&found.highlight),
        "light": part(&found.light),
        "note": "rgb: linear Rec. 709, scaled to a luminance of one; log_chroma: ln R/G and ln B/G, with their 90 % intervals; strip: colours at the \
                 5, 25, 50, 75 and 95 % quantiles along the most uncertain direction; body: half angles of 30 to 70 degrees; highlight: half angles \
                 below 2 degrees; both for difference angles below 60 degrees; light: colour of a white matte ball at the position of the object",
    })
}

/// Returns the section `observations`: the detected shape and the status of the pixels.
pub fn detection(detection: &Detection) -> Value {
    let mut notes = match &detection.found {
        Found::Circle(circle) => json!({ "circle": circle }),
        Found::Ball(centre) => json!({ "shape": { "ball": { "centre": centre.to_array() } } }),
        Found::Ellipse(ellipse, depth) => json!({ "shape": { "ellipse": ellipse, "depth_axis": depth } }),
        Found::Outline(depth) => json!({ "shape": { "outline": { "depth_factor": depth } } }),
        Found::Surface => json!({ "shape": {} }),
        Found::Normals(soundness) => {
            let shape = soundness.as_ref().map(|soundness| json!({ "soundness": soundness }));
            json!({ "shape": shape })
        }
    };
    if let (Some(placed), Some(shape)) = (&detection.placed, notes.get_mut("shape").and_then(Value::as_object_mut))
        && !matches!(detection.found, Found::Ellipse(..))
    {
        shape.insert("projection".into(), json!(placed.camera.projection));
    }
    if let Some(sureness) = detection.sureness {
        notes["sureness"] = json!({
            "support": sureness.support,
            "rival": sureness.rival,
            "error": sureness.error,
            "note": "the ball was detected by its edges; support: share of the outline that coincides with an \
                     edge; rival: weight of the next candidate circle, without the edges that the ball explains, \
                     relative to the weight of the ball; error: standard error of the centre and the radius, \
                     in pixels",
        });
    }
    if let Some((seen, inside)) = detection.pixels {
        notes["pixels"] = json!({ "seen": seen, "inside": inside });
    }
    notes["report"] = json!(detection.observations.report);
    notes["note"] = json!(
        "report: observed_pixels: number of pixels on the object. used_pixels: number of those that gonio uses. points: number of \
         points on the object at which gonio samples the image, between pixels if the image is small. used, clipped, outside, \
         faulty, other_colour and in_shadow: number of points by status."
    );
    notes
}
