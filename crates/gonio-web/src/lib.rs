//! Estimates BRDF and light from a photograph of a ball in a browser, without a network.
//!
//! * [`session`]: stepwise inference from a photograph, with results as JSON and bytes;
//! * [`preview`]: a photograph for display.
//!
//! This module exposes a [`session::Session`] to JavaScript. `page/` contains the page:
//! `index.html` with its style, `page.js`, which displays results, and `worker.js`, which runs a
//! session in a worker, so that the page stays responsive.
//!
//! `cargo run -p xtask --features web -- web` packs everything into one file. The worker measures
//! times; this crate does not read a clock.

pub mod preview;
pub mod session;

use std::path::Path;

use wasm_bindgen::prelude::*;

use session::Product;

#[wasm_bindgen]
extern "C" {
    /// Reports a panic to the worker, because WebAssembly cannot unwind.
    #[wasm_bindgen(js_name = gonioPanicked)]
    fn panicked(message: &str);
}

/// Initialises the module. Call it once, before any other function.
#[wasm_bindgen]
pub fn prepare() {
    std::panic::set_hook(Box::new(|info| panicked(&info.to_string())));
    #[cfg(target_arch = "wasm32")]
    gemm_common::set_wasm_simd128(cfg!(target_feature = "simd128"));
}

/// A [`session::Session`] for JavaScript. Errors and calls out of order throw a displayable string.
#[wasm_bindgen]
pub struct Session(session::Session);

#[wasm_bindgen]
impl Session {
    /// Decodes a model and an image. `name` is the file name of the image.
    ///
    /// # Errors
    /// If one of them cannot be read.
    #[wasm_bindgen(constructor)]
    pub fn new(model: &[u8], name: &str, bytes: &[u8]) -> Result<Session, String> {
        let model = gonio_io::model::decode_model(Path::new("the embedded model"), model);
        session::Session::open(model.map_err(|e| e.to_string())?, name, bytes).map(Self)
    }

    /// Returns the image for display, as JSON with a PNG of at most `side` pixels per side.
    pub fn preview(&self, side: usize) -> String {
        self.0.preview(side).to_string()
    }

    /// Detects the ball, or uses a given outline of three numbers (centre and radius in pixels).
    /// Returns JSON.
    ///
    /// # Errors
    /// If the ball has too few usable pixels.
    pub fn observe(&mut self, outline: Option<Vec<f64>>) -> Result<String, String> {
        self.0.observe(outline.as_deref()).map(|document| document.to_string())
    }

    /// Estimates the material and its colours. Returns JSON.
    ///
    /// # Errors
    /// If the image is black.
    pub fn material(&mut self) -> Result<String, String> {
        self.0.material().map(|document| document.to_string())
    }

    /// Estimates the light on a grid of `side` texels per side. Returns JSON.
    ///
    /// # Errors
    /// If the prior does not support the grid, or a light on the grid of the program does not
    /// reproduce the photograph.
    pub fn light(&mut self, side: usize) -> Result<String, String> {
        self.0.light(side).map(|document| document.to_string())
    }

    /// Returns the uncertainty picture as SVG.
    ///
    /// # Errors
    /// If the material has not been estimated yet.
    pub fn uncertainty(&self) -> Result<Vec<u8>, String> {
        self.0.uncertainty()
    }

    /// Returns an output file by name. `seconds` is JSON for `result.json`.
    ///
    /// # Errors
    /// If the name is unknown, or the content has not been estimated yet.
    pub fn product(&self, name: &str, seconds: &str) -> Result<Vec<u8>, String> {
        let product = Product::named(name).ok_or_else(|| format!("{name}: unknown output file"))?;
        self.0.product(product, seconds)
    }
}
