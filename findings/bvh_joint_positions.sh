#!/usr/bin/env bash
# bvh-converter 1.0.2 and bvhtoolbox 0.1.3: positions of joints other than the root are read, and then not used.
#
# Expected: a BVH's CHANNELS line says which numbers a joint has. A joint below the root may have six, and its positions
#   then move it, as those of the root do. A tool that prints the places of all joints uses them, or refuses the file.
# Seen: both tools step over the three numbers, so the rotations are right, and put each joint at its OFFSET.
# Output: a hip and a knee whose position is (0, -12, 0), once with the OFFSET (0, -10, 0) and once with (0, 0, 0). With
#   bvhio 1.5.4, the knee is 12 from the hip in both. With the two tools, it is 10 away, and in the hip.
# Matters: users of other readers report motions with six channels for every joint (bvhio's issues 5 and 15), and some
#   with offsets of 0 (deep-motion-editing's issue 121). A shoulder that slides stands still in the CSV file, and a body
#   without offsets collapses into its root.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check bvh-converter==1.0.2 bvhtoolbox==0.1.3 bvh==0.3 \
  transforms3d==0.4.2 bvhio==1.5.4 numpy==2.4.6
venv/bin/python - <<'PY'
import pathlib
import subprocess
import sys

import bvhio
import numpy as np


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def write(offset):
    for old in "leg_worldpos.csv", "leg_pos.csv":
        pathlib.Path(old).unlink(missing_ok=True)
    six = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    frame = "1 2 3 90 0 0 0 -12 0 0 0 0\n"  # the hip turns by 90 degrees about z: the knee goes to its right
    with open("leg.bvh", "w") as file:
        file.write(f"HIERARCHY\nROOT Hip\n{{\n OFFSET 0 0 0\n {six}\n JOINT Knee\n {{\n  OFFSET {offset}\n  {six}\n"
                   "  End Site\n  {\n   OFFSET 0 -8 0\n  }\n }\n}\n"
                   f"MOTION\nFrames: 2\nFrame Time: 0.05\n{frame}{frame}")


def places(file):
    """The rows of a CSV file, by the name of the joint, without the time."""
    with open(file) as lines:
        names, numbers = [line.strip().split(",") for line in list(lines)[:2]]
    found = {}
    for name, number in list(zip(names, numbers))[1:]:
        found.setdefault(name.split(".")[0], []).append(round(float(number), 3) + 0.0)
    return found


def knees():
    for tool in ["bvh-converter"], ["bvh2csv", "--position"]:  # bvh2csv's exit status is 1 for one file that it wrote
        subprocess.run(["venv/bin/" + tool[0], *tool[1:], "leg.bvh"], stdout=subprocess.DEVNULL)
    root = bvhio.readAsHierarchy("leg.bvh").loadPose(0)
    third = next(joint for joint, _, _ in root.layout() if joint.Name == "Knee").PositionWorld
    found = [places(f"leg_{name}.csv")["Knee"] for name in ("worldpos", "pos")]
    return (np.round(list(third), 3) + 0.0).tolist(), *found


for offset, stated in ("0 -10 0", [11, 2, 3]), ("0 0 0", [1, 2, 3]):
    write(offset)
    third, first, second = knees()
    print(f"offset {offset}:")
    check("  the knee in bvhio", third, [13, 2, 3])
    check("  in bvh-converter", first, stated)
    check("  in bvhtoolbox", second, stated)
PY
