"""The extension in Blender (the package bpy), installed from its archive as a user does.

Needs `EXTENSION` (the archive), `SVBRDF_CLI`, and `BLENDER_USER_RESOURCES` naming an empty folder."""

import contextlib
import importlib
import json
import os
import pathlib
import subprocess
import sys
import threading
import time
import types

import bpy
import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
CAPTURE = ROOT / "examples" / "captures" / "tile"
sys.path.insert(0, str(ROOT / "tests" / "exports"))
import blender as shown  # noqa: E402  what tests/blender.sh renders with

MODULE = "bl_ext.user_default.svbrdf"
#: Photographs and steps: enough for a material with relief and gloss, and quick.
QUICK = {"photos": 3, "steps": 20}


@pytest.fixture(scope="session", autouse=True)
def installed():
    """The extension as Blender installs it, with the wheel from its archive."""
    assert "svbrdf" not in sys.modules
    bpy.ops.extensions.package_install_files(
        filepath=os.environ["EXTENSION"], repo="user_default", enable_on_install=True
    )
    return importlib.import_module(MODULE)


@pytest.fixture(scope="session")
def svbrdf(installed):
    return part("wheel").load()


def part(name):
    return importlib.import_module(f"{MODULE}.{name}")


@pytest.fixture(scope="session")
def fitted(svbrdf, tmp_path_factory):
    """A folder with maps of the capture."""
    folder = tmp_path_factory.mktemp("fitted")
    svbrdf.fit(CAPTURE, **QUICK).save(folder)
    return folder


@pytest.fixture()
def settings(tmp_path):
    """The panel's settings in an empty scene."""
    # It also takes the preferences back to how Blender comes.
    shown.empty_scene(64, 64)
    bpy.ops.preferences.addon_enable(module=MODULE)
    settings = bpy.context.scene.svbrdf
    settings.name = "tile"
    settings.folder = str(tmp_path / "textures")
    return settings


@pytest.fixture()
def quick(monkeypatch):
    """Fits that take seconds."""
    panel = part("panel")
    whole = panel.request

    def request(settings):
        return part("job").Request(**{**whole(settings).__dict__, **QUICK, "resolution": 256})

    monkeypatch.setattr(panel, "request", request)


def images(material):
    return {n.label: n.image for n in material.node_tree.nodes if n.type == "TEX_IMAGE"}


def blocks(picture, texels):
    height, width = (n // texels for n in picture.shape[:2])
    return picture.reshape(height, texels, width, texels, 3).mean(axis=(1, 3))


def differences(fitted, tmp_path, size, texels=1):
    """Mean difference of Blender's renderings from `svbrdf render`, relative, for each view; of means over blocks
    of so many texels along each side."""
    views = json.loads((ROOT / "tests" / "exports" / "views.json").read_text())
    scene = bpy.context.scene
    found = []
    for index, view in enumerate(views):
        known = tmp_path / f"{index}.exr"
        camera, light = (",".join(map(str, view[key])) for key in ("camera", "light"))
        subprocess.run(
            [os.environ["SVBRDF_CLI"], "render", str(fitted), f"--camera-mm={camera}"]
            + [f"--light-mm={light}", "--sample-mm=88", "--out", str(known)],
            check=True,
        )
        known = shown.pixels(str(known))
        scene.render.resolution_x, scene.render.resolution_y = known.shape[1], known.shape[0]
        for item in [o for o in scene.objects if o.type != "MESH"]:
            bpy.data.objects.remove(item)
        ours = shown.render(scene, view, size, str(tmp_path / f"blender-{index}.exr"))
        ours, known = (blocks(picture, texels) for picture in (ours, known))
        found.append(np.abs(ours - known).sum() / known.sum())
    return found


def test_the_wheel_comes_with_the_extension(svbrdf):
    resources = os.path.realpath(os.environ["BLENDER_USER_RESOURCES"])
    assert os.path.realpath(svbrdf.__file__).startswith(resources)
    assert svbrdf.__version__ == part("wheel").version()


def test_photographs_become_a_material_that_renders_as_the_library_does(
    settings, quick, fitted, tmp_path
):
    settings.photographs = str(CAPTURE)
    assert bpy.ops.svbrdf.make() == {"FINISHED"}
    plane = bpy.data.objects["tile"]
    # True size, in metres; the capture says 88 mm.
    assert plane.dimensions[:] == pytest.approx((0.088, 0.088, 0))
    assert plane.active_material.name == "tile"
    assert "3 of 3 photographs used" in part("panel")._report
    assert not (tmp_path / "textures" / "tile-2").exists()
    found = differences(fitted, tmp_path, (0.088, 0.088))
    print("Blender", bpy.app.version_string, "mean difference", [f"{100 * d:.1f} %" for d in found])
    assert max(found) < 0.05, found


def test_maps_become_materials_side_by_side(settings, fitted, tmp_path):
    settings.source, settings.maps = "MAPS", str(fitted)
    for number in (1, 2):
        assert bpy.ops.svbrdf.make() == {"FINISHED"}
        assert len(bpy.data.materials) == number
    first, second = (bpy.data.materials[name] for name in ("tile", "tile.001"))
    for label, image in images(first).items():
        assert image.filepath != images(second)[label].filepath
        wanted = "sRGB" if label in ("Base Color", "Specular Tint") else "Non-Color"
        assert image.colorspace_settings.name == wanted
        assert os.path.isfile(bpy.path.abspath(image.filepath))
    assert set(images(first)) == {"Base Color", "Specular Tint", "Roughness", "Normal", "Height"}
    surface = next(n for n in first.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    assert all(surface.inputs[i].is_linked for i in ("Base Color", "Specular Tint", "Roughness", "Normal"))


def test_the_active_object_gets_the_material_at_true_size(settings, fitted):
    bpy.ops.mesh.primitive_plane_add(size=2)
    wall = bpy.context.active_object
    for name, value in {
        "source": "MAPS", "maps": str(fitted), "target": "ACTIVE", "metres": True, "tile": True, "pack": True,
    }.items():
        setattr(settings, name, value)
    assert bpy.ops.svbrdf.make() == {"FINISHED"}
    material = wall.active_material
    mapping = next(n for n in material.node_tree.nodes if n.type == "MAPPING")
    # A metre of wall shows the sample so many times.
    assert mapping.inputs["Scale"].default_value[:] == pytest.approx((1 / 0.088, 1 / 0.088, 1))
    assert all(image.packed_file for image in images(material).values())
    textures = [n for n in material.node_tree.nodes if n.type == "TEX_IMAGE"]
    assert all(n.extension == "REPEAT" and n.inputs["Vector"].is_linked for n in textures)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = None
    with pytest.raises(RuntimeError, match="select a mesh"):
        bpy.ops.svbrdf.make()


def test_displacement_moves_the_surface_by_its_height(settings, fitted, tmp_path):
    settings.source, settings.maps, settings.displacement = "MAPS", str(fitted), True
    assert bpy.ops.svbrdf.make() == {"FINISHED"}
    material = bpy.data.materials["tile"]
    output = next(n for n in material.node_tree.nodes if n.type == "OUTPUT_MATERIAL")
    surface = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    assert output.inputs["Displacement"].is_linked and not surface.inputs["Normal"].is_linked
    assert material.displacement_method == "BOTH"
    assert bpy.data.objects["tile"].modifiers["Subdivision"].render_levels == 8
    record = json.loads((tmp_path / "textures" / "tile" / "material.json").read_text())
    low, high = record["height"]["range_mm"]
    height = next(n for n in material.node_tree.nodes if n.type == "DISPLACEMENT")
    assert height.inputs["Scale"].default_value == pytest.approx((high - low) / 1000)
    # The moved surface shows its relief: most of what the normals show and a flat one does not. Heights have no
    # steps, and moved texels lie elsewhere in the picture.
    size = (0.088, 0.088)
    moved = differences(fitted, tmp_path, size, texels=8)
    material.node_tree.links.remove(output.inputs["Displacement"].links[0])
    flat = differences(fitted, tmp_path, size, texels=8)
    print("displaced", moved, "flat", flat)
    assert all(m < 0.75 * f for m, f in zip(moved, flat)), (moved, flat)


@pytest.mark.parametrize("wrong", ["version", "missing"])
def test_a_wheel_that_does_not_fit_is_an_error_and_blender_goes_on(settings, svbrdf, monkeypatch, fitted, wrong):
    settings.source, settings.maps = "MAPS", str(fitted)
    with monkeypatch.context() as changed:
        if wrong == "version":
            changed.setattr(svbrdf, "__version__", "0.0.9")
        else:
            changed.setitem(sys.modules, "svbrdf", None)
        error = "WheelVersionError.*0.0.9" if wrong == "version" else "WheelMissingError"
        with pytest.raises(RuntimeError, match=error):
            bpy.ops.svbrdf.make()
        with pytest.raises(RuntimeError, match=error):
            bpy.ops.svbrdf.board(filepath="board.pdf")
        assert part("panel")._report
    assert bpy.ops.svbrdf.make() == {"FINISHED"}


@contextlib.contextmanager
def nobody():
    """Without the rights of root, who may write anywhere."""
    is_root = os.geteuid() == 0
    if is_root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)


def test_faults_of_files_are_told(settings, fitted, tmp_path):
    settings.source, settings.maps = "MAPS", str(fitted)
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    settings.folder = str(locked / "textures")
    with nobody(), pytest.raises(RuntimeError, match="PermissionError: "):
        bpy.ops.svbrdf.make()
    with nobody(), pytest.raises(RuntimeError, match="FileError: .*board.pdf"):
        bpy.ops.svbrdf.board(filepath=str(locked / "board"))
    assert os.listdir(locked) == []
    settings.folder = str(tmp_path / "textures")
    settings.maps = str(tmp_path / "nowhere")
    with pytest.raises(RuntimeError, match="SourceError: .*nowhere"):
        bpy.ops.svbrdf.make()
    (tmp_path / "empty").mkdir()
    settings.source, settings.photographs = "PHOTOGRAPHS", str(tmp_path / "empty")
    with pytest.raises(RuntimeError, match="FileError: .*nor a photograph"):
        bpy.ops.svbrdf.make()
    (tmp_path / "empty" / "0.png").write_bytes(b"\x89PNG\r\n\x1a\n no picture")
    with pytest.raises(RuntimeError, match="RejectedError"):
        bpy.ops.svbrdf.make()
    assert any("0.png" in line for line in part("panel")._report)
    # Nothing half done is left.
    assert os.listdir(tmp_path / "textures") == []
    assert bpy.ops.svbrdf.board(filepath=str(tmp_path / "board")) == {"FINISHED"}
    assert (tmp_path / "board.pdf").read_bytes()[:5] == b"%PDF-"


class Manager:
    """What a window manager does with a modal operator."""

    def __init__(self):
        self.timers, self.windows, self.handlers = 0, (), []

    def event_timer_add(self, seconds, window):
        self.timers += 1
        return object()

    def event_timer_remove(self, timer):
        self.timers -= 1

    def modal_handler_add(self, operator):
        self.handlers.append(operator)


def test_blender_goes_on_while_a_fit_runs_and_is_cancelled(settings, svbrdf, monkeypatch):
    """The steps of the modal operator with events as Blender sends them: this bpy has no windows."""
    panel = part("panel")
    cancelled, tell = threading.Event(), panel.Job._tell

    def held(job, fraction, message):
        tell(job, fraction, message)
        if fraction > 0:
            # A fast fit would be through before.
            cancelled.wait()
            tell(job, fraction, message)

    monkeypatch.setattr(panel.Job, "_tell", held)
    settings.photographs = str(CAPTURE)
    settings.resolution = "1024"
    manager = Manager()
    context = types.SimpleNamespace(
        scene=bpy.context.scene, window_manager=manager, window=None, area=None, active_object=None
    )
    kind = panel.SVBRDF_OT_make
    told = []
    names = ("invoke", "modal", "_begin", "_end", "_fail")
    operator = types.SimpleNamespace(report=lambda level, text: told.append((level, text)))
    for name in names:
        setattr(operator, name, types.MethodType(getattr(kind, name), operator))
    assert operator.invoke(context, None) == {"RUNNING_MODAL"} and manager.handlers == [operator]
    assert not kind.poll(context) and panel.SVBRDF_OT_cancel.poll(context)
    event = types.SimpleNamespace(type="TIMER", value="NOTHING", mouse_x=0, mouse_y=0)
    # Events are not held up: each of these has passed before the fit is through.
    while panel._job.fraction == 0:
        assert operator.modal(context, event) == {"PASS_THROUGH"}
        time.sleep(0.02)
    assert bpy.ops.svbrdf.cancel() == {"FINISHED"}
    cancelled.set()
    while (answer := operator.modal(context, event)) == {"PASS_THROUGH"}:
        time.sleep(0.02)
    assert answer == {"CANCELLED"} and manager.timers == 0
    assert told == [({"WARNING"}, "CancelledError: cancelled")]
    assert kind.poll(context) and len(bpy.data.materials) == 0
    assert os.listdir(settings.folder) == []
