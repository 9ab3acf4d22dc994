# SPDX-License-Identifier: MIT
"""The surface of an object as a PLY file, in coordinates of the object."""

import numpy as np

from .problem import Problem

HEADER = """ply
format binary_little_endian 1.0
element vertex {}
property float x
property float y
property float z
property float nx
property float ny
property float nz
element face {}
property list uchar int vertex_indices
end_header
"""


def write(path, thing, depsgraph):
    """Writes the triangles of an object, with its modifiers, each with places and normals of its own corners."""
    if thing.mode == "EDIT":
        thing.update_from_editmode()
    evaluated = thing.evaluated_get(depsgraph)
    try:
        mesh = evaluated.to_mesh()
    except RuntimeError:
        raise Problem(f"{thing.name}: has no surface; make the object active that the photograph shows") from None
    try:
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        if count == 0:
            raise Problem(f"{thing.name}: has no faces; make the object active that the photograph shows")
        vertices, corners = taken(mesh)
    finally:
        evaluated.to_mesh_clear()
    faces = np.empty(count, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = np.arange(3 * count).reshape(count, 3)
    with open(path, "wb") as file:
        file.write(HEADER.format(3 * count, count).encode())
        file.write(np.hstack([vertices, corners]).astype("<f4").tobytes())
        file.write(faces.tobytes())


def taken(mesh):
    """Places and normals of the corners of all triangles, [3 x triangles][3] each."""

    def numbers(them, name, each, kind):
        values = np.empty(len(them) * each, dtype=kind)
        them.foreach_get(name, values)
        return values

    places = numbers(mesh.vertices, "co", 3, np.float32).reshape(-1, 3)
    normals = numbers(mesh.corner_normals, "vector", 3, np.float32).reshape(-1, 3)
    return (
        places[numbers(mesh.loop_triangles, "vertices", 3, np.int32)],
        normals[numbers(mesh.loop_triangles, "loops", 3, np.int32)],
    )
