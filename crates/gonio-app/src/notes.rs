//! The sections of `result.json`.

use gonio::colour::ChromaInterval;
use gonio::estimate::{
    ALBEDO, Colouring, Estimate, Light, LightEstimator, LitEstimate, Material, WIDE, expected_misfit,
};
use gonio::inference::learnt::Neighbour;
use gonio::inference::light::LightProblem;
use gonio::model::Model;
use gonio::scene::{Found, Sighting};
use gonio::shape::{Camera, Soundness};
use serde_json::{Value, json};

use crate::KnownLight;

/// Everything in `result.json` that does not depend on the method, and the sections that do.
pub struct Account<'a> {
    /// How messages call the photograph.
    pub image: &'a str,
    /// Name of the method.
    pub method: &'a str,
    /// The model it was found with.
    pub model: &'a Model,
    /// The section `observations`: [`sighting`] and more.
    pub observations: Value,
    /// The section `bracket` of a photograph that was merged.
    pub bracket: Option<Value>,
    /// The colours found.
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

impl Account<'_> {
    /// `result.json`.
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

/// Adds sections to others. What is no object stays as it is.
pub fn extend(notes: &mut Value, more: Value) {
    if let (Some(notes), Value::Object(more)) = (notes.as_object_mut(), more) {
        notes.extend(more);
    }
}

/// Notes on a mesh before its camera, to be added to those of [`sighting`].
pub fn mesh(name: &str, soundness: &Soundness, camera: &Camera) -> Value {
    json!({
        "mesh": name, "soundness": soundness, "principal_point": camera.principal,
        "camera_to_world": camera.to_world.transpose().to_cols_array_2d(),
    })
}

/// The sections `posterior`, `reflectance`, `light` and `noise` of an estimate.
pub fn estimate(estimate: &Estimate) -> Value {
    let Estimate { material, light, tint, .. } = estimate;
    let colours = tint.as_ref().map(|tint| {
        json!({
            "misfit": tint.misfit,
            "apart": { "blue_orange": tint.apart[0], "green_magenta": tint.apart[1] },
            "note": "misfit: what BRDF and light, both in colour, leave of the channels (root mean square, relative); apart: difference of \
                     the photograph's chroma from that of the BRDF in a light of one colour, in natural logarithms; captured light varies \
                     from blue to orange, and hardly from green to magenta",
        })
    });
    json!({
        "posterior": posterior(material, ALBEDO),
        "reflectance": {
            "quantiles": "brdf_quantiles.npy",
            "note": "brdf.binary is the mean of the posterior, in 1/sr with a normal albedo of 0.5; brdf_quantiles.npy holds \
                     its 5, 25, 75 and 95 % quantiles, [quantile][theta_h][theta_d]; the scale of reflectance is not \
                     determined by a photograph under unknown light",
        },
        "light": light_notes(light),
        "noise": {
            "sd": light.noise,
            "relative": light.relative_noise,
            "misfit": light.misfit,
            "expected": expected_misfit(material),
            "note": "misfit: what light and material leave of the photograph (root mean square, relative); expected: what noise and the \
                     light's resolution would leave if the material were right",
            "colours": colours,
        },
    })
}

/// The sections `posterior`, `reflectance`, `known_light`, `exposure`, `noise` and `settings` of an
/// estimate under a known light.
pub fn under_known_light(found: &LitEstimate, ask: &KnownLight) -> Value {
    let albedo = found.exposure * ALBEDO;
    let channels = found.colouring.field().tables(&found.material.table);
    let rgb = channels.each_ref().map(|table| found.exposure * table.normal_albedo());
    let turn = found.turn.to_scaled_axis().to_array().map(f64::to_degrees);
    let gain = found.gain.map(|(gain, sd)| json!({ "factor": gain, "log_sd": sd }));
    json!({
        "posterior": posterior(&found.material, if ask.absolute { albedo } else { ALBEDO }),
        "reflectance": {
            "quantiles": "brdf_quantiles.npy",
            "absolute": ask.absolute,
            "normal_albedo": if ask.absolute { albedo } else { ALBEDO },
            "note": "brdf.binary is the most probable BRDF, in 1/sr; brdf_quantiles.npy holds the 5, 25, 75 and 95 % quantiles of \
                     the posterior, [quantile][theta_h][theta_d]; absolute: photograph and light map are on one scale, and so is the \
                     BRDF, whose normal albedo is 0.5 otherwise",
        },
        "known_light": {
            "map": ask.map.name("the light"),
            "rows": found.map_rows,
            "turn_degrees": turn,
            "clipped": gain,
            "note": "turn_degrees: rotation vector (about x, y, z) from where the map has the light to where it was found; clipped: \
                     factor by which the clipped pixels of the map are brighter than it says, and the standard deviation of its \
                     logarithm; light.exr is the map with both",
        },
        "exposure": {
            "albedo": albedo,
            "albedo_rgb": rgb,
            "note": "albedo along the normal, in luminance and of red, green and blue, if photograph and light map are on one scale",
        },
        "noise": {
            "relative": found.noise,
            "discrepancy": found.discrepancy,
            "misfit": found.misfit,
            "expected": found.expected_misfit(),
            "channels": found.channel_misfit,
            "note": "channels: what red, green and blue leave of the photograph beside the luminance (root mean square, relative); \
                     relative: standard deviation of the independent error of the logarithm of the image; discrepancy: of its smooth \
                     error; misfit: what light and material leave of the photograph (root mean square, relative); expected: what \
                     noise and texture would leave if both were right",
        },
        "settings": { "rows": found.rows, "settled": found.settled },
    })
}

/// Changes the sections of [`estimate`] to a BRDF of this absolute albedo along the normal.
pub(crate) fn make_absolute(sections: &mut Value, material: &Material, albedo: f64) {
    sections["posterior"] = posterior(material, albedo);
    sections["reflectance"] = json!({
        "quantiles": "brdf_quantiles.npy",
        "absolute": true,
        "normal_albedo": albedo,
        "note": "brdf.binary is the mean of the posterior, in 1/sr; brdf_quantiles.npy holds its 5, 25, 75 and 95 % quantiles, \
                 [quantile][theta_h][theta_d]; absolute: the reference in the picture fixes the scale, and light.exr goes with it",
    });
}

/// The section `settings`: what the estimate was asked for. `linear` says whether integer values
/// were taken for radiance.
pub fn settings(settings: &gonio::estimate::EstimateSettings, linear: bool) -> Value {
    json!({ "grid": settings.side, "linear": linear, "rows": settings.rows, "steps": LightProblem::STEPS })
}

/// The section `posterior` of a material from several photographs.
pub(crate) fn combined(material: &Material) -> Value {
    let mut notes = posterior(material, ALBEDO);
    if let Some(notes) = notes.as_object_mut() {
        for of_one in ["strangeness", "scatter", "normals", "filled", "unshadowed", "note"] {
            notes.remove(of_one);
        }
    }
    notes
}

/// `albedo`: along the normal, assumed or found.
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
            "verdict": material.verdict(),
            "ggx_alpha": three(material.highlight.alpha),
            "roughness": three(material.highlight.roughness()),
            "units": { "albedo": albedo, "20": at_20, "60": at_60 },
            "note": "the BRDF along the normal over its mean at half angles beyond 45 degrees: its quantiles at 5, 50 and 95 %; \
                     factor: 95 % over 5 %; ggx_alpha: width of the GGX lobe that is as sharp (0.5 to 0.56 for all wider ones, 1 for no highlight); roughness: its square root, which the principled \
                     models of Mitsuba and Blender take; units: gloss units at 20 and 60 degrees (ASTM D523) if the albedo along \
                     the normal is as given here, to which they are in proportion and which a photograph under unknown light \
                     does not determine",
        },
        "note": "materials: the measured materials that are most like it in the shape of the highlight, not in colour, with \
                 their share of the posterior; undetermined: share of the BRDF's cells (both angles below 80 degrees) where \
                 the 90 % interval is most of what it is without a photograph; wide: share of the cells whose 90 % interval \
                 is wider than this factor; strangeness: share of the encoder's features outside of what was \
                 seen in training; scatter: standard deviation of pixels that share a normal, relative to their mean \
                 (noise, texture, shadows and wrong normals; 0 where too few share one); normals: cells of the disk of \
                 normals; filled: those of them without an observation; unshadowed: mean absolute logarithm of \
                 the ratio by which values were changed to those of a sphere, for shapes that keep light \
                 from themselves",
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
        "note": "given the mean of the posterior of reflectance: the mean of the posterior of the light among those without \
                 negative texels; radiance is exposure times the Haar synthesis of the coefficients",
    })
}

/// The section `colour`. `assumption` says in words what was taken for the light's colour.
fn colouring(colouring: &Colouring, assumption: &str) -> Value {
    let found = match colouring {
        Colouring::Grey => return json!({ "how": "none" }),
        Colouring::GreyPhotograph => return json!({ "how": "grey photograph" }),
        Colouring::Median(chroma) => {
            return json!({
                "how": "median",
                "rgb": chroma.rgb().to_array(),
                "note": "the median colour of the photograph, of luminance one, light and reflectance together",
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
        "note": "rgb: linear Rec. 709, of luminance one; log_chroma: ln R/G and ln B/G, with their 90 % intervals; strip: colours at 5, \
                 25, 50, 75 and 95 % along the direction in which they are least certain; body: half angles of 30 to 70 degrees; highlight: \
                 half angles below 2 degrees; both for difference angles below 60 degrees; light: a white matte ball in the object's place",
    })
}

/// The section `observations`: what was found of the shape, and what became of the pixels.
pub fn sighting(sighting: &Sighting) -> Value {
    let mut notes = match &sighting.found {
        Found::Circle(circle) => json!({ "circle": circle }),
        Found::Ball(centre) => json!({ "shape": { "ball": { "centre": centre.to_array() } } }),
        Found::Ellipse(ellipse, depth) => json!({ "shape": { "ellipse": ellipse, "depth_axis": depth } }),
        Found::Surface => json!({ "shape": {} }),
        Found::Normals(soundness) => {
            let shape = soundness.as_ref().map(|soundness| json!({ "soundness": soundness }));
            json!({ "shape": shape })
        }
    };
    if let (Some(placed), Some(shape)) = (&sighting.placed, notes.get_mut("shape").and_then(Value::as_object_mut))
        && !matches!(sighting.found, Found::Ellipse(..))
    {
        shape.insert("projection".into(), json!(placed.camera.projection));
    }
    if let Some(sureness) = sighting.sureness {
        notes["sureness"] = json!({
            "support": sureness.support,
            "rival": sureness.rival,
            "note": "the ball was found by a vote of the edges; support: share of its outline on which there is an edge \
                     along it; rival: weight of the next circle, without the edges of the ball, relative to its",
        });
    }
    if let Some((seen, inside)) = sighting.pixels {
        notes["pixels"] = json!({ "seen": seen, "inside": inside });
    }
    notes["report"] = json!(sighting.observations.report);
    notes["note"] = json!(
        "report: used_pixels of the observed_pixels of the photograph are used; points are the places on the object where the \
         picture is sampled, between pixels if it is small, and used, clipped, outside, faulty, other_colour and in_shadow \
         say what became of them"
    );
    notes
}
