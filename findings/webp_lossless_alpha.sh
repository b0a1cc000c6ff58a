#!/usr/bin/env bash
# Pillow 13.0.0, imageio 2.38.1 and OpenCV 5.0.0: lossless WebP loses the colours of transparent pixels.
#
# Expected: lossless means that the pixels come back, as they do from PNG. Pillow's `lossless=True` and OpenCV's
#   quality above 100 are documented as lossless compression.
# Seen: libwebp sets the colours of pixels with alpha 0 to black, unless its `exact` is set, which none of the three
#   does by itself. Pillow takes `exact=True`.
# Output: of 32 pixels with alpha 0 none keeps its colour; all 32 with alpha above 0 do. With exact=True all 64 do.
# Matters: SOG stores Gaussians in WebP planes whose alpha is data (opacity, in the plane of the colours' indices),
#   and matted photographs have colour under their alpha that filters at the edge need.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    pillow==13.0.0 imageio==2.38.1 opencv-python-headless==5.0.0.93 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import cv2
import imageio.v3 as iio
import numpy as np
from PIL import Image

pixels = np.random.default_rng(0).integers(1, 255, (8, 8, 4)).astype("u1")
pixels[:4, :, 3] = 0


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def kept(image):
    """Pixels that came back: of those with alpha 0, of the others."""
    same = (image == pixels).all(axis=2)
    return int(same[:4].sum()), int(same[4:].sum())


Image.fromarray(pixels).save("pillow.webp", lossless=True)
check("Pillow, lossless=True", kept(np.array(Image.open("pillow.webp"))), (0, 32))
Image.fromarray(pixels).save("exact.webp", lossless=True, exact=True)
check("Pillow, lossless=True, exact=True", kept(np.array(Image.open("exact.webp"))), (32, 32))
iio.imwrite("imageio.webp", pixels, lossless=True)
check("imageio, lossless=True", kept(iio.imread("imageio.webp")), (0, 32))
cv2.imwrite("opencv.webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, 101])
check("OpenCV, quality 101", kept(cv2.imread("opencv.webp", cv2.IMREAD_UNCHANGED)), (0, 32))
PY
