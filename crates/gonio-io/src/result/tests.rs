use serde_json::json;

use super::*;

fn written(document: &Value) -> Result<ResultFile, Error> {
    of_value(Path::new("out/result.json"), document.clone())
}

fn material(document: &Value) -> ResultDocument {
    match written(document).unwrap() {
        ResultFile::Material(document) => *document,
        ResultFile::Regions(_) => panic!("not a material"),
    }
}

/// Returns a document with all sections.
fn complete() -> ResultDocument {
    let shape = Shape::Sphere { circle: Circle { x: 3.0, y: 4.0, radius: 2.0 } };
    let report = PixelCounts { used_pixels: 7, ..PixelCounts::default() };
    let posterior = Posterior {
        highlight: Highlight {
            roughness: Some([0.1, 0.2, 0.3].into()),
            peak_to_body: PeakToBody { quantiles: [1.0, 2.0, 4.0].into(), factor: 4.0 },
            ..Highlight::default()
        },
        materials: vec![SimilarMaterial { name: "brass".into(), weight: 0.25 }],
        ..Posterior::default()
    };
    let patch = Patch { reflectance: 0.9, rgb: [1.0, 1.0, 0.9], pixels: 20, clipped: 0, variation: 0.01 };
    let reference =
        Reference { kind: ReferenceKind::WhitePatch(patch), white: [1.0; 3], log_chroma: [0.0; 2], scale: None };
    ResultDocument {
        image: Some("ball.exr".into()),
        observations: Some(Observations { shape, detection: None, surface: None, visibility: None, report }),
        posterior: Some(posterior),
        light: Some(Light { coefficients: vec![1.0, 0.5], ..Light::default() }),
        residual: Some(Residual { misfit: Some(0.03), ..Residual::default() }),
        reference: Some(reference),
        ..ResultDocument::new("learnt", "0.1.0")
    }
}

#[test]
fn a_document_is_the_same_after_a_round_trip() {
    let document = complete();
    let encoded: Value = serde_json::from_str(&encode(&document)).unwrap();
    assert_eq!(
        encoded["posterior"]["highlight"]["peak_to_body"],
        json!({ "5": 1.0, "50": 2.0, "95": 4.0, "factor": 4.0 })
    );
    assert_eq!(
        encoded["observations"]["shape"],
        json!({ "kind": "sphere", "circle": { "x": 3.0, "y": 4.0, "radius": 2.0 } })
    );
    assert_eq!((&encoded["reference"]["kind"], &encoded["bracket"]), (&json!("white patch"), &Value::Null));
    assert_eq!(material(&encoded), document);
}

#[test]
fn numbers_that_are_not_finite_can_be_read_again() {
    let mut document = complete();
    if let Some(posterior) = &mut document.posterior {
        posterior.highlight.peak_to_body.factor = f64::INFINITY;
        posterior.highlight.roughness = Some([f64::NAN; 3].into());
    }
    let read = material(&serde_json::from_str(&encode(&document)).unwrap()).posterior.unwrap();
    assert!(read.highlight.peak_to_body.factor.is_nan() && read.highlight.roughness.unwrap().median.is_nan());
}

#[test]
fn version_1_keeps_material_colour_and_residual() {
    let old = json!({
        "format": "gonio-result", "version": 1, "gonio": "0.1.0", "image": "ball.exr", "method": "learnt",
        "model": { "provenance": "p", "rank": 8, "map": "folded" },
        "observations": { "circle": { "x": 1, "y": 1, "radius": 1 } },
        "posterior": {
            "materials": [{ "name": "brass", "weight": 0.5 }], "undetermined": 0.1,
            "wide": { "factor": 3.0, "share": 0.2 }, "strangeness": 0.01, "scatter": 0.02,
            "gloss": {
                "5": 1.0, "50": 2.0, "95": 8.0, "factor": 8.0, "finish": "satin", "verdict": "satin: roughness 0.4",
                "roughness": { "5": 0.3, "50": 0.4, "95": 0.5 },
            },
        },
        "reflectance": { "quantiles": "brdf.npz", "note": "words" },
        "colour": { "how": "estimate", "body": { "rgb": [1.0, 1.0, 1.0], "log_chroma": [0.0, 0.0], "strip": [] } },
        "noise": { "sd": 0.1, "relative": 0.2, "misfit": 0.05, "expected": 0.03 },
        "colorspace": { "output": "acescg" }, "warnings": ["odd"], "seconds": { "total": 3.0 },
    });
    let new = material(&old);
    let posterior = new.posterior.unwrap();
    assert_eq!(posterior.highlight.peak_to_body.quantiles, [1.0, 2.0, 8.0].into());
    assert_eq!((&*posterior.highlight.finish, posterior.highlight.ggx_alpha), ("satin", None));
    assert_eq!((posterior.out_of_distribution, posterior.materials[0].weight), (Some(0.01), 0.5));
    let residual = new.residual.unwrap();
    assert_eq!((residual.misfit, residual.expected, residual.relative_noise), (Some(0.05), Some(0.03), Some(0.2)));
    assert_eq!((new.reflectance.absolute, new.reflectance.normal_albedo), (false, 0.5));
    assert_eq!((&*new.colorspace.output, new.version, new.observations), ("acescg", 2, None));
    for empty in
        [json!({}), json!({ "posterior": {}, "noise": {} }), json!({ "posterior": { "gloss": { "5": null } } })]
    {
        let mut old = empty;
        old["format"] = json!("gonio-result");
        assert_eq!(material(&old).posterior, None);
    }
}

#[test]
fn regions_of_both_versions_are_read() {
    for version in [1, 2] {
        let document = json!({
            "format": "gonio-regions", "version": version, "gonio": "0.1.0", "image": "two.exr", "method": "learnt",
            "regions": [{ "name": "1", "folder": "1", "relative_albedo": null, "gloss": [1, 2, 3], "misfit": 0.1 }],
            "warnings": [], "note": "words",
        });
        let ResultFile::Regions(regions) = written(&document).unwrap() else { panic!("not regions") };
        assert_eq!((regions.regions[0].folder.as_str(), regions.regions[0].misfit), ("1", 0.1));
    }
}

#[test]
fn errors_name_the_file_and_the_cause() {
    let error = |document: Value| written(&document).unwrap_err().to_string();
    assert!(error(json!({ "format": "gonio-export" })).contains("not a result of gonio infer"));
    assert!(error(json!([1])).contains("not a result of gonio infer"));
    assert!(error(json!({ "format": "gonio-result", "version": 9 })).contains("update gonio"));
    let wrong = error(json!({ "format": "gonio-result", "version": 2, "posterior": { "materials": 3 } }));
    assert!(wrong.starts_with("out/result.json: is not a valid result") && !wrong.contains('\n'), "{wrong}");
}

/// The checked-in schema is that of the types. `GONIO_UPDATE_SCHEMA=1` writes it.
#[test]
fn the_schema_in_the_documentation_is_current() {
    #[derive(schemars::JsonSchema)]
    #[serde(untagged)]
    #[expect(dead_code, reason = "the schema has the variants")]
    enum Documents {
        Result(Box<ResultDocument>),
        Regions(RegionsDocument),
        Export(ExportDocument),
    }
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/result.schema.json");
    let settings = schemars::generate::SchemaSettings::default().for_serialize();
    let schema = settings.into_generator().into_root_schema_for::<Documents>();
    let schema = format!("{}\n", serde_json::to_string_pretty(&schema).unwrap());
    if std::env::var_os("GONIO_UPDATE_SCHEMA").is_some() {
        std::fs::write(&file, &schema).unwrap();
    }
    let current = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(current == schema, "docs/result.schema.json is not current; run this test with GONIO_UPDATE_SCHEMA=1");
}
