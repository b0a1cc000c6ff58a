#!/usr/bin/env bash
# bvhio 1.5.4: a BVH that goes through its hierarchy loses all End Sites.
#
# Expected: readAsHierarchy() and writeHierarchy() are the pair that the library offers for changing motions; a figure
#   that is not touched keeps its shape. The OFFSET of an End Site is the last bone: hand, foot, head.
# Seen: the offset is not kept. What is written is 0.3 times the length of the bone before, in that bone's direction,
#   whatever the file said. readAsBvh() and writeBvh() keep it.
# Output: End Sites (20, 0, 0), (0, -7, 0) and (0, 0.1, 0) behind a bone of (10, 0, 0) all come back as (3, 0, 0).
# Matters: in BVH without fingers the End Site is all there is to say where a hand or a foot points, and how long it
#   is.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check bvhio==1.5.4 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import bvhio

motion = """HIERARCHY
ROOT Hips
{{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Hand
  {{
    OFFSET 10 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {{
      OFFSET {}
    }}
  }}
}}
MOTION
Frames: 1
Frame Time: 0.01
0 90 0 0 0 0 0 0 0
"""


def end_site(path):
    with open(path) as f:
        offsets = [line.split()[1:] for line in f if line.split()[:1] == ["OFFSET"]]
    return [round(float(x), 3) + 0.0 for x in offsets[-1]]


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


for offset in ("20 0 0", "0 -7 0", "0 0.1 0"):
    with open("in.bvh", "w") as f:
        f.write(motion.format(offset))
    bvhio.writeHierarchy("out.bvh", bvhio.readAsHierarchy("in.bvh"), 0.01)
    check(f"{offset} through the hierarchy", end_site("out.bvh"), [3.0, 0.0, 0.0])
    bvhio.writeBvh("plain.bvh", bvhio.readAsBvh("in.bvh"))
    check(f"{offset} through the container", end_site("plain.bvh"), [float(x) for x in offset.split()])
PY
