#!/usr/bin/env bash
# imageio 2.38.1: its two plugins give an upright phone video upright and lying.
#
# Expected: one library, one file, one picture. A phone held upright records lying frames and a display matrix in the
#   MP4 that turns them; players apply it.
# Seen: plugin "FFMPEG" applies the matrix, plugin "pyav" does not, and neither does PyAV 18.1.0 itself, whose frames
#   carry `rotation` instead. Left to itself, imread() takes FFMPEG where imageio-ffmpeg is installed and
#   pyav where only PyAV is. The FFMPEG plugin warns about the size; its metadata says `rotate: 0`.
# Output: 64 x 48 turned by 90 degrees: shape (64, 48, 3) by FFMPEG, (48, 64, 3) by pyav.
# Matters: the same script gives upright people on one computer and lying ones on another, and intrinsics fit one of
#   the two.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check imageio==2.38.1 imageio-ffmpeg==0.8.1 av==18.1.0 numpy==2.4.6
venv/bin/python - <<'PY' 2>/dev/null
import subprocess
import sys

import av
import imageio.v3 as iio
import imageio_ffmpeg
import numpy as np


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        print(f"changed: {what} was {stated}")
        sys.exit(1)


ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
subprocess.run([ffmpeg, "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "64x48", "-r", "30", "-i", "-", "-c:v", "libx264",
                "-pix_fmt", "yuv420p", "lying.mp4"], input=bytes(64 * 48 * 3 * 5), check=True)
subprocess.run([ffmpeg, "-display_rotation", "90", "-i", "lying.mp4", "-c", "copy", "upright.mp4"], check=True)
check("FFMPEG", iio.imread("upright.mp4", index=0, plugin="FFMPEG").shape, (64, 48, 3))
check("FFMPEG's metadata", iio.immeta("upright.mp4", plugin="FFMPEG")["rotate"], 0)
check("pyav", iio.imread("upright.mp4", index=0, plugin="pyav").shape, (48, 64, 3))
frame = next(av.open("upright.mp4").decode(video=0))
check("PyAV itself", (frame.height, frame.width, frame.rotation), (48, 64, 90))
check("by itself, with both installed", iio.imread("upright.mp4", index=0).shape, (64, 48, 3))
PY
