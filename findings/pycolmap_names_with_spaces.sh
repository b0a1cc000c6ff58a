#!/usr/bin/env bash
# pycolmap 4.2.1: a model in text form loses what follows the first space in an image's name.
#
# Expected: what write_text() writes read_text() reads. COLMAP's documentation gives the text and the binary form as
#   the same content; the name is the last field of images.txt, so a space in it could be told from a separator.
# Seen: write_text() writes names as they are, read_text() takes the first word of the name. Names may become
#   equal, as find_image_with_name() and the image files then show. The binary form keeps them.
# Output: "WhatsApp Image 1.jpg" and "WhatsApp Image 2.jpg" are both read as "WhatsApp".
# Matters: pictures from phones and messengers have such names. The error appears far away, as an image file that
#   is missing, or as one photograph under two cameras.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pycolmap==4.2.1 numpy==2.4.6
venv/bin/python - <<'PY'
import os
import sys

import numpy as np
import pycolmap


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


names = ["WhatsApp Image 1.jpg", "WhatsApp Image 2.jpg", "left/001.jpg"]
model = pycolmap.Reconstruction()
camera = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240], camera_id=1)
model.add_camera_with_trivial_rig(camera)
for i, name in enumerate(names, 1):
    image = pycolmap.Image(name=name, camera_id=1, image_id=i)
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0.0, 0.0, i])))
for folder in ("text", "binary"):
    os.mkdir(folder)
model.write_text("text")
model.write_binary("binary")


def read(method, folder):
    back = pycolmap.Reconstruction()
    getattr(back, method)(folder)
    return [back.images[i].name for i in sorted(back.images)]


with open("text/images.txt") as f:
    check("the file holds the whole name", sum("WhatsApp Image 1.jpg" in line for line in f), 1)
check("binary", read("read_binary", "binary"), names)
check("text", read("read_text", "text"), ["WhatsApp", "WhatsApp", "left/001.jpg"])
PY
