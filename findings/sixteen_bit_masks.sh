#!/usr/bin/env bash
# OpenCV 5.0.0 and Pillow 13.0.0: a 16-bit mask read as 8 bits loses its labels in one and its softness in the other.
#
# Expected: asked for 8 bits of grey, a library scales 16 bits by 257 (PNG's specification, section 13.12, gives the
#   rule), or leaves labels alone, or refuses; and two libraries agree.
# Seen: OpenCV's imread() drops the low byte, Pillow's convert("L") and convert("RGB") cut at 255. Neither warns.
#   imageio with mode="L" does as Pillow.
# Output: alpha 0 128 16384 32768 65535 becomes 0 0 64 128 255 in OpenCV and 0 128 255 255 255 in Pillow; labels 0 1 2
#   24 become 0 0 0 0 in OpenCV and stay in Pillow.
# Matters: mattes of 16 bits become hard silhouettes, one pixel wider all around, or label images of people and
#   clothes become empty masks. Both look like a bad mask, not like a reader's fault.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    opencv-python-headless==5.0.0.93 pillow==13.0.0 imageio==2.38.1 numpy==2.4.6
venv/bin/python - <<'PY'
import sys
import warnings

import cv2
import imageio.v3 as iio
import numpy as np
from PIL import Image

warnings.simplefilter("error")


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


cv2.imwrite("alpha.png", np.array([[0, 128, 16384, 32768, 65535]], "u2"))
cv2.imwrite("labels.png", np.array([[0, 1, 2, 24]], "u2"))
grey = cv2.IMREAD_GRAYSCALE
check("alpha, OpenCV", cv2.imread("alpha.png", grey)[0].tolist(), [0, 0, 64, 128, 255])
check("alpha, Pillow, L", list(Image.open("alpha.png").convert("L").tobytes()), [0, 128, 255, 255, 255])
check("alpha, Pillow, RGB", list(Image.open("alpha.png").convert("RGB").tobytes()[::3]), [0, 128, 255, 255, 255])
check("alpha, imageio", iio.imread("alpha.png", mode="L")[0].tolist(), [0, 128, 255, 255, 255])
check("labels, OpenCV", cv2.imread("labels.png", grey)[0].tolist(), [0, 0, 0, 0])
check("labels, Pillow", list(Image.open("labels.png").convert("L").tobytes()), [0, 1, 2, 24])
PY
