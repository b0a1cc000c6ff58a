#!/usr/bin/env bash
# OpenCV 4.12.0: corners of ChArUco boards are half a pixel off, in x and in y; 5.0.0's are not.
#
# Expected: OpenCV's image coordinates have their origin in the centre of the first pixel (its page on resize and
#   warping, and cornerSubPix, agree on it). CharucoDetector and cornerSubPix then find the same corner.
# Seen: 4.12.0's CharucoDetector returns every corner 0.50 to the right and 0.50 down of where the picture has it (so
#   does 4.13.0). cornerSubPix, started from these, goes back by half a pixel. 5.0.0 is right (so is 4.14.0), and gives
#   an array of (n, 2) where 4.12.0 gave (n, 1, 2).
# Output: mean of 24 corners under three perspectives: (0.50, 0.50) px off in 4.12.0, (0.00, 0.00) within 0.03 in
#   5.0.0.
# Matters: a calibration by ChArUco puts the principal point half a pixel off with residuals as small as ever; only a
#   comparison with chessboards, COLMAP or rendered masks shows it. Calibrations of the two versions must not be mixed
#   in one rig.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cat > look.py <<'PY'
import sys

import cv2
import numpy as np

five = cv2.__version__.startswith("5")


def check(what, seen, stated):
    print(f"OpenCV {cv2.__version__}, {what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


# A board of 5 x 7 squares of 400 pixels with a white edge of 200, drawn large; squares begin between two pixels.
board = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.02, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
drawing = cv2.copyMakeBorder(board.generateImage((2000, 2800), marginSize=0), 200, 200, 200, 200,
                             cv2.BORDER_CONSTANT, value=255)
detector = cv2.aruco.CharucoDetector(board)
found, refined = [], []
for tilt in (1, 2, 3):
    view = np.array([[0.25, 0.02 * tilt, 30], [0.01 * tilt, 0.25, 20], [1e-5 * tilt, 2e-5 * tilt, 1]])
    # 4 x 4 samples a pixel, then their mean: centres of pixels stay at whole numbers.
    fine = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]]) @ view
    samples = cv2.warpPerspective(drawing, fine, (2800, 3600), flags=cv2.INTER_LINEAR, borderValue=255)
    picture = cv2.resize(samples, (700, 900), interpolation=cv2.INTER_AREA)
    corners, ids, _, _ = detector.detectBoard(picture)
    check(f"tilt {tilt}, shape of the corners", corners.shape, (24, 2) if five else (24, 1, 2))
    corners, ids = corners.reshape(-1, 2), ids.ravel()
    drawn = np.stack([(ids % 4 + 1) * 400 + 199.5, (ids // 4 + 1) * 400 + 199.5], 1)
    true = cv2.perspectiveTransform(drawn[None], view)[0]
    better = cv2.cornerSubPix(picture, corners.astype("f4").reshape(-1, 1, 2).copy(), (5, 5), (-1, -1), (3, 50, 1e-4))
    found.append(corners - true)
    refined.append(better.reshape(-1, 2) - true)
found, refined = (np.concatenate(v).mean(axis=0) for v in (found, refined))
print("off by", found.round(3), "after cornerSubPix", refined.round(3))
stated = 0.0 if five else 0.5
check("corners are off by this, within 0.03", bool(np.abs(found - stated).max() < 0.03), True)
check("after cornerSubPix by nothing, within 0.03", bool(np.abs(refined).max() < 0.03), True)
PY
"${PYTHON:-python3}" -m venv venv4
venv4/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==4.12.0.88 numpy==2.2.6
venv4/bin/python look.py
"${PYTHON:-python3}" -m venv venv5
venv5/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
venv5/bin/python look.py
