use gonio::shading::{BlenderPrincipled, COAT_IOR};

use super::{HALF_WIDTH, SIZE, colour, number};

/// Writes a script for Blender 4.0 and later that creates a material with a Principled BSDF.
///
/// It runs in Blender's text editor or with `blender --python`. The material has the name `name`
/// and is assigned to the active object if there is one. Blender's `Roughness` is the square root
/// of GGX's width. `note` becomes a comment.
pub fn blender_script(name: &str, BlenderPrincipled(model): &BlenderPrincipled, note: &str) -> String {
    // A JSON string is also a Python string.
    let quoted = serde_json::Value::from(name).to_string();
    format!(
        "import bpy\n\n# {note}\n# Colours are linear Rec. 709.\nmaterial = bpy.data.materials.new({quoted})\nmaterial.use_nodes = True\n\
         shader = next(n for n in material.node_tree.nodes if n.type == \"BSDF_PRINCIPLED\")\n\
         for name, value in {{\n    \"Base Color\": ({}, 1.0),\n    \"Metallic\": {},\n    \"Roughness\": {},\n    \"IOR\": {},\n    \
         \"Specular IOR Level\": 0.5,\n    \"Specular Tint\": ({}, 1.0),\n    \"Coat Weight\": {},\n    \"Coat Roughness\": {},\n    \
         \"Coat IOR\": {},\n}}.items():\n    shader.inputs[name].default_value = value\n\
         if bpy.context.active_object is not None:\n    bpy.context.active_object.active_material = material\n",
        colour(model.base_color),
        number(model.metalness),
        number(model.roughness),
        number(model.ior),
        colour(model.specular_color),
        number(model.coat_weight),
        number(model.coat_roughness),
        number(COAT_IOR),
    )
}

/// Writes the script of [`blender_script`] with a scene that shows the material.
///
/// The scene is a sphere of the material, framed like that of `render_sphere`, under the lat-long
/// map in the file `light`, brightened by `exposure` stops. If Blender runs without a window, the
/// script renders the scene to `blender.png` in its own folder.
pub fn blender_scene(name: &str, model: &BlenderPrincipled, light: &str, exposure: f64, note: &str) -> String {
    format!(
        "{}\n\nLIGHT = \"{light}\"\nEXPOSURE = {}  # stops\nSIZE = {SIZE}  # pixels\nWIDTH = {:.6}  # of the picture, in radii\n\n{}",
        blender_script(name, model, note),
        number(exposure),
        2.0 * HALF_WIDTH,
        include_str!("blender_scene.py"),
    )
}
