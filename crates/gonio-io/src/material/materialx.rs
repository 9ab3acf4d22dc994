use gonio::shading::{COAT_IOR, Layered};

use super::{colour, identifier, number};

/// Writes a MaterialX 1.39 document with one `open_pbr_surface`. Its `specular_roughness` is the
/// square root of GGX's width. `note` becomes a comment.
pub fn materialx(name: &str, model: &Layered, note: &str) -> String {
    let id = identifier(name);
    let input = |name: &str, kind: &str, value: &str| {
        format!("    <input name=\"{name}\" type=\"{kind}\" value=\"{value}\"/>\n")
    };
    let inputs = [
        input("base_weight", "float", "1.0"),
        input("base_color", "color3", &colour(model.base_color)),
        input("base_diffuse_roughness", "float", "0.0"),
        input("base_metalness", "float", &number(model.metalness)),
        input("specular_weight", "float", "1.0"),
        input("specular_color", "color3", &colour(model.specular_color)),
        input("specular_roughness", "float", &number(model.roughness)),
        input("specular_ior", "float", &number(model.ior)),
        input("coat_weight", "float", &number(model.coat_weight)),
        input("coat_roughness", "float", &number(model.coat_roughness)),
        input("coat_ior", "float", &number(COAT_IOR)),
        input("coat_darkening", "float", "0.0"),
    ];
    format!(
        "<?xml version=\"1.0\"?>\n<!-- {note} -->\n<materialx version=\"1.39\" colorspace=\"lin_rec709\">\n  <open_pbr_surface name=\"{id}_surface\" type=\"surfaceshader\">\n{}  \
         </open_pbr_surface>\n  <surfacematerial name=\"{id}\" type=\"material\">\n    <input name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"{id}_surface\"/>\n  \
         </surfacematerial>\n</materialx>\n",
        inputs.concat()
    )
}
