#!/usr/bin/env bash
# scikit-image 0.26.0, sewar 0.4.10, opencv-contrib 5.0.0: one pair of pictures, "SSIM" from 0.73 to 0.90 by default.
#
# Expected: SSIM as the paper of 2004 defines it and as papers on avatars report it: a Gaussian window of
#   11 x 11, sigma 1.5, population variances.
# Seen: by default scikit-image averages over a box of 7 x 7 with sample variances, sewar over a box of 11 x 11 (its
#   page says 8), OpenCV's quality module has the Gaussian but counts the reflected border.
# Output: for sigma 15 of noise: scikit-image 0.8133, sewar 0.9037, OpenCV 0.7338, the paper's 0.7349.
# Matters: the gap between libraries is larger than the gap between methods in any table. A number needs the call that
#   made it; scikit-image gives the paper's with gaussian_weights=True, sigma=1.5, use_sample_covariance=False.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    opencv-contrib-python-headless==5.0.0.93 scikit-image==0.26.0 sewar==0.4.10 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import cv2
import numpy as np
import sewar.full_ref
from scipy.ndimage import correlate1d
from skimage.metrics import structural_similarity


def check(what, seen, stated):
    print(f"{what}: {seen:.4f}")
    if round(float(seen), 4) != stated:
        sys.exit(f"changed: {what} was {stated}")


def paper(a, b):
    """SSIM of 2004 in plain words: 11 x 11 Gaussian, sigma 1.5, whole windows only, bytes."""
    window = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    window /= window.sum()

    def mean(v):
        return correlate1d(correlate1d(v, window, 0), window, 1)[5:-5, 5:-5]

    a, b = a.astype(float), b.astype(float)
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    ma, mb = mean(a), mean(b)
    va, vb, cov = mean(a * a) - ma**2, mean(b * b) - mb**2, mean(a * b) - ma * mb
    return ((2 * ma * mb + c1) * (2 * cov + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))).mean()


rng = np.random.default_rng(0)
y, x = np.mgrid[0:128, 0:128]
a = (127 + 100 * np.sin(0.2 * x) * np.cos(0.15 * y)).round().astype("u1")
b = np.clip(a + rng.normal(0, 15, a.shape), 0, 255).round().astype("u1")
check("paper", paper(a, b), 0.7349)
check("scikit-image, with three arguments",
      structural_similarity(a, b, gaussian_weights=True, sigma=1.5, use_sample_covariance=False), 0.7349)
check("scikit-image, default", structural_similarity(a, b), 0.8133)
check("sewar, default", sewar.full_ref.ssim(a, b)[0], 0.9037)
check("OpenCV, default", cv2.quality.QualitySSIM_compute(a, b)[0][0], 0.7338)
PY
