//! Tests of `gonio export` and `gonio convert`.

use gonio::lighting::studio_light;
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio_app::export::Target;

use crate::support::{Bench, material, merl};

fn bench() -> Bench {
    let bench = Bench::new();
    let tables = [1.0, 0.6, 0.3].map(|body| material(0.1 * body, 0.3));
    gonio_io::merl::write(bench.path("in.binary"), &MerlTable::from_bivariate(tables.each_ref())).unwrap();
    bench
}

#[test]
fn writes_all_targets_with_their_errors() {
    let bench = bench();
    bench.run("export in.binary -o few").succeeds();
    let few = bench.json("few/export.json")["exports"].as_object().unwrap().len();
    assert_eq!(few, Target::DEFAULT.len());
    let all = Target::ALL.map(|target| target.names().0).join(",");
    bench.run(&format!("export in.binary -o out --name ball --to {all}")).succeeds();
    let exports = &bench.json("out/export.json")["exports"];
    let count = exports.as_object().unwrap().len();
    assert_eq!(count, Target::ALL.len());
    for (target, entry) in exports.as_object().unwrap() {
        for file in entry["files"].as_array().unwrap() {
            assert!(!bench.read(&format!("out/{}", file.as_str().unwrap())).is_empty(), "{target}");
        }
        let (relight, log) = (entry["relight"].as_f64().unwrap(), entry["log_relight"].as_f64().unwrap());
        let most = match target.as_str() {
            "merl" => 1e-4,
            "bsdf" => 0.02,
            "merl-grey" => 1.0,
            _ => 0.5,
        };
        assert!(relight <= most && log <= most, "{target}: {relight} {log}");
        assert!(!entry["conventions"].as_str().unwrap().is_empty());
    }
    let text = |file: &str| String::from_utf8(bench.read(&format!("out/{file}"))).unwrap();
    assert!(text("principled.xml").contains("id=\"ball\""));
    let roughness = &exports["mtlx"]["parameters"]["roughness"].as_f64().unwrap();
    assert!(
        text("openpbr.mtlx").contains(&format!("name=\"specular_roughness\" type=\"float\" value=\"{roughness:.4}\""))
    );
    let roughness = &exports["blender"]["parameters"]["roughness"].as_f64().unwrap();
    assert!(text("blender.py").contains(&format!("\"Roughness\": {roughness:.4}")));
}

#[test]
fn albedo_scales_all_targets() {
    let bench = bench();
    bench.run("export in.binary -o out --to merl,bsdf,ward --albedo 0.25").succeeds();
    assert_eq!(bench.json("out/export.json")["albedo"].as_f64().map(|a| (1e6 * a).round() / 1e6), Some(0.25));
    let table = gonio_io::brdf::read(bench.path("out/brdf.binary")).unwrap();
    let luminance = BivariateTable::luminance(&table.to_bivariate());
    assert!((luminance.normal_albedo() - 0.25).abs() < 1e-3);
    let tensor = gonio_io::brdf::read(bench.path("out/brdf_rgb.bsdf")).unwrap();
    assert!((tensor.bivariate(0).normal_albedo() / table.bivariate(0).normal_albedo() - 1.0).abs() < 0.02);
    assert_eq!(bench.json("out/export.json")["exports"].as_object().unwrap().len(), 3);
}

#[test]
fn conversion_and_back_preserves_the_brdf() {
    let bench = bench();
    bench.run("convert in.binary a.bsdf").succeeds();
    bench.run("convert a.bsdf b.binary").succeeds();
    bench.run("convert in.binary c_spec.bsdf --grey").succeeds();
    // Arrays of numpy, tables of text and measurements of MDL have the same values.
    let read = |file: &str| gonio_io::brdf::read(bench.path(file)).unwrap().bivariate(1);
    let before = read("in.binary");
    for (file, tolerance) in [("d.npz", 1e-3), ("d.csv", 1e-3), ("d.mbsdf", 0.03)] {
        bench.run(&format!("convert in.binary {file}")).succeeds();
        let after = read(file);
        for at in gonio::reflectance::trusted_cells() {
            let (a, b) = (before.as_slice()[at], after.as_slice()[at]);
            assert!((a - b).abs() < tolerance * a, "{file}, cell {at}: {a} {b}");
        }
    }
    bench.write("table.txt", b"theta_h,theta_d,red,green,blue\n");
    bench.refuses("convert table.txt e.binary", &["table.txt: is not in a format of BRDFs", "CSV table"]);
    bench.write("table.csv", b"theta_h,theta_d,r,g,b\n0,0,1,1,1\n");
    bench.refuses("convert table.csv e.binary", &["table.csv: has no column red"]);
    let [a, b] = ["in.binary", "b.binary"].map(|f| gonio_io::brdf::read(bench.path(f)).unwrap());
    for c in 0..3 {
        let (a, b) = (a.bivariate(c), b.bivariate(c));
        let off: f64 = (0..5000).map(|i| f64::from((a.as_slice()[i] - b.as_slice()[i]).abs() / a.as_slice()[i])).sum();
        assert!(off / 5000.0 < 0.03, "{c}: {off}");
    }
    // `gonio render` accepts RGL tensors.
    bench.write("light.hdr", &gonio_io::picture::encode_hdr(studio_light(16).radiance()));
    bench.run("render --brdf a.bsdf --light light.hdr -o a.exr --size 16").succeeds();
}

#[test]
fn rejects_invalid_input() {
    let bench = bench();
    gonio_io::merl::write(bench.path("black.binary"), &merl(&BivariateTable::from_fn(|_, _| 0.0))).unwrap();
    std::fs::create_dir(bench.path("empty")).unwrap();
    let tensor = {
        bench.run("convert in.binary t.bsdf").succeeds();
        bench.read("t.bsdf")
    };
    bench.write("short.bsdf", &tensor[..tensor.len() / 2]);
    for (arguments, message) in [
        ("export in.binary", "specify one with -o DIR"),
        ("export none.binary -o x", "none.binary"),
        ("export empty -o x", "empty: does not contain brdf.npz"),
        ("export black.binary -o x", "black.binary: cannot be exported, because the BRDF is zero"),
        ("export in.binary -o x --to pdf", "--to"),
        ("export in.binary -o x --albedo 2", "--albedo"),
        ("export short.bsdf -o x", "short.bsdf: is truncated"),
        ("convert in.binary x.txt", "x.txt: is not the name of a BRDF file that gonio writes"),
        ("convert short.bsdf x.binary", "short.bsdf: is truncated"),
    ] {
        bench.refuses(arguments, &[message]);
    }
}

#[test]
fn scenes_use_the_light_of_the_results() {
    let bench = bench();
    let read = |file: &str| gonio_app::read_light(&bench.path(file), None).unwrap().radiance().as_slice().to_vec();
    let means = |file: &str| read(file).iter().sum::<glam::Vec3>() / read(file).len() as f32;
    // The scene of a BRDF without a light uses the studio light.
    bench.run("export in.binary -o alone --to blender").succeeds();
    assert_eq!(bench.json("alone/export.json")["light"], "studio");
    assert!(!bench.path("alone/scene.xml").exists());

    // The map of an estimated light is grey; its colour is in `result.json`. Scaling the BRDF does
    // not change the brightness of the scene.
    std::fs::create_dir(bench.path("out")).unwrap();
    bench.run("convert in.binary out/brdf.npz").succeeds();
    let grey = studio_light(16).radiance().map(|p| glam::Vec3::splat(p.x));
    bench.write("out/light.exr", &gonio_io::picture::encode_exr(&grey, None));
    let result = |absolute: bool| {
        let result = format!(
            r#"{{"format": "gonio-result", "reflectance": {{"absolute": {absolute}}}, "colour": {{"light": {{"rgb": [0.5, 1.0, 2.0]}}}}}}"#
        );
        bench.write("out/result.json", result.as_bytes());
    };
    result(true);
    bench.run("export out --to bsdf,mitsuba,merl").succeeds();
    assert_eq!(bench.json("out/export/export.json")["light"], "of the results");
    let (found, lit) = (means("out/light.exr"), means("out/export/light.exr"));
    assert!((lit / found - glam::Vec3::new(0.5, 1.0, 2.0)).abs().max_element() < 1e-2, "{lit} {found}");
    let albedo = bench.json("out/export/export.json")["albedo"].as_f64().unwrap();
    bench.run("export out -o dark --to mitsuba --albedo 0.05").succeeds();
    let brighter = f64::from(means("dark/light.exr").y / lit.y);
    assert!((brighter * 0.05 / albedo - 1.0).abs() < 1e-2, "{brighter}");

    // If the photograph does not determine the scale, the models of renderers do.
    result(false);
    let printed = bench.run("export out -o fitted --to mtlx,mitsuba").succeeds().stdout;
    let fitted = bench.json("fitted/export.json");
    let scaled = fitted["albedo"].as_f64().unwrap();
    assert!(
        fitted["albedo_source"] == "fit" && scaled <= albedo && printed.contains(&format!("incidence {scaled:.2}"))
    );
    let brighter = f64::from(means("fitted/light.exr").y / lit.y);
    assert!((brighter * scaled / albedo - 1.0).abs() < 1e-2, "{brighter}");
    bench.run("export out -o table --to merl").succeeds();
    assert_eq!(bench.json("table/export.json")["albedo_source"], "input");
    result(true);

    // The scene uses the more accurate material. It is removed if neither material is exported.
    let scene = |folder: &str| String::from_utf8(bench.read(&format!("{folder}/scene.xml"))).unwrap();
    assert!(scene("out/export").contains("name=\"material\" value=\"brdf_measured.xml\""));
    assert!(scene("dark").contains("name=\"material\" value=\"principled.xml\""));
    bench.run("export out --to merl").succeeds();
    assert!(!bench.path("out/export/scene.xml").exists() && !bench.path("out/export/light.exr").exists());

    // The map of a known light has colours.
    bench.write("out/light.exr", &gonio_io::picture::encode_exr(studio_light(16).radiance(), None));
    bench.run("export out --to mitsuba").succeeds();
    assert_eq!(read("out/export/light.exr"), read("out/light.exr"));
    bench.write("out/light.exr", b"no picture");
    bench.refuses("export out --to mitsuba", &["light.exr"]);
}
