#!/usr/bin/env bash
# ezc3d 1.7.2: takes beyond 65,535 frames lose their end, and takes of others gain frames of zeros.
#
# Expected: C3D's header counts frames in 16 bits, and the format's user guide therefore has parameters for longer
#   takes (TRIAL:ACTUAL_END_FIELD, POINT:LONG_FRAMES). A library that writes 70,000 frames without an objection
#   reads 70,000 of them.
# Seen: it writes the data of all frames and the count 65,535, and reads that many back, without a word. Of a take of
#   70,000 frames that the c3d package (0.6.0) wrote with both parameters right, it reads 70,016: the zeros that
#   fill the last block of 512 bytes count as frames.
# Output: 65,535 instead of 70,000; 70,016 instead of 70,000, the last at (0, 0, 0).
# Matters: 65,535 frames are under eleven minutes at 100 Hz; a marker that jumps to the origin at the end of a take
#   looks like a tracking fault.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check ezc3d==1.7.2 c3d==0.6.0 numpy==2.4.6
venv/bin/python - <<'PY'
import sys
import warnings

import c3d
import ezc3d
import numpy as np

warnings.simplefilter("ignore")
count = 70000
x = np.arange(1, count + 1)


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


take = ezc3d.c3d()
take["parameters"]["POINT"]["RATE"]["value"] = [100.0]
take["parameters"]["POINT"]["LABELS"]["value"] = ("HEAD",)
take["data"]["points"] = np.ones((4, 1, count))
take["data"]["points"][0, 0] = x
take.write("own.c3d")
points = ezc3d.c3d("own.c3d")["data"]["points"]
check("frames of its own take", points.shape[2], 65535)
check("last x", float(points[0, 0, -1]), 65535.0)
check("the file holds the last frame", np.float32(count).tobytes() in open("own.c3d", "rb").read()[-600:], True)

writer = c3d.Writer(point_rate=100.0)
frame = np.zeros((1, 5), "f4")
frames = []
for v in x:
    frame[0, 0] = v
    frames.append((frame.copy(), np.zeros((0, 0))))
writer.add_frames(frames)
writer.set_point_labels(["HEAD"])
with open("other.c3d", "wb") as f:
    writer.write(f)
with open("other.c3d", "rb") as f:
    check("frames of the other take, read by c3d", sum(1 for _ in c3d.Reader(f).read_frames()), count)
other = ezc3d.c3d("other.c3d")
points = other["data"]["points"]
check("the same, read by ezc3d", points.shape[2], 70016)
check("its LONG_FRAMES", float(other["parameters"]["POINT"]["LONG_FRAMES"]["value"][0]), 70000.0)
check("x at the end", [float(v) for v in points[0, 0, count - 1:count + 1]], [70000.0, 0.0])
PY
