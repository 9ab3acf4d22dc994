//! Prior of materials: which mixtures of components are drawn, and how often.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::components::{ALPHAS, DIFFUSE, HIGHLIGHT_WIDTH_FACTORS, Layout, SHEENS, TAILS, VARIANTS_PER_MATERIAL};
use super::{Dictionary, DrawnMaterial, MaterialField, Mixture};

/// Kinds of materials of the prior. A "material" below is a measured material or a variant of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaterialKind {
    /// A measured material.
    Measured,
    /// A measured material with highlights up to twice or half as wide.
    Warped,
    /// A material near the line between two measured ones in the logarithm.
    Variant,
    /// A mixture of two materials.
    Pair,
    /// A mixture of a material and a diffuse reflector.
    Based,
    /// A material below a clear surface.
    Coated,
    /// A diffuse base with one or two lobes of a dielectric.
    Dielectric,
    /// One or two lobes of a metal, and a faint diffuse part.
    Metal,
    /// A diffuse base with the sheen of cloth, and sometimes a lobe.
    Cloth,
    /// A dark base with a lobe of metal flakes, 5 to 15 degrees wide, below a clear coat: car
    /// paints.
    Flakes,
    /// One or two lobes of a dielectric on a base of an albedo below 2 %.
    Dark,
}

impl MaterialKind {
    /// All kinds, in the order of [`Prior::shares`].
    pub const ALL: [Self; 11] = [
        Self::Measured,
        Self::Warped,
        Self::Variant,
        Self::Pair,
        Self::Based,
        Self::Coated,
        Self::Dielectric,
        Self::Metal,
        Self::Cloth,
        Self::Flakes,
        Self::Dark,
    ];
}

/// Probabilities of the kinds of materials.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Relative frequency of each kind, in the order of [`MaterialKind::ALL`]: not negative, not
    /// all zero.
    pub shares: [f64; 11],
    /// Share of the materials whose table is multiplied by a smooth random [`MaterialField`],
    /// 0..=1.
    pub fields: f64,
}

impl Default for Prior {
    /// Returns shares that were chosen in tests with left-out materials, lights and kinds.
    ///
    /// Few draws are unchanged measured materials, which an encoder would memorise. With fields in
    /// 85 % of the materials, the errors on real photographs are larger (`docs/trials.md`).
    fn default() -> Self {
        let shares = [0.05, 0.07, 0.2, 0.12, 0.08, 0.08, 0.1, 0.07, 0.05, 0.12, 0.06];
        Self { shares, fields: 0.25 }
    }
}

impl Prior {
    /// Returns the prior of only these kinds, in the proportions of the default.
    pub fn of(kinds: &[MaterialKind]) -> Self {
        let mut prior = Self::default();
        for (share, kind) in prior.shares.iter_mut().zip(MaterialKind::ALL) {
            if !kinds.contains(&kind) {
                *share = 0.0;
            }
        }
        prior
    }

    fn kind(&self, rng: &mut Pcg64) -> MaterialKind {
        let mut at = rng.random_range(0.0..self.shares.iter().sum::<f64>());
        for (share, kind) in self.shares.iter().zip(MaterialKind::ALL) {
            if at < *share {
                return kind;
            }
            at -= share;
        }
        // Round-off may leave `at` above all shares: use the last kind with a positive share.
        let last = self.shares.iter().rposition(|s| *s > 0.0);
        MaterialKind::ALL[last.unwrap_or(0)]
    }
}

impl Dictionary {
    /// Draws a material from the prior.
    pub fn draw(&self, prior: &Prior, rng: &mut Pcg64) -> DrawnMaterial {
        let kind = prior.kind(rng);
        let mut draw = Draw { layout: self.layout(), albedos: &self.albedos, rng };
        let mixture = draw.of(kind);
        let total: f64 = mixture.iter().map(|(_, w)| w).sum();
        let mixture = mixture.into_iter().filter(|(_, w)| *w > 0.0).map(|(c, w)| (c, w / total)).collect();
        let field = (prior.fields > 0.0 && rng.random_range(0.0..1.0) < prior.fields).then(|| MaterialField::draw(rng));
        DrawnMaterial { mixture, field }
    }
}

/// State of a draw. The weights of its parts are albedos.
struct Draw<'a> {
    layout: Layout,
    albedos: &'a [f64],
    rng: &'a mut Pcg64,
}

impl Draw<'_> {
    fn of(&mut self, kind: MaterialKind) -> Mixture {
        let share = self.between(0.0, 1.0);
        let mut parts = Vec::new();
        match kind {
            MaterialKind::Measured => parts.push((self.measured(), 1.0)),
            MaterialKind::Warped => self.warped(&mut parts),
            MaterialKind::Variant => parts.push((self.variant(), 1.0)),
            MaterialKind::Pair => parts.extend([(self.material(), share), (self.material(), 1.0 - share)]),
            MaterialKind::Based => {
                parts.push((self.material(), share));
                self.diffuse(1.0 - share, &mut parts);
            }
            MaterialKind::Coated => {
                parts.push((self.material(), self.log_between(0.02, 0.8)));
                self.lobes((0.02, 0.08), (0.0, 9.0), &mut parts);
            }
            MaterialKind::Dielectric => {
                let albedo = self.log_between(0.02, 0.8);
                self.diffuse(albedo, &mut parts);
                self.lobes((0.02, 0.08), (0.0, (ALPHAS.len() - 1) as f64), &mut parts);
            }
            MaterialKind::Metal => {
                let albedo = self.log_between(0.002, 0.2);
                self.diffuse(albedo, &mut parts);
                self.lobes((0.3, 1.0), (0.0, (ALPHAS.len() - 1) as f64), &mut parts);
            }
            MaterialKind::Cloth => {
                let albedo = self.log_between(0.02, 0.8);
                self.diffuse(albedo, &mut parts);
                let sheen = self.layout.sheen(self.rng.random_range(0..SHEENS.len()));
                let factor = self.log_between(0.05, 1.0);
                parts.push((sheen, factor * self.albedos[sheen]));
                if share < 0.3 {
                    self.lobes((0.02, 0.08), (7.0, (ALPHAS.len() - 1) as f64), &mut parts);
                }
            }
            MaterialKind::Flakes => {
                let albedo = self.log_between(3e-4, 0.2);
                self.diffuse(albedo, &mut parts);
                let (f0, width, weight) =
                    (self.between(0.1, 0.9), self.between(5.5, 11.0), self.log_between(0.02, 0.6));
                let tail = self.rng.random_range(0..TAILS.len());
                self.lobe(f0, width, tail, weight, &mut parts);
                self.lobes((0.03, 0.06), (0.0, 5.0), &mut parts);
            }
            MaterialKind::Dark => {
                let albedo = self.log_between(5e-4, 0.02);
                self.diffuse(albedo, &mut parts);
                self.lobes((0.02, 0.08), (0.0, (ALPHAS.len() - 1) as f64), &mut parts);
            }
        }
        parts
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.rng.random_range(low..high)
    }

    fn log_between(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    fn measured(&mut self) -> usize {
        self.rng.random_range(0..self.layout.measured)
    }

    fn variant(&mut self) -> usize {
        self.layout.variant(self.rng.random_range(0..self.layout.measured * VARIANTS_PER_MATERIAL))
    }

    fn material(&mut self) -> usize {
        if self.rng.random_range(0..2) == 0 { self.measured() } else { self.variant() }
    }

    fn warped(&mut self, parts: &mut Mixture) {
        let material = self.measured();
        // The material itself lies between the narrower and the wider warps.
        let at = self.between(0.0, HIGHLIGHT_WIDTH_FACTORS.len() as f64);
        let component = |step: usize| match step.cmp(&(HIGHLIGHT_WIDTH_FACTORS.len() / 2)) {
            std::cmp::Ordering::Less => self.layout.warped(material, step),
            std::cmp::Ordering::Equal => material,
            std::cmp::Ordering::Greater => self.layout.warped(material, step - 1),
        };
        parts.extend([(component(at as usize), 1.0 - at.fract()), (component(at as usize + 1), at.fract())]);
    }

    /// Adds diffuse reflection: Lambert's alone in half of the cases, else two kinds in any
    /// proportion.
    fn diffuse(&mut self, albedo: f64, parts: &mut Mixture) {
        if self.rng.random_range(0..2) == 0 {
            parts.push((self.layout.diffuse(0), albedo));
            return;
        }
        let share = self.between(0.0, 1.0);
        for share in [share, 1.0 - share] {
            parts.push((self.layout.diffuse(self.rng.random_range(0..DIFFUSE)), share * albedo));
        }
    }

    /// Adds a lobe and, in three of ten cases, a wider one as well.
    ///
    /// `f0` is the range of the reflectance along the normal, `widths` that of the position in
    /// [`ALPHAS`].
    fn lobes(&mut self, f0: (f64, f64), widths: (f64, f64), parts: &mut Mixture) {
        let f0 = self.between(f0.0, f0.1);
        let width = self.between(widths.0, widths.1);
        let tail = self.rng.random_range(0..TAILS.len());
        let second = if self.between(0.0, 1.0) < 0.3 { self.between(0.1, 0.7) } else { 0.0 };
        self.lobe(f0, width, tail, 1.0 - second, parts);
        if second > 0.0 {
            let wider = self.between(width, (ALPHAS.len() - 1) as f64);
            self.lobe(f0, wider, tail, second, parts);
        }
    }

    fn lobe(&self, f0: f64, width: f64, tail: usize, weight: f64, parts: &mut Mixture) {
        let narrow = (width as usize).min(ALPHAS.len() - 2);
        let blend = width - narrow as f64;
        for (at, share) in [(narrow, 1.0 - blend), (narrow + 1, blend)] {
            for (full, part) in [(false, 1.0 - f0), (true, f0)] {
                let component = self.layout.lobe(at, tail, full);
                parts.push((component, weight * share * part * self.albedos[component]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::super::super::log_basis::LogBasis;
    use super::super::super::parametric::{Ggx, Parametric};
    use super::super::DictionarySettings;
    use super::*;
    use crate::testing::lobe;

    fn dictionary() -> Dictionary {
        let set = [0.1, 0.3, 0.9].map(|w| (w.to_string(), lobe(0.05, 1.0, w)));
        Dictionary::new(LogBasis::fit(&set, 9), &DictionarySettings { draws: 1, ..Default::default() })
    }

    #[test]
    fn kinds_occur_in_their_shares_and_have_their_components() {
        let dictionary = dictionary();
        let layout = dictionary.layout();
        let mut rng = Pcg64::seed_from_u64(3);
        let mut counts = [0; 11];
        for _ in 0..4000 {
            let kind = Prior::default().kind(&mut rng);
            counts[MaterialKind::ALL.iter().position(|k| *k == kind).unwrap()] += 1;
        }
        for (count, share) in counts.iter().zip(Prior::default().shares) {
            assert!((f64::from(*count) / 4000.0 - share).abs() < 0.03, "{counts:?}");
        }
        let made_of_measured = |c: usize| c < layout.diffuse(0);
        let sheen = |c: usize| (layout.sheen(0)..layout.sheen(SHEENS.len())).contains(&c);
        for (at, kind) in MaterialKind::ALL.into_iter().enumerate() {
            for _ in 0..200 {
                let DrawnMaterial { mixture, .. } = dictionary.draw(&Prior::of(&[kind]), &mut rng);
                let sum: f64 = mixture.iter().map(|(_, w)| w).sum();
                assert!((sum - 1.0).abs() < 1e-12 && mixture.iter().all(|m| m.0 < layout.count()));
                assert_eq!(mixture.iter().any(|m| made_of_measured(m.0)), at < 6, "{kind:?}");
                assert_eq!(mixture.iter().any(|m| sheen(m.0)), kind == MaterialKind::Cloth);
                if kind == MaterialKind::Warped {
                    let material = |c: usize| if c < 3 { c } else { (c - 3) / HIGHLIGHT_WIDTH_FACTORS.len() };
                    assert!(mixture.iter().all(|m| material(m.0) == material(mixture[0].0)), "{mixture:?}");
                }
            }
        }
    }

    #[test]
    fn lobes_have_the_requested_reflectance_and_width() {
        // Mixtures of the lobes of full and of no reflectance give the lobe of any reflectance,
        // since Schlick's formula is linear in it.
        let dictionary = dictionary();
        let mut rng = Pcg64::seed_from_u64(0);
        let draw = Draw { layout: dictionary.layout(), albedos: &dictionary.albedos, rng: &mut rng };
        let mut parts = Vec::new();
        draw.lobe(0.3, 8.0, 1, 1.0, &mut parts);
        let want = Ggx { diffuse: 0.0, f0: 0.3, alpha: ALPHAS[8] }.to_bivariate();
        let drawn = DrawnMaterial { mixture: parts, field: None };
        for (a, b) in dictionary.table(&drawn).as_slice().iter().zip(want.as_slice()) {
            assert!((a - b).abs() <= 1e-4 * b.abs() + 1e-7, "{a} {b}");
        }
    }
}
