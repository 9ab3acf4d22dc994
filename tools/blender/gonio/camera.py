# SPDX-License-Identifier: MIT
"""Exports the camera of the scene in gonio's format (docs/camera.md)."""

from .problem import Problem


def rotation(scene, depsgraph):
    """Returns the rotation from camera axes to world axes."""
    if scene.camera is None:
        raise Problem("the scene has no camera; add the camera of the photograph")
    if scene.camera.matrix_world.is_negative:
        raise Problem(f"{scene.camera.name}: the camera has a negative scale; apply the scale")
    return scene.camera.evaluated_get(depsgraph).matrix_world.decompose()[1].to_matrix()


def describe(scene, depsgraph):
    """Returns the contents of `camera.json` for the camera of the scene."""
    turn = rotation(scene, depsgraph)
    camera = scene.camera.evaluated_get(depsgraph)
    render = scene.render
    if camera.data.type not in {"PERSP", "ORTHO"}:
        raise Problem(f"{camera.name}: panoramic cameras are not supported; use a perspective or orthographic camera")
    if abs(render.pixel_aspect_x / render.pixel_aspect_y - 1) > 1e-6:
        raise Problem("the render settings have non-square pixels; set both aspect values to 1")
    width, height = (int(n * render.resolution_percentage / 100) for n in (render.resolution_x, render.resolution_y))
    # The frame in camera coordinates includes fit, shift and sensor size.
    corners = camera.data.view_frame(scene=scene)
    left, right = min(c.x for c in corners), max(c.x for c in corners)
    top = max(c.y for c in corners)
    pixels = width / (right - left)
    matrix = turn.to_4x4()
    matrix.translation = camera.matrix_world.translation
    if camera.data.type == "ORTHO":
        lens = {"projection": "orthographic", "pixels_per_unit": pixels}
    else:
        lens = {"projection": "perspective", "focal_pixels": -corners[0].z * pixels}
    return lens | {
        "size": [width, height],
        "principal_point": [-left * pixels, top * pixels],
        "pose": {"camera_to_world": [list(row) for row in matrix]},
    }
