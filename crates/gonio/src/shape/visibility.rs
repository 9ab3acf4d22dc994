//! Visibility `V_i` of the paper: the light that reaches each point of a self-shadowing surface.

use glam::DVec3;

use super::Surface;
use crate::lighting::LightGrid;
use crate::parallel;
use crate::sphere::OctahedralMap;

/// Number of rays along each side of a texel that is partly open.
const RAYS: usize = 4;

/// Number of neighbouring points that are traced together.
const GROUP: usize = 64;

/// Number of neighbouring texels whose central rays are traced together: as many rays as a mesh
/// traces at a time.
const PACKET: usize = 16;

/// A surface point at which to compute visibility.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibilityPoint {
    /// Origin of the rays: [`Hit::ray_origin`](super::Hit::ray_origin).
    pub from: DVec3,
    /// Unit normal; rays below its horizon are not traced. With a zero normal, no rays are traced,
    /// and all shares are one.
    pub normal: DVec3,
}

/// Open share of every texel of a light grid, for each of some points.
///
/// Stored as one bit per texel, and eight bytes for each texel that is partly open.
#[derive(Clone, Debug, PartialEq)]
pub struct Visibility {
    map: OctahedralMap,
    side: usize,
    rows: Vec<Row>,
}

/// Shares of one point. Most points receive all light above their horizon.
#[derive(Clone, Debug, Default, PartialEq)]
struct Row {
    /// Bits of the texels that are fully blocked, 64 to a word; empty if no texel is fully blocked.
    blocked: Box<[u64]>,
    /// Texels that are partly open, in ascending order, with their open share in 255ths.
    partial: Box<[(u32, u8)]>,
}

impl Visibility {
    /// Traces the visibility of points on a surface, for a grid of `side` squared texels.
    ///
    /// One ray is traced to the centre of each texel above the horizon. Where neighbouring texels
    /// differ, sixteen rays are traced, and the open share is the fraction of those above the
    /// horizon that pass. Obstacles that are thinner than a texel and miss all centres are
    /// therefore ignored.
    ///
    /// `progress` receives the completed share, in 0..=1, from several threads and in any order.
    ///
    /// # Panics
    /// If `side` is not a power of two.
    pub fn trace(
        surface: &dyn Surface,
        points: &[VisibilityPoint],
        map: OctahedralMap,
        side: usize,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Self {
        let texels = Texels::new(map, side);
        if surface.is_convex() {
            return Self { map, side, rows: vec![Row::default(); points.len()] };
        }
        let done = std::sync::atomic::AtomicUsize::new(0);
        let order = spatial_order(points);
        let groups: Vec<&[usize]> = order.chunks(GROUP).collect();
        let traced = parallel::flat_map_range(groups.len(), |at| {
            let group: Vec<VisibilityPoint> = groups[at].iter().map(|point| points[*point]).collect();
            let rows = texels.rows(surface, &group);
            let finished = done.fetch_add(group.len(), std::sync::atomic::Ordering::Relaxed) + group.len();
            progress(finished as f64 / points.len() as f64);
            rows
        });
        let mut rows = vec![Row::default(); points.len()];
        order.into_iter().zip(traced).for_each(|(point, row)| rows[point] = row);
        Self { map, side, rows }
    }

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Returns whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Returns the map of the grid to the sphere.
    pub fn map(&self) -> OctahedralMap {
        self.map
    }

    /// Returns the number of texels along a side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Returns whether every point receives all light above its horizon.
    pub(crate) fn is_open(&self) -> bool {
        self.rows.iter().all(|row| row.blocked.is_empty() && row.partial.is_empty())
    }

    /// Returns the open share of a texel, in 0..=1.
    ///
    /// The share is one below the horizon, where no rays are traced.
    pub fn share(&self, point: usize, texel: usize) -> f32 {
        let row = &self.rows[point];
        if row.blocked.get(texel / 64).is_some_and(|word| word >> (texel % 64) & 1 == 1) {
            return 0.0;
        }
        let partial = row.partial.binary_search_by_key(&(texel as u32), |p| p.0);
        partial.map_or(1.0, |at| f32::from(row.partial[at].1) / 255.0)
    }

    /// Returns the open share of the texel that contains a unit direction.
    pub fn share_along(&self, point: usize, direction: DVec3) -> f32 {
        self.share(point, LightGrid::texel_of(self.map, self.side, direction))
    }

    /// Multiplies the values of the texels, `stride` per texel, by the open shares.
    ///
    /// # Panics
    /// If there are not `stride` values for each texel.
    pub fn apply(&self, point: usize, values: &mut [f32], stride: usize) {
        assert_eq!(values.len(), self.side * self.side * stride);
        let row = &self.rows[point];
        for (w, &word) in row.blocked.iter().enumerate() {
            let mut left = word;
            while left != 0 {
                let texel = 64 * w + left.trailing_zeros() as usize;
                values[texel * stride..(texel + 1) * stride].fill(0.0);
                left &= left - 1;
            }
        }
        for (texel, share) in self.partial(point) {
            values[texel * stride..(texel + 1) * stride].iter_mut().for_each(|v| *v *= share);
        }
    }

    /// Iterates over the partly open texels of a point, with the open share of each.
    pub(crate) fn partial(&self, point: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        self.rows[point].partial.iter().map(|&(texel, share)| (texel as usize, f32::from(share) / 255.0))
    }

    /// Computes the [`SkyVisibility`] of each point in a uniform sky.
    ///
    /// # Panics
    /// If the numbers of normals and points differ.
    pub(crate) fn sky_visibilities(&self, normals: &[DVec3]) -> Vec<SkyVisibility> {
        assert_eq!(normals.len(), self.rows.len());
        let centres: Vec<(DVec3, f64)> = (0..self.side * self.side)
            .map(|t| {
                let (u, v) = LightGrid::centre_of(self.side, t);
                (self.map.direction(u, v), self.map.density(u, v))
            })
            .collect();
        let of = |at: usize| {
            let (row, normal) = (&self.rows[at], normals[at]);
            if row.blocked.is_empty() && row.partial.is_empty() {
                return SkyVisibility { unoccluded: 1.0, penumbra: 0.0 };
            }
            let weight = |t: usize| centres[t].0.dot(normal).max(0.0) * centres[t].1;
            let all: f64 = (0..centres.len()).map(weight).sum();
            let bits = row.blocked.iter().enumerate();
            let blocked: f64 = bits
                .flat_map(|(w, &word)| (0..64).filter(move |b| word >> b & 1 == 1).map(move |b| 64 * w + b))
                .map(weight)
                .sum();
            let edge: f64 = row.partial.iter().map(|p| weight(p.0 as usize)).sum();
            let lost: f64 = row.partial.iter().map(|p| weight(p.0 as usize) * (1.0 - f64::from(p.1) / 255.0)).sum();
            SkyVisibility { unoccluded: (1.0 - (blocked + lost) / all).max(0.0), penumbra: edge / all }
        };
        parallel::map_range(self.rows.len(), of)
    }

    /// Selects the visibility of some of the points.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn select(&self, points: &[usize]) -> Self {
        Self { map: self.map, side: self.side, rows: points.iter().map(|&i| self.rows[i].clone()).collect() }
    }

    /// Returns the size of the shares in memory, in bytes.
    pub fn bytes(&self) -> usize {
        let row = |r: &Row| size_of::<Row>() + size_of_val(&*r.blocked) + size_of_val(&*r.partial);
        self.rows.iter().map(row).sum()
    }
}

/// Visible part of the sky at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyVisibility {
    /// Fraction of the light of a uniform sky that reaches the point, in 0..=1.
    pub unoccluded: f64,
    /// Fraction of the unoccluded light that comes from texels that are partly open.
    pub penumbra: f64,
}

/// Directions of a grid.
struct Texels {
    /// Texels in an order in which neighbours are close to each other.
    order: Vec<usize>,
    centres: Vec<DVec3>,
    /// Neighbours of each texel.
    near: Vec<[u32; 8]>,
    /// [`RAYS`] squared directions for each texel.
    fine: Vec<DVec3>,
    /// Upper bound of the angle between a centre and any direction of its texel.
    radius: f64,
}

/// State of a texel, according to its central ray.
#[derive(Clone, Copy, PartialEq)]
enum State {
    Below,
    Open,
    Blocked,
}

impl Texels {
    fn new(map: OctahedralMap, side: usize) -> Self {
        assert!(side.is_power_of_two(), "the side of a light grid must be a power of two, not {side}");
        let direction = |t: usize, dx: f64, dy: f64| {
            let at = |i: usize, d: f64| 2.0 * (i as f64 + d) / side as f64 - 1.0;
            map.direction(at(t % side, dx), -at(t / side, dy))
        };
        let offset = |i: usize| (i as f64 + 0.5) / RAYS as f64;
        let centres = (0..side * side).map(|t| direction(t, 0.5, 0.5)).collect();
        let cells = (0..side * side).flat_map(|t| (0..RAYS * RAYS).map(move |f| (t, f)));
        let fine = cells.map(|(t, f)| direction(t, offset(f % RAYS), offset(f / RAYS))).collect();
        let mut order: Vec<usize> = (0..side * side).collect();
        order.sort_by_key(|t| interleaved(t % side, t / side));
        let near = (0..side * side).map(|t| NEIGHBOURS.map(|(dx, dy)| neighbour(side, t, dx, dy) as u32)).collect();
        Self { order, centres, near, fine, radius: map.cell_radius(side.ilog2()) }
    }

    /// Traces points that are close to each other. Rays of similar directions follow each other,
    /// because they visit the same parts of a large mesh, which then stay in the cache.
    fn rows(&self, surface: &dyn Surface, points: &[VisibilityPoint]) -> Vec<Row> {
        // Centres slightly below the horizon are included, since parts of their texels are above
        // it.
        let lowest = -self.radius.sin();
        let mut states = vec![vec![State::Below; self.centres.len()]; points.len()];
        for texels in self.order.chunks(PACKET) {
            for (point, states) in points.iter().zip(&mut states) {
                // No centre is above the horizon of a zero normal.
                let least = lowest * point.normal.length();
                let is_above = |t: &usize| self.centres[*t].dot(point.normal) > least;
                let above: Vec<usize> = texels.iter().copied().filter(is_above).collect();
                let centres: Vec<DVec3> = above.iter().map(|t| self.centres[*t]).collect();
                for (texel, blocked) in above.into_iter().zip(surface.blocked(point.from, &centres)) {
                    states[texel] = if blocked { State::Blocked } else { State::Open };
                }
            }
        }
        let mut rows = vec![Row::default(); points.len()];
        let block = |row: &mut Row, texel: usize| {
            if row.blocked.is_empty() {
                row.blocked = vec![0; self.centres.len().div_ceil(64)].into();
            }
            row.blocked[texel / 64] |= 1 << (texel % 64);
        };
        let mut partial = vec![Vec::new(); points.len()];
        for &texel in &self.order {
            for (at, (point, states)) in points.iter().zip(&states).enumerate() {
                let state = states[texel];
                let other = |near: &u32| states[*near as usize] != state && states[*near as usize] != State::Below;
                if state == State::Below {
                    continue;
                }
                if !self.near[texel].iter().any(other) {
                    if state == State::Blocked {
                        block(&mut rows[at], texel);
                    }
                    continue;
                }
                let all = &self.fine[texel * RAYS * RAYS..(texel + 1) * RAYS * RAYS];
                let rays: Vec<DVec3> = all.iter().filter(|d| d.dot(point.normal) > 0.0).copied().collect();
                let open = surface.blocked(point.from, &rays).into_iter().filter(|hit| !hit).count();
                match (255 * open).checked_div(rays.len()).unwrap_or(255) {
                    255 => (),
                    0 => block(&mut rows[at], texel),
                    share => partial[at].push((texel as u32, share as u8)),
                }
            }
        }
        for (row, mut partial) in rows.iter_mut().zip(partial) {
            partial.sort_unstable();
            row.partial = partial.into();
        }
        rows
    }
}

/// Returns the indices of points such that close points follow each other. The depth does not
/// matter, because the points are visible from one side.
fn spatial_order(points: &[VisibilityPoint]) -> Vec<usize> {
    let low = points.iter().fold(DVec3::INFINITY, |low, point| low.min(point.from));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |high, point| high.max(point.from));
    let step = ((high - low).truncate().max_element() / 1024.0).max(1e-300);
    let key = |at: &usize| {
        let place = (points[*at].from - low) / step;
        interleaved(place.x as usize, place.y as usize)
    };
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_cached_key(key);
    order
}

/// Steps to the neighbours of a texel.
const NEIGHBOURS: [(isize, isize); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// Returns the texel at a step from another.
///
/// Beyond an edge of the square, this is a texel on the same edge.
fn neighbour(side: usize, texel: usize, dx: isize, dy: isize) -> usize {
    let n = side as isize;
    let (mut x, mut y) = ((texel % side) as isize + dx, (texel / side) as isize + dy);
    if x < 0 || x >= n {
        (x, y) = (if x < 0 { 0 } else { n - 1 }, n - 1 - y);
    }
    if y < 0 || y >= n {
        (x, y) = (n - 1 - x, if y < 0 { 0 } else { n - 1 });
    }
    (y.clamp(0, n - 1) * n + x.clamp(0, n - 1)) as usize
}

/// Interleaves the bits of a column and a row.
fn interleaved(x: usize, y: usize) -> usize {
    (0..usize::BITS / 2).map(|bit| (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1)).sum()
}
