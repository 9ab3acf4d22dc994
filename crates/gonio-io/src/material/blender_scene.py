
def render():
    """Renders a sphere of the material under the light to `blender.png` in the folder of this file."""
    from math import pi
    from pathlib import Path

    import bmesh

    folder = Path(__file__).resolve().parent
    scene = bpy.data.scenes.new(material.name)

    mesh = bpy.data.meshes.new("sphere")
    sphere = bmesh.new()
    bmesh.ops.create_uvsphere(sphere, u_segments=256, v_segments=128, radius=1)
    sphere.to_mesh(mesh)
    sphere.free()
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("sphere", mesh))

    # The camera looks along +y; +x is to the right and +z is up.
    camera = bpy.data.cameras.new("camera")
    camera.type = "ORTHO"
    camera.ortho_scale = WIDTH
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.camera.location = (0, -5, 0)
    scene.camera.rotation_euler = (pi / 2, 0, 0)
    scene.collection.objects.link(scene.camera)

    # The centre of the map is in front of the camera. Blender places it along +x, so rotate the map.
    scene.world = bpy.data.worlds.new("light")
    scene.world.use_nodes = True
    tree = scene.world.node_tree
    background = next(n for n in tree.nodes if n.type == "BACKGROUND")
    place = tree.nodes.new("ShaderNodeTexCoord")
    turn = tree.nodes.new("ShaderNodeMapping")
    turn.inputs["Rotation"].default_value = (0, 0, -pi / 2)
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = bpy.data.images.load(str(folder / LIGHT))
    around.image.colorspace_settings.name = "Non-Color"
    tree.links.new(place.outputs["Generated"], turn.inputs["Vector"])
    tree.links.new(turn.outputs["Vector"], around.inputs["Vector"])
    tree.links.new(around.outputs["Color"], background.inputs["Color"])

    scene.render.engine = "CYCLES"
    scene.cycles.samples = 32
    scene.cycles.use_denoising = True
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = EXPOSURE
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.filepath = str(folder / "blender.png")
    bpy.ops.render.render(write_still=True, scene=scene.name)


if __name__ == "__main__" and bpy.app.background:
    render()
