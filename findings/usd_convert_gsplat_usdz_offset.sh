#!/usr/bin/env bash
# usd-convert-gsplat 0.1.15 (NVIDIA): its .usdz packages break the format's one rule of layout.
#
# Expected: the USDZ specification asks that the data of each file in the package begin at a multiple of 64
#   bytes, so that it can be mapped as it lies; OpenUSD pads the headers for that (UsdZipFileWriter).
# Seen: the converter packs with an ordinary zip writer, and the layer's data begin at byte 42. OpenUSD's own
#   validation, which usd-core brings, refuses the package.
# Output: ByteMisalignment: "File 'default.usda' in package 'scene.usdz' has an invalid offset 42."
# Matters: .usdz is the ending that the package's first example writes; strict readers and asset checks of
#   pipelines turn these files away. Write .usdc, or pack with UsdUtils.CreateNewUsdzPackage.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3.11}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check usd-convert-gsplat==0.1.15 usd-core==26.11
cat > make.py <<'PY'
import struct

fields = {"x": 1, "y": 2, "z": 3, "f_dc_0": 0, "f_dc_1": 0, "f_dc_2": 0, "opacity": 1,
          "scale_0": -3, "scale_1": -3, "scale_2": -3, "rot_0": 1, "rot_1": 0, "rot_2": 0, "rot_3": 0}
with open("scene.ply", "wb") as f:
    f.write(b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n")
    f.write("".join(f"property float {name}\n" for name in fields).encode() + b"end_header\n")
    f.write(struct.pack(f"<{len(fields)}f", *fields.values()))
PY
venv/bin/python make.py
venv/bin/usd-convert-gsplat -i scene.ply -o scene.usdz >log.txt
venv/bin/python - <<'PY'
import struct
import sys
import zipfile

from pxr import Usd, UsdUtils, UsdValidation


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def offsets(path):
    """Where the data of each file begin: after the local header, its name and its extra field."""
    with zipfile.ZipFile(path) as package, open(path, "rb") as raw:
        found = []
        for entry in package.infolist():
            raw.seek(entry.header_offset + 26)
            name, extra = struct.unpack("<HH", raw.read(4))
            found.append(entry.header_offset + 30 + name + extra)
    return found


def misaligned(path):
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(path))
    return sorted({e.GetMessage() for e in errors if e.GetName() == "ByteMisalignment"})


check("offset", offsets("scene.usdz"), [42])
check("OpenUSD's validation", misaligned("scene.usdz"),
      ["File 'default.usda' in package 'scene.usdz' has an invalid offset 42."])
# What OpenUSD packs itself passes.
Usd.Stage.Open("scene.usdz").Export("plain.usda")
UsdUtils.CreateNewUsdzPackage("plain.usda", "ours.usdz")
check("offsets modulo 64 of OpenUSD's own package", [o % 64 for o in offsets("ours.usdz")], [0])
check("its validation", misaligned("ours.usdz"), [])
PY
