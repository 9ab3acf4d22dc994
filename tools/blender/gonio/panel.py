# SPDX-License-Identifier: MIT
"""Panel in the sidebar of the 3D view."""

import textwrap

import bpy

from .operator import GONIO_OT_infer


class GONIO_PT_photograph(bpy.types.Panel):
    bl_label = "Material from a Photograph"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "gonio"

    def draw(self, context):
        layout, asked = self.layout, context.scene.gonio
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(asked, "photograph")
        layout.prop(asked, "shows")
        if asked.shows == "BALL":
            layout.prop(asked, "outline")
            if asked.outline == "GIVEN":
                layout.prop(asked, "centre")
                layout.prop(asked, "radius")
            layout.prop(asked, "near")
        else:
            thing, camera = context.active_object, context.scene.camera
            layout.label(text=thing.name if thing else "No active object", icon="OBJECT_DATA")
            layout.label(text=camera.name if camera else "The scene has no camera", icon="CAMERA_DATA")
        layout.prop(asked, "mask")
        layout.prop(asked, "world")
        layout.prop(asked, "folder")
        if GONIO_OT_infer.working:
            layout.label(text="Running; press Esc to stop", icon="SORTTIME")
        layout.operator(GONIO_OT_infer.bl_idname, icon="MATERIAL")
        if asked.said:
            # Blender does not wrap labels.
            wide = max(20, int(context.region.width / (7 * context.preferences.system.ui_scale)))
            lines = layout.column(align=True)
            for line in textwrap.wrap(asked.said, wide):
                lines.label(text=line)
        if asked.report:
            layout.operator("wm.url_open", text="Report", icon="URL").url = asked.report
