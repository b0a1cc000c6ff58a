# SPDX-License-Identifier: Apache-2.0
"""The programs: executables of the package, and the commands that start them.

A command replaces its process with the executable, so that arguments, streams, signals and the exit code are the
program's own.
"""

import os
import sys

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "bin")
NAMES = ("animate", "body", "check", "evaluate", "export", "fit", "motion", "reconstruct", "render", "video", "view")


def path_of(name):
    """The executable of a program, ``"render"`` for gsh-render.

    Raises FileNotFoundError in a build without programs.
    """
    path = os.path.join(FOLDER, "gsh-" + name)
    if not os.path.exists(path):
        raise FileNotFoundError(f"{path}: the package was built without programs (GSH_PYTHON_PROGRAMS)")
    return path


def replace_process(name, arguments):
    sys.stdout.flush()
    sys.stderr.flush()
    try:
        os.execv(path_of(name), ["gsh-" + name, *arguments])
    except OSError as error:
        sys.exit(f"gsh-{name}: cannot be started: {error}")


def _command(name):
    def command():
        replace_process(name, sys.argv[1:])

    return command


animate, body, check, evaluate, export, fit, motion, reconstruct, render, video, view = map(_command, NAMES)
