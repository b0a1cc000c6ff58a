#!/usr/bin/env bash
# Blender 5.3.0 (bpy): a BVH imported and exported with the operators' defaults lies down and plays five times slower.
#
# Expected: import_anim.bvh and export_anim.bvh of one program are inverse to each other: the importer asks for the
#   file's axes (forward -Z, up Y by default) and reads its Frame Time.
# Seen: the exporter has no option for axes and writes Blender's own, z up. The importer puts one frame of the file
#   on each frame of the scene, at the scene's 24 a second, unless update_scene_fps is set (it is not by default),
#   and the exporter writes the scene's rate and range. Joints whose bones do not touch get position channels.
# Output: hips at (1, 2, 3) come out at (1, -3, 2); 3 frames of 1/120 s come out as 250 of 1/24 s; a hand of three
#   channels has six.
# Matters: BVH that "was only looked at in Blender" carries z up in a format of y-up files, which readers take for a
#   person who lies on the back.
# It needs Python 3.13 (bpy 5.3 has no other wheel), 1.3 GB of disk and 430 MB of download.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python=${PYTHON313:-python3.13}
"$python" --version >/dev/null 2>&1 || python=$(ls "$HOME"/.pyenv/versions/3.13*/bin/python3.13 | tail -1)
"$python" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check --no-cache-dir bpy==5.3.0
cat > look.py <<'PY'
import sys

import bpy

motion = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Chest
  {
    OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT LeftHand
    {
      OFFSET 10 0 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 2 0 0
      }
    }
    JOINT RightHand
    {
      OFFSET -10 0 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET -2 0 0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.008333333
1 2 3 0 0 0 0 0 0 0 0 0 0 0 0
1 2 3 0 0 0 0 0 0 0 0 0 0 0 0
1 2 3 0 0 0 0 0 0 0 0 0 0 0 0
"""
with open("in.bvh", "w") as f:
    f.write(motion)
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_anim.bvh(filepath="in.bvh")
bpy.ops.export_anim.bvh(filepath="out.bvh")
with open("out.bvh") as f:
    lines = f.read().split("\n")


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


start = lines.index("MOTION")
check("frames", lines[start + 1], "Frames: 250")
check("time", lines[start + 2], "Frame Time: 0.041667")
check("hips", [round(float(x), 3) for x in lines[start + 3].split()[:3]], [1.0, -3.0, 2.0])
check("channels", [line.split()[1] for line in lines if "CHANNELS" in line], ["6", "3", "6", "6"])
PY
venv/bin/python look.py
