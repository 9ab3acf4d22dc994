"""Tests the completion of gonio command lines in interactive shells: types each line in a terminal, presses the tab key, and reads the completed line.

    python3 completions.py GONIO BALL [SHELL...]

GONIO is the program, BALL a photograph (samples/ball.exr), and SHELL any of bash, zsh and fish (default: all). The exit code is 1 if a completion is wrong.
"""

import os
import pty
import select
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Typed lines and their completions: a command, an option, an option after a photograph, values, files, and a line without completions.
LINES = {
    "gonio inf": "gonio infer",
    "gonio infer --so": "gonio infer --solver",
    "gonio infer photo.exr --so": "gonio infer photo.exr --solver",
    "gonio infer photo.exr --solver pri": "gonio infer photo.exr --solver printed",
    "gonio export out --to cook": "gonio export out --to cook-torrance",
    "gonio infer ba": "gonio infer ball.exr",
    "gonio infer --mask ball": "gonio infer --mask ball.exr",
    "gonio infer --zz": "gonio infer --zz",
}
PROMPT = "ready> "
# Time limit for one answer of a shell, in seconds.
PATIENCE = 60

# Start-up file of each shell. It loads the completion script from the place that docs/options.md specifies, and binds Ctrl-X to write the line to the file `line`.
BASH = """
. .local/share/bash-completion/completions/gonio
PS1='{prompt}'
tell() {{ printf '%s' "$READLINE_LINE" > line.part; mv line.part line; READLINE_LINE=; READLINE_POINT=0; }}
bind -x '"\\C-x": tell'
bind 'set enable-bracketed-paste off'
"""
ZSH = """
fpath=($HOME/.zfunc $fpath)
autoload -Uz compinit
compinit -u
PS1='{prompt}'
unsetopt prompt_cr prompt_sp
tell() {{ print -rn -- "$BUFFER" > line.part; mv line.part line; BUFFER= }}
zle -N tell
bindkey -e
bindkey '^X' tell
"""
FISH = """
function fish_prompt; printf '{prompt}'; end
function fish_greeting; end
function tell; commandline > line.part; mv line.part line; commandline ''; end
bind \\cx tell
"""
# For each shell: path and content of its start-up file, path of the completion script, and options.
SHELLS = {
    "bash": (".bashrc", BASH, ".local/share/bash-completion/completions/gonio", ["--rcfile", ".bashrc", "--noprofile", "-i"]),
    "zsh": (".zshrc", ZSH, ".zfunc/_gonio", ["-i"]),
    "fish": (".config/fish/config.fish", FISH, ".config/fish/completions/gonio.fish", ["-i"]),
}


class Terminal:
    """A shell in a pseudo-terminal."""

    def __init__(self, command, home):
        self.shown = b""
        self.home = home
        environment = {
            "HOME": str(home), "PATH": f"{home / 'bin'}:{os.environ['PATH']}", "TERM": "xterm", "LC_ALL": "C.UTF-8", "ZDOTDIR": str(home),
        }
        self.process, self.end = pty.fork()
        if self.process == 0:
            os.chdir(home)
            os.execvpe(command[0], command, environment)

    def until(self, done, what):
        """Reads the output of the shell until `done()` is true."""
        deadline = time.monotonic() + PATIENCE
        while not done():
            if time.monotonic() > deadline:
                raise TimeoutError(f"{what}: nothing for {PATIENCE} s; shown: {self.shown[-2000:]!r}")
            if select.select([self.end], [], [], 0.02)[0]:
                try:
                    self.shown += os.read(self.end, 4096)
                except OSError as error:
                    raise EOFError(f"{what}: the shell has ended; shown: {self.shown[-2000:]!r}") from error

    def complete(self, line):
        """Types a line and the tab key; returns the completed line."""
        answer = self.home / "line"
        answer.unlink(missing_ok=True)
        os.write(self.end, f"{line}\t\x18".encode())
        self.until(answer.is_file, line)
        return answer.read_text().rstrip("\n")

    def close(self):
        os.close(self.end)
        os.waitpid(self.process, 0)


def check(shell, gonio, ball):
    """Returns a message for each wrong completion."""
    settings, text, script, options = SHELLS[shell]
    with tempfile.TemporaryDirectory() as home:
        home = Path(home)
        for file in (settings, script, "bin/gonio", "ball.exr"):
            (home / file).parent.mkdir(parents=True, exist_ok=True)
        (home / "bin" / "gonio").symlink_to(gonio)
        shutil.copy(ball, home / "ball.exr")
        (home / settings).write_text(text.format(prompt=PROMPT))
        with open(home / script, "wb") as file:
            subprocess.run([gonio, "completions", shell], check=True, stdout=file)
        terminal = Terminal([shell, *options], home)
        try:
            terminal.until(lambda: PROMPT.encode() in terminal.shown, f"{shell}: the prompt")
            # Shells append a space to complete words, and zsh an equals sign to options that take a value.
            found = {line: terminal.complete(line).rstrip(" =") for line in LINES}
        finally:
            terminal.close()
    wrong = [f"{shell}: {line!r} became {found[line]!r}, not {LINES[line]!r}" for line in LINES if found[line] != LINES[line]]
    print(f"{shell}: {len(LINES) - len(wrong)} of {len(LINES)} lines are completed correctly", *wrong, sep="\n", flush=True)
    return wrong


def main(gonio, ball, *shells):
    gonio, ball = Path(gonio).resolve(), Path(ball).resolve()
    # A failure in one shell does not skip the others.
    wrong = [check(shell, gonio, ball) for shell in shells or SHELLS]
    return 1 if any(wrong) else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
