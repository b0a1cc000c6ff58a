# SPDX-License-Identifier: Apache-2.0
"""``python -m gsh``: the demo, and the programs by their short names."""

import os
import shlex
import signal
import subprocess
import sys

from . import _programs

USAGE = """usage: python -m gsh demo [ARGUMENTS OF gsh-reconstruct]
       python -m gsh PROGRAM [ARGUMENTS]

demo      films the built-in actor, finds the light and trains an avatar in it, in out/demo. The last quarter of the
          motion is left out of training; the figures of seen and of new motion are printed.
PROGRAM   {programs};
          the same as the commands gsh-PROGRAM. --help lists their options.
"""

RESULTS = """
Look at
  {out}/report.html    pictures, curves and figures; opens in any browser
  {out}/metrics.json   the figures, with those of seen_motion and new_motion (left out of training)
  {out}/test/          render, photograph and error of views that were not used in training
  {out}/avatar.ply     the canonical Gaussians, for any 3DGS viewer
  {out}/avatar.gsh     the avatar and its light, for gsh-animate

See it move, in a browser:
  gsh-view {out}/avatar.gsh --open"""


def wait_for(process):
    """The exit code of a process that the terminal interrupts, too; SIGTERM is passed on to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # after its start: ignored signals are inherited
    signal.signal(signal.SIGTERM, lambda number, frame: process.send_signal(number))
    code = process.wait()
    return code if code >= 0 else 128 - code


def demo(arguments):
    out = os.path.join("out", "demo")
    for i, argument in enumerate(arguments):
        if argument == "--video":
            sys.exit("python -m gsh demo: --video needs the sources of gsh, where it is scripts/demo --video")
        if argument == "--out" and i + 1 < len(arguments):
            out = arguments[i + 1]
        elif argument.startswith("--out="):
            out = argument[len("--out="):]
    words = [_programs.path_of("reconstruct"), "--synthetic", *arguments]
    if not any(argument == "--out" or argument.startswith("--out=") for argument in arguments):
        os.makedirs(out, exist_ok=True)
        words += ["--out", out]
    if not any(argument.startswith("--hold-out-motion") for argument in arguments):
        words += ["--hold-out-motion", "0.25"]
    code = wait_for(subprocess.Popen(words, stdin=subprocess.DEVNULL))
    if code == 0 and not {"--help", "-h"} & set(arguments):
        print(RESULTS.format(out=shlex.quote(out)))
    return code


def main(arguments):
    if not arguments or arguments[0] in ("-h", "--help"):
        print(USAGE.format(programs=", ".join(_programs.NAMES)), end="")
        return 0 if arguments else 2
    name, rest = arguments[0], arguments[1:]
    if name == "demo":
        return demo(rest)
    if name not in _programs.NAMES:
        print(f"python -m gsh: there is no {name!r}; --help lists what there is", file=sys.stderr)
        return 2
    return _programs.replace_process(name, rest)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
