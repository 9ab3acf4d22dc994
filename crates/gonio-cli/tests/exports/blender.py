"""Runs an exported script in Blender and compares a sphere of it, in Cycles, with `gonio render` of the table of the same fit.

    python3 blender.py GONIO RESULTS [PICTURES]

GONIO is the program, RESULTS a folder of results of `gonio infer`. Needs the package bpy (Blender 4.2 or later as a module). Not part of CI: bpy has a third of
a gigabyte and needs a Python of its own version.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

SIZE = 96
SAMPLES = 256


def run(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, stdout=subprocess.DEVNULL)


def read(path):
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    pixels = np.array(image.pixels[:], dtype=np.float64).reshape(height, width, 4)[::-1]
    return pixels


def write(path, rgb):
    height, width, _ = rgb.shape
    image = bpy.data.images.new("light", width, height, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels = np.concatenate([rgb[::-1], np.ones((height, width, 1))], axis=-1).astype(np.float32).ravel()
    image.filepath_raw, image.file_format = str(path), "OPEN_EXR"
    image.save()


def light():
    """Soft lamps on a graded sky: nothing is alike in any two directions."""
    height = 64
    v, u = np.mgrid[:height, : 2 * height]
    azimuth, polar = (2 * np.pi * ((u + 0.5) / (2 * height) - 0.5), np.pi * (v + 0.5) / height)
    d = np.stack([np.sin(azimuth) * np.sin(polar), np.cos(polar), -np.cos(azimuth) * np.sin(polar)], axis=-1)
    sky = 0.4 + 0.3 * d[..., 1:2] * np.array([0.6, 0.8, 1.0])
    for centre, width, colour in [([-0.7, 0.5, 0.6], 0.35, [6, 5, 4]), ([0.9, 0.1, 0.3], 0.25, [2, 4, 6]), ([0.2, 0.7, -0.8], 0.4, [5, 6, 3])]:
        centre = np.array(centre) / np.linalg.norm(centre)
        sky = sky + np.exp((d @ centre - 1) / width**2)[..., None] * np.array(colour)
    return sky


def render(script, light_path, output):
    """A sphere of radius one, as `gonio render` frames it. Blender's maps have +x in the middle and -y to the right of it: the camera looks along +x."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=512, ring_count=256)
    bpy.ops.object.shade_smooth()
    exec(compile(script.read_text(), str(script), "exec"), {"__name__": "__main__"})
    world = bpy.data.worlds.new("world")
    bpy.context.scene.world = world
    world.use_nodes = True
    texture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(str(light_path))
    texture.image.colorspace_settings.name = "Non-Color"
    background = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    camera = bpy.data.cameras.new("camera")
    camera.type = "ORTHO"
    camera.ortho_scale = 2 * 0.5 * SIZE / (0.5 * SIZE - 2.0)
    seen = bpy.data.objects.new("camera", camera)
    # Right, up and back of the camera in the world.
    seen.matrix_world = Matrix([[0, 0, -1, -5], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    bpy.context.collection.objects.link(seen)
    scene = bpy.context.scene
    scene.camera = seen
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", SAMPLES, 1
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(output)
    bpy.ops.render.render(write_still=True)
    return read(output)


def errors(a, b):
    """Relative and logarithmic relight error within 0.95 of the radius, over all channels."""
    y, x = np.mgrid[:SIZE, :SIZE]
    inside = np.hypot(x + 0.5 - SIZE / 2, y + 0.5 - SIZE / 2) < 0.95 * (SIZE / 2 - 2)
    a, b = a[inside][:, :3], b[inside][:, :3]
    logs = np.log(np.maximum(a, 0.01 * b.mean()) / np.maximum(b, 0.01 * b.mean()))
    return np.sqrt(((a - b) ** 2).mean() / (b**2).mean()), np.sqrt((logs**2).mean())


def main(gonio, results, pictures=None):
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(pictures or scratch)
        write(scratch / "light.exr", light())
        run(gonio, "export", results, "--to", "blender", "--tables", "-o", scratch / "export")
        run(gonio, "render", "--brdf", scratch / "export" / "blender.binary", "--light", scratch / "light.exr", "-o", scratch / "own.exr", "--size", SIZE)
        own = read(scratch / "own.exr")
        theirs = render(scratch / "export" / "blender.py", scratch / "light.exr", scratch / "blender.exr")
        relight, log = errors(theirs, own)
        mirrored = errors(theirs[:, ::-1], own)[1]
        print(f"blender: relight {relight:.4f}, log {log:.4f}; turned the wrong way {mirrored:.4f}")
        return 0 if log < 0.05 < mirrored else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
