//! Options of a run, and the grid that they select.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use gonio::inference::Hyperparameters;
use gonio_paper::{PlanSettings, VariationalSettings};
use serde::{Deserialize, Serialize};

use super::estimators::Estimator;
use super::grid::Protocol;
use super::store::{Conditions, VERSION};
use crate::data::Lights;
use crate::materials::Materials;
use crate::posteriors::Effort;

/// Options of `gonio-eval bench`.
#[derive(clap::Args)]
#[command(args_override_self = true)]
pub(crate) struct BenchOptions {
    /// Output folder; an unfinished run in it is resumed
    #[arg(short, long)]
    pub(crate) output: PathBuf,
    /// Test 20 left-out materials in 4 lights instead of the full grid
    #[arg(long)]
    quick: bool,
    /// Folder of full MERL `.binary` files [default: DATA/merl]
    #[arg(long)]
    merl: Option<PathBuf>,
    /// Relation of the tested to the training materials [default: all,leave-out; with --quick
    /// leave-out]
    #[arg(long, value_enum, value_delimiter = ',')]
    protocols: Vec<Protocol>,
    /// Test only these materials (each protocol skips those that it excludes)
    #[arg(long, value_delimiter = ',')]
    materials: Vec<String>,
    /// Test lights of the photographs [default: all; with --quick four]
    #[arg(long, value_delimiter = ',')]
    lights: Vec<String>,
    /// Test lights that estimates are relit in
    #[arg(long, value_delimiter = ',', default_value = "debevec_galileo,hotel_room,usc_pisa")]
    relight: Vec<String>,
    /// Estimators to compare [default: all but the slow algorithm1]
    #[arg(long, value_enum, value_delimiter = ',')]
    estimators: Vec<Estimator>,
    /// Random starts of each method
    #[arg(long, default_value_t = 1)]
    starts: usize,
    #[command(flatten)]
    separable: Separable,
    /// Prior of light for the inference [default: that of the embedded model]
    #[arg(long, value_name = "FILE")]
    pub(crate) prior: Option<PathBuf>,
    /// Basis functions of reflectance
    #[arg(long, default_value_t = 10)]
    rank: usize,
    /// Texels along a side of the light grid
    #[arg(long, default_value_t = 32)]
    grid: usize,
    /// Rows that images are projected onto
    #[arg(long, default_value_t = PlanSettings::default().rank)]
    rows: usize,
    /// Normals on the visible hemisphere
    #[arg(long, default_value_t = 12_000)]
    normals: usize,
    /// Standard deviation of noise added to each channel of the photographs, relative to its mean
    #[arg(long, default_value_t = 0.0)]
    noise: f64,
    /// Pixels along a side of the relit sphere
    #[arg(long, default_value_t = 64)]
    size: usize,
    #[command(flatten)]
    effort: Effort,
    /// Number of photographs processed in parallel [default: one for each core]
    #[arg(long)]
    pub(crate) threads: Option<usize>,
}

/// Settings of the separable posterior and of the joint maximum.
#[derive(Clone, Copy, Debug, PartialEq, clap::Args, Serialize, Deserialize)]
pub(crate) struct Separable {
    /// Settings as printed in the paper: no normals near the poles of its map, a vague prior of the
    /// noise, and starts from the exponential prior. Without --prior, also its map of light at one
    /// azimuth
    #[arg(long)]
    pub(crate) paper: bool,
    /// Stopping threshold of the separable posterior, in nats
    #[arg(long, default_value_t = VariationalSettings::default().tolerance)]
    pub(crate) tolerance: f64,
    /// Initial variance of every coefficient of the separable posterior
    #[arg(long, default_value_t = VariationalSettings::default().variance)]
    pub(crate) variance: f64,
    /// Largest number of iterations of each start
    #[arg(long, default_value_t = VariationalSettings::default().max_iterations)]
    pub(crate) iterations: usize,
    /// Shape `a` of the prior of the noise [default: the number of normals; with --paper 1e-3]
    #[arg(long)]
    pub(crate) noise_shape: Option<f64>,
    /// Rate `b` of the prior of the noise, for an image of root mean square one [default: `a` times
    /// the square of a model error of 5 %; with --paper 1e-6]
    #[arg(long)]
    pub(crate) noise_rate: Option<f64>,
    /// Rate `lambda_gamma` of the prior of the exposure
    #[arg(long, default_value_t = Hyperparameters::default().exposure_rate)]
    pub(crate) exposure_rate: f64,
}

impl Separable {
    /// Returns the priors of exposure and noise for `pixels` observations.
    pub(crate) fn hyper(&self, pixels: usize) -> Hyperparameters {
        let usual = if self.paper { Hyperparameters::default() } else { Hyperparameters::with_model_error(pixels) };
        Hyperparameters {
            exposure_rate: self.exposure_rate,
            noise_shape: self.noise_shape.unwrap_or(usual.noise_shape),
            noise_rate: self.noise_rate.unwrap_or(usual.noise_rate),
        }
    }
}

#[cfg(test)]
impl Default for Separable {
    fn default() -> Self {
        let VariationalSettings { tolerance, variance, max_iterations: iterations, .. } =
            VariationalSettings::default();
        let exposure_rate = Hyperparameters::default().exposure_rate;
        Self { paper: false, tolerance, variance, iterations, noise_shape: None, noise_rate: None, exposure_rate }
    }
}

/// Lights of the photographs of a quick run: two interiors, a wood, and noon in direct sun.
const QUICK_LIGHTS: [&str; 4] = ["debevec_stpeters", "debevec_grace", "debevec_rnl", "noon_grass"];
/// Light that replaces a relighting light equal to the light of the photograph.
const SPARE: &str = "debevec_uffizi";

/// The grid of a run.
pub(crate) struct Grid {
    pub(crate) protocols: Vec<Protocol>,
    /// Indices of the tested materials.
    pub(crate) materials: Vec<usize>,
    pub(crate) lights: Vec<String>,
    pub(crate) estimators: Vec<Estimator>,
}

impl BenchOptions {
    fn protocols(&self) -> Vec<Protocol> {
        match (self.protocols.is_empty(), self.quick) {
            (false, _) => self.protocols.clone(),
            (true, true) => vec![Protocol::LeaveOut],
            (true, false) => vec![Protocol::All, Protocol::LeaveOut],
        }
    }

    /// Opens the materials that the protocols need.
    pub(crate) fn open_materials(&self, data: &Path) -> Result<Materials> {
        let materials = Materials::open(data, self.merl.as_deref())?;
        if self.protocols().contains(&Protocol::OutOfDomain) {
            materials.with_out_of_domain(data)
        } else {
            Ok(materials)
        }
    }

    /// Builds the grid and checks all names and ranges.
    pub(crate) fn grid(&self, materials: &Materials, lights: &Lights) -> Result<Grid> {
        let protocols = self.protocols();
        let tested = if !self.materials.is_empty() {
            self.materials.iter().map(|name| materials.index(name)).collect::<Result<_>>()?
        } else if self.quick {
            materials.held_out().into_iter().chain(materials.out_of_domain()).collect()
        } else {
            (0..materials.names.len()).collect()
        };
        let all = lights.names();
        let wanted: Vec<String> = match (self.lights.is_empty(), self.quick) {
            (false, _) => self.lights.clone(),
            (true, true) => QUICK_LIGHTS.map(str::to_owned).into(),
            (true, false) => all.clone(),
        };
        for light in wanted.iter().chain(&self.relight) {
            if !all.contains(light) {
                bail!("there is no test light {light}; the data have {}", all.join(", "));
            }
        }
        if !self.grid.is_power_of_two() || !(8..=128).contains(&self.grid) {
            bail!("--grid {}: give a power of two from 8 to 128", self.grid);
        }
        for (name, value) in [("starts", self.starts), ("rank", self.rank), ("rows", self.rows)] {
            if value == 0 {
                bail!("--{name} 0: give at least 1");
            }
        }
        if !(200..=100_000).contains(&self.normals) || !(16..=512).contains(&self.size) {
            bail!("give --normals from 200 to 100000 and --size from 16 to 512");
        }
        if !(0.0..=1.0).contains(&self.noise) {
            bail!("--noise {}: give a fraction of the mean, from 0 to 1", self.noise);
        }
        if self.threads == Some(0) {
            bail!("--threads 0: give at least 1");
        }
        let estimators = if self.estimators.is_empty() { Estimator::usual() } else { self.estimators.clone() };
        Ok(Grid { protocols, materials: tested, lights: wanted, estimators })
    }

    /// Returns the conditions common to all cells. `available` are the names of the test lights.
    ///
    /// # Errors
    /// If the prior cannot be read.
    pub(crate) fn conditions(&self, available: &[String]) -> Result<Conditions> {
        let prior = match &self.prior {
            Some(path) => Some(gonio_io::model::read_lighting(path)?.1),
            None => None,
        };
        let spare = Some(SPARE.to_owned()).filter(|s| available.contains(s)).into_iter().collect();
        Ok(Conditions {
            version: VERSION,
            gonio: env!("CARGO_PKG_VERSION").to_owned(),
            plan: PlanSettings { rank: self.rows, ..PlanSettings::of_side(self.grid) },
            rank: self.rank,
            normals: self.normals,
            starts: self.starts,
            separable: self.separable,
            prior,
            learning: self.effort.learning(),
            noise: self.noise,
            relight: self.relight.clone(),
            spare,
            size: self.size,
        })
    }
}
