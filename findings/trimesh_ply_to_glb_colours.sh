#!/usr/bin/env bash
# trimesh 5.2.0: vertex colours grow brighter on the way from PLY to GLB, as bytes are copied between two meanings.
#
# Expected: a PLY's uchar colours are display values (sRGB), as every scanner and MeshLab write them; glTF's COLOR_0
#   is "an additional linear multiplier to base color" (glTF 2.0, section 3.9.2). An exporter decodes sRGB
#   first: 128 is 0.216.
# Seen: the bytes go over as they are, and come back so, which hides it from a round trip through trimesh.
# Output: 128 of the PLY is 128 of 255 in COLOR_0, linear 0.502, which a viewer shows as 188.
# Matters: scans of people look washed out in every glTF viewer, and the colours of a glTF from elsewhere too dark in
#   what trimesh saves as PLY.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.4.6
venv/bin/python - <<'PY'
import json
import struct
import sys

import trimesh


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


with open("scan.ply", "w") as f:
    f.write("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
            "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
            "property list uchar int vertex_indices\nend_header\n"
            "0 0 0 128 128 128\n1 0 0 128 128 128\n0 1 0 128 128 128\n3 0 1 2\n")
trimesh.load("scan.ply").export("scan.glb")

with open("scan.glb", "rb") as f:
    glb = f.read()
(size,) = struct.unpack_from("<I", glb, 12)
model, binary = json.loads(glb[20:20 + size]), glb[28 + size:]
accessor = model["accessors"][model["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
view = model["bufferViews"][accessor["bufferView"]]
check("COLOR_0's component type", accessor["componentType"], 5121)
check("COLOR_0's first byte", binary[view.get("byteOffset", 0) + accessor.get("byteOffset", 0)], 128)
shown = 1.055 * (128 / 255) ** (1 / 2.4) - 0.055
check("which is shown as", round(255 * shown), 188)
PY
