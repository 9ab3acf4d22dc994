# SPDX-License-Identifier: MIT
"""Exports the surface of an object as a PLY file, in object coordinates."""

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
    """Writes the triangles of an object with its modifiers, with positions and normals per corner."""
    if thing.mode == "EDIT":
        thing.update_from_editmode()
    evaluated = thing.evaluated_get(depsgraph)
    try:
        mesh = evaluated.to_mesh()
    except RuntimeError:
        raise Problem(f"{thing.name}: the object has no surface; activate the photographed object") from None
    try:
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        if count == 0:
            raise Problem(f"{thing.name}: the object has no faces; activate the photographed object")
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
    """Returns positions and normals of the corners of all triangles, [3 x triangles][3] each."""

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
