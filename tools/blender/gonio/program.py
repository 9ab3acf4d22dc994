# SPDX-License-Identifier: MIT
"""The program at work: it infers, then exports, beside Blender."""

import json
import subprocess

from .problem import Problem


class Run:
    """One photograph, from the program's options to what it found.

    `folder` is scratch; `results` is where the results go.
    """

    def __init__(self, program, options, folder, results):
        self.results = results
        self.warnings = []
        self._log = folder / "program.json"
        # Kept even if it fails, as nothing but the first error line of the program is shown.
        self._errors = folder / "program.log"
        self._commands = [
            [program, "infer", *options, "-o", str(results), "--json"],
            [program, "export", str(results), "--to", "blender", "-o", str(self.exported), "--json"],
        ]
        self._process = None
        self._next()

    @property
    def exported(self):
        """The folder of the export."""
        return self.results / "export"

    def _next(self):
        with open(self._log, "wb") as out, open(self._errors, "wb") as errors:
            try:
                self._process = subprocess.Popen(
                    self._commands.pop(0),
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=errors,
                    # Windows would show a console.
                    creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                )
            except OSError as error:
                raise Problem(f"gonio cannot be run: {error}; check the preferences of the add-on") from error

    def wait(self, seconds):
        """Waits for so long; tells whether all is done. Raises `Problem` with the program's own line if it failed."""
        try:
            code = self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        said = self._said()
        if code != 0:
            raise Problem(said.get("error") or self._last_line() or f"gonio ended with code {code} and said nothing")
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
        """Ends the program if it is still at work."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait()
