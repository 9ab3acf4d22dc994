//! Builds the page of `gonio-web`.
//!
//! This module compiles the crate, binds it to JavaScript, and combines everything in one file.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;
use wasm_bindgen_cli_support::Bindgen;

use crate::relaxed;

const TARGET: &str = "wasm32-unknown-unknown";
/// Compiler flags for SIMD. All browsers have supported it since 2023, and the inference needs it
/// for speed.
const FEATURES: &str = "-C target-feature=+simd128";
/// Binary digits of the numbers in the model of the page. With these, the BRDF of the sample
/// differs from that of the program by less than 0.1 %.
const DIGITS: u32 = 16;
/// Placeholders in `index.html`, each used once, and the files that replace them unchanged.
const PARTS: [(&str, &[&str]); 2] = [
    ("@@STYLE@@", &["crates/gonio-report/viewer/viewer.css", "crates/gonio-web/page/page.css"]),
    (
        "@@SCRIPT@@",
        &[
            "crates/gonio-report/viewer/renderer.js",
            "crates/gonio-report/viewer/viewer.js",
            "crates/gonio-web/page/outline.js",
            "crates/gonio-web/page/page.js",
        ],
    ),
];

/// Builds `index.html` in a folder; returns a summary line.
pub(crate) fn make(output: &Path) -> Result<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?;
    let module = compile(&root)?;
    let mut bound = Bindgen::new()
        .input_path(&module)
        .no_modules(true)?
        .typescript(false)
        // Names are removed here, because the option `strip` of the profile would also remove the
        // list of vector instructions.
        .remove_name_section(true)
        .generate_output()
        .with_context(|| format!("{}: cannot be bound to JavaScript", module.display()))?;
    let worker = format!("{}\n{}", bound.js(), read(&root, "crates/gonio-web/page/worker.js")?);
    relaxed::replace(bound.wasm_mut())?;
    let wasm = bound.wasm_mut().emit_wasm();
    let sample = root.join("samples/ball.exr");
    let sample = fs::read(&sample).with_context(|| sample.display().to_string())?;

    let mut page = read(&root, "crates/gonio-web/page/index.html")?;
    for (place, files) in PARTS {
        let texts: Result<Vec<String>> = files.iter().map(|file| read(&root, file)).collect();
        fill(&mut page, place, &texts?.join("\n"))?;
    }
    fill(&mut page, "@@WORKER@@", &worker)?;
    let (module, model) = (packed(&wasm)?, packed(&planes(&gonio_io::model::embedded_rounded(DIGITS)?))?);
    fill(&mut page, "@@MODULE@@", &STANDARD.encode(&module))?;
    fill(&mut page, "@@MODEL@@", &STANDARD.encode(&model))?;
    fill(&mut page, "@@SAMPLE@@", &STANDARD.encode(&sample))?;
    fs::create_dir_all(output).with_context(|| output.display().to_string())?;
    let path = output.join("index.html");
    fs::write(&path, &page).with_context(|| path.display().to_string())?;
    let megabytes = |bytes: usize| bytes as f64 / 1e6;
    Ok(format!(
        "{}: {:.1} MB; compressed, the module has {:.1} MB and the model {:.1} MB",
        path.display(),
        megabytes(page.len()),
        megabytes(module.len()),
        megabytes(model.len())
    ))
}

/// Compresses bytes with gzip, which browsers can decompress.
fn packed(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}

/// Groups the bytes of 4-byte words by position: all first bytes, then all second bytes, and so on.
/// If the last digits of the numbers are zero, the result compresses by a quarter better.
fn planes(bytes: &[u8]) -> Vec<u8> {
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().next_multiple_of(4), 0);
    (0..4).flat_map(|plane| padded.iter().copied().skip(plane).step_by(4)).collect()
}

/// Compiles `gonio-web`; returns the path of the module.
fn compile(root: &Path) -> Result<PathBuf> {
    if !has_target()? {
        bail!("the Rust target {TARGET} is not installed; run `rustup target add {TARGET}`");
    }
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = Command::new(cargo)
        .current_dir(root)
        .args(["build", "--package", "gonio-web", "--lib", "--profile", "web", "--target", TARGET])
        .arg("--message-format=json-render-diagnostics")
        // Flags meant for the host would override those for the browser.
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        .env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", FEATURES)
        .stderr(Stdio::inherit())
        .output()
        .context("cargo cannot be run")?;
    if !built.status.success() {
        bail!("gonio-web does not compile for {TARGET}");
    }
    let messages = built.stdout.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok());
    let files = messages.flat_map(|message: Value| message["filenames"].as_array().cloned().unwrap_or_default());
    let mut names = files.filter_map(|file| file.as_str().map(PathBuf::from));
    names
        .rfind(|file| file.file_name().is_some_and(|name| name == "gonio_web.wasm"))
        .context("cargo did not print the path of the module")
}

/// Returns whether the standard library for browsers is installed.
fn has_target() -> Result<bool> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let found = Command::new(rustc)
        .args(["--print", "target-libdir", "--target", TARGET])
        .output()
        .context("rustc cannot be run")?;
    let folder = String::from_utf8_lossy(&found.stdout);
    Ok(found.status.success() && Path::new(folder.trim()).is_dir())
}

fn read(root: &Path, file: &str) -> Result<String> {
    fs::read_to_string(root.join(file)).with_context(|| file.to_owned())
}

/// Replaces a placeholder by a text. Fails if the text would end its script element.
fn fill(page: &mut String, place: &str, text: &str) -> Result<()> {
    if text.contains("</script") || text.contains("<!--") {
        bail!("{place}: the text would end its element");
    }
    if page.matches(place).count() != 1 {
        bail!("{place}: must be in index.html once");
    }
    *page = page.replace(place, text);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_grouped_by_position_in_a_word() {
        assert_eq!(planes(&[1, 2, 3, 4, 5, 6, 7, 8]), [1, 5, 2, 6, 3, 7, 4, 8]);
        assert_eq!(planes(&[1, 2, 3, 4, 5]), [1, 5, 2, 0, 3, 0, 4, 0]);
    }

    #[test]
    fn each_placeholder_is_replaced_once() {
        let mut page = "a PLACE b".to_owned();
        assert!(fill(&mut page, "PLACE", "</script>").is_err());
        fill(&mut page, "PLACE", "text").unwrap();
        assert_eq!(page, "a text b");
        assert!(fill(&mut page, "PLACE", "text").is_err());
    }
}
