#!/usr/bin/env bash
# pypcd4 1.5.1: a coloured point cloud that is saved as ASCII is black.
#
# Expected: save() takes three encodings of PCD, and the file holds the same points in each. encode_rgb packs a colour
#   into the bits of one float32, as is usual in PCD, and from_xyzrgb_points makes a cloud of these.
# Seen: as ASCII, every float is written with ten digits after the point. Such a packed colour is a number below
#   2.4e-38, so "0.0000000000" is written for all of them, silently. Nine digits and an exponent would keep it. The
#   reader takes them well. In the two binary encodings, the colours stay.
# Output: five colours, read again from the three encodings, and from a copy of the ASCII file with exponents.
# Matters: a scan of a person that is saved as text for another program keeps its shape and loses its colours for good.
#   Save it in one of the binary encodings.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pypcd4==1.5.1 numpy==2.4.6 pydantic==2.14.4 \
  python-neo-lzf==0.3.5
venv/bin/python - <<'PY'
import sys

import numpy as np
from pypcd4 import Encoding, PointCloud


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


colours = [[255, 0, 10], [1, 2, 3], [200, 150, 120], [128, 128, 128], [255, 255, 255]]
places = np.arange(15, dtype=np.float32).reshape(5, 3) / 8
packed = PointCloud.encode_rgb(np.array(colours, np.uint8))
cloud = PointCloud.from_xyzrgb_points(np.column_stack((places, packed)).astype(np.float32))


def read(file):
    """The colours in a file, whose places are checked."""
    again = PointCloud.from_path(file)
    if not np.array_equal(again.numpy(("x", "y", "z")), places):
        sys.exit("changed: other places")
    return PointCloud.decode_rgb(np.ascontiguousarray(again.pc_data["rgb"], np.float32)).tolist()


for encoding, stated in ((Encoding.BINARY, colours), (Encoding.BINARY_COMPRESSED, colours),
                         (Encoding.ASCII, [[0, 0, 0]] * 5)):
    cloud.save(f"{encoding.name}.pcd", encoding=encoding)
    check(encoding.name, read(f"{encoding.name}.pcd"), stated)

with open("ASCII.pcd") as file:
    lines = file.read().splitlines()
check("its last line", lines[-1].split()[-1], "0.0000000000")
lines[-5:] = [f"{x} {y} {z} {rgb:.8e}" for (x, y, z), rgb in zip(places, packed)]
with open("exponents.pcd", "w") as file:
    file.write("\n".join(lines) + "\n")
check("ASCII with exponents", read("exponents.pcd"), colours)
PY
