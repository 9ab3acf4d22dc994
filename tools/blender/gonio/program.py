# SPDX-License-Identifier: MIT
"""Runs the program in the background: inference, then export."""

import json
import subprocess

from .problem import Problem


class Run:
    """Run of the program on one photograph.

    `folder` is for temporary files, `results` for the results.
    """

    def __init__(self, program, options, folder, results):
        self.results = results
        self.warnings = []
        self._log = folder / "program.json"
        # Kept on failure, because the add-on shows only one line of the program's errors.
        self._errors = folder / "program.log"
        self._commands = [
            [program, "infer", *options, "-o", str(results), "--json"],
            [program, "export", str(results), "--to", "blender", "-o", str(self.exported), "--json"],
        ]
        self._process = None
        self._next()

    @property
    def exported(self):
        """Folder of the export."""
        return self.results / "export"

    def _next(self):
        with open(self._log, "wb") as out, open(self._errors, "wb") as errors:
            try:
                self._process = subprocess.Popen(
                    self._commands.pop(0),
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=errors,
                    # Without this flag, Windows shows a console.
                    creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                )
            except OSError as error:
                raise Problem(f"cannot run gonio: {error}; check the path in the preferences of the add-on") from error

    def wait(self, seconds):
        """Waits for up to `seconds`; returns whether the run is complete. Raises `Problem` with the error of the program."""
        try:
            code = self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        said = self._said()
        if code != 0:
            raise Problem(said.get("error") or self._last_line() or f"gonio exited with code {code} and no message")
        self.warnings += [w for w in said.get("warnings", []) if w not in self.warnings]
        if not self._commands:
            return True
        self._next()
        return False

    def _said(self):
        try:
            return json.loads(self._log.read_text(encoding="utf-8"))
        except ValueError:
            return {}

    def _last_line(self):
        lines = self._errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else None

    def stop(self):
        """Terminates the program if it is running."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait()
