#!/usr/bin/env bash
# usd-convert-gsplat 0.1.15 (NVIDIA): the order of spherical harmonics hangs on the *name* of a source file.
#
# Expected: read_spz() returns "GaussianSplatData (same schema as read_ply output)", and source_file of
#   write_gaussian_splat_usd() is an optional string "for layer metadata". So what was read from an SPZ is
#   written rightly with and without it, and by write_ply().
# Seen: f_rest is channel-major after read_ply() and coefficient-major after read_spz(), under one name; the
#   writer takes it for the latter if source_file ends in ".spz" and for the former otherwise. Left out (its
#   default), red, green and blue of three coefficients trade places. write_ply() always mixes them up.
# Output: with source_file the first coefficient is (0.0625, 0.125, 0.25), without it (0.0625, 0.375, 0.75).
# Matters: SPZ read through Python and written as USD or PLY gets coloured fringes that move with the view.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3.11}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check usd-convert-gsplat==0.1.15 usd-core==26.11
venv/bin/python - >log.txt <<'PY'
import gzip
import struct
import sys

import usd_convert_gsplat as converter
from pxr import Usd, UsdVol

# One Gaussian, version 3, degree 1: positions, alphas, colours, scales, rotations, sh (by coefficient, then r g b).
bands = [[8, 16, 32], [48, 64, 80], [96, 104, 112]]
head = struct.pack("<IIIBBBB", 0x5053474E, 3, 1, 1, 12, 0, 0)
body = bytes(9) + bytes([200]) + bytes([128] * 3) + bytes([100] * 3) + struct.pack("<I", 3 << 30)
body += bytes(128 + b for row in bands for b in row)
with gzip.open("scene.spz", "wb") as f:
    f.write(head + body)
stored = [tuple(b / 128 for b in row) for row in bands]


def check(what, seen, stated):
    print(f"{what}: {seen}", file=sys.stderr)
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def written(**more):
    name = f"out{len(more)}.usda"
    converter.write_gaussian_splat_usd(converter.read_spz("scene.spz"), name, **more)
    stage = Usd.Stage.Open(name)
    gaussians = UsdVol.ParticleField3DGaussianSplat(stage.GetDefaultPrim())
    return [tuple(v) for v in gaussians.GetRadianceSphericalHarmonicsCoefficientsAttr().Get()][1:]


check("with source_file", written(source_file="scene.spz"), stored)
check("without it", written(), [tuple(stored[k][c] for k in range(3)) for c in range(3)])
converter.write_ply(converter.read_spz("scene.spz"), "out.ply")
rest = converter.read_ply("out.ply").f_rest[0].tolist()
check("red of the three coefficients in the PLY", rest[:3], list(stored[0]))
check("which should be", [row[0] for row in stored], [0.0625, 0.375, 0.75])
PY
