#!/usr/bin/env bash
# usd-convert-gsplat 0.1.15 (NVIDIA): --rotate-x turns positions and orientations, but no spherical harmonics.
#
# Expected: the page of the package offers `--rotate-x 180` as "orientation correction", and its API says "e.g.
#   180,0,0 for COLMAP Y-down data". The numbers are baked, so colours that depend on the view must be turned with them:
#   under a half turn about x the first band's y and z coefficients change sign.
# Seen: positions and orientations are turned, every coefficient is written as it was, at exit status 0.
# Output: position (1, 2, 3) becomes (1, -2, -3); the first band stays (0.1, 0.4, 0.7) (0.2, 0.5, 0.8) (0.3, 0.6,
#   0.9), where (-0.1, -0.4, -0.7) (-0.2, -0.5, -0.8) (0.3, 0.6, 0.9) is right.
# Matters: nearly every PLY needs this turn to stand upright in USD's y-up stage, and every one of them that has bands
#   then reflects light from below. An xform above the prim does it rightly.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3.11}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check usd-convert-gsplat==0.1.15 usd-core==26.11
cat > make.py <<'PY'
import struct

fields = {"x": 1, "y": 2, "z": 3, "f_dc_0": 0, "f_dc_1": 0, "f_dc_2": 0,
          **{f"f_rest_{i}": (i + 1) / 10 for i in range(9)},  # channel-major: red's three, green's, blue's
          "opacity": 1, "scale_0": -3, "scale_1": -3, "scale_2": -3, "rot_0": 1, "rot_1": 0, "rot_2": 0, "rot_3": 0}
with open("scene.ply", "wb") as f:
    f.write(b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n")
    f.write("".join(f"property float {name}\n" for name in fields).encode() + b"end_header\n")
    f.write(struct.pack(f"<{len(fields)}f", *fields.values()))
PY
venv/bin/python make.py
venv/bin/usd-convert-gsplat -i scene.ply -o turned.usda --rotate-x 180 >log.txt
venv/bin/python - <<'PY'
import sys

from pxr import Usd, UsdVol


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def rounded(values):
    return [tuple(round(x, 4) for x in v) for v in values]


stage = Usd.Stage.Open("turned.usda")
gaussians = UsdVol.ParticleField3DGaussianSplat(stage.GetDefaultPrim())
order = gaussians.GetPrim().GetAttribute("xformOpOrder").Get()
check("transforms left to the stage", list(order or []), [])
check("position", rounded(gaussians.GetPositionsAttr().Get()), [(1.0, -2.0, -3.0)])
check("first band", rounded(gaussians.GetRadianceSphericalHarmonicsCoefficientsAttr().Get())[1:],
      [(0.1, 0.4, 0.7), (0.2, 0.5, 0.8), (0.3, 0.6, 0.9)])
PY
