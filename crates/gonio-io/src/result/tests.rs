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
            peak_height: PeakHeight { quantiles: [1.0, 2.0, 4.0].into(), factor: 4.0 },
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
        encoded["posterior"]["highlight"]["peak_height"],
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
        posterior.highlight.peak_height.factor = f64::INFINITY;
        posterior.highlight.roughness = Some([f64::NAN; 3].into());
    }
    let read = material(&serde_json::from_str(&encode(&document)).unwrap()).posterior.unwrap();
    assert!(read.highlight.peak_height.factor.is_nan() && read.highlight.roughness.unwrap().median.is_nan());
}

#[test]
fn regions_are_read() {
    let document = json!({
        "format": "gonio-regions", "version": 2, "gonio": "0.1.0", "image": "two.exr", "method": "learnt",
        "regions": [{ "name": "1", "folder": "1", "relative_albedo": null, "misfit": 0.1 }], "warnings": [],
    });
    let ResultFile::Regions(regions) = written(&document).unwrap() else { panic!("not regions") };
    assert_eq!((regions.regions[0].folder.as_str(), regions.regions[0].misfit), ("1", 0.1));
}

#[test]
fn errors_name_the_file_and_the_cause() {
    let error = |document: Value| written(&document).unwrap_err().to_string();
    assert!(error(json!({ "format": "gonio-export" })).contains("not a result of gonio infer"));
    assert!(error(json!([1])).contains("not a result of gonio infer"));
    assert!(error(json!({ "format": "gonio-result", "version": 9 })).contains("update gonio"));
    assert!(error(json!({ "format": "gonio-result", "version": 1 })).contains("run gonio infer again"));
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
