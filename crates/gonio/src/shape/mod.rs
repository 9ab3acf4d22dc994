//! Shapes in front of a camera: the visible surface at each pixel, and self-shadowing.
//!
//! * [`Mesh`]: triangles with smooth normals; [`MeshDefects`] lists their defects. `of_positions`
//!   builds a mesh from a position map, [`BuiltInShape`] builds meshes from formulas.
//! * [`Surface`]: a shape that intersects rays: a [`Tracer`] of a mesh or an [`Ellipsoid`].
//!   [`GeometryBuffer`] contains its visible points.
//! * [`Inflation`]: a smooth surface with a given silhouette.
//! * [`Visibility`]: the paper's `V_i` for some points of a surface.
//! * [`Camera`]: orthographic or perspective, with a pose. [`positions_of_depth`] computes the
//!   positions visible in its pixels at given depths.
//!
//! Axes are those of the crate: the camera looks along -z with y up. Pictures have y down and the
//! centre of the first pixel at (0.5, 0.5). Lengths are in the units of the file that contains the
//! shape; only their ratios matter.

mod buffer;
mod camera;
mod depth;
mod forms;
mod inflation;
mod mesh;
mod packet;
mod placed;
mod points;
mod smooth;
mod surface;
#[cfg(test)]
mod tests;
mod topology;
mod tracer;
mod visibility;

pub use buffer::{GeometryBuffer, hit_at, view_at};
pub use camera::{Camera, CameraError, Projection, Ray};
pub use depth::{DepthKind, DepthSize, positions_of_depth};
pub use forms::BuiltInShape;
pub use inflation::Inflation;
pub use mesh::{Mesh, MeshDefects, MeshError, MeshParts};
pub use placed::{PoseError, PosedSurface};
pub use points::{Points, SurfacePoint};
pub use surface::{Ellipsoid, EllipsoidError, Hit, Surface};
pub use tracer::Tracer;
pub use visibility::{SkyVisibility, Visibility, VisibilityPoint};
