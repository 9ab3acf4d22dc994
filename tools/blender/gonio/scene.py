# SPDX-License-Identifier: MIT
"""Creates material, sphere and world from the results."""

import json
import math

import bmesh
import bpy
from mathutils import Matrix

from .problem import Problem

# The centre of Blender's world map is +x, with -y to the right; the centre of gonio's map is -z of the camera,
# with +x to the right. Rotation from camera axes to map axes:
TO_MAP = Matrix(((0, 0, -1), (-1, 0, 0), (0, 1, 0)))
# Default camera that looks along +y: Blender's front view.
FRONT = Matrix.Rotation(math.pi / 2, 3, "X")


def material(name, exported):
    """Creates a material with the Principled BSDF of an export folder."""
    try:
        found = json.loads((exported / "export.json").read_text(encoding="utf-8"))["exports"]["blender"]["parameters"]
        values = {
            "Base Color": (*found["base_color"], 1.0),
            "Metallic": found["metalness"],
            "Roughness": found["roughness"],
            "IOR": found["ior"],
            "Specular IOR Level": 0.5,
            "Specular Tint": (*found["specular_color"], 1.0),
            "Coat Weight": found["coat_weight"],
            "Coat Roughness": found["coat_roughness"],
            "Coat IOR": 1.5,
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise Problem(f"{exported}: is not an export that this add-on supports ({error!r})") from error
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = next(n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    for key, value in values.items():
        shader.inputs[key].default_value = value
    # Solid viewport shading uses these values.
    made.diffuse_color = values["Base Color"]
    made.metallic = values["Metallic"]
    made.roughness = values["Roughness"]
    return made


def give(thing, made):
    """Assigns a material to all slots of an object."""
    if not thing.material_slots:
        thing.data.materials.append(made)
    for slot in thing.material_slots:
        slot.material = made


def sphere(name, scene):
    """Creates a smooth sphere at the 3D cursor."""
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
    """Creates a world with the light of an export folder; `turn` is the rotation from camera axes to world axes."""
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
    # The folder may be temporary.
    around.image.pack()
    tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], around.inputs["Vector"])
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    for n, node in enumerate((place, mapping, around)):
        node.location = (background.location.x - 250 * (3 - n), background.location.y)
    return made
