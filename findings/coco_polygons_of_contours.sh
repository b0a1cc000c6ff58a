#!/usr/bin/env bash
# OpenCV 5.0.0 and pycocotools 2.0.11: a mask saved as a COCO polygon of its contour loses a row and a column.
#
# Expected: mask to polygon (findContours) to mask (frPyObjects, decode) is the way that most annotation scripts go,
#   and gives the mask back.
# Seen: OpenCV's contour goes through the *centres* of the outermost pixels, counted from 0, and COCO's polygons are
#   outlines in coordinates whose pixel 0 spans 0 to 1. So the mask shrinks by one pixel at its right and lower edge.
#   The other way, fillPoly() of a COCO outline gains a row and a column.
# Output: 10 x 10 pixels become 9 x 9; a limb of 2 x 30 pixels becomes 1 x 29; fillPoly() of the outline of 10 x 10
#   gives 11 x 11.
# Matters: a pixel is much of a wrist or a finger in a picture of a whole person, and it is always missing on the same
#   side, so silhouettes pull the body up and left.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    opencv-python-headless==5.0.0.93 pycocotools==2.0.11 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import cv2
import numpy as np
from pycocotools import mask as coco


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def box(mask):
    """Rows and columns that a mask fills: first, last of each."""
    rows, columns = np.nonzero(mask)
    assert len(rows) == (np.ptp(rows) + 1) * (np.ptp(columns) + 1), "no rectangle"
    return [int(x) for x in (rows.min(), rows.max(), columns.min(), columns.max())]


def drawn(polygon):
    return coco.decode(coco.merge(coco.frPyObjects([polygon], 40, 40)))


def through_contour(mask):
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return drawn(contours[0].reshape(-1).astype(float).tolist())


square = np.zeros((40, 40), "u1")
square[10:20, 10:20] = 1
check("10 x 10", box(through_contour(square)), [10, 18, 10, 18])
limb = np.zeros((40, 40), "u1")
limb[5:35, 10:12] = 1
check("2 x 30", box(through_contour(limb)), [5, 33, 10, 10])
outline = [10.0, 10.0, 20.0, 10.0, 20.0, 20.0, 10.0, 20.0]
check("COCO draws the outline of 10 x 10", bool((drawn(outline) == square).all()), True)
filled = cv2.fillPoly(np.zeros_like(square), [np.array(outline, np.int32).reshape(-1, 2)], 1)
check("OpenCV draws it", box(filled), [10, 20, 10, 20])
PY
