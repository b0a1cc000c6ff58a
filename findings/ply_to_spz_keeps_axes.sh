#!/usr/bin/env bash
# gsply 0.4.6 and GaussForge 0.6.0: a PLY turned into SPZ keeps its numbers, so the scene stands on its head.
#
# Expected: SPZ has axes and PLY does not. The format's owner (README of nianticlabs/spz, "Coordinate System") says
#   that SPZ is stored right-up-back, as in OpenGL, and PLY typically right-down-front, as COLMAP and
#   INRIA's trainer leave it. A converter turns (x, y, z) into (x, -y, -z); its own library does so when told RDF.
# Seen: both converters write x, y, z as they are, and SPZ has no field to say so. Reading back gives the same
#   numbers, so a round trip through either library shows nothing.
# Output: (1, 2, 3) of a PLY is stored as (1, 2, 3), not as (1, -2, -3).
# Matters: programs that follow the owner's axes (Blender 5.3.0 does) show people on their heads, and
#   those that do not need a flip for SPZ files of the owner. Whoever reads SPZ cannot know which kind it is.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gsply==0.4.6 gaussforge==0.6.0 numpy==2.4.6 numba==0.68.1
venv/bin/python - <<'PY'
import gzip
import struct
import sys

import gaussforge
import gsply

fields = {"x": 1, "y": 2, "z": 3, "nx": 0, "ny": 0, "nz": 0, "f_dc_0": 0, "f_dc_1": 0, "f_dc_2": 0, "opacity": 1,
          "scale_0": -3, "scale_1": -4, "scale_2": -5, "rot_0": 1, "rot_1": 0, "rot_2": 0, "rot_3": 0}
plain = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
plain += "".join(f"property float {name}\n" for name in fields).encode() + b"end_header\n"
plain += struct.pack(f"<{len(fields)}f", *fields.values())
with open("scene.ply", "wb") as f:
    f.write(plain)


def stored(data):
    """x, y, z as an SPZ of version 3 holds them: 24 bits each, after a header of 16 bytes."""
    raw = gzip.decompress(data)
    scale = 2.0 ** raw[13]
    return [int.from_bytes(raw[16 + 3 * i:19 + 3 * i], "little", signed=True) / scale for i in range(3)]


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


gsply.write_spz("scene.spz", gsply.plyread("scene.ply"))
with open("scene.spz", "rb") as f:
    check("gsply", stored(f.read()), [1.0, 2.0, 3.0])
check("GaussForge", stored(gaussforge.GaussForge().convert(plain, "ply", "spz")["data"]), [1.0, 2.0, 3.0])
PY
