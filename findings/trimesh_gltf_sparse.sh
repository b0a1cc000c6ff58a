#!/usr/bin/env bash
# trimesh 5.2.0: sparse accessors of glTF are read without their sparse part, silently.
#
# Expected: glTF 2.0 (section 3.6.2.3, "Sparse Accessors") lets any accessor carry a list of elements that replace
#   those of its buffer view, or zeros where it has none. It is core, no extension, so a loader of glTF 2.0 reads it.
# Seen: the replaced elements keep their old value; without a buffer view all are zero. No warning, no error.
# Output: the file says (0, 5, 0) for vertex 2; trimesh says (0, 1, 0), and (0, 0, 0) without a buffer view.
# Matters: exporters use sparse accessors for what differs little: morph targets, expressions, corrective shapes.
#   A face exported that way is read as the neutral face, or as one point.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.4.6
venv/bin/python - <<'PY'
import base64
import json
import struct
import sys
import warnings

import trimesh

warnings.simplefilter("error")
base = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
data = base + struct.pack("<3H2x", 0, 1, 2) + struct.pack("<H2x", 2) + struct.pack("<3f", 0, 5, 0)
views = [(0, 36), (36, 6), (44, 2), (48, 12)]


def vertices(with_view):
    position = {"componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [int(with_view), 5, 0],
                "sparse": {"count": 1, "indices": {"bufferView": 2, "byteOffset": 0, "componentType": 5123},
                           "values": {"bufferView": 3, "byteOffset": 0}}}
    if with_view:
        position["bufferView"] = 0
    model = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
             "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
             "accessors": [position, {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
             "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in views],
             "buffers": [{"byteLength": len(data),
                          "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}
    with open("sparse.gltf", "w") as f:
        json.dump(model, f)
    scene = trimesh.load("sparse.gltf", process=False)
    return list(scene.geometry.values())[0].vertices.tolist()


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


check("on a buffer view", vertices(True), [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
check("on zeros", vertices(False), [[0, 0, 0], [0, 0, 0], [0, 0, 0]])
PY
