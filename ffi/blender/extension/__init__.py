# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials from flash photographs, with the library `svbrdf` that comes as a wheel."""

from . import panel


def register():
    panel.register()


def unregister():
    panel.unregister()
