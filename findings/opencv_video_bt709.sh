#!/usr/bin/env bash
# OpenCV 4.12.0: VideoCapture gives other colours for HD video than 5.0.0, PyAV and ffmpeg do.
#
# Expected: a video's stream says by which matrix its luma and chroma come from RGB (H.264's matrix_coefficients,
#   which is BT.709 for nearly all HD cameras and phones), and a decoder undoes that matrix.
# Seen: OpenCV 4.12.0 undoes BT.601 whatever the stream says. 5.0.0 heeds it (so does 4.13.0).
# Output: a green of (0, 200, 0) comes as (15, 234, 5) from 4.12.0 and as (0, 199, 0) from 5.0.0, PyAV 18.1.0 and
#   ffmpeg.
# Matters: up to 34 of 255 in a channel. Frames taken by two programs, or before and after an update, do not fit
#   together: a second camera, a mask's colour threshold or an avatar's test set is off by more than it is trained to.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cat > look.py <<'PY'
import subprocess
import sys

import cv2
import numpy as np

version = cv2.__version__


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


if version.startswith("5"):
    import av
    import imageio_ffmpeg

    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    size = (1280, 720)
    frame = np.zeros((size[1], size[0], 3), "u1")
    frame[:] = (0, 200, 0)
    for name, matrix in (("bt709", "bt709"), ("bt601", "smpte170m")):
        subprocess.run([ffmpeg, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "1280x720",
                        "-r", "30", "-i", "-", "-vf", f"scale=out_color_matrix={name}:out_range=tv,format=yuv420p",
                        "-c:v", "libx264", "-qp", "0", "-colorspace", matrix, "-color_primaries", "bt709",
                        "-color_trc", "bt709", "-color_range", "tv", f"{name}.mp4"],
                       input=frame.tobytes() * 5, check=True)
    check("PyAV, BT.709", next(av.open("bt709.mp4").decode(video=0)).to_ndarray(format="rgb24")[360, 640].tolist(),
          [0, 199, 0])
    out = subprocess.run([ffmpeg, "-loglevel", "error", "-i", "bt709.mp4", "-frames:v", "1", "-f", "rawvideo",
                          "-pix_fmt", "rgb24", "-"], capture_output=True, check=True).stdout
    check("ffmpeg, BT.709", list(out[3 * (360 * 1280 + 640):][:3]), [0, 199, 0])


def first_colour(path):
    good, image = cv2.VideoCapture(path, cv2.CAP_FFMPEG).read()
    return image[360, 640, ::-1].tolist() if good else None


check(f"OpenCV {version}, BT.709", first_colour("bt709.mp4"), [0, 199, 0] if version.startswith("5") else [15, 234, 5])
check(f"OpenCV {version}, BT.601", first_colour("bt601.mp4"), [0, 199, 0])
PY
"${PYTHON:-python3}" -m venv venv5
venv5/bin/pip install --quiet --disable-pip-version-check \
    opencv-python-headless==5.0.0.93 av==18.1.0 imageio-ffmpeg==0.8.1 numpy==2.4.6
venv5/bin/python look.py
"${PYTHON:-python3}" -m venv venv4
venv4/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==4.12.0.88 numpy==2.2.6
venv4/bin/python look.py
