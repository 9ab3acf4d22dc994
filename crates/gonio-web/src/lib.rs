//! The inference of gonio in a browser: a photograph of a ball in, its material, light and files
//! out, and nothing leaves the machine.
//!
//! * [`session`]: a photograph and what is found of it, step by step, as JSON and bytes;
//! * [`preview`]: a photograph to look at.
//!
//! This module hands a [`session::Session`] to JavaScript. `page/` holds the page: `index.html`
//! with its style, `page.js`, which shows, and `worker.js`, which runs a session in a worker, so
//! that the page stays alive. `cargo run -p xtask -- web` makes one file of all this. Times are
//! taken by the worker; nothing here reads a clock.

pub mod preview;
pub mod session;

use wasm_bindgen::prelude::*;

use session::Product;

#[wasm_bindgen]
extern "C" {
    /// Tells the worker why the program is about to stop: a browser cannot unwind.
    #[wasm_bindgen(js_name = gonioPanicked)]
    fn panicked(message: &str);
}

/// What is to be done once, before anything else.
#[wasm_bindgen]
pub fn prepare() {
    std::panic::set_hook(Box::new(|info| panicked(&info.to_string())));
    #[cfg(target_arch = "wasm32")]
    gemm_common::set_wasm_simd128(cfg!(target_feature = "simd128"));
}

/// A [`session::Session`] for JavaScript. What fails throws a string that can be shown. What is
/// called before its turn throws too.
#[wasm_bindgen]
pub struct Session(session::Session);

#[wasm_bindgen]
impl Session {
    /// Decodes a picture. `name` is that of its file.
    ///
    /// # Errors
    /// If it cannot be read.
    #[wasm_bindgen(constructor)]
    pub fn new(name: &str, bytes: &[u8]) -> Result<Session, String> {
        session::Session::open(name, bytes).map(Self)
    }

    /// The picture to look at, as JSON with a PNG of at most so many pixels a side.
    pub fn preview(&self, side: usize) -> String {
        self.0.preview(side).to_string()
    }

    /// Finds the ball; an outline of three numbers (centre and radius in pixels) is taken as it is.
    /// JSON.
    ///
    /// # Errors
    /// If there is no ball, or too little of it.
    pub fn observe(&mut self, outline: Option<Vec<f64>>) -> Result<String, String> {
        self.0.observe(outline.as_deref()).map(|notes| notes.to_string())
    }

    /// Finds the material and its colours. JSON.
    ///
    /// # Errors
    /// If the picture is black.
    pub fn material(&mut self) -> Result<String, String> {
        self.0.material().map(|notes| notes.to_string())
    }

    /// Finds the light on a grid of so many texels a side. JSON.
    ///
    /// # Errors
    /// If the grid is none.
    pub fn light(&mut self, side: usize) -> Result<String, String> {
        self.0.light(side).map(|notes| notes.to_string())
    }

    /// The picture of the uncertainty, as PNG.
    ///
    /// # Errors
    /// If the material has not been found.
    pub fn uncertainty(&self) -> Result<Vec<u8>, String> {
        self.0.uncertainty()
    }

    /// A file to keep, by its name. `seconds` is JSON that goes into `result.json`.
    ///
    /// # Errors
    /// If there is no such file, or what it holds has not been found.
    pub fn product(&self, name: &str, seconds: &str) -> Result<Vec<u8>, String> {
        let product = Product::named(name).ok_or_else(|| format!("{name}: there is no such file"))?;
        self.0.product(product, seconds)
    }
}
