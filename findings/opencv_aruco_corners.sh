#!/usr/bin/env bash
# OpenCV 5.0.0: the four ways to refine a marker's corners give four markers, of other sizes and places.
#
# Expected: corner refinement (DetectorParameters.cornerRefinementMethod) trades time for noise; each way aims at the
#   corner as drawn, in coordinates whose origin is the centre of the first pixel.
# Seen: the default (none) and CONTOUR give markers that are too small on every side: the outermost black pixels'
#   centres are taken for the edge. APRILTAG gives the right size half a pixel to the right and down (AprilTag counts
#   from the first pixel's corner, and nothing is subtracted). SUBPIX alone is right. 4.12.0 does the same.
# Output: over 20 views of a marker of 120 pixels, each corner's distance inwards and the marker's shift: none 0.4 and
#   0.0, SUBPIX 0.1 and 0.0, CONTOUR 0.6 and 0.0, APRILTAG 0.0 and 0.4 to 0.5 px.
# Matters: at 120 pixels CONTOUR makes a marker one per cent smaller, so the camera is put one per cent too far away;
#   APRILTAG shifts the principal point, as nothing else in a rig does.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import cv2
import numpy as np

aruco = cv2.aruco
marks = aruco.getPredefinedDictionary(aruco.DICT_4X4_50)
drawing = cv2.copyMakeBorder(aruco.generateImageMarker(marks, 3, 1200), 600, 600, 600, 600,
                             cv2.BORDER_CONSTANT, value=255)
square = np.array([[599.5, 599.5], [1799.5, 599.5], [1799.5, 1799.5], [599.5, 1799.5]])
inwards = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
ways = {"none": aruco.CORNER_REFINE_NONE, "SUBPIX": aruco.CORNER_REFINE_SUBPIX,
        "CONTOUR": aruco.CORNER_REFINE_CONTOUR, "APRILTAG": aruco.CORNER_REFINE_APRILTAG}
off = {name: [] for name in ways}
rng = np.random.default_rng(0)
for _ in range(20):
    view = np.array([[0.1, 0.01 * rng.normal(), 30 + rng.uniform()], [0.01 * rng.normal(), 0.1, 20 + rng.uniform()],
                     [3e-6 * rng.normal(), 3e-6 * rng.normal(), 1]])
    # 4 x 4 samples a pixel, then their mean: centres of pixels stay at whole numbers.
    fine = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]]) @ view
    samples = cv2.warpPerspective(drawing, fine, (1600, 1600), flags=cv2.INTER_LINEAR, borderValue=255)
    picture = cv2.resize(samples, (400, 400), interpolation=cv2.INTER_AREA)
    true = cv2.perspectiveTransform(square[None], view)[0]
    for name, way in ways.items():
        parameters = aruco.DetectorParameters()
        parameters.cornerRefinementMethod = way
        corners, _, _ = aruco.ArucoDetector(marks, parameters).detectMarkers(picture)
        off[name].append(corners[0].reshape(4, 2) - true)


def near(what, seen, stated):
    print(f"{what}: {seen:.2f}")
    if abs(seen - stated) > 0.05:
        sys.exit(f"changed: {what} was {stated}")


stated = {"none": (0.36, 0.0), "SUBPIX": (0.09, 0.0), "CONTOUR": (0.58, 0.0), "APRILTAG": (0.03, 0.45)}
for name, errors in off.items():
    mean = np.array(errors).mean(axis=0)
    near(f"{name}, inwards", float((mean * inwards).mean()), stated[name][0])
    near(f"{name}, to the right", float(mean[:, 0].mean()), stated[name][1])
    near(f"{name}, down", float(mean[:, 1].mean()), stated[name][1])
PY
