#!/usr/bin/env bash
# pygltflib 1.16.5: saving what was loaded makes some accessors invalid, and drops weights of nodes.
#
# Expected: load() and save() without a change in between give an equivalent, valid glTF. Of an accessor without
#   `bufferView` (zeros, or zeros with a sparse part) the specification says that `byteOffset` must not be defined; the
#   schema makes the one depend on the other. `weights` of a node set the morph targets of its mesh (section 5.25).
# Seen: every accessor is given `"byteOffset": 0`, with a bufferView or without. `weights` of nodes, and `extras` of
#   `asset`, are lost, without a word; those of meshes, skins, animations and so on stay.
# Output: the sparse accessor gains byteOffset 0; the node's weights [0.5] are gone, and the mesh's [0.25] take their
#   place.
# Matters: morph targets of faces are written as such accessors, and validators and strict loaders then refuse the
#   file. Two characters that share a mesh get one expression.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pygltflib==1.16.5
venv/bin/python - <<'PY'
import base64
import json
import struct
import sys

import pygltflib

data = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<H2x", 2) + struct.pack("<3f", 0, 5, 0)
views = [(0, 36), (36, 2), (40, 12)]
model = {
    "asset": {"version": "2.0", "extras": {"rig": 7}}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "weights": [0.5], "extras": {"kept": True}}],
    "meshes": [{"weights": [0.25], "extras": {"targetNames": ["smile"]},
                "primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}]}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
        {"componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [0, 5, 0],
         "sparse": {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}}],
    "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in views],
    "buffers": [{"byteLength": len(data),
                 "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}
with open("face.gltf", "w") as f:
    json.dump(model, f)
pygltflib.GLTF2().load("face.gltf").save("saved.gltf")
with open("saved.gltf") as f:
    saved = json.load(f)


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


target = saved["accessors"][1]
check("the accessor's bufferView and byteOffset", (target.get("bufferView"), target.get("byteOffset")), (None, 0))
check("the node's weights", saved["nodes"][0].get("weights"), None)
check("the node's extras", saved["nodes"][0].get("extras"), {"kept": True})
check("the mesh's weights", saved["meshes"][0]["weights"], [0.25])
check("the asset's extras", saved["asset"].get("extras"), None)
PY
