"""Builds the material "svbrdf" and a plane of the sample's size that shows it."""
import os

import bpy

SIZE_M = ({{size}})
IOR = {{ior}}
EXTENSION = "{{extension}}"
# Height of the surface: the normals show it already. True moves the surface instead, which takes a
# mesh with many faces, and time.
DISPLACEMENT = False
HEIGHT_M = {{range}}
HEIGHT_MIDLEVEL = {{middle}}
TEXTURES = {
    "Base Color": ("{{base}}", "sRGB"),
    "{{input}}": ("{{last}}", "{{space}}"),
    "Roughness": ("{{roughness}}", "Non-Color"),
    "Normal": ("{{normal}}", "Non-Color"),
    "Height": ("{{height}}", "Non-Color"),
{{lobes}}}


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


def real_size(nodes, links):
    """Coordinates of textures for UVs in metres: nodes that divide them by the sample's size."""
    uv = nodes.new("ShaderNodeUVMap")
    uv.location = (-1000, 0)
    mapping = nodes.new("ShaderNodeMapping")
    mapping.location = (-820, 0)
    mapping.inputs["Scale"].default_value = (1 / SIZE_M[0], 1 / SIZE_M[1], 1)
    links.new(uv.outputs["UV"], mapping.inputs["Vector"])
    return mapping.outputs["Vector"]


def build_material(name="svbrdf", displacement=DISPLACEMENT, metres=False):
    """The material. `metres`: UVs of the meshes are in metres, not one sample wide; seamless maps repeat."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["IOR"].default_value = IOR
    links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    if "Anisotropic" in TEXTURES:
        # Directions are angles from the direction of u.
        tangent = nodes.new("ShaderNodeTangent")
        tangent.direction_type = "UV_MAP"
        tangent.location = (-300, -1400)
        links.new(tangent.outputs["Tangent"], surface.inputs["Tangent"])
    if "Coat Weight" in TEXTURES:
        surface.inputs["Coat IOR"].default_value = 1.5
    place = real_size(nodes, links) if metres else None
    root = folder()
    for row, (label, (file, space)) in enumerate(TEXTURES.items()):
        # Another export may have been shown from the same folder before.
        image = bpy.data.images.load(os.path.join(root, file), check_existing=True)
        image.reload()
        image.colorspace_settings.name = space
        texture = nodes.new("ShaderNodeTexImage")
        texture.image, texture.label = image, label
        texture.extension = EXTENSION
        texture.location = (-600, 300 - 280 * row)
        if place:
            links.new(place, texture.inputs["Vector"])
        color = texture.outputs["Color"]
        if label == "Normal":
            normal = nodes.new("ShaderNodeNormalMap")
            normal.location = (-300, 300 - 280 * row)
            links.new(color, normal.inputs["Color"])
            if not displacement:
                links.new(normal.outputs["Normal"], surface.inputs[label])
                if "Coat Weight" in TEXTURES:
                    links.new(normal.outputs["Normal"], surface.inputs["Coat Normal"])
        elif label == "Height":
            height = nodes.new("ShaderNodeDisplacement")
            height.location = (-300, 300 - 280 * row)
            height.inputs["Scale"].default_value = HEIGHT_M
            height.inputs["Midlevel"].default_value = HEIGHT_MIDLEVEL
            links.new(color, height.inputs["Height"])
            if displacement:
                links.new(height.outputs["Displacement"], output.inputs["Displacement"])
        else:
            links.new(color, surface.inputs[label])
    output.location = (300, 0)
    if displacement:
        # What faces are too large to show is left to shading.
        if hasattr(material, "displacement_method"):
            material.displacement_method = "BOTH"
        else:
            material.cycles.displacement_method = "BOTH"
    return material


def build_plane(material, name="sample", displacement=DISPLACEMENT):
    """A plane of the sample's size, its middle at the origin."""
    x, y = SIZE_M[0] / 2, SIZE_M[1] / 2
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    for loop, uv in zip(layer.data, [(0, 0), (1, 0), (1, 1), (0, 1)]):
        loop.uv = uv
    mesh.materials.append(material)
    plane = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(plane)
    if displacement:
        faces = plane.modifiers.new("Subdivision", "SUBSURF")
        faces.subdivision_type = "SIMPLE"
        faces.levels, faces.render_levels = 6, 8
    return plane


if __name__ == "__main__":
    build_plane(build_material())
