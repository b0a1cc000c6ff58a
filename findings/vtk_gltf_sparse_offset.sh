#!/usr/bin/env bash
# VTK 9.7.2: vtkGLTFReader refuses a sparse accessor that leaves out an offset of zero.
#
# Expected: `byteOffset` of accessor.sparse.indices and of accessor.sparse.values is optional in glTF 2.0, default 0
#   (section 5.3, 5.4), and `bufferView` of the accessor itself is optional, too: its elements then start as zeros.
# Seen: without the offset the file is refused with "Invalid accessor.sparse.indices.byteOffset value"; without
#   the buffer view the vertices that the sparse part does not name are missing, which is told as an invalid index.
# Output: 3 points with offset and view, none without the one or the other.
# Matters: F3D 4.0.0, which loads glTF through VTK, refuses such files, too. Write the offset though it is zero.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check vtk==9.7.2 numpy==2.4.6
cat > look.py <<'PY'
import base64
import json
import struct
import sys

from vtkmodules.vtkIOGeometry import vtkGLTFReader

data = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<3H2x", 0, 1, 2)
data += struct.pack("<H2x", 2) + struct.pack("<3f", 0, 5, 0)
views = [(0, 36), (36, 6), (44, 2), (48, 12)]


def points(offset, view):
    zero = {"byteOffset": 0} if offset else {}
    position = {"componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [int(view), 5, 0],
                "sparse": {"count": 1, "indices": {"bufferView": 2, "componentType": 5123, **zero},
                           "values": {"bufferView": 3, **zero}}}
    if view:
        position["bufferView"] = 0
    model = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
             "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
             "accessors": [position, {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
             "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in views],
             "buffers": [{"byteLength": len(data),
                          "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}
    with open("sparse.gltf", "w") as f:
        json.dump(model, f)
    reader = vtkGLTFReader()
    reader.SetFileName("sparse.gltf")
    reader.Update()
    leaves = reader.GetOutput().NewIterator()
    leaves.InitTraversal()
    found = []
    while not leaves.IsDoneWithTraversal():
        mesh = leaves.GetCurrentDataObject()
        found += [mesh.GetPoint(i) for i in range(mesh.GetNumberOfPoints())]
        leaves.GoToNextItem()
    return found


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


check("with offset and view", points(True, True), [(0, 0, 0), (1, 0, 0), (0, 5, 0)])
check("without the offset", points(False, True), [])
check("without the view", points(True, False), [])
PY
venv/bin/python look.py 2>errors.txt
grep -o "Invalid accessor.sparse.indices.byteOffset value" errors.txt | head -1 | grep .
