#!/usr/bin/env bash
# GaussForge 0.6.0: SOG files of quaternions that are not normalised hold other rotations.
#
# Expected: the rotation of a Gaussian is that of its normalised quaternion. INRIA's trainer, gsplat and most others
#   store rot_0 … rot_3 as they were optimised, of any length, and every renderer normalises them; a writer of
#   SOG, whose bytes hold three components of a *unit* quaternion, has to do so first.
# Seen: the components are clipped to 1/sqrt(2) as they are. Other targets of the same library (ksplat, splat,
#   spz) normalise.
# Output: (w, x, y, z) = (1.2, -1.6, 0.8, 0.4) is read from SPZ within 1 degree of its rotation,
#   from SOG 96 degrees away.
# Matters: any scene straight from a trainer is affected; one that passed through a tool that normalises is not, so
#   tests on such files see nothing.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gaussforge==0.6.0 numpy==2.4.6
venv/bin/python - <<'PY'
import struct
import sys

import gaussforge
import numpy as np


def scene(rotation):
    fields = {"x": 1, "y": 2, "z": 3, "nx": 0, "ny": 0, "nz": 0, "f_dc_0": 0, "f_dc_1": 0, "f_dc_2": 0, "opacity": 1,
              "scale_0": -3, "scale_1": -4, "scale_2": -5, **{f"rot_{i}": v for i, v in enumerate(rotation)}}
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    head += "".join(f"property float {name}\n" for name in fields).encode() + b"end_header\n"
    return head + struct.pack(f"<{len(fields)}f", *fields.values())


def through(rotation, target):
    """Degrees between a rotation and what it becomes through a target format."""
    forge = gaussforge.GaussForge()
    packed = forge.convert(scene(rotation), "ply", target)["data"]
    header, rows = forge.convert(packed, target, "ply")["data"].split(b"end_header\n", 1)
    names = [line.split()[-1] for line in header.decode().splitlines() if line.startswith("property")]
    row = dict(zip(names, np.frombuffer(rows, "<f4")))
    read = [row[f"rot_{i}"] for i in range(4)]
    a, b = (np.asarray(q, float) / np.linalg.norm(q) for q in (rotation, read))
    return round(float(np.degrees(2 * np.arccos(min(1.0, abs(a @ b))))))


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


free = np.array([1.2, -1.6, 0.8, 0.4])
unit = free / np.linalg.norm(free)
for target, stated in (("sog", 96), ("spz", 0), ("ksplat", 0)):
    check(f"degrees off through {target}, length {np.linalg.norm(free):.2f}", through(free, target), stated)
check("degrees off through sog, length 1", through(unit, "sog"), 0)
PY
