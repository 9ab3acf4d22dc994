# SPDX-License-Identifier: MIT
"""What was found, put into the scene: material, sphere and world."""

import json
import math

import bmesh
import bpy
from mathutils import Matrix

from .problem import Problem

# Blender looks a world's map up with its middle along +x, -y to the right of it; the middle of gonio's is before
# the camera, along -z, with +x to the right. From the camera's axes to those of the map:
TO_MAP = Matrix(((0, 0, -1), (-1, 0, 0), (0, 1, 0)))
# A camera that looks along +y, for photographs without one: Blender's view from the front.
FRONT = Matrix.Rotation(math.pi / 2, 3, "X")


def material(name, exported):
    """A material with the Principled BSDF of an export's folder."""
    try:
        found = json.loads((exported / "export.json").read_text(encoding="utf-8"))["exports"]["blender"]["parameters"]
        values = {
            "Base Color": (*found["base_color"], 1.0),
            "Metallic": found["metalness"],
            "Roughness": found["roughness"],
            "IOR": found["ior"],
            "Specular IOR Level": 0.5,
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise Problem(f"{exported}: is no export of a gonio that this add-on knows ({error!r})") from error
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = next(n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    for key, value in values.items():
        shader.inputs[key].default_value = value
    # The viewport without rendering shows these.
    made.diffuse_color = values["Base Color"]
    made.metallic = values["Metallic"]
    made.roughness = values["Roughness"]
    return made


def give(thing, made):
    """Gives all of an object a material."""
    if not thing.material_slots:
        thing.data.materials.append(made)
    for slot in thing.material_slots:
        slot.material = made


def sphere(name, scene):
    """A smooth sphere at the 3D cursor."""
    mesh = bpy.data.meshes.new(name)
    shape = bmesh.new()
    bmesh.ops.create_uvsphere(shape, u_segments=128, v_segments=64, radius=1)
    shape.to_mesh(mesh)
    shape.free()
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    made = bpy.data.objects.new(name, mesh)
    made.location = scene.cursor.location
    scene.collection.objects.link(made)
    return made


def world(name, exported, turn):
    """A world with the light of an export's folder; `turn` is from the axes of the camera to those of the world."""
    made = bpy.data.worlds.new(name)
    made.use_nodes = True
    tree = made.node_tree
    background = next(n for n in tree.nodes if n.type == "BACKGROUND")
    place = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Rotation"].default_value = (TO_MAP @ turn.transposed()).to_euler("XYZ")
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = bpy.data.images.load(str(exported / "light.exr"))
    around.image.name = name
    around.image.colorspace_settings.name = "Non-Color"
    # The folder may be a temporary one.
    around.image.pack()
    tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], around.inputs["Vector"])
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    for n, node in enumerate((place, mapping, around)):
        node.location = (background.location.x - 250 * (3 - n), background.location.y)
    return made
