#!/usr/bin/env bash
# c3d 0.6.0: Writer wraps points that do not fit its integers, cuts off their fractions, and so changes copies.
#
# Expected: a C3D file with a positive scale stores points as 16-bit integers times this scale. A writer takes the
#   nearest integer, and refuses points that do not fit. What was read from such a file can be written again unchanged.
# Seen: Writer(point_scale=0.1) divides and converts, without a check. Points beyond 32,767 steps come back elsewhere in
#   the room (as seen on x86-64). Fractions are cut off, so all points move towards 0. What the reader gives for a step
#   is sometimes a little less than it, and then a copy of the file has one step less, and the copy's copy two.
#   Residuals wrap at 256 steps.
# Output: 4 m at a scale of 0.1 mm becomes -2.55 m. ezc3d reads the same from the file. 0.99 steps become 0. Of 4,001
#   values of the scale 0.01, 320 lose a step in each copy. If a program computes in float64, 1,996 do, and 1,794 at the
#   scale 0.1 in the first three copies.
# Matters: at 0.1 mm, markers more than 3.28 m from the origin jump, and all others move a little towards it. Leave
#   point_scale negative (the default), which writes floats, also for edits of a file whose own scale is positive.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check c3d==0.6.0 ezc3d==1.7.2 numpy==2.4.6
venv/bin/python -W ignore - <<'PY'
import io
import sys

import c3d
import ezc3d
import numpy as np


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def written(frames, **options):
    """The bytes of a file of one marker, whose frames are rows of x, y, z, residual and cameras."""
    writer = c3d.Writer(point_rate=100, analog_rate=100, **options)
    for frame in frames:
        writer.add_frames([(np.asarray(frame)[None], np.zeros((0, 1)))])
    writer.set_point_labels(["head"])
    handle = io.BytesIO()
    writer.write(handle)
    return handle.getvalue()


def read(data):
    return np.array([points[0, :5] for _, points, _ in c3d.Reader(io.BytesIO(data)).read_frames()], float)


def rounded(frame, digits=2):
    return (np.round(frame, digits) + 0.0).tolist()


frame = [1000.06, -2500.04, 4000.12, 0, 0]  # millimetres
check("as floats", rounded(read(written([frame]))[0, :3]), [1000.06, -2500.04, 4000.12])
data = written([frame], point_scale=0.1)
check("in steps of 0.1", rounded(read(data)[0, :3]), [1000.0, -2500.0, -2553.5])
with open("steps.c3d", "wb") as file:
    file.write(data)
check("by ezc3d", rounded(ezc3d.c3d("steps.c3d")["data"]["points"][:3, 0, 0]), [1000.0, -2500.0, -2553.5])
check("in steps of 0.01", rounded(read(written([frame], point_scale=0.01))[0, :3]), [-310.66, 121.4, 67.96])
frame = [0.099, -0.099, 0.06, 0, 0]
check("0.99, -0.99 and 0.6 steps", rounded(read(written([frame], point_scale=0.1))[0, :3]), [0, 0, 0])
frame = [0, 0, 0, 30, 0]
check("a residual of 30 in steps of 0.1", rounded(read(written([frame], point_scale=0.1))[0, 3]), 4.4)


def changes(scale, kind):
    """For each of four copies in a row: how many of 4001 values have changed, and by how many steps at most."""
    steps = np.arange(-2000, 2001)
    centres = (steps + 0.4 * np.sign(steps)) * scale  # become those steps, however a writer rounds
    frames = read(written(np.outer(centres, [1, 0, 0, 0, 0]), point_scale=scale))
    check(f"steps of {scale} in the first file", bool((np.rint(frames[:, 0] / scale) == steps).all()), True)
    found = []
    for _ in range(4):
        frames = read(written(frames.astype(kind), point_scale=scale))
        moved = np.abs(np.rint(frames[:, 0] / scale) - steps)
        found.append((int(np.count_nonzero(moved)), int(moved.max())))
    return found


stated = {
    (0.1, "float32"): [(0, 0)] * 4,
    (0.1, "float64"): [(1794, 1), (1794, 2), (1794, 3), (1794, 3)],
    (0.01, "float32"): [(320, 1), (320, 2), (320, 3), (320, 4)],
    (0.01, "float64"): [(1996, 1), (1996, 2), (1996, 3), (1996, 4)],
}
for scale in 0.1, 0.01:
    for kind in "float32", "float64":
        check(f"copies in steps of {scale} as {kind}", changes(scale, kind), stated[scale, kind])
PY
