#!/usr/bin/env bash
# GaussForge 0.6.0: compressed PLY comes back with its spherical harmonics in another order.
#
# Expected: PLY to compressed.ply and back gives each f_rest_i within a step of 8 bits (1/32). The compressed
#   form (PlayCanvas) names its bytes f_rest_0, f_rest_1, … as the plain form does: channel by channel.
# Seen: the writer stores them coefficient by coefficient under those names, the reader takes them as channel by
#   channel. All coefficients of degree 1 and above change places but those on the diagonal, without an error.
#   gsply 0.4.6 reads the written file in the same wrong order, so the fault is the writer's.
# Output: f_rest of degree 1, in: 0.125 0.25 0.375 0.5 0.625 0.75 0.875 1 1.125,
#   back: 0.125 0.5 0.875 0.25 0.625 1 0.375 0.75 1.125.
# Matters: compressed PLY is what SuperSplat and PlayCanvas are fed; highlights turn into coloured noise.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gaussforge==0.6.0 gsply==0.4.6 numpy==2.4.6 numba==0.68.1
venv/bin/python - <<'PY'
import struct
import sys

import gaussforge
import gsply

rest = [(i + 1) / 8 for i in range(9)]  # four steps of 8 bits apart
fields = {"x": 1, "y": 2, "z": 3, "nx": 0, "ny": 0, "nz": 0, "f_dc_0": 0, "f_dc_1": 0, "f_dc_2": 0,
          **{f"f_rest_{i}": v for i, v in enumerate(rest)}, "opacity": 1,
          "scale_0": -3, "scale_1": -3, "scale_2": -3, "rot_0": 1, "rot_1": 0, "rot_2": 0, "rot_3": 0}
plain = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
plain += "".join(f"property float {name}\n" for name in fields).encode() + b"end_header\n"
plain += struct.pack(f"<{len(fields)}f", *fields.values())


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def f_rest(path):
    """Channel by channel, to the nearest eighth."""
    return [round(float(x) * 8) / 8 for x in gsply.plyread(path).shN[0].T.reshape(-1)]


forge = gaussforge.GaussForge()
packed = forge.convert(plain, "ply", "compressed.ply")["data"]
back = forge.convert(packed, "compressed.ply", "ply")["data"]
for name, data in (("in.ply", plain), ("packed.compressed.ply", packed), ("back.ply", back)):
    with open(name, "wb") as f:
        f.write(data)
turned = [rest[3 * (i % 3) + i // 3] for i in range(9)]
check("f_rest in", f_rest("in.ply"), rest)
check("f_rest back", f_rest("back.ply"), turned)
check("f_rest of the compressed file, read by gsply", f_rest("packed.compressed.ply"), turned)
PY
