//! Loads light transport plans from the cache, or builds and caches them.

use gonio::lighting::LightPrior;
use gonio::reflectance::BivariateTable;
use gonio::shape::Points;
use gonio_io::Error;
use gonio_io::cache::Cache;
use gonio_io::plan::{load_plan, plan_key, store_plan};
use gonio_paper::{Plan, PlanError, PlanSettings};

/// Origin of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanOrigin {
    /// The plan was in the cache.
    Cache,
    /// The plan was built.
    Built,
}

/// Returns the plan from the cache, or else builds and stores it. The arguments are those of
/// [`Plan::build`].
///
/// The third value is the error of storing, if that failed; the plan is valid. Several threads or
/// processes can call this concurrently; at worst, each builds the plan.
///
/// # Errors
/// See [`Plan::build`].
pub fn load_or_build<'a>(
    cache: Option<&Cache>,
    points: impl Into<Points<'a>>,
    tables: &[BivariateTable],
    prior: &LightPrior,
    settings: &PlanSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<(Plan, PlanOrigin, Option<Error>), PlanError> {
    let points = points.into();
    let build = || Plan::build(points, tables, prior, settings, progress);
    let Some(cache) = cache else { return Ok((build()?, PlanOrigin::Built, None)) };
    let key = plan_key(points, tables, prior, settings);
    if let Some(plan) = load_plan(cache, &key, points.len(), tables.len(), settings) {
        progress(1.0);
        return Ok((plan, PlanOrigin::Cache, None));
    }
    let plan = build()?;
    let failed = store_plan(cache, &key, &plan).err();
    Ok((plan, PlanOrigin::Built, failed))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use gonio::shape::SurfacePoint;
    use gonio::sphere::fibonacci_hemisphere;

    use super::*;

    /// Loads or builds a small plan of `points` points, at most 150.
    fn get(cache: Option<&Cache>, points: usize) -> Result<(Plan, PlanOrigin, Option<Error>), PlanError> {
        let model = gonio_io::model::embedded().unwrap();
        let seen = fibonacci_hemisphere(150).map(|normal| SurfacePoint { normal, view: glam::DVec3::Z });
        let points: Vec<SurfacePoint> = seen.take(points).collect();
        let settings = PlanSettings { rank: 40, oversampling: 8, ..PlanSettings::of_side(8) };
        load_or_build(cache, &points, &model.reflectance.functions, &model.light, &settings, &|_| ())
    }

    #[test]
    fn loads_cached_plans_and_rebuilds_damaged_ones() {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::at(dir.path());
        let get = || get(Some(&cache), 150).unwrap();
        let (built, origin, failed) = get();
        assert!(origin == PlanOrigin::Built && failed.is_none());
        let (found, origin, _) = get();
        assert_eq!((origin, &found), (PlanOrigin::Cache, &built));
        let files: Vec<_> = fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        let plan = files.iter().find(|path| path.extension().is_some_and(|e| e == "plan")).unwrap();
        let mut bytes = fs::read(plan).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        fs::write(plan, bytes).unwrap();
        let (again, origin, failed) = get();
        assert_eq!((origin, &again), (PlanOrigin::Built, &built));
        assert!(failed.is_none());
        assert_eq!(get().1, PlanOrigin::Cache);
    }

    #[test]
    fn builds_the_plan_if_the_cache_cannot_be_written() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("file"), "").unwrap();
        let (plan, origin, failed) = get(Some(&Cache::at(dir.path().join("file/cache"))), 150).unwrap();
        assert_eq!((plan.points, origin), (150, PlanOrigin::Built));
        assert!(failed.unwrap().to_string().contains("cache folder"));
        let (.., failed) = get(Some(&Cache::at(dir.path()).with_budget(1000)), 150).unwrap();
        assert!(failed.unwrap().to_string().contains("size limit"));
    }

    #[test]
    fn concurrent_threads_get_the_same_plan() {
        let dir = tempfile::tempdir().unwrap();
        let (cache, barrier) = (Cache::at(dir.path()), std::sync::Barrier::new(2));
        let run = || {
            barrier.wait();
            get(Some(&cache), 150).unwrap()
        };
        let (a, b) = std::thread::scope(|s| {
            let (a, b) = (s.spawn(run), s.spawn(run));
            (a.join().unwrap(), b.join().unwrap())
        });
        assert_eq!(a.0, b.0);
        assert!(a.2.is_none() && b.2.is_none());
        assert_eq!(get(Some(&cache), 150).unwrap().1, PlanOrigin::Cache);
    }

    #[test]
    fn rejects_too_few_points() {
        let dir = tempfile::tempdir().unwrap();
        for cache in [None, Some(&Cache::at(dir.path()))] {
            assert_eq!(get(cache, 10).unwrap_err(), gonio::transfer::TransferError::TooFewPoints(10).into());
        }
    }
}
