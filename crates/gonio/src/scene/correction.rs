//! Orders and signs of the channels of a normal map.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::picture::Plane;

/// Correction of the channels of a normal map: a reordering, then sign flips.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Correction {
    /// Indices, from 0, of the channels that contain x, y and z: `[0, 1, 2]` if they are in order,
    /// `[1, 0, 2]` if x and y are swapped, `[2, 1, 0]` for BGR.
    pub order: [usize; 3],
    /// Whether the sign of x is wrong.
    pub flip_x: bool,
    /// Whether the sign of y is wrong: y points down, as in normal maps for DirectX.
    pub flip_y: bool,
    /// Whether the sign of z is wrong: z points away from the camera.
    pub flip_z: bool,
}

impl Default for Correction {
    /// No correction.
    fn default() -> Self {
        Self { order: [0, 1, 2], flip_x: false, flip_y: false, flip_z: false }
    }
}

/// All orders of three channels; those with fewer changes come first.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]];

impl Correction {
    /// Whether the correction changes nothing.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Parses an order of channels from three letters: `xyz`, `yxz` (x and y swapped), `zyx` (BGR)
    /// and so on.
    pub fn order_named(name: &str) -> Option<[usize; 3]> {
        ORDERS.into_iter().find(|order| order_name(*order) == name)
    }

    /// Returns a normal with the correction applied.
    ///
    /// # Panics
    /// If [`Self::order`] contains an index above two.
    pub fn apply(&self, normal: Vec3) -> Vec3 {
        let channels = normal.to_array();
        let [x, y, z] = self.order.map(|i| channels[i]);
        let sign = |flip: bool, v: f32| if flip { -v } else { v };
        Vec3::new(sign(self.flip_x, x), sign(self.flip_y, y), sign(self.flip_z, z))
    }

    /// Returns all normals with the correction applied. A missing normal, zero, stays zero.
    ///
    /// # Panics
    /// If [`Self::order`] contains an index above two.
    pub fn apply_to(&self, normals: &Plane<Vec3>) -> Plane<Vec3> {
        normals.map(|n| self.apply(*n))
    }

    /// Returns the order of the channels in three letters ([`Self::order_named`]), unless it is
    /// `xyz`.
    pub fn reordered(&self) -> Option<String> {
        (self.order != [0, 1, 2]).then(|| order_name(self.order))
    }

    /// Describes the error in words, for example "y flipped".
    pub(super) fn words(&self) -> String {
        let order = self.reordered().map(|order| format!("the channel order {order}"));
        let flips = self.flips().into_iter().map(|axis| format!("{axis} flipped"));
        order.into_iter().chain(flips).collect::<Vec<_>>().join(" and ")
    }

    /// Returns the axes whose sign is wrong.
    pub fn flips(&self) -> Vec<char> {
        let all = [(self.flip_x, 'x'), (self.flip_y, 'y'), (self.flip_z, 'z')];
        all.iter().filter(|f| f.0).map(|f| f.1).collect()
    }

    /// Lists all 48 corrections, those with fewer changes first, y before x.
    pub(super) fn all() -> Vec<Self> {
        let signs = (0..8_u8).map(|bits| [bits >> 1 & 1 == 1, bits & 1 == 1, bits >> 2 & 1 == 1]);
        let mut all: Vec<Self> = signs
            .flat_map(|[flip_x, flip_y, flip_z]| ORDERS.map(|order| Self { order, flip_x, flip_y, flip_z }))
            .collect();
        let moved = |c: &Self| (0..3).filter(|&i| c.order[i] != i).count();
        all.sort_by_key(|c| moved(c) + c.flips().len());
        all
    }
}

/// Returns the axis that each channel contains, given the channels of x, y and z.
fn order_name(order: [usize; 3]) -> String {
    (0..3)
        .filter_map(|channel| ['x', 'y', 'z'].into_iter().zip(order).find(|(_, at)| *at == channel))
        .map(|a| a.0)
        .collect()
}
