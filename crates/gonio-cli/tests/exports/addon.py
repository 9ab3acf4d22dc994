"""Installs the Blender add-on from a zip file, and estimates materials with it in scenes, without a window.

    python3 addon.py GONIO BALL [PICTURES]

GONIO is the program, BALL a photograph of a ball (samples/ball.exr), and PICTURES a folder for the pictures. Requires the package bpy (Blender 4.2 or later as a
module) and numpy, which bpy installs. The exit code is 1 if a check fails.

`gonio render` renders the second photograph from a mesh and a camera. Their parameters are specified here twice, for gonio and for Blender, which tests the parameters
that the add-on reads from the scene independently of the add-on. The outline is also compared with a rendering by Cycles.
"""

import contextlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import types
from pathlib import Path

# Do not read or change the user's Blender settings.
SCRATCH = tempfile.TemporaryDirectory()
os.environ["BLENDER_USER_RESOURCES"] = str(Path(SCRATCH.name) / "blender")

import bpy
import numpy as np

SOURCE = Path(__file__).resolve().parents[4] / "tools" / "blender" / "gonio"
ADDON = "bl_ext.user_default.gonio"

# The camera: away from the origin, rotated about all axes, with a shifted lens and a sensor that is fitted to the height of a wide picture.
SIZE = (320, 240)
PLACE, TURN = (5.0, -3.2, 2.6), (63.0, 7.0, 52.0)
FOCAL, SENSOR = 60.0, 24.0
SHIFT = (0.06, -0.08)
# The object: rotated, and scaled differently along each axis, including a reflection.
LOCATION, ROTATION, SCALE = (-0.1, 0.5, -0.9), (-25.0, 20.0, 75.0), (-0.8, 1.0, 0.7)

# Limit of the root mean square difference of log luminance between the photograph and a rendering of the estimates by Cycles, on the object. It allows for the errors
# of the Principled BSDF and of a light of 32 x 32 texels.
LIMIT = 0.3
# Smallest ratio of the intersection and the union of two outlines.
OVERLAP = 0.99

failed = []


def check(what, good):
    print(f"{what}{'' if good else '  FAILED'}", flush=True)
    if not good:
        failed.append(what)


@contextlib.contextmanager
def silent():
    """Suppresses the progress messages of Cycles on standard output."""
    sys.stdout.flush()
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)


def gonio(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, stdout=subprocess.DEVNULL)


def install(folder):
    """Builds the zip file with Blender's tool and installs it."""
    archive = folder / "gonio.zip"
    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    subprocess.run([sys.executable, tool, "build", "--source-dir", SOURCE, "--output-filepath", archive], check=True)
    bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
    check("the add-on is installed and enabled", ADDON in bpy.context.preferences.addons and hasattr(bpy.types.Scene, "gonio"))


def empty():
    """Creates an empty scene."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    return bpy.context.scene


def read(path):
    """Reads an image as height x width x RGBA, without colour conversion."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    width, height = image.size
    pixels = np.array(image.pixels[:], dtype=np.float64).reshape(height, width, 4)[::-1]
    bpy.data.images.remove(image)
    return pixels


def cycles(scene, path):
    """Renders the scene with Cycles, without interreflection."""
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16
    scene.cycles.max_bounces = 0
    scene.cycles.use_denoising = True
    scene.cycles.pixel_filter_type = "BOX"
    # The light has fewer than 256 rows.
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 256
    scene.render.film_transparent = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.filepath = str(path)
    with silent():
        bpy.ops.render.render(write_still=True)
    return read(path)


def inside(picture):
    return picture[..., 3] > 0.999


def overlap(a, b):
    return (inside(a) & inside(b)).sum() / (inside(a) | inside(b)).sum()


def distance(shown, photograph):
    """Returns the root mean square difference of log luminance."""
    told = inside(shown) & inside(photograph)
    luminance = [np.maximum(p[told][:, :3] @ (0.2126, 0.7152, 0.0722), 1e-4) for p in (shown, photograph)]
    return np.sqrt(np.mean(np.log(luminance[0] / luminance[1]) ** 2))


def same_light(scene, what, photograph, path):
    """Checks that the rendered scene matches the photograph, and does not match it with a rotated light."""
    shown = cycles(scene, path)
    turn = next(n for n in scene.world.node_tree.nodes if n.type == "MAPPING").inputs["Rotation"]
    right = tuple(turn.default_value)
    off = distance(shown, photograph)
    turned = []
    for axis in range(3):
        turn.default_value = [angle + (math.pi / 4 if axis == i else 0) for i, angle in enumerate(right)]
        turned.append(distance(cycles(scene, path.with_name(f"turned-{axis}.exr")), photograph))
    turn.default_value = right
    told = ", ".join(f"{t:.3f}" for t in turned)
    check(f"{what}: the rendering by Cycles differs from the photograph by {off:.3f} (limit {LIMIT}), with a rotated light by {told}", off < LIMIT < min(turned))
    return shown


def shader(thing):
    tree = thing.active_material.node_tree
    return next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED").inputs


def refuses(what, part):
    """Checks that the operator fails with one line that contains `part`."""
    try:
        bpy.ops.gonio.infer()
        said = "nothing"
    except RuntimeError as error:
        said = str(error).strip()
    check(f"{what}: {said}", part in said and "\n" not in said)


def errors(program, ball):
    scene = empty()
    scene.gonio.shows = "BALL"
    refuses("no photograph", "no photograph selected")
    scene.gonio.photograph = str(ball.with_name("nothing.exr"))
    refuses("the error of the program", "nothing.exr: cannot open")
    scene.gonio.shows = "MESH"
    scene.gonio.photograph = str(ball)
    refuses("no object", "no active object")
    preferences = bpy.context.preferences.addons[ADDON].preferences
    preferences.program = "gonio-that-is-not-there"
    refuses("no program", "gonio-that-is-not-there: program not found")
    preferences.program = str(program)
    check("no data were created", not bpy.data.materials and not bpy.data.objects and scene.world is None)


class Layout:
    """Records what a panel draws. Properties, operators and icons must exist in Blender."""

    ICONS = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()

    def __init__(self):
        self.drawn = []

    def prop(self, owner, name):
        self.drawn.append(owner.bl_rna.properties[name].name)

    def label(self, text, icon="NONE"):
        self.drawn.append(text)
        assert icon in self.ICONS, icon

    def operator(self, name, text="", icon="NONE"):
        category, _, operator = name.partition(".")
        rna = getattr(getattr(bpy.ops, category), operator).get_rna_type()
        self.label(text or rna.name, icon)
        return types.SimpleNamespace()

    def column(self, align):
        return self


def drawn(scene, active):
    """Returns the names and texts that the panel shows."""
    # Without a window, the interface scale of Blender is zero.
    preferences = types.SimpleNamespace(system=types.SimpleNamespace(ui_scale=1.0))
    context = types.SimpleNamespace(scene=scene, active_object=active, region=types.SimpleNamespace(width=220), preferences=preferences)
    layout = Layout()
    sys.modules[f"{ADDON}.panel"].GONIO_PT_photograph.draw(types.SimpleNamespace(layout=layout), context)
    return layout.drawn


def panel():
    """Checks the contents of the panel for each setting."""
    scene = empty()
    every = ["Photograph", "Shows", "Mask", "Light as World", "Results", "Estimate Material and Light"]
    ball = ["Photograph", "Shows", "Outline", "Nearby Camera", *every[2:]]
    check("the panel for a ball", drawn(scene, None) == ball)
    scene.gonio.outline = "GIVEN"
    check("the panel for a circle", drawn(scene, None) == [*ball[:3], "Centre", "Radius", *ball[3:]])
    scene.gonio.shows = "MESH"
    check("the panel for an object", drawn(scene, None) == [*every[:2], "No active object", "The scene has no camera", *every[2:]])
    scene.gonio.said, scene.gonio.report = "one two " * 8, "file:///report.html"
    end = drawn(scene, None)[len(every) + 2 :]
    check("the panel after a run", len(end) > 2 and " ".join(end) == "one two " * 8 + "Report")


def ball_found(program, photograph, folder):
    """Estimates the material of a ball seen from the front, and checks it."""
    scene = empty()
    results = folder / "ball"
    scene.gonio.photograph = str(photograph)
    scene.gonio.folder = str(results)
    check("a ball: the operator finishes", bpy.ops.gonio.infer() == {"FINISHED"})
    gonio(program, "export", results, "--to", "blender", "-o", folder / "own")
    found = json.loads((folder / "own" / "export.json").read_text())["exports"]["blender"]["parameters"]
    [thing] = scene.objects
    inputs = shader(thing)
    given = [*inputs["Base Color"].default_value[:3], *(inputs[n].default_value for n in ("Metallic", "Roughness", "IOR"))]
    wanted = [*found["base_color"], found["metalness"], found["roughness"], found["ior"]]
    check(f"a ball: its material is {np.round(given, 3).tolist()}, as exported", np.allclose(given, wanted, rtol=1e-5))
    verdict = json.loads((results / "result.json").read_text())["posterior"]["highlight"]["verdict"]
    check(f"a ball: the panel says: {scene.gonio.said}", scene.gonio.said == verdict and scene.gonio.report.endswith("/report.html"))
    light = next(n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT").image
    pixels = np.array(light.pixels[:]).reshape(light.size[1], light.size[0], 4)[::-1, :, :3]
    exported = read(folder / "own" / "light.exr")[..., :3]
    check("a ball: the world has the exported light, packed", light.packed_file is not None and np.allclose(pixels, exported, rtol=1e-5))

    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.data.type = "ORTHO"
    camera.location, camera.rotation_euler = (0, -5, 0), (math.pi / 2, 0, 0)
    picture = read(photograph)
    # Frame the rendering by Cycles like the photograph.
    rows, columns = np.nonzero(inside(picture))
    diameter = (rows.max() - rows.min() + columns.max() - columns.min()) / 2 + 1
    scene.render.resolution_y, scene.render.resolution_x = picture.shape[:2]
    camera.data.ortho_scale = 2 * max(picture.shape[:2]) / diameter
    middle = [(at.min() + at.max() + 1) / 2 - length / 2 for at, length in ((columns, picture.shape[1]), (rows, picture.shape[0]))]
    camera.data.shift_x, camera.data.shift_y = -middle[0] / max(picture.shape[:2]), middle[1] / max(picture.shape[:2])
    same_light(scene, "a ball", picture, folder / "ball.exr")


def in_a_window(photograph):
    """Checks the operator with the events that Blender sends if there is a window."""
    operator = sys.modules[f"{ADDON}.operator"].GONIO_OT_infer
    said = []
    methods = {name: it for name, it in vars(operator).items() if isinstance(it, types.FunctionType)}
    methods["report"] = lambda _, kind, line: said.append((*kind, line))
    # Only Blender can create instances of operators.
    Work = type("Work", (), methods)

    def work(event, path):
        scene = empty()
        scene.gonio.photograph = str(path)
        it = Work()
        it._start(bpy.context)
        busy = not bpy.ops.gonio.infer.poll()
        answers = [{"PASS_THROUGH"}]
        slowest = 0.0
        while answers[-1] == {"PASS_THROUGH"}:
            time.sleep(0.05)
            start = time.monotonic()
            answers.append(it.modal(bpy.context, types.SimpleNamespace(type=event)))
            if answers[-1] == {"PASS_THROUGH"}:
                slowest = max(slowest, time.monotonic() - start)
        ended = it._run._process.poll() is not None and bpy.ops.gonio.infer.poll()
        return busy and ended, answers[-1], len(answers), slowest, len(bpy.data.materials)

    tidy, answer, events, slowest, made = work("TIMER", photograph)
    good = tidy and answer == {"FINISHED"} and events > 5 and slowest < 0.5 and made == 1 and said[-1][0] == "INFO"
    check(f"in a window: {events} events, of which the slowest took {slowest:.3f} s while the program was at work", good)
    tidy, answer, _, _, made = work("ESC", photograph)
    check("in a window: Esc ends the program", tidy and answer == {"CANCELLED"} and made == 0)
    tidy, answer, _, _, made = work("TIMER", photograph.with_name("nothing.exr"))
    check(f"in a window: {said[-1]}", tidy and answer == {"CANCELLED"} and made == 0 and said[-1][0] == "ERROR" and "cannot open" in said[-1][1])


def rotation(degrees):
    """Returns the rotation about x, y and z of the world, in this order."""
    x, y, z = (math.radians(d) for d in degrees)
    about_x = np.array([[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]])
    about_y = np.array([[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]])
    about_z = np.array([[math.cos(z), -math.sin(z), 0], [math.sin(z), math.cos(z), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def rendered(program, folder, name, mesh=None, size=SIZE, found=None):
    """Renders a mesh with the material and light of the ball, and with camera.json and pose.json of a folder; `found` contains the results of the ball."""
    photograph, found = folder / f"{name}.exr", found or folder
    gonio(
        *(program, "render", "--brdf", found / "ball" / "brdf.npz", "--light", found / "own" / "light.exr"),
        *("--mesh", mesh or folder / f"{name}.obj", "--pose", folder / "pose.json", "--camera", folder / "camera.json"),
        *("--size", size[0], "--height", size[1], "-o", photograph),
    )
    return photograph


def export(path):
    """Writes the selected object with its modifiers applied."""
    with silent():
        bpy.ops.wm.obj_export(filepath=str(path), export_selected_objects=True, forward_axis="Y", up_axis="Z", export_materials=False)


def near(what, thing, truth):
    """Checks that the material of an object is close to that of the photograph."""
    rough, wanted = shader(thing)["Roughness"].default_value, truth["roughness"]
    check(f"{what}: its roughness is {rough:.3f}, that of its material {wanted:.3f}", abs(rough - wanted) < 0.1)
    # The photograph does not determine the scale of the colour; each export chooses its own.
    colour = np.array(shader(thing)["Base Color"].default_value[:3]) / truth["base_color"]
    check(f"{what}: its colour is {np.round(colour, 2).tolist()} times that of its material", colour.max() / colour.min() < 1.2 and 0.3 < colour.mean() < 3)


def mesh_found(program, folder):
    """Estimates the material of a mesh before the camera of the scene, and checks it. The photograph is a rendering with the material and light of the ball."""
    scene = empty()
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6)
    thing = bpy.context.active_object
    bpy.ops.object.shade_smooth()
    # With its modifiers, the surface is a bent drop.
    for name, method, amount in (("taper", "TAPER", -0.6), ("bend", "BEND", math.radians(70))):
        modifier = thing.modifiers.new(name, "SIMPLE_DEFORM")
        modifier.deform_method, modifier.deform_axis = method, "Z"
        setattr(modifier, "factor" if method == "TAPER" else "angle", amount)
    export(folder / "drop.obj")

    # The same camera and pose in the formats of gonio; image coordinates have y down.
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(TURN), PLACE
    pixels = SIZE[1] / SENSOR
    camera = {
        "projection": "perspective",
        "focal_pixels": FOCAL * pixels,
        "size": SIZE,
        "principal_point": [SIZE[0] / 2 - SHIFT[0] * max(SIZE), SIZE[1] / 2 + SHIFT[1] * max(SIZE)],
        "pose": {"camera_to_world": matrix.tolist()},
    }
    (folder / "camera.json").write_text(json.dumps(camera))
    (folder / "pose.json").write_text(json.dumps({"translation": LOCATION, "rotation_degrees": ROTATION, "scale": SCALE}))
    photograph = rendered(program, folder, "drop")
    picture = read(photograph)

    thing.location, thing.rotation_euler, thing.scale = LOCATION, [math.radians(d) for d in ROTATION], SCALE
    eye = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(eye)
    scene.camera = eye
    eye.location, eye.rotation_euler, eye.scale = PLACE, [math.radians(d) for d in TURN], (2, 2, 2)
    eye.data.sensor_fit, eye.data.sensor_height, eye.data.lens = "VERTICAL", SENSOR, FOCAL
    eye.data.shift_x, eye.data.shift_y = (s * max(SIZE) / SIZE[1] for s in SHIFT)
    # The resolution percentage reduces the size.
    scene.render.resolution_x, scene.render.resolution_y = (4 * s for s in SIZE)
    scene.render.resolution_percentage = 25

    scene.gonio.shows = "MESH"
    scene.gonio.photograph = str(photograph)
    scene.gonio.folder = str(folder / "drop")
    check("a mesh: the operator finishes", bpy.ops.gonio.infer() == {"FINISHED"})
    found = json.loads((folder / "drop" / "result.json").read_text())
    check(f"a mesh: warnings: {found['warnings']}", not any("fit" in w or "shape" in w for w in found["warnings"]))
    truth = json.loads((folder / "own" / "export.json").read_text())["exports"]["blender"]["parameters"]
    near("a mesh", thing, truth)
    shown = same_light(scene, "a mesh", picture, folder / "shown.exr")
    both = overlap(shown, picture)
    check(f"a mesh: the outlines of the rendering by Cycles and of the photograph overlap by {both:.4f}", both > OVERLAP)
    # Compare a rendering with the files of the add-on with the photograph.
    [files] = {path.parent for path in Path(bpy.app.tempdir).glob("gonio-*/mesh.ply")}
    seen = rendered(program, files, "seen", files / "mesh.ply", found=folder)
    off, both = distance(read(seen), picture), overlap(read(seen), picture)
    check(f"a mesh: a rendering with the add-on's files overlaps by {both:.4f} and differs by {off:.4f}", both > 0.998 and off < 0.01)


def near_ball_found(program, folder):
    """Estimates the material of a ball in the scene of `mesh_found`, and checks it. The ball is near, so that perspective matters."""
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6)
    bpy.ops.object.shade_smooth()
    export(folder / "near.obj")
    bpy.ops.object.delete()
    (folder / "pose.json").write_text(json.dumps({"translation": LOCATION}))
    scene.gonio.photograph = str(rendered(program, folder, "near"))
    scene.gonio.shows, scene.gonio.near = "BALL", True
    scene.gonio.folder = str(folder / "near")
    check("a near ball: the operator finishes", bpy.ops.gonio.infer() == {"FINISHED"})
    truth = json.loads((folder / "own" / "export.json").read_text())["exports"]["blender"]["parameters"]
    near("a near ball", scene.objects["near"], truth)
    # Detected centre in camera coordinates, from the outline and the camera parameters of the add-on.
    found = json.loads((folder / "near" / "result.json").read_text())["observations"]["shape"]["centre"]
    wanted = rotation(TURN).T @ np.subtract(LOCATION, PLACE)
    off = math.degrees(np.arccos(np.dot(found, wanted) / np.linalg.norm(found) / np.linalg.norm(wanted)))
    check(f"a near ball: its centre is {off:.4f} degrees off", off < 0.05)


def other_cameras(program, folder):
    """Compares the outlines of the drop in renderings by gonio, with the parameters of the add-on, and by Cycles, for other cameras."""
    scene, eye = bpy.context.scene, bpy.context.scene.camera.data
    describe = sys.modules[f"{ADDON}.camera"].describe
    [written] = {path.parent for path in Path(bpy.app.tempdir).glob("gonio-*/mesh.ply")}
    scene.objects["near"].hide_render = True
    scene.render.resolution_percentage = 100
    for kind, fit, size in (("ORTHO", "AUTO", (320, 240)), ("ORTHO", "HORIZONTAL", (240, 320)), ("PERSP", "AUTO", (240, 320)), ("PERSP", "HORIZONTAL", (200, 320))):
        scene.render.resolution_x, scene.render.resolution_y = size
        eye.type, eye.sensor_fit, eye.sensor_width, eye.ortho_scale = kind, fit, 30, 3.5
        eye.shift_x, eye.shift_y = 0.07, -0.05
        placed = folder / f"{kind}-{fit}".lower()
        placed.mkdir(exist_ok=True)
        (placed / "camera.json").write_text(json.dumps(describe(scene, bpy.context.evaluated_depsgraph_get())))
        (placed / "pose.json").write_text((written / "pose.json").read_text())
        seen = read(rendered(program, placed, "seen", written / "mesh.ply", size=size, found=folder))
        shown = cycles(scene, placed / "shown.exr")
        both = overlap(seen, shown)
        check(f"{kind}, {fit}, {size[0]} x {size[1]}: the outlines overlap by {both:.4f}", both > OVERLAP and inside(shown).mean() > 0.05)


def main(program, ball, pictures=None):
    folder = Path(pictures or Path(SCRATCH.name) / "pictures").resolve()
    folder.mkdir(parents=True, exist_ok=True)
    program, ball = Path(program).resolve(), Path(ball).resolve()
    install(folder)
    version = subprocess.run([program, "-V"], check=True, capture_output=True, text=True).stdout.split()[-1]
    check(f"the add-on is of version {version}", f'\nversion = "{version}"\n' in (SOURCE / "blender_manifest.toml").read_text())
    bpy.context.preferences.addons[ADDON].preferences.program = str(program)
    panel()
    errors(program, ball)
    in_a_window(ball)
    ball_found(program, ball, folder)
    mesh_found(program, folder)
    near_ball_found(program, folder)
    other_cameras(program, folder)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
