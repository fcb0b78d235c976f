"""Builds the material "svbrdf" and a plane of the sample's size that shows it."""
import os

import bpy

SIZE_M = ({{size}})
IOR = {{ior}}
EXTENSION = "{{extension}}"
# Height of the surface: the normals show it already; True also moves the (subdivided) surface.
DISPLACEMENT = False
HEIGHT_M = {{range}}
HEIGHT_MIDLEVEL = {{middle}}
TEXTURES = {
    "Base Color": ("{{base}}", "sRGB"),
    "{{input}}": ("{{last}}", "{{space}}"),
    "Roughness": ("{{roughness}}", "Non-Color"),
    "Normal": ("{{normal}}", "Non-Color"),
    "Height": ("{{height}}", "Non-Color"),
}


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
