//! MaterialX 1.39: one graph of textures under two surfaces, `gltf_pbr` and `open_pbr_surface`.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, Layered};
use super::lobes;
use super::textures::Texture;
use crate::Result;

/// A texture of the graph: name, type and values.
pub(super) type Image = (&'static str, &'static str, Texture);

/// The document and its textures below `folder`, and their description.
pub(super) fn encode(bundle: &Bundle, layered: &Layered, folder: &str) -> Result<(Files, Value)> {
    let images = images(bundle, layered);
    let textures: Vec<_> =
        images.iter().map(|(name, _, texture)| (*name, texture.clone())).collect();
    let mut files = bundle.encode(&format!("{folder}textures/"), &textures)?;
    let names: Vec<&str> =
        files.iter().map(|(name, _)| name.strip_prefix(folder).unwrap_or(name)).collect();
    let document = document(&images, &names, layered);
    files.insert(0, (format!("{folder}material.mtlx"), document.into_bytes()));
    let mut description = json!({
        "surfaces": ["svbrdf_gltf_pbr", "svbrdf_open_pbr"],
        "normal": "OpenGL: green up",
        "layers": super::glb::describe(layered),
    });
    if bundle.anisotropy.is_some() {
        description["anisotropy"] = json!({
            "tangent": "direction of the larger alpha, (v + 1) / 2",
            "gltf_pbr": "alpha along = mix(roughness^2, 1, anisotropy^2)",
            "open_pbr": "alpha across = (1 - open_pbr_anisotropy) alpha along, \
                         open_pbr_roughness^4 = mean of both squared",
        });
    }
    if bundle.maps.coat().is_some() {
        description["coat"] = json!(
            "dielectric of index 1.5; open_pbr: index and roughness of the base allow for the coat above"
        );
    }
    if bundle.maps.sheen().is_some() {
        description["sheen"] =
            json!(format!("gltf_pbr as KHR_materials_sheen; open_pbr: {}", lobes::FUZZ));
    }
    Ok((files, description))
}

/// The textures of both surfaces.
pub(super) fn images(bundle: &Bundle, layered: &Layered) -> Vec<Image> {
    let mut images = vec![
        ("base_color", "color3", layered.base.clone()),
        ("normal", "vector3", bundle.normals(1.0)),
        ("roughness", "float", bundle.gray(|i| bundle.roughness_across(i))),
        ("occlusion", "float", bundle.gray(|i| bundle.occlusion[i])),
    ];
    images.push(match &layered.tint {
        Some(tint) => ("specular_color", "color3", tint.clone()),
        None => ("metallic", "float", bundle.gray(|i| layered.orm.value(i, 2))),
    });
    let strength = bundle.of_anisotropy(|lobe| lobe.strength());
    let open = bundle.of_anisotropy(|lobe| lobes::quadratic(lobe)[1]);
    images.extend(bundle.tangents(1.0).map(|texture| ("tangent", "vector3", texture)));
    images.extend(strength.map(|texture| ("anisotropy", "float", texture)));
    images.extend(open.map(|texture| ("open_pbr_anisotropy", "float", texture)));
    let coat = bundle.maps.coat();
    if let Some([weight, roughness]) = coat {
        images.push(("coat", "float", bundle.gray(|i| weight[i])));
        images.push(("coat_roughness", "float", bundle.gray(|i| roughness[i])));
    }
    if coat.is_some() || bundle.anisotropy.is_some() {
        let open = |i: usize| {
            let lobes = bundle.anisotropy.as_ref();
            let own = lobes.map_or(bundle.roughness()[i], |lobes| lobes::quadratic(&lobes[i])[0]);
            coat.map_or(own, |planes| lobes::below_rough_coat(own, planes.map(|plane| plane[i])))
        };
        images.push(("open_pbr_roughness", "float", bundle.gray(open)));
    }
    if let Some([r, g, b, roughness]) = bundle.maps.sheen() {
        let fuzz = |i: usize| lobes::fuzz([r[i], g[i], b[i]], roughness[i]);
        images.push(("sheen_color", "color3", bundle.colour(|i| [r[i], g[i], b[i]])));
        images.push(("sheen_roughness", "float", bundle.gray(|i| roughness[i])));
        images.push(("fuzz_color", "color3", bundle.colour(|i| fuzz(i).tint)));
        images.push(("fuzz_weight", "float", bundle.gray(|i| fuzz(i).weight)));
        images.push(("fuzz_roughness", "float", bundle.gray(|i| fuzz(i).roughness)));
    }
    images
}

fn document(images: &[Image], files: &[&str], layered: &Layered) -> String {
    let (mut nodes, mut outputs) = (String::new(), String::new());
    for ((name, kind, _), file) in images.iter().zip(files) {
        let space = if *kind == "color3" { r#" colorspace="srgb_texture""# } else { "" };
        nodes += &format!(
            r#"    <image name="{name}_image" type="{kind}">
      <input name="file" type="filename" value="{file}"{space} />
    </image>
"#
        );
        let node = if *kind == "vector3" {
            nodes += &format!(
                r#"    <normalmap name="{name}_map" type="vector3">
      <input name="in" type="vector3" nodename="{name}_image" />
    </normalmap>
"#
            );
            format!("{name}_map")
        } else {
            format!("{name}_image")
        };
        outputs += &output(name, kind, &node);
    }
    let has = |name: &str| images.iter().any(|(own, ..)| *own == name);
    if has("coat") {
        nodes += &ior_below_coat(layered.ior);
        outputs += &output(BELOW_COAT, "float", BELOW_COAT);
    }
    format!(
        r#"<?xml version="1.0"?>
<materialx version="1.39" colorspace="lin_rec709">
  <nodegraph name="svbrdf_maps">
{nodes}{outputs}  </nodegraph>
{gltf}{open}</materialx>
"#,
        gltf = gltf_pbr(layered, has),
        open = open_pbr(layered, has),
    )
}

fn output(name: &str, kind: &str, node: &str) -> String {
    format!("    <output name=\"{name}_out\" type=\"{kind}\" nodename=\"{node}\" />\n")
}

/// Nodes for the index below a coat. OpenPBR uses the base's index relative to the coat's, in proportion to
/// the coat's weight: `n (1 - w) + w n / 1.5`. The nodes compute the `n` for which this equals `ior`.
fn ior_below_coat(ior: f32) -> String {
    format!(
        r#"    <multiply name="coat_third" type="float">
      <input name="in1" type="float" nodename="coat_image" />
      <input name="in2" type="float" value="{third}" />
    </multiply>
    <subtract name="coat_rest" type="float">
      <input name="in1" type="float" value="1" />
      <input name="in2" type="float" nodename="coat_third" />
    </subtract>
    <divide name="open_pbr_ior" type="float">
      <input name="in1" type="float" value="{ior}" />
      <input name="in2" type="float" nodename="coat_rest" />
    </divide>
"#,
        third = 1.0 - lobes::COAT_IOR.recip(),
    )
}

/// An input connected to an output of the graph.
fn connected(input: &str, kind: &str, output: &str) -> String {
    format!(
        "    <input name=\"{input}\" type=\"{kind}\" nodegraph=\"svbrdf_maps\" output=\"{output}_out\" />\n"
    )
}

fn constant(input: &str, value: f32) -> String {
    format!("    <input name=\"{input}\" type=\"float\" value=\"{value}\" />\n")
}

fn gltf_pbr(layered: &Layered, has: impl Fn(&str) -> bool) -> String {
    let mut inputs = [
        connected("base_color", "color3", "base_color"),
        connected("roughness", "float", "roughness"),
        connected("normal", "vector3", "normal"),
        connected("occlusion", "float", "occlusion"),
        constant("ior", layered.ior),
    ]
    .concat();
    inputs += &match layered.tint {
        Some(_) => {
            constant("metallic", 0.0) + &connected("specular_color", "color3", "specular_color")
        }
        None => connected("metallic", "float", "metallic"),
    };
    if has("anisotropy") {
        inputs += &connected("tangent", "vector3", "tangent");
        inputs += &connected("anisotropy_strength", "float", "anisotropy");
    }
    if has("coat") {
        inputs += &connected("clearcoat", "float", "coat");
        inputs += &connected("clearcoat_roughness", "float", "coat_roughness");
        inputs += &connected("clearcoat_normal", "vector3", "normal");
    }
    if has("sheen_color") {
        inputs += &connected("sheen_color", "color3", "sheen_color");
        inputs += &connected("sheen_roughness", "float", "sheen_roughness");
    }
    surface("gltf_pbr", "svbrdf_gltf_pbr", &inputs)
}

/// Source of an input of a surface.
pub(super) enum Source {
    /// A texture, or the nodes of [`BELOW_COAT`].
    Map(&'static str),
    Value(f32),
}

/// Name of the index of refraction below a coat.
pub(super) const BELOW_COAT: &str = "open_pbr_ior";

/// Inputs of `open_pbr_surface` for the textures that there are: name, type and source.
pub(super) fn open_pbr_inputs(
    layered: &Layered,
    has: impl Fn(&str) -> bool,
) -> Vec<(&'static str, &'static str, Source)> {
    use Source::{Map, Value};
    let own = has("open_pbr_roughness");
    let roughness = if own { "open_pbr_roughness" } else { "roughness" };
    let ior = if has("coat") { Map(BELOW_COAT) } else { Value(layered.ior) };
    let mut inputs = vec![
        ("base_color", "color3", Map("base_color")),
        ("specular_roughness", "float", Map(roughness)),
        ("geometry_normal", "vector3", Map("normal")),
        ("specular_ior", "float", ior),
        match layered.tint {
            Some(_) => ("specular_color", "color3", Map("specular_color")),
            None => ("base_metalness", "float", Map("metallic")),
        },
    ];
    if has("anisotropy") {
        inputs.push(("specular_roughness_anisotropy", "float", Map("open_pbr_anisotropy")));
        inputs.push(("geometry_tangent", "vector3", Map("tangent")));
    }
    if has("coat") {
        inputs.push(("coat_weight", "float", Map("coat")));
        inputs.push(("coat_roughness", "float", Map("coat_roughness")));
        inputs.push(("coat_ior", "float", Value(lobes::COAT_IOR)));
        inputs.push(("coat_darkening", "float", Value(0.0)));
        inputs.push(("geometry_coat_normal", "vector3", Map("normal")));
    }
    if has("fuzz_weight") {
        inputs.push(("fuzz_weight", "float", Map("fuzz_weight")));
        inputs.push(("fuzz_color", "color3", Map("fuzz_color")));
        inputs.push(("fuzz_roughness", "float", Map("fuzz_roughness")));
    }
    inputs
}

fn open_pbr(layered: &Layered, has: impl Fn(&str) -> bool) -> String {
    let inputs = open_pbr_inputs(layered, has).into_iter();
    let inputs = inputs.map(|(input, kind, source)| match source {
        Source::Map(name) => connected(input, kind, name),
        Source::Value(value) => constant(input, value),
    });
    surface("open_pbr_surface", "svbrdf_open_pbr", &inputs.collect::<String>())
}

fn surface(kind: &str, name: &str, inputs: &str) -> String {
    format!(
        r#"  <{kind} name="{name}_surface" type="surfaceshader">
{inputs}  </{kind}>
  <surfacematerial name="{name}" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="{name}_surface" />
  </surfacematerial>
"#
    )
}
