#!/usr/bin/env bash
# Blender 5.3.0 (bpy): the same Gaussians imported as PLY and as SPZ come in a quarter of a turn apart.
#
# Expected: two imports of one scene lie on each other. The PLY importer's panel has "Forward Axis" Y and "Up Axis" Z,
#   which for other meshes means "take the file as z-up".
# Seen: SPZ is turned from y-up to Blender's z-up (numbers, orientations and bands), PLY is not turned. A PLY of
#   a trainer is y-down, so it lies on its back, and its SPZ, as the format's owner converts it
#   (x, -y, -z), stands.
# Output: PLY (1, 2, 3) stays (1, 2, 3); its SPZ (1, -2, -3) becomes (1, 3, -2). Choosing forward Z and up -Y
#   brings them together, by an object matrix; orientations and bands stay in the file's axes.
# Matters: replacing a PLY by its smaller SPZ moves the person in a scene that was arranged around it.
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
import gzip
import struct
import sys

import bpy

fields = {"x": 1, "y": 2, "z": 3, "f_dc_0": 0, "f_dc_1": 0, "f_dc_2": 0, "opacity": 1,
          "scale_0": -3, "scale_1": -4, "scale_2": -5, "rot_0": 1, "rot_1": 0, "rot_2": 0, "rot_3": 0}
with open("scene.ply", "wb") as f:
    f.write(b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n")
    f.write("".join(f"property float {name}\n" for name in fields).encode() + b"end_header\n")
    f.write(struct.pack(f"<{len(fields)}f", *fields.values()))
# The same Gaussian in SPZ's axes: position (1, -2, -3); the identity stays the identity.
body = b"".join(int(v * 4096).to_bytes(3, "little", signed=True) for v in (1, -2, -3))
body += bytes([186]) + bytes([128] * 3) + bytes([112, 96, 80]) + struct.pack("<I", 3 << 30)
with gzip.open("scene.spz", "wb") as f:
    f.write(struct.pack("<IIIBBBB", 0x5053474E, 3, 1, 0, 12, 0, 0) + body)


def place(operator, path, **options):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    operator(filepath=path, **options)
    thing = bpy.context.object
    world = thing.matrix_world @ thing.data.attributes["position"].data[0].vector
    return [round(x, 3) + 0.0 for x in world]


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


check("PLY", place(bpy.ops.wm.ply_import, "scene.ply"), [1.0, 2.0, 3.0])
check("SPZ", place(bpy.ops.wm.spz_import, "scene.spz"), [1.0, 3.0, -2.0])
check("PLY, forward Z, up -Y",
      place(bpy.ops.wm.ply_import, "scene.ply", forward_axis="Z", up_axis="NEGATIVE_Y"), [1.0, 3.0, -2.0])
PY
venv/bin/python look.py
