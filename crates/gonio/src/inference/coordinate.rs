//! Exact minimisation over one block of variables at a time: steps that can never raise `C_KL`.

use super::ensemble::AllMoments;
use super::expectations::{Expectations, prior_pull};
use super::grams::{Columns, Grams, pull_weights, symmetric_times};
use super::{Ensemble, Problem};
use crate::lighting::{CoefficientPrior, Moments};
use crate::transfer::kernels::dot;

/// Steps of conjugate gradients at most.
const LIGHT_STEPS: usize = 40;

/// The means of all light coefficients with mixture priors at once, given all else, by
/// preconditioned conjugate gradients from their present values:
///
/// ```text
/// ( <b><g^2> [ B'B + sum_k vf_k A_k'A_k ] + diag d ) l = <b><g> B'I,    d_m = sum_n r_n / s_n^2
/// ```
///
/// Stopping early is safe: every step of conjugate gradients lowers the quadratic. Returns new
/// means (DC and rectified coefficients unchanged) and the precisions `1/w` that go with them.
pub(crate) fn light_step(problem: &Problem<'_>, now: &Expectations, grams: &Grams) -> (Vec<f64>, Vec<f64>) {
    let m_count = problem.m();
    let AllMoments { l, g, precision, .. } = &now.moments;
    let stiffness = precision * g.mean_square();
    let pull = now.pull(problem);
    let priors: Vec<f64> = std::iter::once(0.0)
        .chain(problem.light.iter().zip(&l[1..]).map(|(prior, l)| prior_pull(prior, l).1))
        .collect();
    let free: Vec<bool> = std::iter::once(false)
        .chain(problem.light.iter().map(|prior| matches!(prior, CoefficientPrior::Mixture(_))))
        .collect();
    let diagonal: Vec<f64> = pull.stiffness.iter().zip(&priors).map(|(s, d)| stiffness * s + d).collect();
    let mask = |x: Vec<f64>| -> Vec<f64> { x.into_iter().zip(&free).map(|(x, f)| if *f { x } else { 0.0 }).collect() };
    let curvature = grams.light_curvature(now);
    let apply = |p: &[f64]| {
        let out = symmetric_times(&curvature, p).into_iter().zip(p.iter().zip(&priors));
        mask(out.map(|(s, (p, d))| stiffness * s + d * p).collect())
    };
    let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut means = now.moments.l_means();
    let mut residual = mask((0..m_count).map(|m| precision * pull.light[m] - priors[m] * means[m]).collect());
    let precondition = |r: &[f64]| -> Vec<f64> { r.iter().zip(&diagonal).map(|(r, d)| r / d).collect() };
    let mut z = precondition(&residual);
    let mut p = z.clone();
    let mut rz = inner(&residual, &z);
    let start = rz;
    for _ in 0..LIGHT_STEPS {
        // Half of rz is about how much the cost can still fall.
        if rz <= 1e-10 * start || rz < 1e-10 {
            break;
        }
        let ap = apply(&p);
        let alpha = rz / inner(&p, &ap);
        means.iter_mut().zip(&p).for_each(|(x, p)| *x += alpha * p);
        residual.iter_mut().zip(&ap).for_each(|(r, a)| *r -= alpha * a);
        z = precondition(&residual);
        let next = inner(&residual, &z);
        p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + next / rz * *p);
        rz = next;
    }
    (means, diagonal)
}

/// Quadratic form of the residual in the reflectance coefficients, light marginalised under q.
pub(crate) struct ReflectanceSystem {
    /// `sum_i [a_ik a_ij + sum_m vl_m A_imk A_imj]`, K x K.
    pub(crate) gram: Vec<f64>,
    /// `sum_i I_i a_ik`.
    pub(crate) target: Vec<f64>,
}

impl ReflectanceSystem {
    pub(crate) fn new(problem: &Problem<'_>, now: &Expectations, grams: &Grams) -> Self {
        let (k, m) = (problem.k(), problem.m());
        let mut gram = vec![0.0; k * k];
        let mut target = vec![0.0; k];
        for (a, i) in now.a.chunks_exact(k).zip(&problem.target) {
            for x in 0..k {
                target[x] += i * a[x];
                for y in 0..=x {
                    gram[x * k + y] += a[x] * a[y];
                }
            }
        }
        for x in 0..k {
            for y in 0..=x {
                let spread: f64 = grams.reflectance[(x * k + y) * m..][..m]
                    .iter()
                    .zip(&now.moments.l)
                    .map(|(g, l)| g * l.variance)
                    .sum();
                gram[x * k + y] += spread;
                gram[y * k + x] = gram[x * k + y];
            }
        }
        Self { gram, target }
    }

    /// Coordinate descent to convergence: `u/w` and `1/w` of every coefficient, with
    /// `moments_of(u/w, 1/w)` giving the moments that the coefficient has then.
    pub(crate) fn descend(
        &self,
        problem: &Problem<'_>,
        moments: &AllMoments,
        mut moments_of: impl FnMut(usize, f64, f64) -> Moments,
    ) -> Vec<Moments> {
        let k_count = problem.k();
        let (g1, g2) = (moments.g.mean, moments.g.mean_square());
        let mut f = moments.f.clone();
        for _ in 0..500 {
            let mut moved = 0.0_f64;
            for k in 0..k_count {
                let row = &self.gram[k * k_count..(k + 1) * k_count];
                let others: f64 = row.iter().zip(&f).map(|(h, f)| h * f.mean).sum::<f64>() - row[k] * f[k].mean;
                let natural = moments.precision * (g1 * self.target[k] - g2 * others) - problem.rates[k];
                let next = moments_of(k, natural, moments.precision * g2 * row[k]);
                moved = moved.max((next.mean - f[k].mean).abs() / (next.mean + next.variance.sqrt()).max(1e-300));
                f[k] = next;
            }
            if moved < 1e-9 {
                break;
            }
        }
        f
    }
}

/// One exact update of a single light coefficient, responsibilities included, given all else; for
/// the rectified coefficient and for tests. Returns what belongs to the ensemble then.
pub(crate) fn light_coordinate(
    problem: &Problem<'_>,
    now: Expectations,
    ensemble: &mut Ensemble,
    m: usize,
    columns: &Columns,
) -> Expectations {
    let AllMoments { l, g, precision, .. } = &now.moments;
    let mut weights = vec![0.0; now.a.len()];
    pull_weights(problem, &now, &now.a, &now.y, &mut weights);
    let stiffness = precision * g.mean_square() * now.stiffness(problem)[m];
    let push = precision * dot(columns.of(m), &weights) + stiffness * l[m].mean;
    let mut moments = l[m];
    // The responsibilities depend on the coefficient's own moments: a fixed point, monotone in the
    // cost.
    for _ in 0..200 {
        let (natural, prior) = prior_pull(problem.light[m - 1], &moments);
        ensemble.set_l(m, push + natural, stiffness + prior);
        let next = ensemble.l_moments(m, problem.light[m - 1]);
        let settled = (next.mean - moments.mean).abs() + (next.variance - moments.variance).abs() < 1e-16;
        moments = next;
        if settled {
            break;
        }
    }
    now.with_light(problem, m, moments, columns)
}

/// One round of exact minimisation over light, reflectance and exposure in turn, and over the noise
/// if `noise`. `now` belongs to `ensemble`; so does what is returned to its.
pub(crate) fn round(
    problem: &Problem<'_>,
    ensemble: &Ensemble,
    mut now: Expectations,
    grams: &Grams,
    noise: bool,
) -> (Ensemble, Expectations) {
    let mut next = ensemble.clone();
    if problem.m() > 1 {
        let (means, precisions) = light_step(problem, &now, grams);
        for m in 1..problem.m() {
            if matches!(problem.light[m - 1], CoefficientPrior::Mixture(_)) {
                next.set_l(m, means[m] * precisions[m], precisions[m]);
            }
        }
        now = now.after(problem, &next);
        for m in (1..problem.m()).filter(|&m| matches!(problem.light[m - 1], CoefficientPrior::Rectified(_))) {
            now = light_coordinate(problem, now, &mut next, m, &grams.columns);
        }
    }
    let system = ReflectanceSystem::new(problem, &now, grams);
    system.descend(problem, &now.moments, |k, natural, precision| {
        next.set_f(k, natural, precision);
        next.f_moments(k)
    });
    now = now.after(problem, &next);
    let precision = now.moments.precision;
    next.set_g(precision * now.iy - problem.hyper.exposure_rate, precision * now.q);
    let c = best_scale(problem, &next);
    next.rescale(c);
    now = now.rescaled(problem, &next, c);
    if noise {
        next.set_log_noise(now.best_log_noise(problem));
        now = now.after(problem, &next);
    }
    (next, now)
}

/// The image sees only the product of exposure and reflectance. Along `f -> c f, g -> g / c` the
/// cost is `c sum_k lambda_k <f_k> + lambda_g <g> / c - (K - 1) log c`, whose minimum has a closed
/// form; the other steps would creep along that ridge.
fn best_scale(problem: &Problem<'_>, ensemble: &Ensemble) -> f64 {
    let f: f64 = problem.rates.iter().enumerate().map(|(k, rate)| rate * ensemble.f_moments(k).mean).sum();
    let g = problem.hyper.exposure_rate * ensemble.g_moments().mean;
    let others = problem.k() as f64 - 1.0;
    let c = (others + (others * others + 4.0 * f * g).sqrt()) / (2.0 * f);
    if c.is_finite() && c > 0.0 { c } else { 1.0 }
}
