//! Software bill of materials of the program `gonio`, as CycloneDX 1.5 JSON.
//!
//! `cargo tree` lists the crates: unlike `cargo metadata`, it resolves the features of one package
//! alone. Licences come from `cargo metadata`, checksums from `Cargo.lock`. The output is
//! deterministic: equal lock files give equal output.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};

const PACKAGE: &str = "gonio-cli";
/// Folder of the learnt models in the program; its `PROVENANCE.md` describes the training data.
const MODELS: &str = "crates/gonio-io/model";

/// Name and version of a crate, unique in a lock file.
type Id = (String, String);

/// Writes the bill of materials; returns a summary line.
pub(crate) fn make(output: &Path) -> Result<String> {
    let bill = bill()?;
    let text = serde_json::to_string_pretty(&bill)? + "\n";
    fs::write(output, &text).with_context(|| output.display().to_string())?;
    let count = bill["components"].as_array().map_or(0, Vec::len);
    Ok(format!("{}: {count} components of gonio", output.display()))
}

fn bill() -> Result<Value> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?;
    let host = host()?;
    let tree = |edges: &str| {
        let arguments = ["tree", "--package", PACKAGE, "--edges", edges, "--target", &host, "--prefix", "depth"];
        let text = cargo(&root, &[&arguments[..], &["--format", " {p}", "--locked"]].concat())?;
        graph(&String::from_utf8(text)?)
    };
    let all = tree("normal,build")?;
    let linked = tree("normal,no-proc-macro")?;
    let metadata = cargo(&root, &["metadata", "--format-version", "1", "--filter-platform", &host, "--locked"])?;
    let metadata: Value = serde_json::from_slice(&metadata)?;
    let packages = packages(&metadata);
    let lock = fs::read_to_string(root.join("Cargo.lock")).context("Cargo.lock")?;
    let checksums = checksums(&lock);

    let mut program = Value::Null;
    let mut components = Vec::new();
    for id in all.keys() {
        let package =
            packages.get(id).with_context(|| format!("{} {}: missing in the output of cargo metadata", id.0, id.1))?;
        let mut component = component(id, package, checksums.get(id).map(String::as_str))?;
        if id.0 == PACKAGE {
            program = component;
            continue;
        }
        component["scope"] = json!(if linked.contains_key(id) { "required" } else { "excluded" });
        components.push(component);
    }
    let models = models(&root)?;
    let mut dependencies: Vec<Value> = all
        .iter()
        .map(|(id, on)| json!({ "ref": reference(id), "dependsOn": on.iter().map(reference).collect::<Vec<_>>() }))
        .collect();
    let holder = dependencies.iter_mut().find(|d| d["ref"].as_str().is_some_and(|r| r.starts_with("gonio-io@")));
    if let Some(on) = holder.and_then(|d| d["dependsOn"].as_array_mut()) {
        on.extend(models.iter().map(|model| model["bom-ref"].clone()));
    }
    components.extend(models);
    Ok(json!({
        "$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": program,
            "properties": [{ "name": "gonio:target", "value": host }],
        },
        "components": components,
        "dependencies": dependencies,
    }))
}

/// Returns the host platform of rustc.
fn host() -> Result<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let out = run(Command::new(rustc).arg("-vV"))?;
    let out = String::from_utf8(out)?;
    let host = out.lines().find_map(|line| line.strip_prefix("host: "));
    Ok(host.context("rustc -vV does not print its host")?.to_owned())
}

fn cargo(root: &Path, arguments: &[impl AsRef<OsStr>]) -> Result<Vec<u8>> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    run(Command::new(cargo).current_dir(root).args(arguments))
}

fn run(command: &mut Command) -> Result<Vec<u8>> {
    let out = command.stderr(Stdio::inherit()).output().with_context(|| format!("{command:?}: cannot be run"))?;
    if !out.status.success() {
        bail!("{command:?}: failed");
    }
    Ok(out.stdout)
}

/// Parses depth, name and version from `cargo tree`; returns each crate with its dependencies.
fn graph(tree: &str) -> Result<BTreeMap<Id, BTreeSet<Id>>> {
    let mut graph: BTreeMap<Id, BTreeSet<Id>> = BTreeMap::new();
    let mut path: Vec<Id> = Vec::new();
    for line in tree.lines() {
        let mut words = line.split_whitespace();
        let (depth, name, version) = (words.next(), words.next(), words.next());
        let (Some(depth), Some(name), Some(version)) =
            (depth.and_then(|d| d.parse::<usize>().ok()), name, version.and_then(|v| v.strip_prefix('v')))
        else {
            bail!("cargo tree printed {line:?}, which is not a crate");
        };
        let id = (name.to_owned(), version.to_owned());
        if depth > path.len() {
            bail!("cargo tree printed {line:?} without a parent crate");
        }
        path.truncate(depth);
        if let Some(parent) = path.last() {
            graph.entry(parent.clone()).or_default().insert(id.clone());
        }
        graph.entry(id.clone()).or_default();
        path.push(id);
    }
    Ok(graph)
}

fn packages(metadata: &Value) -> BTreeMap<Id, &Value> {
    let list = metadata["packages"].as_array().map(Vec::as_slice).unwrap_or_default();
    let id = |p: &Value| Some((p["name"].as_str()?.to_owned(), p["version"].as_str()?.to_owned()));
    list.iter().filter_map(|p| Some((id(p)?, p))).collect()
}

/// Returns the SHA-256 checksums of the crate archives.
fn checksums(lock: &str) -> BTreeMap<Id, String> {
    let mut sums = BTreeMap::new();
    for package in lock.split("[[package]]").skip(1) {
        let value = |key: &str| {
            let line = package.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = \""));
            line.and_then(|value| value.strip_suffix('"')).map(str::to_owned)
        };
        if let (Some(name), Some(version), Some(sum)) = (value("name"), value("version"), value("checksum")) {
            sums.insert((name, version), sum);
        }
    }
    sums
}

fn reference((name, version): &Id) -> String {
    format!("{name}@{version}")
}

fn component(id: &Id, package: &Value, checksum: Option<&str>) -> Result<Value> {
    let (name, version) = id;
    let licence = package["license"].as_str().with_context(|| format!("{name}: states no licence"))?;
    let mut component = json!({
        "type": if name == PACKAGE { "application" } else { "library" },
        "bom-ref": reference(id),
        "name": if name == PACKAGE { "gonio" } else { name },
        "version": version,
        // Old manifests separate alternative licences by a slash.
        "licenses": [{ "expression": licence.replace(" / ", " OR ").replace('/', " OR ") }],
    });
    if let Some(description) = package["description"].as_str() {
        component["description"] = json!(description.split_whitespace().collect::<Vec<_>>().join(" "));
    }
    match checksum {
        Some(sum) => component["hashes"] = json!([{ "alg": "SHA-256", "content": sum }]),
        None if package["source"].is_null() => {}
        None => bail!("{name} {version}: has no checksum in Cargo.lock"),
    }
    // Packages of this workspace are not in a registry; there, their names could belong to other
    // crates.
    if !package["source"].is_null() {
        component["purl"] = json!(format!("pkg:cargo/{name}@{}", version.replace('+', "%2B")));
    }
    Ok(component)
}

/// Returns the learnt models that are part of the program.
fn models(root: &Path) -> Result<Vec<Value>> {
    let folder = root.join(MODELS);
    let mut names = Vec::new();
    for entry in fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
        let name = entry?.file_name().to_string_lossy().into_owned();
        if !name.ends_with(".md") {
            names.push(name);
        }
    }
    names.sort();
    let model = |name: &String| {
        json!({
            "type": "machine-learning-model",
            "bom-ref": format!("model:{name}"),
            "name": name,
            "licenses": [{ "license": { "name": format!("terms of its training data: see {MODELS}/PROVENANCE.md") } }],
        })
    };
    Ok(names.iter().map(model).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text<'a>(value: &'a Value, key: &str) -> &'a str {
        value[key].as_str().unwrap_or_else(|| panic!("{key} of {value}"))
    }

    #[test]
    fn the_bill_lists_all_components_of_the_program() {
        let bill = bill().unwrap();
        assert_eq!((text(&bill, "bomFormat"), text(&bill, "specVersion")), ("CycloneDX", "1.5"));
        let program = &bill["metadata"]["component"];
        assert_eq!((text(program, "type"), text(program, "name")), ("application", "gonio"));
        assert_eq!(text(program, "version"), env!("CARGO_PKG_VERSION"));

        let components = bill["components"].as_array().unwrap();
        let find = |name: &str| components.iter().find(|c| c["name"] == name);
        for own in ["gonio", "gonio-app", "gonio-io", "gonio-linalg", "gonio-paper", "gonio-report", "gonio-train"] {
            let own = find(own).unwrap_or_else(|| panic!("no {own}"));
            assert_eq!(own["licenses"][0]["expression"], "MIT OR Apache-2.0");
            assert!(own["purl"].is_null() && own["hashes"].is_null(), "{own}");
        }
        let strange = components.iter().filter(|c| c["type"] == "library" && !text(c, "name").starts_with("gonio"));
        for one in strange.filter(|c| c["name"] != "shared-features") {
            assert!(text(one, "purl").starts_with(&format!("pkg:cargo/{}@", text(one, "name"))), "{one}");
            let sum = text(&one["hashes"][0], "content");
            assert!(sum.len() == 64 && sum.bytes().all(|b| b.is_ascii_hexdigit()), "{one}");
            let licence = text(&one["licenses"][0], "expression");
            assert!(!licence.contains('/'), "{licence}");
        }
        // Linked crates are required and crates of the build excluded. Crates of tests, of other
        // programs and of disabled features are absent.
        assert_eq!(find("clap").unwrap()["scope"], "required");
        assert_eq!(find("serde_derive").unwrap()["scope"], "excluded");
        for other in ["proptest", "divan", "nuts-rs", "walrus", "xtask", "gonio-eval", "pyo3", "rawler"] {
            assert!(find(other).is_none(), "{other}");
        }
        assert_eq!(find("gonio-1.model").unwrap()["type"], "machine-learning-model");

        let name = |c: &Value| text(c, "bom-ref").to_owned();
        let mut names: BTreeSet<String> = components.iter().map(name).collect();
        assert_eq!(names.len(), components.len());
        assert!(names.insert(name(program)));
        let dependencies = bill["dependencies"].as_array().unwrap();
        let mut needed = BTreeSet::from([name(program)]);
        for dependency in dependencies {
            assert!(names.contains(text(dependency, "ref")), "{dependency}");
            needed.extend(dependency["dependsOn"].as_array().unwrap().iter().map(|d| d.as_str().unwrap().to_owned()));
        }
        assert_eq!(needed, names);
    }

    #[test]
    fn parses_the_output_of_cargo_tree() {
        let id = |name: &str| (name.to_owned(), "1.0.0".to_owned());
        let read =
            graph("0 a v1.0.0 (/here)\n1 b v1.0.0\n2 c v1.0.0 (proc-macro)\n1 c v1.0.0 (proc-macro) (*)\n").unwrap();
        let expected = [(id("a"), [id("b"), id("c")].into()), (id("b"), [id("c")].into()), (id("c"), [].into())];
        assert_eq!(read, BTreeMap::from(expected));
        for wrong in ["a v1.0.0", "0 a", "0 a 1.0.0", "1 a v1.0.0"] {
            assert!(graph(wrong).is_err(), "{wrong}");
        }
    }
}
