//! MaterialX 1.39: one graph of textures under two surfaces, `gltf_pbr` and `open_pbr_surface`.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, Layered};
use crate::Result;

/// The document and its textures below `folder`, and what they hold.
pub(super) fn encode(bundle: &Bundle, layered: &Layered, folder: &str) -> Result<(Files, Value)> {
    let roughness = bundle.roughness();
    let mut textures = vec![
        ("base_color", layered.base.clone()),
        ("normal", bundle.normals(1.0)),
        ("roughness", bundle.gray(|i| roughness[i])),
        ("occlusion", bundle.gray(|i| bundle.occlusion[i])),
    ];
    match &layered.tint {
        Some(tint) => textures.push(("specular_color", tint.clone())),
        None => textures.push(("metallic", bundle.gray(|i| layered.orm.value(i, 2)))),
    }
    let mut files = bundle.encode(&format!("{folder}textures/"), &textures)?;
    let names: Vec<&str> =
        files.iter().map(|(name, _)| name.strip_prefix(folder).unwrap_or(name)).collect();
    let document = document(&names, layered);
    files.insert(0, (format!("{folder}material.mtlx"), document.into_bytes()));
    let description = json!({
        "surfaces": ["svbrdf_gltf_pbr", "svbrdf_open_pbr"],
        "normal": "OpenGL: green up",
        "layers": super::glb::describe(layered),
    });
    Ok((files, description))
}

fn document(names: &[&str], layered: &Layered) -> String {
    let image = |name: &str, kind: &str, file: &str, space: &str| {
        format!(
            r#"    <image name="{name}_image" type="{kind}">
      <input name="file" type="filename" value="{file}"{space} />
    </image>
"#
        )
    };
    let srgb = r#" colorspace="srgb_texture""#;
    let last = if layered.tint.is_some() {
        image("specular_color", "color3", names[4], srgb)
    } else {
        image("metallic", "float", names[4], "")
    };
    let images = [
        image("base_color", "color3", names[0], srgb),
        image("normal", "vector3", names[1], ""),
        image("roughness", "float", names[2], ""),
        image("occlusion", "float", names[3], ""),
        last,
    ]
    .concat();
    let output = |name: &str, kind: &str, node: &str| {
        format!("    <output name=\"{name}\" type=\"{kind}\" nodename=\"{node}\" />\n")
    };
    let mut outputs = [
        output("base_color_out", "color3", "base_color_image"),
        output("normal_out", "vector3", "normal_map"),
        output("roughness_out", "float", "roughness_image"),
        output("occlusion_out", "float", "occlusion_image"),
    ]
    .concat();
    outputs += &match layered.tint {
        Some(_) => output("specular_color_out", "color3", "specular_color_image"),
        None => output("metallic_out", "float", "metallic_image"),
    };
    format!(
        r#"<?xml version="1.0"?>
<materialx version="1.39" colorspace="lin_rec709">
  <nodegraph name="svbrdf_maps">
{images}    <normalmap name="normal_map" type="vector3">
      <input name="in" type="vector3" nodename="normal_image" />
    </normalmap>
{outputs}  </nodegraph>
{gltf}{open}</materialx>
"#,
        gltf = gltf_pbr(layered),
        open = open_pbr(layered),
    )
}

/// An input connected to an output of the graph.
fn connected(input: &str, kind: &str, output: &str) -> String {
    format!(
        "    <input name=\"{input}\" type=\"{kind}\" nodegraph=\"svbrdf_maps\" output=\"{output}_out\" />\n"
    )
}

fn gltf_pbr(layered: &Layered) -> String {
    let mut inputs = [
        connected("base_color", "color3", "base_color"),
        connected("roughness", "float", "roughness"),
        connected("normal", "vector3", "normal"),
        connected("occlusion", "float", "occlusion"),
        format!("    <input name=\"ior\" type=\"float\" value=\"{}\" />\n", layered.ior),
    ]
    .concat();
    inputs += &match layered.tint {
        Some(_) => {
            "    <input name=\"metallic\" type=\"float\" value=\"0\" />\n".to_owned()
                + &connected("specular_color", "color3", "specular_color")
        }
        None => connected("metallic", "float", "metallic"),
    };
    surface("gltf_pbr", "svbrdf_gltf_pbr", &inputs)
}

fn open_pbr(layered: &Layered) -> String {
    let mut inputs = [
        connected("base_color", "color3", "base_color"),
        connected("specular_roughness", "float", "roughness"),
        connected("geometry_normal", "vector3", "normal"),
        format!("    <input name=\"specular_ior\" type=\"float\" value=\"{}\" />\n", layered.ior),
    ]
    .concat();
    inputs += &match layered.tint {
        Some(_) => connected("specular_color", "color3", "specular_color"),
        None => connected("base_metalness", "float", "metallic"),
    };
    surface("open_pbr_surface", "svbrdf_open_pbr", &inputs)
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
