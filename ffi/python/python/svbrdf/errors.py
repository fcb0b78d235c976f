"""Exceptions. A photograph that cannot be used is no error: ``Session.add_photo`` returns ``Rejected``."""

from __future__ import annotations

__all__ = [
    "ArgumentError",
    "CancelledError",
    "Error",
    "FieldError",
    "FileError",
    "InternalError",
    "MemoryLimitError",
    "ModelError",
    "NoMapsError",
    "RejectedError",
    "StateError",
]


class Error(Exception):
    """Base of all errors of this package."""


class ArgumentError(Error, ValueError):
    """An argument has a wrong shape or is out of range."""


class FieldError(Error, ValueError):
    """A field of a file has no usable value."""


class FileError(Error, OSError):
    """A file cannot be read or written."""


class ModelError(Error):
    """A network is damaged or does not fit this version."""


class StateError(Error, ValueError):
    """A saved session cannot be read."""


class MemoryLimitError(Error, MemoryError):
    """The work would need more memory than is allowed."""


class NoMapsError(Error):
    """No photograph has been accepted yet."""


class CancelledError(Error):
    """The work was cancelled."""


class InternalError(Error):
    """A fault of the library."""


class RejectedError(Error):
    """Every photograph of a fit was rejected; ``photos`` says why."""

    def __init__(self, message: str, photos: tuple[object, ...] = ()) -> None:
        super().__init__(message)
        self.photos = photos
