#!/usr/bin/env bash
# OpenCV 4.12.0 and 5.0.0: in a video of variable rate, set(CAP_PROP_POS_FRAMES, k) goes to another frame than the k-th.
#
# Expected: the property is the "0-based index of the frame to be decoded next". Reading one by one gives all frames,
#   and CAP_PROP_FRAME_COUNT counts them rightly.
# Seen: the index is turned into a time by the mean rate, so after the rate has changed it is another frame, and near
#   the end there is none. get(CAP_PROP_POS_FRAMES) shows the index that was asked for.
# Output: 120 frames, 60 at 30 a second and 60 at 15: for 60 comes 70, for 90 comes 108, for 119 none.
# Matters: phones record so (the rate drops in the dark). Frames picked by index, as annotation tools and loaders do,
#   carry the masks, poses and keypoints of others. Read in order, or go by CAP_PROP_POS_MSEC.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cat > look.py <<'PY'
import os
import subprocess
import sys

import cv2
import numpy as np


def check(what, seen, stated):
    print(f"OpenCV {cv2.__version__}, {what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def frame(number):
    """Eight bars that spell the number in bits."""
    image = np.zeros((48, 64, 3), "u1")
    for bit in range(8):
        image[:, 8 * bit:8 * bit + 8] = 255 * (number >> bit & 1)
    return image


def number(image):
    return sum(int(image[24, 8 * bit + 4].mean() > 127) << bit for bit in range(8))


if not os.path.exists("constant.mp4"):
    import imageio_ffmpeg

    raw = b"".join(frame(i).tobytes() for i in range(120))
    times = "setpts='if(lt(N,60),N,60+(N-60)*2)/(30*TB)'"
    for name, options in (("constant.mp4", []), ("variable.mp4", ["-vf", times, "-fps_mode", "vfr"])):
        subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
                        "-s", "64x48", "-r", "30", "-i", "-", *options, "-c:v", "libx264", "-crf", "5",
                        "-pix_fmt", "yuv420p", name], input=raw, check=True)


def in_order(path):
    video = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
    found = []
    while (read := video.read())[0]:
        found.append(number(read[1]))
    return found, int(video.get(cv2.CAP_PROP_FRAME_COUNT))


def by_index(path, k):
    video = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
    video.set(cv2.CAP_PROP_POS_FRAMES, k)
    good, image = video.read()
    return number(image) if good else None


wanted = [0, 30, 59, 60, 70, 90, 119]
for path in ("constant.mp4", "variable.mp4"):
    check(f"{path} in order", in_order(path) == (list(range(120)), 120), True)
check("constant.mp4 by index", [by_index("constant.mp4", k) for k in wanted], wanted)
check("variable.mp4 by index", [by_index("variable.mp4", k) for k in wanted], [0, 30, 69, 70, 88, 108, None])
PY
"${PYTHON:-python3}" -m venv venv5
venv5/bin/pip install --quiet --disable-pip-version-check \
    opencv-python-headless==5.0.0.93 imageio-ffmpeg==0.8.1 numpy==2.4.6
venv5/bin/python look.py
"${PYTHON:-python3}" -m venv venv4
venv4/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==4.12.0.88 numpy==2.2.6
venv4/bin/python look.py
