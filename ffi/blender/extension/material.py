# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of exported maps: the nodes are built by the script that the library writes beside its textures."""

import runpy


def build(result, name, *, displacement=False, metres=False, onto=None, pack=False):
    """The material of a job's result, on a plane of the sample's size or on the mesh `onto`: (material, object)."""
    script = runpy.run_path(result.script, run_name="svbrdf_material")
    material = script["build_material"](name, displacement, metres)
    if onto is None:
        shown = script["build_plane"](material, name, displacement)
    else:
        shown = onto
        if shown.material_slots:
            shown.material_slots[shown.active_material_index].material = material
        else:
            shown.data.materials.append(material)
    if pack:
        for node in material.node_tree.nodes:
            if node.type == "TEX_IMAGE":
                node.image.pack()
    return material, shown
