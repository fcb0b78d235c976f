# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user sees: properties, operators and the panel in the sidebar of the 3D view."""

import os

import bpy

from . import material, wheel
from .job import Job, Request

#: Seconds between two looks at the work.
LOOK = 0.1
#: The work in progress, and what the last one told.
_job = None
_report = []


class SVBRDF_Settings(bpy.types.PropertyGroup):
    source: bpy.props.EnumProperty(
        name="From",
        items=[
            ("PHOTOGRAPHS", "Photographs", "Fit maps to flash photographs of a sample in its board"),
            ("MAPS", "Maps", "Read maps that were fitted before"),
        ],
    )
    photographs: bpy.props.StringProperty(
        name="Photographs",
        description="Folder with photographs, or with capture.json",
        subtype="DIR_PATH",
    )
    maps: bpy.props.StringProperty(
        name="Maps",
        description="Folder with maps.exr, or normal, diffuse, specular and roughness pictures",
        subtype="DIR_PATH",
    )
    name: bpy.props.StringProperty(name="Name", default="Scanned material")
    resolution: bpy.props.EnumProperty(
        name="Resolution",
        items=[(str(n), f"{n}", f"{n} texels along each side") for n in (256, 512, 1024, 2048)],
        default="512",
    )
    states_size: bpy.props.BoolProperty(
        name="State the size",
        description="Of the sample, where neither photographs nor maps tell it",
    )
    size_mm: bpy.props.FloatVectorProperty(
        name="Size (mm)", size=2, default=(100.0, 100.0), min=1.0, max=10000.0
    )
    tile: bpy.props.BoolProperty(name="Seamless", description="Make the maps repeat without seams")
    displacement: bpy.props.BoolProperty(
        name="Displacement",
        description="Move the surface, instead of its normals alone; needs a mesh with many faces",
    )
    target: bpy.props.EnumProperty(
        name="Onto",
        items=[
            ("PLANE", "Plane of true size", "Add a plane of the sample's size"),
            ("ACTIVE", "Active object", "Put the material onto the active object"),
        ],
    )
    metres: bpy.props.BoolProperty(
        name="UVs in metres",
        description="One unit of the object's UVs is a metre: the material gets its true size",
    )
    folder: bpy.props.StringProperty(
        name="Textures",
        description="Folder to write textures into; empty: textures/ beside the saved file",
        subtype="DIR_PATH",
    )
    pack: bpy.props.BoolProperty(name="Pack", description="Keep the textures inside the .blend file")


def request(settings):
    """What the panel asks for."""
    is_maps = settings.source == "MAPS"
    source = settings.maps if is_maps else settings.photographs
    return Request(
        source=bpy.path.abspath(source),
        is_maps=is_maps,
        folder=_folder(settings),
        name=settings.name,
        resolution=int(settings.resolution),
        sample_mm=tuple(settings.size_mm) if settings.states_size else None,
        tile=settings.tile,
    )


def _folder(settings):
    if settings.folder:
        return bpy.path.abspath(settings.folder)
    if bpy.data.filepath:
        return bpy.path.abspath("//textures")
    return bpy.utils.extension_path_user(__package__, path="textures", create=True)


class SVBRDF_OT_make(bpy.types.Operator):
    bl_idname = "svbrdf.make"
    bl_label = "Make material"
    bl_description = "Make a material from photographs or maps"
    bl_options = {"REGISTER", "UNDO"}

    _timer = None

    @classmethod
    def poll(cls, context):
        return _job is None

    def invoke(self, context, event):
        """Goes on beside everything else."""
        if not self._begin(context):
            return {"CANCELLED"}
        manager = context.window_manager
        self._timer = manager.event_timer_add(LOOK, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if _job is None:
            # The extension was disabled meanwhile.
            context.window_manager.event_timer_remove(self._timer)
            return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS" and _is_inside(context, event):
            _job.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        _redraw(context)
        if not _job.is_done:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        return self._end(context)

    def execute(self, context):
        """Waits for the end, for scripts."""
        if not self._begin(context):
            return {"CANCELLED"}
        _job.wait()
        return self._end(context)

    def cancel(self, context):
        """Blender closes the window."""
        global _job
        if _job is not None:
            _job.cancel()
            _job.wait()
            _job = None

    def _begin(self, context):
        global _job
        _report.clear()
        try:
            # A fit takes a while; the object is the one that was active when it began.
            self._onto = _active(context) if context.scene.svbrdf.target == "ACTIVE" else None
            _job = Job(wheel.load(), request(context.scene.svbrdf)).start()
            return True
        except (wheel.WheelError, ValueError, OSError) as fault:
            return self._fail(fault)

    def _end(self, context):
        global _job
        job, _job = _job, None
        settings = context.scene.svbrdf
        if job.error is not None:
            self._fail(job.error)
            return {"CANCELLED"}
        try:
            made, shown = material.build(
                job.result,
                settings.name,
                displacement=settings.displacement,
                metres=settings.metres and self._onto is not None,
                onto=self._onto,
                pack=settings.pack,
            )
        except (OSError, RuntimeError, ReferenceError) as fault:
            self._fail(fault)
            return {"CANCELLED"}
        _report.extend(job.result.report)
        self.report({"INFO"}, f"{made.name} is on {shown.name}")
        _redraw(context)
        return {"FINISHED"}

    def _fail(self, fault):
        kind = type(fault).__name__
        _report.extend(str(fault).splitlines() or [kind])
        level = "WARNING" if kind == "CancelledError" else "ERROR"
        self.report({level}, f"{kind}: {fault}")
        return False


class SVBRDF_OT_cancel(bpy.types.Operator):
    bl_idname = "svbrdf.cancel"
    bl_label = "Cancel"
    bl_description = "End the work in progress"

    @classmethod
    def poll(cls, context):
        return _job is not None

    def execute(self, context):
        _job.cancel()
        return {"FINISHED"}


class SVBRDF_OT_board(bpy.types.Operator):
    bl_idname = "svbrdf.board"
    bl_label = "Save board to print"
    bl_description = "Write the board that lies round the sample as a PDF file, to be printed at 100 %"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", default="board.pdf")

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        try:
            svbrdf = wheel.load()
            svbrdf.Board().write(bpy.path.ensure_ext(bpy.path.abspath(self.filepath), ".pdf"))
        except (wheel.WheelError, ValueError, OSError) as fault:
            self.report({"ERROR"}, f"{type(fault).__name__}: {fault}")
            return {"CANCELLED"}
        return {"FINISHED"}


class SVBRDF_PT_panel(bpy.types.Panel):
    bl_idname = "SVBRDF_PT_panel"
    bl_label = "Material from photographs"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SVBRDF"

    def draw(self, context):
        layout, settings = self.layout, context.scene.svbrdf
        layout.use_property_split = True
        column = layout.column()
        column.enabled = _job is None
        column.prop(settings, "source", expand=True)
        if settings.source == "MAPS":
            column.prop(settings, "maps")
        else:
            column.prop(settings, "photographs")
            column.prop(settings, "resolution")
        column.prop(settings, "states_size")
        if settings.states_size:
            column.prop(settings, "size_mm")
        column.prop(settings, "name")
        column.prop(settings, "target")
        if settings.target == "ACTIVE":
            column.prop(settings, "metres")
        column.prop(settings, "tile")
        column.prop(settings, "displacement")
        column.prop(settings, "folder")
        column.prop(settings, "pack")
        if _job is None:
            layout.operator("svbrdf.make", icon="MATERIAL")
        else:
            layout.progress(factor=_job.fraction, text=_job.message)
            layout.operator("svbrdf.cancel", icon="CANCEL")
        if _report:
            box = layout.box()
            for line in _report:
                box.label(text=line)
        layout.operator("svbrdf.board", icon="MESH_GRID")


def _active(context):
    shown = context.active_object
    if shown is None or shown.type != "MESH":
        raise ValueError("Onto: select a mesh, or choose a plane")
    return shown


def _is_inside(context, event):
    """Whether the pointer is over the area of the panel: elsewhere Escape means something else."""
    area = context.area
    if area is None:
        return False
    x, y = event.mouse_x - area.x, event.mouse_y - area.y
    return 0 <= x < area.width and 0 <= y < area.height


def _redraw(context):
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


CLASSES = (SVBRDF_Settings, SVBRDF_OT_make, SVBRDF_OT_cancel, SVBRDF_OT_board, SVBRDF_PT_panel)


def register():
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Scene.svbrdf = bpy.props.PointerProperty(type=SVBRDF_Settings)


def unregister():
    global _job
    if _job is not None:
        _job.cancel()
        _job.wait()
        _job = None
    del bpy.types.Scene.svbrdf
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
