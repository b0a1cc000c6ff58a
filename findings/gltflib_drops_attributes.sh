#!/usr/bin/env bash
# gltflib 1.0.13: loading and saving a glTF drops every vertex attribute but eight names.
#
# Expected: glTF 2.0 (section 3.7.2.1) has sets JOINTS_n, WEIGHTS_n, TEXCOORD_n, COLOR_n for any n and custom names
#   that begin with an underscore, and extensions add their own. A library that loads and saves keeps them.
# Seen: what is not POSITION, NORMAL, TANGENT, TEXCOORD_0, TEXCOORD_1, COLOR_0, JOINTS_0 or WEIGHTS_0 is gone, without
#   a word. Accessors, buffers, the primitive's extensions and extensionsUsed stay, so nothing looks amiss.
# Output: of JOINTS_0/1, WEIGHTS_0/1, _REGION and KHR_gaussian_splatting:ROTATION only JOINTS_0 and WEIGHTS_0 come
#   back.
# Matters: bodies with more than four bones a vertex keep weights that no longer sum to 1; Gaussians become bare
#   points that still claim the extension.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gltflib==1.0.13
venv/bin/python - <<'PY'
import base64
import json
import struct
import sys

from gltflib import GLTF

data = struct.pack("<3f", 1, 2, 3) + bytes([0, 1, 2, 3]) + struct.pack("<4f", 0.2, 0.2, 0.2, 0.2)
data += bytes([4, 0, 0, 0]) + struct.pack("<4f", 0.2, 0, 0, 0)
views = [(0, 12), (12, 4), (16, 16), (32, 4), (36, 16)]
kinds = [(5126, "VEC3"), (5121, "VEC4"), (5126, "VEC4"), (5121, "VEC4"), (5126, "VEC4")]
names = {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2, "JOINTS_1": 3, "WEIGHTS_1": 4, "_REGION": 0,
         "KHR_gaussian_splatting:ROTATION": 4}
model = {"asset": {"version": "2.0"}, "extensionsUsed": ["KHR_gaussian_splatting"], "scene": 0,
         "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
         "meshes": [{"primitives": [{"mode": 0, "attributes": names,
                                     "extensions": {"KHR_gaussian_splatting": {"kernel": "ellipse"}}}]}],
         "accessors": [{"bufferView": i, "componentType": c, "count": 1, "type": t} for i, (c, t) in enumerate(kinds)],
         "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in views],
         "buffers": [{"byteLength": len(data),
                      "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}
model["accessors"][0].update(min=[1, 2, 3], max=[1, 2, 3])
with open("body.gltf", "w") as f:
    json.dump(model, f)
GLTF.load("body.gltf").export("saved.gltf")
with open("saved.gltf") as f:
    saved = json.load(f)


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


primitive = saved["meshes"][0]["primitives"][0]
check("attributes", primitive["attributes"], {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2})
check("accessors", len(saved["accessors"]), 5)
check("extensions", [saved["extensionsUsed"], list(primitive["extensions"])],
      [["KHR_gaussian_splatting"], ["KHR_gaussian_splatting"]])
PY
