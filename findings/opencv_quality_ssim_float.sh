#!/usr/bin/env bash
# opencv-contrib 5.0.0: cv2.quality's SSIM of float pictures in 0 to 1 is near 1 for anything.
#
# Expected: SSIM has constants C1 = (0.01 L)^2 and C2 = (0.03 L)^2, where L is the range of values; a picture and the
#   same picture divided by 255 have the same SSIM. The module takes floats without an objection, and has no
#   parameter for the range.
# Seen: L is 255 whatever the type, so for floats in 0 to 1 the constants outweigh all that is in the picture.
# Output: for a picture and a noisy copy 0.3114 in bytes, 0.9995 in floats; scikit-image gives 0.3096 for both.
# Matters: it looks like a very good avatar. Render targets and network outputs are floats in 0 to 1.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    opencv-contrib-python-headless==5.0.0.93 scikit-image==0.26.0 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import cv2
import numpy as np
from skimage.metrics import structural_similarity


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


rng = np.random.default_rng(0)
y, x = np.mgrid[0:128, 0:128]
picture = (127 + 100 * np.sin(0.2 * x) * np.cos(0.15 * y)).round().astype("u1")
noisy = np.clip(picture + rng.normal(0, 40, picture.shape), 0, 255).round().astype("u1")


def by_opencv(a, b):
    return round(cv2.quality.QualitySSIM_compute(a, b)[0][0], 4)


def by_skimage(a, b, data_range):
    return round(float(structural_similarity(a, b, data_range=data_range, gaussian_weights=True, sigma=1.5,
                                             use_sample_covariance=False)), 4)


floats = [(p / 255).astype("f4") for p in (picture, noisy)]
check("OpenCV, bytes", by_opencv(picture, noisy), 0.3114)
check("OpenCV, floats", by_opencv(*floats), 0.9995)
check("scikit-image, bytes", by_skimage(picture, noisy, 255), 0.3096)
check("scikit-image, floats", by_skimage(*floats, 1), 0.3096)
PY
