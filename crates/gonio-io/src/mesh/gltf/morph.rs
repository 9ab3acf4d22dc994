//! Morph targets: displacements of vertices, each multiplied by a weight of the node or its mesh.

use std::path::Path;

use gltf::accessor::Accessor;
use gltf::{Node, Primitive};

use super::buffers::Buffers;
use crate::Error;
use crate::mesh::parts::MeshBuilder;

/// Returns the default weights of the morph targets of a node with a mesh.
pub(super) fn weights<'a>(node: &Node<'a>) -> &'a [f32] {
    let of_mesh = || node.mesh().and_then(|mesh| mesh.weights());
    node.weights().or_else(of_mesh).unwrap_or_default()
}

/// Vertices of a primitive.
pub(super) struct Vertices {
    pub(super) positions: Vec<[f32; 3]>,
    /// Empty if the file has no normals.
    pub(super) normals: Vec<[f32; 3]>,
}

impl Vertices {
    /// Adds the displacements of the morph targets with a weight other than zero.
    ///
    /// If a target moves vertices without changing the normals, the normals of the file no longer
    /// fit. This function then removes them, so that the mesh computes its own.
    pub(super) fn morph(
        &mut self,
        path: &Path,
        primitive: &Primitive<'_>,
        weights: &[f32],
        buffers: &Buffers<'_>,
        parts: &mut MeshBuilder<'_>,
    ) -> Result<(), Error> {
        if weights.iter().all(|weight| *weight == 0.0) {
            return Ok(());
        }
        let targets = primitive.morph_targets().zip(weights).filter(|(_, weight)| **weight != 0.0);
        for (target, &weight) in targets {
            let mut add = |to: &mut [[f32; 3]], accessor: &Accessor<'_>, what: &str| {
                parts.room_for_displacements(to.len() as u64)?;
                if accessor.count() != to.len() {
                    let problem = format!("has {} {what} in a morph target for {}", accessor.count(), to.len());
                    return Err(Error::damaged(path, problem));
                }
                let by = buffers.vectors(accessor, what)?;
                for (value, by) in to.iter_mut().flatten().zip(by.iter().flatten()) {
                    *value += weight * by;
                }
                Ok(())
            };
            if let Some(accessor) = target.positions() {
                add(&mut self.positions, &accessor, "positions")?;
            }
            match target.normals() {
                Some(accessor) if !self.normals.is_empty() => add(&mut self.normals, &accessor, "normals")?,
                Some(_) => {}
                None if target.positions().is_some() => self.normals.clear(),
                None => {}
            }
        }
        Ok(())
    }
}
