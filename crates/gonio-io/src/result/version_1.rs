//! Conversion of documents of version 1.

use serde_json::{Map, Value, json};

use super::VERSION;

/// Sections with the same contents in both versions.
const SAME_SECTIONS: [&str; 12] = [
    "format",
    "gonio",
    "image",
    "photographs",
    "method",
    "model",
    "colour",
    "colorspace",
    "relative_albedo",
    "regions",
    "warnings",
    "seconds",
];

/// Converts a document of version 1. It keeps the sections that gonio reads: the material, its
/// colours, its scale and the residual.
pub(super) fn converted(mut document: Value) -> Value {
    let mut new = Map::new();
    for name in SAME_SECTIONS {
        if let Some(section) = document.get_mut(name).map(Value::take).filter(|section| !section.is_null()) {
            new.insert(name.to_owned(), section);
        }
    }
    new.insert("version".into(), json!(VERSION));
    if ["5", "50", "95"].iter().all(|q| document["posterior"]["gloss"][q].is_number()) {
        new.insert("posterior".into(), posterior(&document["posterior"]));
    }
    if document["noise"].is_object() {
        new.insert("residual".into(), residual(&document["noise"]));
    }
    let reflectance = &document["reflectance"];
    let albedo = reflectance["normal_albedo"].as_f64().unwrap_or(0.5);
    let absolute = reflectance["absolute"].as_bool().unwrap_or(false);
    new.insert("reflectance".into(), json!({ "absolute": absolute, "normal_albedo": albedo }));
    if document["exposure"]["albedo"].is_number() {
        new.insert("exposure".into(), json!({ "albedo": document["exposure"]["albedo"] }));
    }
    Value::Object(new)
}

fn posterior(old: &Value) -> Value {
    let gloss = &old["gloss"];
    let or = |value: &Value, default: Value| if value.is_null() { default } else { value.clone() };
    json!({
        "highlight": {
            "finish": or(&gloss["finish"], json!("")),
            "verdict": or(&gloss["verdict"], json!("")),
            "roughness": gloss["roughness"],
            "ggx_alpha": gloss["ggx_alpha"],
            "gloss_units": gloss["units"],
            "peak_to_body": {
                "5": gloss["5"], "50": gloss["50"], "95": gloss["95"], "factor": or(&gloss["factor"], json!(0.0)),
            },
        },
        "materials": or(&old["materials"], json!([])),
        "undetermined": or(&old["undetermined"], json!(0.0)),
        "wide": or(&old["wide"], json!({ "factor": 0.0, "share": 0.0 })),
        "out_of_distribution": old["strangeness"],
        "scatter": old["scatter"],
        "disk_cells": old["normals"],
        "filled_cells": old["filled"],
        "self_shadowing": old["unshadowed"],
    })
}

fn residual(old: &Value) -> Value {
    json!({
        "misfit": old["misfit"],
        "expected": old["expected"],
        "noise_sd": old["sd"],
        "relative_noise": old["relative"],
        "smooth_error": old["discrepancy"],
    })
}
