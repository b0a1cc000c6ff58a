#!/usr/bin/env bash
# trimesh 5.2.0: a mesh that is said to be in millimetres is written to GLB in "metres" of a thousandth.
#
# Expected: glTF 2.0 (section 3.4) measures all lengths in metres. trimesh has `units`, and convert_units() that knows
#   them, so an exporter to glTF converts, or warns that it does not.
# Seen: the numbers are written as they are, and the unit into the mesh's `extras`, a place for private notes. trimesh
#   reads it back, so a round trip shows nothing.
# Output: a person of 1,700 mm: greatest y in the file is 850, which is 850 m in any viewer.
# Matters: scans and body models in millimetres or centimetres arrive a thousand or a hundred times too large, beyond
#   the far plane. Call convert_units("meters") before the export.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.4.6 scipy==1.17.1
venv/bin/python - <<'PY'
import json
import struct
import sys
import warnings

import trimesh

warnings.simplefilter("error")


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def positions(mesh):
    """The largest coordinates that the GLB states for its positions."""
    glb = mesh.export(file_type="glb")
    (size,) = struct.unpack_from("<I", glb, 12)
    model = json.loads(glb[20:20 + size])
    accessor = model["accessors"][model["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    return [round(x, 6) for x in accessor["max"]]


person = trimesh.creation.box(extents=(500, 1700, 300))
person.units = "millimeters"
check("in millimetres", positions(person), [250.0, 850.0, 150.0])
person.convert_units("meters")
check("after convert_units", positions(person), [0.25, 0.85, 0.15])
PY
