use gonio::shading::Principled;

use super::{colour, identifier, number};

/// Version of Mitsuba's format, an attribute of the root element and of no other.
const VERSION: &str = "3.0.0";

/// Context of the material's text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A separate file.
    File,
    /// Part of a scene.
    Scene,
}

/// Returns the opening tag of a material.
fn opening(kind: &str, name: &str, place: Place) -> String {
    let version = match place {
        Place::File => format!(" version=\"{VERSION}\""),
        Place::Scene => String::new(),
    };
    format!("<bsdf{version} type=\"{kind}\" id=\"{}\">", identifier(name))
}

/// Writes a `principled` material of Mitsuba 3; its `roughness` is the square root of GGX's width.
///
/// `note` becomes a comment.
pub fn mitsuba_principled(name: &str, model: &Principled, place: Place, note: &str) -> String {
    let float = |name: &str, value: f64| format!("    <float name=\"{name}\" value=\"{}\"/>\n", number(value));
    let values = [
        float("metallic", model.metallic),
        float("roughness", model.roughness),
        float("eta", model.eta),
        float("sheen", model.sheen),
        float("clearcoat", model.clearcoat),
        float("clearcoat_gloss", model.clearcoat_gloss),
    ];
    format!(
        "{}\n    <!-- {note} -->\n    <!-- Colours: rec709, linear -->\n    <rgb name=\"base_color\" value=\"{}\"/>\n{}</bsdf>\n",
        opening("principled", name, place),
        colour(model.base_color),
        values.concat()
    )
}

/// Writes the file of a `measured` material of Mitsuba 3. The material loads `tensor` from the same
/// folder. `colours` names the colour space of the tensor, for a comment.
pub fn mitsuba_measured(name: &str, tensor: &str, colours: &str) -> String {
    format!(
        "{}\n    <!-- Colours: {colours} -->\n    <string name=\"filename\" value=\"{tensor}\"/>\n</bsdf>\n",
        opening("measured", name, Place::File)
    )
}

/// Writes a scene of Mitsuba 3 with a sphere.
///
/// The sphere, framed like that of `render_sphere`, has the material in the file `material`; the
/// light is the lat-long map in the file `light`. The scene has the parameters `material`, `size`
/// and `samples`.
pub fn mitsuba_scene(material: &str, light: &str) -> String {
    // The centre of gonio's maps is along -z, that of Mitsuba's along +z.
    format!(
        r#"<scene version="{VERSION}">
    <default name="material" value="{material}"/>
    <default name="size" value="{SIZE}"/>
    <default name="samples" value="64"/>

    <integrator type="path">
        <boolean name="hide_emitters" value="true"/>
    </integrator>
    <sensor type="orthographic">
        <transform name="to_world">
            <scale x="{HALF_WIDTH:.6}" y="{HALF_WIDTH:.6}"/>
            <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="$size"/>
            <integer name="height" value="$size"/>
            <string name="pixel_format" value="rgba"/>
            <rfilter type="box"/>
        </film>
        <sampler type="multijitter">
            <integer name="sample_count" value="$samples"/>
        </sampler>
    </sensor>

    <shape type="sphere">
        <include filename="$material"/>
    </shape>
    <emitter type="envmap">
        <string name="filename" value="{light}"/>
        <transform name="to_world">
            <rotate y="1" angle="180"/>
        </transform>
    </emitter>
</scene>
"#,
        SIZE = super::SIZE,
        HALF_WIDTH = super::HALF_WIDTH,
    )
}
