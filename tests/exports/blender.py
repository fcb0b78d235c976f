"""Shows exported materials in Blender (Cycles) and compares them with `svbrdf render`:
blender.py CASES LIMIT, with the folder that three.mjs takes.

Every case is shown twice: its GLB imported, and its nodes built by blender/material.py. One pixel is
one texel (see three.mjs); a camera with a shifted lens ends its frustum at the sample's edges."""
import json
import math
import os
import runpy
import sys

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))


def pixels(path):
    """An EXR file as rows from the bottom, linear."""
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    values = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[..., :3]


def empty_scene(width, height):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 4
    scene.cycles.max_bounces = 0
    scene.cycles.use_denoising = False
    scene.cycles.sample_clamp_direct = 0
    scene.cycles.blur_glossy = 0
    # The pixel's middle alone: a texel. (A box has no width of its own.)
    scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    scene.cycles.filter_width = 0.01
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 2
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    return scene


def render(scene, view, size, path):
    x, y, z = (v / 1000 for v in view["camera"])
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = 36
    camera.lens = 36 * z / size[0]
    camera.shift_x, camera.shift_y = -x / size[0], -y / size[0]
    camera.clip_start = 0.01
    placed = bpy.data.objects.new("camera", camera)
    placed.location = (x, y, z)
    scene.collection.objects.link(placed)
    scene.camera = placed
    light = bpy.data.lights.new("light", "POINT")
    light.shadow_soft_size = 0
    light.energy = 1
    lamp = bpy.data.objects.new("light", light)
    lamp.location = [v / 1000 for v in view["light"]]
    scene.collection.objects.link(lamp)
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    shown = pixels(path)
    # A lamp of P watts lights a white surface that faces it to P / (4 pi^2 d^2).
    height, width = shown.shape[:2]
    columns = (np.arange(width) + 0.5) / width - 0.5
    rows = (np.arange(height) + 0.5) / height - 0.5
    lx, ly, lz = lamp.location
    squared = (columns[None] * size[0] - lx) ** 2 + (rows[:, None] * size[1] - ly) ** 2 + lz**2
    return shown * (4 * math.pi**2 * squared)[..., None]


def main():
    cases, limit = os.path.abspath(sys.argv[1]), float(sys.argv[2])
    views = json.load(open(os.path.join(HERE, "views.json")))
    failed = False
    for name in sorted(os.listdir(cases)):
        folder = os.path.join(cases, name)
        estimated = json.load(open(os.path.join(folder, "material.json")))["estimated"]["maps"]
        # Blender's sheen has another formula.
        if "sheen" in estimated:
            continue
        # Blender's importer takes glTF's strength for its own anisotropy, which has another formula.
        for kind in ["nodes"] if "anisotropy" in estimated else ["GLB", "nodes"]:
            for index, view in enumerate(views):
                known_path = os.path.join(folder, f"{index}.exr")
                scene = empty_scene(64, 64)
                known = pixels(known_path)
                scene.render.resolution_x, scene.render.resolution_y = known.shape[1], known.shape[0]
                if kind == "GLB":
                    bpy.ops.import_scene.gltf(filepath=os.path.join(folder, "material.glb"))
                    # Blender's z is up: glTF's x-y plane came to stand.
                    for item in list(scene.objects):
                        if item.parent is None:
                            item.rotation_mode = "XYZ"
                            item.rotation_euler = (-math.pi / 2, 0, 0)
                else:
                    runpy.run_path(os.path.join(folder, "blender", "material.py"), run_name="__main__")
                mesh = next(item for item in scene.objects if item.type == "MESH")
                bpy.context.view_layer.update()
                corners = [mesh.matrix_world @ v.co for v in mesh.data.vertices]
                size = [max(c[a] for c in corners) - min(c[a] for c in corners) for a in (0, 1)]
                assert all(abs(c[2]) < 1e-6 for c in corners), "the sample lies in z = 0"
                shown = render(scene, view, size, os.path.join(folder, f"blender-{kind}-{index}.exr"))
                difference = np.abs(shown - known).sum() / known.sum()
                ratio = shown.sum() / known.sum()
                good = difference <= limit
                print(
                    f"Blender {bpy.app.version_string} {kind} {name} view {index}: {ratio:.3f} of the "
                    f"library's radiance, mean difference {100 * difference:.1f} %"
                    + ("" if good else " FAILED"),
                    flush=True,
                )
                failed |= not good
    sys.exit(failed)


if __name__ == "__main__":
    main()
