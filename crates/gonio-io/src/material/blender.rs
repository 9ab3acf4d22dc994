use gonio::shading::Layered;

use super::{colour, number};

/// Writes a script for Blender 4.0 and later, to be run from its text editor or with
/// `blender --python`: it creates a material of this name with a Principled BSDF, and assigns it to
/// the active object if there is one. Blender's `Roughness` is the square root of GGX's width.
pub fn blender_script(name: &str, model: &Layered) -> String {
    // A JSON string is also a Python string.
    let quoted = serde_json::Value::from(name).to_string();
    format!(
        "import bpy\n\nmaterial = bpy.data.materials.new({quoted})\nmaterial.use_nodes = True\n\
         shader = next(n for n in material.node_tree.nodes if n.type == \"BSDF_PRINCIPLED\")\n\
         for name, value in {{\n    \"Base Color\": ({}, 1.0),\n    \"Metallic\": {},\n    \"Roughness\": {},\n    \"IOR\": {},\n    \
         \"Specular IOR Level\": 0.5,\n}}.items():\n    shader.inputs[name].default_value = value\n\
         if bpy.context.active_object is not None:\n    bpy.context.active_object.active_material = material\n",
        colour(model.base_color),
        number(model.metalness),
        number(model.roughness),
        number(model.ior),
    )
}
