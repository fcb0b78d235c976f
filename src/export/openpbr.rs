//! The OpenPBR surface of a USD material, as nodes of MaterialX: for usdview, Houdini and Omniverse, which then
//! show F0, anisotropy, coat and fuzz.

use super::bundle::{Bundle, Layered};
use super::lobes;
use super::materialx::{BELOW_COAT, Image, Source, images, open_pbr_inputs};

/// Path of the material in the scene.
const MATERIAL: &str = "/Sample/Looks/Surface";

/// The textures of the surface but the normal map, which the preview surface has.
pub(super) struct OpenPbr {
    pub images: Vec<Image>,
    inputs: Vec<(&'static str, &'static str, Source)>,
    ior: f32,
}

impl OpenPbr {
    pub fn new(bundle: &Bundle, layered: &Layered) -> Self {
        let mut images = images(bundle, layered);
        let has = |name: &str| images.iter().any(|(own, ..)| *own == name);
        let inputs = open_pbr_inputs(layered, has);
        let used = |name: &str| {
            inputs.iter().any(|(.., from)| matches!(from, Source::Map(own) if *own == name))
        };
        images.retain(|(name, ..)| *name != "normal" && used(name));
        Self { images, inputs, ior: layered.ior }
    }

    /// The nodes, with files in the order of [`Self::images`]; `normal` is the file of the normal map.
    pub fn nodes(&self, files: &[&str], normal: &str, wrap: &str) -> String {
        let mut nodes = node(
            "Texcoord",
            "ND_geompropvalue_vector2",
            "float2",
            &["string inputs:geomprop = \"st\"".into()],
        );
        let named =
            self.images.iter().map(|(name, kind, _)| (*name, *kind)).zip(files.iter().copied());
        for ((name, kind), file) in named.chain([(("normal", "vector3"), normal)]) {
            nodes += &image(name, kind, file, wrap);
        }
        if self.images.iter().any(|(name, ..)| *name == "coat") {
            nodes += &below_coat(self.ior);
        }
        let inputs = self.inputs.iter().map(|(input, kind, source)| match source {
            Source::Map(name) => connection(usd_type(kind), input, &output_of(name, kind)),
            Source::Value(value) => format!("float inputs:{input} = {value}"),
        });
        let inputs: Vec<String> = inputs.collect();
        nodes + &node("OpenPBR", "ND_open_pbr_surface_surfaceshader", "token", &inputs)
    }
}

fn usd_type(kind: &str) -> &'static str {
    match kind {
        "color3" => "color3f",
        "vector3" => "float3",
        _ => "float",
    }
}

/// Name of the node whose output is a map.
fn output_of(name: &str, kind: &str) -> String {
    let last = if kind == "vector3" { "_map" } else { "" };
    format!("OpenPBR_{name}{last}")
}

/// A texture, and the node that turns a vector in tangent space into one in the scene.
fn image(name: &str, kind: &str, file: &str, wrap: &str) -> String {
    let space = if kind == "color3" { "srgb_texture" } else { "lin_rec709" };
    let texture = format!("OpenPBR_{name}");
    let inputs = [
        format!(
            "asset inputs:file = @{file}@ (\n                    colorSpace = \"{space}\"\n                )"
        ),
        connection("float2", "texcoord", "Texcoord"),
        format!("string inputs:uaddressmode = \"{wrap}\""),
        format!("string inputs:vaddressmode = \"{wrap}\""),
    ];
    let mut nodes = node(&texture, &format!("ND_image_{kind}"), usd_type(kind), &inputs);
    if kind == "vector3" {
        let inputs = [connection("float3", "in", &texture)];
        nodes += &node(&output_of(name, kind), "ND_normalmap_float", "float3", &inputs);
    }
    nodes
}

/// See `ior_below_coat` of the MaterialX document.
fn below_coat(ior: f32) -> String {
    let third = 1.0 - lobes::COAT_IOR.recip();
    let number = |input: &str, value: f32| format!("float inputs:{input} = {value}");
    let from = |input: &str, name: &str| connection("float", input, name);
    [
        ("coat_third", "ND_multiply_float", [from("in1", "OpenPBR_coat"), number("in2", third)]),
        ("coat_rest", "ND_subtract_float", [number("in1", 1.0), from("in2", "OpenPBR_coat_third")]),
        (BELOW_COAT, "ND_divide_float", [number("in1", ior), from("in2", "OpenPBR_coat_rest")]),
    ]
    .map(|(name, id, inputs)| node(&format!("OpenPBR_{name}"), id, "float", &inputs))
    .concat()
}

/// An input connected to the output of a node.
fn connection(kind: &str, input: &str, node: &str) -> String {
    format!("{kind} inputs:{input}.connect = <{MATERIAL}/{node}.outputs:out>")
}

fn node(name: &str, id: &str, output: &str, inputs: &[String]) -> String {
    let inputs: String = inputs.iter().map(|line| format!("                {line}\n")).collect();
    format!(
        r#"
            def Shader "{name}"
            {{
                uniform token info:id = "{id}"
{inputs}                {output} outputs:out
            }}
"#
    )
}
