//! A script for Blender 4.0 and later that builds the material's nodes.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, HEIGHT, Layered};
use crate::Result;

/// The script and its textures below `folder`, and what they hold.
pub(super) fn encode(bundle: &Bundle, layered: &Layered, folder: &str) -> Result<(Files, Value)> {
    let roughness = bundle.roughness();
    let mut textures = vec![
        ("base_color", layered.base.clone()),
        ("normal", bundle.normals(1.0)),
        ("roughness", bundle.gray(|i| roughness[i])),
        (HEIGHT, bundle.height_texture()),
    ];
    match &layered.tint {
        Some(tint) => textures.push(("specular_tint", tint.clone())),
        None => textures.push(("metallic", bundle.gray(|i| layered.orm.value(i, 2)))),
    }
    let mut files = bundle.encode(&format!("{folder}textures/"), &textures)?;
    let names: Vec<&str> =
        files.iter().map(|(name, _)| name.strip_prefix(folder).unwrap_or(name)).collect();
    let script = script(bundle, layered, &names);
    files.insert(0, (format!("{folder}material.py"), script.into_bytes()));
    let description = json!({
        "script": "builds the material and a plane of the sample's size; run it in Blender 4.0 or later",
        "normal": "OpenGL: green up",
        "layers": super::glb::describe(layered),
    });
    Ok((files, description))
}

fn script(bundle: &Bundle, layered: &Layered, names: &[&str]) -> String {
    let [x, y] = bundle.sample_mm.map(|mm| mm / 1000.0);
    let [low, high] = bundle.height.range_mm();
    let middle = if high > low { -low / (high - low) } else { 0.5 };
    let (input, space) =
        if layered.tint.is_some() { ("Specular Tint", "sRGB") } else { ("Metallic", "Non-Color") };
    format!(
        r#""""Builds the material "svbrdf" and a plane of the sample's size that shows it."""
import os

import bpy

SIZE_M = ({x}, {y})
IOR = {ior}
EXTENSION = "{extension}"
# Height of the surface: the normals show it already; True also moves the (subdivided) surface.
DISPLACEMENT = False
HEIGHT_M = {range}
HEIGHT_MIDLEVEL = {middle}
TEXTURES = {{
    "Base Color": ("{base}", "sRGB"),
    "{input}": ("{last}", "{space}"),
    "Roughness": ("{roughness}", "Non-Color"),
    "Normal": ("{normal}", "Non-Color"),
    "Height": ("{height}", "Non-Color"),
}}


def folder():
    """The folder of this script, however it is run."""
    candidates = [os.path.dirname(os.path.abspath(globals().get("__file__", "")))]
    text = getattr(getattr(bpy.context, "space_data", None), "text", None)
    if text and text.filepath:
        candidates.insert(0, os.path.dirname(bpy.path.abspath(text.filepath)))
    for candidate in candidates:
        if os.path.isfile(os.path.join(candidate, TEXTURES["Base Color"][0])):
            return candidate
    raise FileNotFoundError("the folder textures/ must stand beside this script")


def build_material():
    material = bpy.data.materials.new("svbrdf")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["IOR"].default_value = IOR
    links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    root = folder()
    for row, (name, (file, space)) in enumerate(TEXTURES.items()):
        image = bpy.data.images.load(os.path.join(root, file), check_existing=True)
        image.colorspace_settings.name = space
        texture = nodes.new("ShaderNodeTexImage")
        texture.image, texture.label = image, name
        texture.extension = EXTENSION
        texture.location = (-600, 300 - 280 * row)
        color = texture.outputs["Color"]
        if name == "Normal":
            normal = nodes.new("ShaderNodeNormalMap")
            normal.location = (-300, 300 - 280 * row)
            links.new(color, normal.inputs["Color"])
            color = normal.outputs["Normal"]
        if name == "Height":
            displacement = nodes.new("ShaderNodeDisplacement")
            displacement.location = (-300, 300 - 280 * row)
            displacement.inputs["Scale"].default_value = HEIGHT_M
            displacement.inputs["Midlevel"].default_value = HEIGHT_MIDLEVEL
            links.new(color, displacement.inputs["Height"])
            if DISPLACEMENT:
                links.new(displacement.outputs["Displacement"], output.inputs["Displacement"])
        else:
            links.new(color, surface.inputs[name])
    output.location = (300, 0)
    return material


def build_plane(material):
    x, y = SIZE_M[0] / 2, SIZE_M[1] / 2
    mesh = bpy.data.meshes.new("sample")
    mesh.from_pydata([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    for loop, uv in zip(layer.data, [(0, 0), (1, 0), (1, 1), (0, 1)]):
        loop.uv = uv
    mesh.materials.append(material)
    plane = bpy.data.objects.new("sample", mesh)
    bpy.context.scene.collection.objects.link(plane)
    return plane


build_plane(build_material())
"#,
        ior = layered.ior,
        extension = if bundle.tileable { "REPEAT" } else { "EXTEND" },
        range = (high - low) / 1000.0,
        base = names[0],
        normal = names[1],
        roughness = names[2],
        height = names[3],
        last = names[4],
    )
}
