#!/usr/bin/env bash
# trimesh 5.2.0 and assimp-py 1.1.0: positions in normalized 16-bit integers are read as something else.
#
# Expected: KHR_mesh_quantization (ratified, and the output of gltfpack) allows POSITION in normalized shorts:
#   32767 means 1.0. A file that uses it has to list it in extensionsRequired, so that a loader which cannot
#   read it refuses.
# Seen: neither refuses. trimesh gives the integers, assimp takes their bytes for those of floats.
# Output: for (1, 0, 0) trimesh gives (32767, 0, 0), assimp about (4.6e-41, 0, 0) and a NaN for (0, 1, 0).
# Matters: bodies for the web are packed this way; one of 32 km is at least seen, one of 1e-41 m looks like an empty
#   scene.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 assimp-py==1.1.0 numpy==2.4.6
venv/bin/python - <<'PY'
import base64
import json
import math
import struct
import sys

import assimp_py
import trimesh

data = struct.pack("<12h", 0, 0, 0, 0, 32767, 0, 0, 0, 0, 32767, 0, 0) + bytes(8)
model = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
         "extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"],
         "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
         "accessors": [{"bufferView": 0, "componentType": 5122, "normalized": True, "count": 3, "type": "VEC3",
                        "min": [0, 0, 0], "max": [32767, 32767, 0]}],
         "bufferViews": [{"buffer": 0, "byteLength": len(data), "byteStride": 8}],
         "buffers": [{"byteLength": len(data),
                      "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}
with open("packed.gltf", "w") as f:
    json.dump(model, f)


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


scene = trimesh.load("packed.gltf", process=False)
check("trimesh", list(scene.geometry.values())[0].vertices.tolist(), [[0, 0, 0], [32767, 0, 0], [0, 32767, 0]])
read = list(assimp_py.import_file("packed.gltf", 0).meshes[0].vertices)
check("assimp, x of (1, 0, 0)", read[3], struct.unpack("<f", struct.pack("<hh", 32767, 0))[0])
check("assimp, x of (0, 1, 0) is NaN", math.isnan(read[6]), True)
PY
