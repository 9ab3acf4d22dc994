//! Encoding and keys of plans in the cache.
//!
//! The bytes are an eight-byte length, a JSON header of that length, and the arrays `q` and `r`
//! (32-bit) and `energies` (64-bit) of the [`Plan`], little-endian. Only the cache stores them, and
//! it detects damage; the format may change with [`VERSION`].

use gonio::lighting::LightPrior;
use gonio::reflectance::BivariateTable;
use gonio::shape::Points;
use gonio_paper::{Plan, PlanSettings};
use serde::{Deserialize, Serialize};

use crate::cache::Cache;
use crate::{Error, little_endian};

/// Version, part of every key. Increase it whenever the bytes change, or [`Plan::build`] gives
/// other results for the same input.
pub const VERSION: u32 = 3;

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    settings: PlanSettings,
    points: usize,
    k: usize,
    rank: usize,
    total_energy: f64,
}

/// Encodes a plan.
pub fn encode_plan(plan: &Plan) -> Vec<u8> {
    let Plan { settings, points, k, q, r, energies, total_energy } = plan;
    let header = Header {
        version: VERSION,
        settings: *settings,
        points: *points,
        k: *k,
        rank: energies.len(),
        total_energy: *total_energy,
    };
    let header = serde_json::to_vec(&header).expect("numbers are JSON");
    let mut bytes = Vec::with_capacity(8 + header.len() + 4 * (q.len() + r.len()) + 8 * energies.len());
    bytes.extend((header.len() as u64).to_le_bytes());
    bytes.extend(header);
    little_endian::put_f32(&mut bytes, q);
    little_endian::put_f32(&mut bytes, r);
    little_endian::put_f64(&mut bytes, energies);
    bytes
}

/// Decodes a plan; `None` if the bytes are not a plan of this version, or their length is wrong.
pub fn decode_plan(bytes: &[u8]) -> Option<Plan> {
    let (length, rest) = bytes.split_first_chunk()?;
    let (header, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let Header { version, settings, points, k, rank, total_energy } = serde_json::from_slice(header).ok()?;
    if version != VERSION {
        return None;
    }
    let columns = settings.transfer.side.checked_pow(2)?.checked_mul(k)?;
    let (q, rest) = rest.split_at_checked(points.checked_mul(rank)?.checked_mul(4)?)?;
    let (r, energies) = rest.split_at_checked(rank.checked_mul(columns)?.checked_mul(4)?)?;
    if energies.len() != rank.checked_mul(8)? {
        return None;
    }
    let (q, r) = (little_endian::f32s(q), little_endian::f32s(r));
    Some(Plan { settings, points, k, q, r, energies: little_endian::f64s(energies), total_energy })
}

/// Computes the key of the plan that [`Plan::build`] computes from these arguments.
///
/// The key is the hexadecimal BLAKE3 hash of all inputs of the plan.
///
/// [`PlanSettings::hold`] is not part of the key, because holding rows in memory changes the result
/// only within round-off.
pub fn plan_key<'a>(
    points: impl Into<Points<'a>>,
    tables: &[BivariateTable],
    prior: &LightPrior,
    settings: &PlanSettings,
) -> String {
    let mut hasher = blake3::Hasher::new();
    // Each part follows its length, so that different splits of the same bytes give different keys.
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
    };
    let doubles = |values: &[f64]| {
        let mut bytes = Vec::new();
        little_endian::put_f64(&mut bytes, values);
        bytes
    };
    part(format!("gonio plan {VERSION}").as_bytes());
    let points = points.into();
    let directions: Vec<f64> =
        points.points().iter().flat_map(|p| [p.normal, p.view]).flat_map(|v| v.to_array()).collect();
    part(&doubles(&directions));
    if let Some(visibility) = points.visibility() {
        let mut bytes = Vec::new();
        visibility.for_each_byte(|b| bytes.extend_from_slice(b));
        part(&bytes);
    }
    for table in tables {
        let mut bytes = Vec::new();
        little_endian::put_f32(&mut bytes, table.as_slice());
        part(&bytes);
    }
    part(&serde_json::to_vec(prior).expect("a prior is JSON"));
    part(&serde_json::to_vec(&unheld(settings)).expect("settings are JSON"));
    hasher.finalize().to_hex().to_string()
}

/// Returns the settings with those reset that do not change the result.
fn unheld(settings: &PlanSettings) -> PlanSettings {
    PlanSettings { hold: 0, ..*settings }
}

/// Reads the plan of a key from the cache. Returns `None` if the plan is missing, damaged, or has
/// other numbers of points and tables or other settings: a user may have renamed a file.
pub fn load_plan(cache: &Cache, key: &str, points: usize, tables: usize, settings: &PlanSettings) -> Option<Plan> {
    let plan = cache.load(key).and_then(|bytes| decode_plan(&bytes))?;
    let fits = (plan.points, plan.k) == (points, tables) && unheld(&plan.settings) == unheld(settings);
    fits.then_some(plan)
}

/// Stores a plan in the cache.
///
/// # Errors
/// Like [`Cache::store`].
pub fn store_plan(cache: &Cache, key: &str, plan: &Plan) -> Result<(), Error> {
    cache.store(key, &encode_plan(plan))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::time::Instant;

    use gonio::lighting::{CoefficientPrior, PriorGroup, ScaleMixture};
    use gonio::shape::SurfacePoint;
    use gonio::sphere::{OctahedralMap, fibonacci_hemisphere};
    use gonio::transfer::{QuadratureSettings, TransferSettings};

    use super::*;

    /// All inputs of a small plan.
    #[derive(Clone)]
    struct Input {
        points: Vec<SurfacePoint>,
        tables: Vec<BivariateTable>,
        prior: LightPrior,
        settings: PlanSettings,
    }

    fn input() -> Input {
        let view = glam::DVec3::Z;
        let density = CoefficientPrior::Mixture(ScaleMixture { weights: vec![1.0], variances: vec![0.01] });
        let prior = LightPrior {
            map: OctahedralMap::EqualArea,
            scales: 3,
            groups: vec![density; PriorGroup::all(3).len()],
            lights: 9,
        };
        Input {
            points: fibonacci_hemisphere(150).map(|normal| SurfacePoint { normal, view }).collect(),
            tables: vec![BivariateTable::from_fn(|_, _| 0.3), BivariateTable::from_fn(|h, _| (-9.0 * h * h).exp())],
            prior,
            settings: PlanSettings { rank: 40, oversampling: 8, ..PlanSettings::of_side(8) },
        }
    }

    impl Input {
        fn key(&self) -> String {
            plan_key(&self.points, &self.tables, &self.prior, &self.settings)
        }

        fn plan(&self) -> Plan {
            Plan::build(&self.points, &self.tables, &self.prior, &self.settings, &|_| ()).unwrap()
        }

        fn load(&self, cache: &Cache) -> Option<Plan> {
            load_plan(cache, &self.key(), self.points.len(), self.tables.len(), &self.settings)
        }
    }

    #[test]
    fn plans_round_trip() {
        let plan = input().plan();
        let bytes = encode_plan(&plan);
        assert_eq!(decode_plan(&bytes).unwrap(), plan);
        for cut in (0..bytes.len()).step_by(211).chain([7, 8, 9, bytes.len() - 1]) {
            assert!(decode_plan(&bytes[..cut]).is_none(), "{cut}");
        }
        assert!(decode_plan(&[&bytes[..], &[0]].concat()).is_none());
        assert!(decode_plan(&[0xff; 40]).is_none());
        // Another version, lengths beyond the end, and lengths whose product overflows.
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let header = std::str::from_utf8(&bytes[8..8 + length]).unwrap();
        for (old, new) in [
            ("\"version\":3", "\"version\":4"),
            ("\"points\":150", "\"points\":15000000000000"),
            ("\"points\":150", "\"points\":1500000000000000000"),
            ("\"side\":8", "\"side\":9000000000000000000"),
            ("\"rank\":40,\"total", "\"rank\":4000000000000000000,\"total"),
        ] {
            assert!(header.contains(old), "{header}");
            let forged = header.replace(old, new);
            let file = [&(forged.len() as u64).to_le_bytes(), forged.as_bytes(), &bytes[8 + header.len()..]].concat();
            assert!(decode_plan(&file).is_none(), "{forged}");
        }
    }

    #[test]
    fn a_plan_of_full_size_is_decoded_in_half_a_second() {
        let settings = PlanSettings::default();
        let (points, k, rank) = (8600, 10, 800);
        let plan = Plan {
            settings,
            points,
            k,
            q: (0..points * rank).map(|i| i as f32).collect(),
            r: (0..rank * k * settings.transfer.side.pow(2)).map(|i| i as f32).collect(),
            energies: vec![0.1; rank],
            total_energy: 0.3,
        };
        let start = Instant::now();
        let bytes = encode_plan(&plan);
        let encoded = start.elapsed();
        let start = Instant::now();
        let back = decode_plan(&bytes).unwrap();
        let decoded = start.elapsed();
        assert_eq!(back, plan);
        // The limit is ten times the usual time, so that the test also passes on a busy machine.
        assert!(decoded.as_secs_f64() < 0.5, "{} bytes: {encoded:?}, {decoded:?}", bytes.len());
    }

    #[test]
    fn keys_depend_on_every_input() {
        let base = input();
        let changed = |change: &dyn Fn(&mut Input)| {
            let mut other = base.clone();
            change(&mut other);
            other.key()
        };
        let s = base.settings;
        let changes: &[&dyn Fn(&mut Input)] = &[
            &|i| i.points[3].normal.x += 1e-12,
            &|i| i.points[3].view.y += 1e-12,
            &|i| i.points.truncate(149),
            &|i| i.tables[1].as_mut_slice()[77] += 1e-3,
            &|i| i.tables.swap(0, 1),
            &|i| i.tables.truncate(1),
            &|i| i.prior.map = OctahedralMap::PraunHoppe,
            &|i| match &mut i.prior.groups[5] {
                CoefficientPrior::Mixture(m) => m.variances[0] += 1e-12,
                CoefficientPrior::Rectified(_) => unreachable!(),
            },
            &move |i| i.settings = PlanSettings { transfer: TransferSettings { side: 4, ..s.transfer }, ..s },
            &move |i| i.settings = PlanSettings { rank: 41, ..s },
            &move |i| i.settings = PlanSettings { oversampling: 9, ..s },
            &move |i| i.settings = PlanSettings { seed: 2, ..s },
            &move |i| i.settings.transfer.quadrature = QuadratureSettings { base: 5, ..s.transfer.quadrature },
            &move |i| i.settings.transfer.quadrature = QuadratureSettings { ratio: 0.31, ..s.transfer.quadrature },
            &move |i| i.settings.transfer.quadrature = QuadratureSettings { core: 0.004, ..s.transfer.quadrature },
        ];
        let mut keys: Vec<String> = changes.iter().map(|c| changed(c)).collect();
        keys.push(base.key());
        let count = keys.len();
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), count);
        assert_eq!(changed(&|i| i.settings.hold = 7), base.key());
        assert_eq!(base.key().len(), 64);
    }

    #[test]
    fn damaged_and_misnamed_plans_are_not_loaded() {
        let dir = tempfile::tempdir().unwrap();
        let (cache, input) = (Cache::at(dir.path()), input());
        let plan = input.plan();
        assert_eq!(input.load(&cache), None);
        let store = |plan: &Plan| store_plan(&cache, &input.key(), plan).unwrap();
        store(&plan);
        assert_eq!(input.load(&cache).as_ref(), Some(&plan));
        let path = dir.path().join(format!("{}.plan", input.key()));
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        fs::write(&path, bytes).unwrap();
        assert_eq!(input.load(&cache), None);
        cache.store(&input.key(), b"no plan").unwrap();
        assert_eq!(input.load(&cache), None);
        store(&Plan { settings: PlanSettings { seed: 5, ..plan.settings }, ..plan.clone() });
        assert_eq!(input.load(&cache), None);
        // The number of rows held in memory does not affect the result.
        store(&Plan { settings: PlanSettings { hold: 7, ..plan.settings }, ..plan.clone() });
        assert!(input.load(&cache).is_some());
    }
}
