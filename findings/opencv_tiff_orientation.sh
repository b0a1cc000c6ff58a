#!/usr/bin/env bash
# OpenCV 4.12.0 and 5.0.0: a TIFF whose Orientation lies on its side is not read at all.
#
# Expected: imread() applies the orientation (documented for EXIF; for TIFF the tag 274 is baseline TIFF 6.0). JPEG,
#   PNG and WebP with any of the eight values are read, and so are TIFFs of 1 to 4.
# Seen: for 5 to 8, where width and height trade places, imread() gives None, with IMREAD_UNCHANGED and
#   IMREAD_IGNORE_ORIENTATION as well; the log says that an internal pointer comparison failed.
#   Pillow reads all eight.
# Output: shape (20, 40, 3) for 1 to 4, None for 5 to 8.
# Matters: cameras held upright write 6 or 8, and raw converters write TIFF. imread()'s None means "no such file" to
#   most programs, so a capture loses exactly its upright pictures.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cat > look.py <<'PY'
import sys

import cv2
import numpy as np
from PIL import Image


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


print("OpenCV", cv2.__version__)
pixels = np.arange(20 * 40 * 3, dtype="u1").reshape(20, 40, 3)


def shape(path, *flags):
    image = cv2.imread(path, *flags)
    return None if image is None else image.shape


for orientation in range(1, 9):
    Image.fromarray(pixels).save("photo.tif", tiffinfo={274: orientation})
    check(f"orientation {orientation}, read by Pillow", sorted(Image.open("photo.tif").size), [20, 40])
    stated = (20, 40, 3) if orientation < 5 else None
    check(f"orientation {orientation}", shape("photo.tif"), stated)
    check(f"orientation {orientation}, unchanged", shape("photo.tif", cv2.IMREAD_UNCHANGED), stated)
    check(f"orientation {orientation}, ignored",
          shape("photo.tif", cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION), stated)
exif = Image.Exif()
exif[274] = 6
Image.fromarray(pixels).save("photo.png", exif=exif)
check("orientation 6 in a PNG", shape("photo.png"), (40, 20, 3))
PY
for version in 4.12.0.88 5.0.0.93; do
    "${PYTHON:-python3}" -m venv "venv$version"
    "venv$version/bin/pip" install --quiet --disable-pip-version-check \
        "opencv-python-headless==$version" pillow==12.0.0 'numpy==2.2.6'
    "venv$version/bin/python" look.py 2>errors.txt || { cat errors.txt; exit 1; }
done
grep -o "original_ptr == real_mat.data" errors.txt | head -1
