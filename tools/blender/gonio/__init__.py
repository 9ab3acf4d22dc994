# SPDX-License-Identifier: MIT
"""Estimates the material of an object and the light around it from one HDR photograph, with the program gonio."""

import bpy

from .operator import GONIO_OT_infer
from .panel import GONIO_PT_photograph
from .preferences import Preferences
from .settings import Settings

CLASSES = (Preferences, Settings, GONIO_OT_infer, GONIO_PT_photograph)


def register():
    for it in CLASSES:
        bpy.utils.register_class(it)
    bpy.types.Scene.gonio = bpy.props.PointerProperty(type=Settings)


def unregister():
    del bpy.types.Scene.gonio
    for it in reversed(CLASSES):
        bpy.utils.unregister_class(it)
