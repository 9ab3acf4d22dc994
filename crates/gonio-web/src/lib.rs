//! The inference of gonio in a browser: a photograph of a ball in, its material, light and files
//! out, and nothing leaves the machine.
//!
//! * [`session`]: inference from a photograph, step by step, with results as JSON and bytes;
//! * [`preview`]: a photograph for display.
//!
//! This module hands a [`session::Session`] to JavaScript. `page/` holds the page: `index.html`
//! with its style, `page.js`, which displays, and `worker.js`, which runs a session in a worker, so
//! that the page stays responsive. `cargo run -p xtask -- web` packs all this into one file. The
//! worker measures times; nothing here reads a clock.

pub mod preview;
pub mod session;

use std::path::Path;

use wasm_bindgen::prelude::*;

use session::Product;

#[wasm_bindgen]
extern "C" {
    /// Tells the worker why the program is about to stop: a browser cannot unwind.
    #[wasm_bindgen(js_name = gonioPanicked)]
    fn panicked(message: &str);
}

/// Initialises the module; to be called once, before anything else.
#[wasm_bindgen]
pub fn prepare() {
    std::panic::set_hook(Box::new(|info| panicked(&info.to_string())));
    #[cfg(target_arch = "wasm32")]
    gemm_common::set_wasm_simd128(cfg!(target_feature = "simd128"));
}

/// A [`session::Session`] for JavaScript. Failures, and calls before their turn, throw a string
/// that can be shown.
#[wasm_bindgen]
pub struct Session(session::Session);

#[wasm_bindgen]
impl Session {
    /// Decodes a model and a picture. `name` is that of the picture's file.
    ///
    /// # Errors
    /// If one of them cannot be read.
    #[wasm_bindgen(constructor)]
    pub fn new(model: &[u8], name: &str, bytes: &[u8]) -> Result<Session, String> {
        let model = gonio_io::model::decode_model(Path::new("the model of the page"), model);
        session::Session::open(model.map_err(|e| e.to_string())?, name, bytes).map(Self)
    }

    /// Returns the picture for display, as JSON with a PNG of at most `side` pixels a side.
    pub fn preview(&self, side: usize) -> String {
        self.0.preview(side).to_string()
    }

    /// Finds the ball, or takes a given outline of three numbers (centre and radius in pixels) as
    /// it is. Returns JSON.
    ///
    /// # Errors
    /// If there is no ball, or too little of it.
    pub fn observe(&mut self, outline: Option<Vec<f64>>) -> Result<String, String> {
        self.0.observe(outline.as_deref()).map(|notes| notes.to_string())
    }

    /// Finds the material and its colours. Returns JSON.
    ///
    /// # Errors
    /// If the picture is black.
    pub fn material(&mut self) -> Result<String, String> {
        self.0.material().map(|notes| notes.to_string())
    }

    /// Finds the light on a grid of `side` texels a side. Returns JSON.
    ///
    /// # Errors
    /// If the prior does not cover the grid.
    pub fn light(&mut self, side: usize) -> Result<String, String> {
        self.0.light(side).map(|notes| notes.to_string())
    }

    /// The picture of the uncertainty, as SVG.
    ///
    /// # Errors
    /// If the material has not been found.
    pub fn uncertainty(&self) -> Result<Vec<u8>, String> {
        self.0.uncertainty()
    }

    /// Returns a file to save, by its name. `seconds` is JSON that goes into `result.json`.
    ///
    /// # Errors
    /// If there is no such file, or what it holds has not been found.
    pub fn product(&self, name: &str, seconds: &str) -> Result<Vec<u8>, String> {
        let product = Product::named(name).ok_or_else(|| format!("{name}: there is no such file"))?;
        self.0.product(product, seconds)
    }
}
