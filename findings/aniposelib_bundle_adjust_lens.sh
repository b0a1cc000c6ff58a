#!/usr/bin/env bash
# aniposelib 0.8.0: bundle_adjust sets all lens coefficients but the first to 0, and fx and fy to one number.
#
# Expected: Camera takes a matrix and five coefficients (four for FisheyeCamera), and project() and triangulate() use
#   them all. bundle_adjust "fine-tunes" cameras, so what it does not adjust stays as it was. Cameras that explain the
#   points exactly are left alone.
# Seen: it starts from the mean of fx and fy and from k1, and writes these back. fx and fy become one number. k2, p1, p2
#   and k3 become 0, silently. extra_dist=True saves k2 only. With only_extrinsics=True, the lens stays as it was.
# Output: four cameras that are exact to 0.001 px. Afterwards the points that were adjusted fit to 0.06 px, which looks
#   well. A point at the edge of the picture lands 38 px away from where it was. A fisheye camera keeps one coefficient
#   of four.
# Matters: a calibrated rig is refined with a person in its middle, and what is projected or undistorted at the edges
#   no longer fits the photographs. Pass only_extrinsics=True, or compare the cameras before and after.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check aniposelib==0.8.0 numpy==2.4.6 scipy==1.17.1 \
  opencv-contrib-python==5.1.0.95 numba==0.68.1 jax==0.10.2 pandas==3.1.1
venv/bin/python -W ignore - <<'PY'
import sys

import cv2
import numpy as np
from aniposelib.cameras import Camera, CameraGroup, FisheyeCamera


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


points = np.random.default_rng(7).uniform((-0.8, -0.9, -0.8), (0.8, 0.9, 0.8), (300, 3))
lens = (-0.3, 0.12, 0.0008, -0.0005, -0.02)


def rig(kind, coefficients, **options):
    """Four cameras 2.5 m around the points."""
    cameras = []
    for angle in (-0.6, -0.2, 0.2, 0.6):
        matrix = np.array([[1000.0, 0, 960], [0, 1002.0, 540], [0, 0, 1]])
        cameras.append(kind(matrix, coefficients, (1920, 1080), np.array([0, angle, 0]), np.array([0, 0, 2.5]),
                            f"camera {angle}", **options))
    return CameraGroup(cameras)


def adjusted(group, **options):
    """The group after the adjustment to its own, exact pictures of the points; and the error in pixels."""
    pictures = group.project(points).reshape(4, -1, 2)
    check("  exact before", bool(group.average_error(pictures) < 0.001), True)
    return group, group.bundle_adjust(pictures, verbose=False, **options)


def kept(group):
    return [int(np.count_nonzero(camera.get_distortions())) for camera in group.cameras]


def one_focal_length(group):
    return all(fx == fy for fx, fy in (camera.get_focal_length(both=True) for camera in group.cameras))


def shift(group):
    """How far the picture of a point near the first camera's left edge has moved, in pixels."""
    camera = rig(Camera, lens).cameras[0]
    rotation = cv2.Rodrigues(camera.get_rotation())[0]
    edge = rotation.T @ (np.array([-2.0, -1.0, 2.5]) - camera.get_translation())
    where = camera.project(edge[None]).ravel()
    check("  in the picture of the first camera", bool((where > 0).all() and (where < (1920, 1080)).all()), True)
    return float(np.linalg.norm(group.cameras[0].project(edge[None]).ravel() - where))


print("by default:")
group, error = adjusted(rig(Camera, lens))
check("  coefficients left of five", kept(group), [1, 1, 1, 1])
check("  fx is fy", one_focal_length(group), True)
moved = shift(group)
print(f"  error of the points {error:.3f} px, of the one at the edge {moved:.1f} px")
check("  points within 0.02 to 0.1 px", bool(0.02 < error < 0.1), True)
check("  edge off by 20 to 60 px", 20 < moved < 60, True)

print("with extra_dist=True:")
group, error = adjusted(rig(Camera, lens, extra_dist=True))
check("  coefficients left of five", kept(group), [2, 2, 2, 2])

print("with only_extrinsics=True:")
group, error = adjusted(rig(Camera, lens), only_extrinsics=True)
check("  coefficients left of five", kept(group), [5, 5, 5, 5])
check("  edge stays", shift(group) < 0.01, True)

print("a fisheye camera:")
group, error = adjusted(rig(FisheyeCamera, (0.05, 0.01, -0.004, 0.001)))
check("  coefficients left of four", kept(group), [1, 1, 1, 1])
PY
