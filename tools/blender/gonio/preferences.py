# SPDX-License-Identifier: MIT
"""Preferences of the add-on: the path of the program."""

import shutil
from pathlib import Path

import bpy

from .problem import Problem


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Program",
        description="Path of the program gonio; a name without a folder is searched on the PATH",
        subtype="FILE_PATH",
        default="gonio",
    )

    def draw(self, _context):
        self.layout.prop(self, "program")


def program(context):
    """Returns the path of the program."""
    given = context.preferences.addons[__package__].preferences.program.strip() or "gonio"
    found = shutil.which(given if Path(given).name == given else bpy.path.abspath(given))
    if found is None:
        raise Problem(f"{given}: program not found; set its path in the preferences of the add-on gonio")
    return found
