# SPDX-License-Identifier: MIT
"""Operator that creates material and world from the panel's settings, in the background."""

import json
import tempfile
from pathlib import Path

import bpy

from . import camera, mesh, scene
from .preferences import program
from .problem import Problem
from .program import Run


class GONIO_OT_infer(bpy.types.Operator):
    """Estimate the material of the photographed object and the light around it"""

    bl_idname = "gonio.infer"
    bl_label = "Estimate Material and Light"
    bl_options = {"REGISTER", "UNDO"}

    # Whether the operator is running.
    working = False

    @classmethod
    def poll(cls, _context):
        if cls.working:
            cls.poll_message_set("gonio is running; press Esc to stop")
        return not cls.working

    def execute(self, context):
        """Runs to completion, for scripts and without a window."""
        try:
            self._begin(context)
            while not self._run.wait(None):
                pass
            self._finish(context)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context, _event):
        """Starts the program in the background."""
        if bpy.app.background:
            return self.execute(context)
        try:
            self._start(context)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self.cancel(context)
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            if not self._run.wait(0):
                return {"PASS_THROUGH"}
            self._finish(context)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            self.cancel(context)
            return {"CANCELLED"}
        self.cancel(context)
        return {"FINISHED"}

    def cancel(self, context):
        """Stops the program; Blender also calls this on exit."""
        self._run.stop()
        GONIO_OT_infer.working = False
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)

    def _start(self, context):
        """Starts the program and a timer that polls it."""
        self._begin(context)
        GONIO_OT_infer.working = True
        self._timer = context.window_manager.event_timer_add(0.2, window=context.window)
        context.workspace.status_text_set("gonio is running; press Esc to stop")

    def _begin(self, context):
        """Writes the input files and starts the program."""
        asked = context.scene.gonio
        path = program(context)
        if not asked.photograph:
            raise Problem("no photograph selected; select one in the panel gonio")
        depsgraph = context.evaluated_depsgraph_get()
        folder = Path(tempfile.mkdtemp(prefix="gonio-", dir=bpy.app.tempdir or None))
        options = [bpy.path.abspath(asked.photograph)]
        if asked.mask:
            options += ["--mask", bpy.path.abspath(asked.mask)]
        self._name = Path(options[0]).stem
        self._scene = context.scene.name
        self._thing = None
        # The light of a ball is oriented by the camera of the scene, if there is one.
        self._turn = scene.FRONT if context.scene.camera is None else camera.rotation(context.scene, depsgraph)
        if asked.shows == "MESH":
            options += self._mesh(context, depsgraph, folder)
        else:
            if asked.outline == "GIVEN":
                options += ["--circle", f"{asked.centre[0]},{asked.centre[1]},{asked.radius}"]
            if asked.near:
                options += self._camera(context, depsgraph, folder)
        results = Path(bpy.path.abspath(asked.folder)) if asked.folder else folder / "results"
        self._run = Run(path, options, folder, results)

    def _mesh(self, context, depsgraph, folder):
        """Returns the options for mesh and pose of the active object."""
        thing = context.active_object
        if thing is None:
            raise Problem("no active object; activate the photographed object")
        self._thing = thing.name
        mesh.write(folder / "mesh.ply", thing, depsgraph)
        matrix = thing.evaluated_get(depsgraph).matrix_world
        write(folder / "pose.json", {"matrix": [list(row) for row in matrix]})
        placed = ["--mesh", str(folder / "mesh.ply"), "--pose", str(folder / "pose.json")]
        return placed + self._camera(context, depsgraph, folder)

    def _camera(self, context, depsgraph, folder):
        """Returns the option for the camera."""
        write(folder / "camera.json", camera.describe(context.scene, depsgraph))
        return ["--camera", str(folder / "camera.json")]

    def _finish(self, context):
        """Adds the results to the scene of the run."""
        target = bpy.data.scenes.get(self._scene)
        if target is None:
            raise Problem(f"{self._scene}: the scene was deleted; the results are in {self._run.results}")
        thing = self._thing and bpy.data.objects.get(self._thing)
        if self._thing and thing is None:
            raise Problem(f"{self._thing}: the object was deleted; the results are in {self._run.results}")
        made = scene.material(self._name, self._run.exported)
        scene.give(thing or scene.sphere(self._name, target), made)
        if target.gonio.world:
            target.world = scene.world(self._name, self._run.exported, self._turn)
        found = json.loads((self._run.results / "result.json").read_text(encoding="utf-8"))
        target.gonio.said = found["posterior"]["highlight"]["verdict"]
        report = self._run.results / "report.html"
        target.gonio.report = report.as_uri() if report.is_file() else ""
        for warning in self._run.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"{self._name}: {target.gonio.said}")


def write(path, value):
    """Writes JSON."""
    path.write_text(json.dumps(value, indent=1), encoding="utf-8")
