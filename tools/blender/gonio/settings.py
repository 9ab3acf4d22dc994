# SPDX-License-Identifier: MIT
"""Settings of the panel, stored in each scene."""

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
        description="Object in the photograph",
        items=(
            ("BALL", "Ball", "A ball; the add-on adds a sphere to the scene"),
            ("MESH", "Active object", "The active object, photographed by the camera of the scene"),
        ),
    )
    outline: EnumProperty(
        name="Outline",
        description="Outline of the ball",
        items=(
            ("FOUND", "Detected", "Detected by the mask, the alpha channel or a uniform background"),
            ("GIVEN", "Circle", "A circle in pixels"),
        ),
    )
    centre: FloatVectorProperty(
        name="Centre", description="Centre in pixels from the top left corner", size=2, min=0, default=(256, 256)
    )
    radius: FloatProperty(name="Radius", description="Radius in pixels", min=0, default=200)
    near: BoolProperty(
        name="Nearby Camera",
        description="The photograph was taken from nearby, with a camera like that of the scene",
    )
    mask: StringProperty(
        name="Mask", description="Image that is white on the object (optional)", subtype="FILE_PATH"
    )
    world: BoolProperty(
        name="Light as World", description="Use the estimated light as the world of the scene", default=True
    )
    folder: StringProperty(
        name="Results",
        description="Folder for the results of the program; if empty, they are deleted when Blender exits",
        subtype="DIR_PATH",
    )
    # Summary and report of the last run.
    said: StringProperty(options={"HIDDEN"})
    report: StringProperty(options={"HIDDEN"})
