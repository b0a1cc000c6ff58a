#!/usr/bin/env bash
# assimp 5.2.5 (Debian 12): the binary FBX that it exports is read by no one, itself included.
#
# Expected: `assimp export body.gltf body.fbx -ffbx` ends with status 0 and "wrote output file", so the file is an FBX.
# Seen: ufbx (pyufbx 0.0.7) fails to load it, Blender 5.3.0 says "Failed to load", and assimp's own reader stops at an
#   offset out of range. FBX as text (-ffbxa) is read by all three, with a unit of 1 cm where glTF's numbers are
#   metres.
# Output: "FBX-Tokenize (offset …) block offset is out of range"; the text form has a unit of 0.01 m.
# Matters: it is a Debian user's nearest command for a body or a motion on its way to a game engine, and the failure
#   shows only there; the text form arrives a hundred times too small. Blender's exporter is a way around both.
# It needs apt's package lists of Debian 12 (bookworm); the packages are unpacked here, not installed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
apt-get download 'assimp-utils=5.2.5~ds0-1+b1' 'libassimp5=5.2.5~ds0-1+b1' libdraco7 libminizip1 libpugixml1v5 \
    libpolyclipping22 >log.txt 2>&1
for package in *.deb; do dpkg -x "$package" assimp; done
export LD_LIBRARY_PATH="$work/assimp/usr/lib/x86_64-linux-gnu"
assimp=assimp/usr/bin/assimp
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyufbx==0.0.7 numpy==2.4.6
venv/bin/python - <<'PY'
import base64
import json
import struct

data = struct.pack("<9f3H2x", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
model = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
         "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
         "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                        "min": [0, 0, 0], "max": [1, 1, 0]},
                       {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
         "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
         "buffers": [{"byteLength": len(data),
                      "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}
with open("body.gltf", "w") as f:
    json.dump(model, f)
PY
"$assimp" export body.gltf binary.fbx -ffbx | grep "wrote output file"
"$assimp" export body.gltf text.fbx -ffbxa | grep "wrote output file"
if "$assimp" info binary.fbx >info.txt 2>&1; then echo "changed: assimp reads its binary FBX"; exit 1; fi
grep "block offset is out of range" info.txt
"$assimp" info text.fbx --raw | grep "Vertices: *3"
venv/bin/python - <<'PY'
import sys

import ufbx


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def loads(path):
    try:
        return ufbx.load_file(path)
    except ufbx.UfbxError:
        return None


check("ufbx, binary", loads("binary.fbx"), None)
scene = loads("text.fbx")
check("ufbx, text: unit in metres", scene.settings.unit_meters, 0.01)
PY
