# SPDX-License-Identifier: MIT
"""What the panel asks for; a part of each scene."""

from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, StringProperty
from bpy.types import PropertyGroup


class Settings(PropertyGroup):
    photograph: StringProperty(
        name="Photograph",
        description="HDR photograph of the object: EXR, Radiance HDR or PFM",
        subtype="FILE_PATH",
    )
    shows: EnumProperty(
        name="Shows",
        description="What the photograph shows",
        items=(
            ("BALL", "Ball", "A ball, which gets a sphere of its own in the scene"),
            ("MESH", "Active object", "The active object, as the camera of the scene sees it"),
        ),
    )
    outline: EnumProperty(
        name="Outline",
        description="Where the ball is",
        items=(
            ("FOUND", "Found", "By the mask, the alpha channel or a constant background"),
            ("GIVEN", "Circle", "A circle in pixels"),
        ),
    )
    centre: FloatVectorProperty(
        name="Centre", description="Centre in pixels from the top left corner", size=2, min=0, default=(256, 256)
    )
    radius: FloatProperty(name="Radius", description="Radius in pixels", min=0, default=200)
    near: BoolProperty(
        name="From Near",
        description="The photograph of the ball was taken from near, by a camera like that of the scene",
    )
    mask: StringProperty(
        name="Mask", description="Picture that is bright on the object; may be left empty", subtype="FILE_PATH"
    )
    world: BoolProperty(
        name="Light as World", description="Give the scene a world with the light that was found", default=True
    )
    folder: StringProperty(
        name="Results",
        description="Folder for the results of the program; without one they are gone when Blender ends",
        subtype="DIR_PATH",
    )
    # Of the last run: what was found in a line, and its report.
    said: StringProperty(options={"HIDDEN"})
    report: StringProperty(options={"HIDDEN"})
