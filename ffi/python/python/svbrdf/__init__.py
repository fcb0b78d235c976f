"""Normal, diffuse, specular and roughness maps of a flat material from a few flash photographs.

Lengths are in mm, angles in degrees, colours linear RGB with Rec. 709 primaries. The board frame has its origin at the
sample's centre: X right, Y up, Z out of the sample. Row 0 of maps is the sample's +Y edge.

    maps = svbrdf.fit("capture", resolution=512)
    maps.save("maps")
    maps.export("material", ["glb", "blender"])
"""

from __future__ import annotations

from . import errors
from ._native import (
    Accepted,
    Board,
    Camera,
    Capture,
    Hint,
    Maps,
    NextView,
    Photo,
    PhotoFile,
    Probe,
    Progress,
    Rejected,
    Session,
    __version__,
)
from .errors import (
    ArgumentError,
    CancelledError,
    Error,
    FieldError,
    FileError,
    InternalError,
    MemoryLimitError,
    ModelError,
    NoMapsError,
    RejectedError,
    StateError,
)
from .fitting import FitProgress, PhotoReport, fit

__all__ = [
    "Accepted",
    "ArgumentError",
    "Board",
    "Camera",
    "CancelledError",
    "Capture",
    "Error",
    "FieldError",
    "FileError",
    "FitProgress",
    "Hint",
    "InternalError",
    "Maps",
    "MemoryLimitError",
    "ModelError",
    "NextView",
    "NoMapsError",
    "Photo",
    "PhotoFile",
    "PhotoReport",
    "Probe",
    "Progress",
    "Rejected",
    "RejectedError",
    "Session",
    "StateError",
    "__version__",
    "errors",
    "fit",
]
