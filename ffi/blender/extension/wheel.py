# SPDX-License-Identifier: GPL-3.0-or-later
"""The library, in the version that this extension was made for."""

import os
import tomllib


class WheelError(Exception):
    """The wheel `svbrdf` cannot be used."""


class WheelMissingError(WheelError):
    """The wheel is not installed, or not for this computer."""


class WheelVersionError(WheelError):
    """The wheel is of another version than the extension."""


def version():
    """Version of this extension, from its manifest."""
    manifest = os.path.join(os.path.dirname(__file__), "blender_manifest.toml")
    with open(manifest, "rb") as file:
        return tomllib.load(file)["version"]


def load():
    """The module `svbrdf`. Raises `WheelError`."""
    try:
        import svbrdf
    except ImportError as fault:
        raise WheelMissingError(
            f"the library svbrdf is missing ({fault}): install the extension for this system anew"
        ) from fault
    found, wanted = getattr(svbrdf, "__version__", "of unknown version"), version()
    if found != wanted:
        where = os.path.dirname(getattr(svbrdf, "__file__", None) or "")
        raise WheelVersionError(
            f"the library svbrdf is {found}, this extension needs {wanted}: remove {where or 'the other one'}"
        )
    return svbrdf
