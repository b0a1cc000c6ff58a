#!/usr/bin/env bash
# pycolmap 4.2.1: a mask of half the photograph's size keeps the features that it should remove.
#
# Expected: COLMAP's FAQ asks of a mask its place and its name, and says that no features are taken where it is black.
#   A mask of another size is scaled to the photograph, or refused.
# Seen: it is looked up at the photograph's coordinates as it is, and beyond its edge counts as black. Nothing is
#   said. (A mask that is missing, in contrast, drops its photograph, with a line in the log.)
# Output: photograph of 640 x 480, mask black left of the middle. With 640 x 480 all features lie right of x = 320;
#   with 320 x 240 all lie between x = 160 and 320, y < 240: none where the mask is white in the picture.
# Matters: segmenters often answer at a lower resolution. The reconstruction is then made of background, or fails, and
#   the masks look right in every viewer.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pycolmap==4.2.1 pillow==13.0.0 numpy==2.4.6
venv/bin/python - 2>log.txt <<'PY'
import os
import sys

import numpy as np
import pycolmap
from PIL import Image

os.mkdir("photos")
cells = np.random.default_rng(0).integers(0, 256, (60, 80), dtype="u1")
Image.fromarray(np.kron(cells, np.ones((8, 8), "u1"))).convert("RGB").save("photos/a.jpg", quality=95)


def features(mask):
    folder = f"masks{mask.shape[1]}"
    os.mkdir(folder)
    Image.fromarray(mask).save(f"{folder}/a.jpg.png")
    database = f"{folder}.db"
    pycolmap.extract_features(database, "photos", reader_options=pycolmap.ImageReaderOptions(mask_path=folder),
                              device=pycolmap.Device.cpu)
    with pycolmap.Database.open(database) as opened:
        return opened.read_keypoints(opened.read_all_images()[0].image_id)[:, :2]


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        print(f"changed: {what} was {stated}")
        sys.exit(1)


mask = np.zeros((480, 640), "u1")
mask[:, 320:] = 255
whole = features(mask)
check("640 x 480: there are features", len(whole) > 500, True)
check("640 x 480: all lie where the mask is white", bool((whole[:, 0] >= 320).all()), True)
half = features(mask[::2, ::2])
check("320 x 240: there are features", len(half) > 100, True)
check("320 x 240: one lies where the mask is white", bool((half[:, 0] >= 320).any()), False)
x, y = half.T
check("320 x 240: all lie in the corner", bool(((x >= 160) & (x < 320) & (y < 240)).all()), True)
PY
