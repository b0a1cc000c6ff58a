#!/usr/bin/env bash
# Six libraries make six things of a mirrored "rotation matrix", and only SciPy refuses it.
#
# Expected: a matrix of determinant -1 is no rotation, and a function that turns matrices into rotations says so, as
#   scipy 1.17.1 does ("Non-positive determinant (left-handed or null coordinate frame)").
# Seen: opencv 5.0.0, pycolmap 4.2.1, numpy-quaternion 2024.0.13, transforms3d 0.4.2, trimesh 5.2.0 and usd-core 26.11
#   give an answer each, without an error or a warning.
# Output for diag(1, 1, -1): OpenCV a quarter turn about (1, 1, 0); pycolmap (w, x, y, z) = (0.707, 0, 0, 0) and
#   usd-core (0, 0, 0.707, 0), of length 0.707; the three others a unit quaternion that their eigenvalue routine happens
#   upon (here no turn, and twice a half turn about y).
# Matters: cameras and bones out of left-handed programs (Unity, Unreal, DirectX captures) arrive as such matrices
#   when one axis is flipped on one side only. The result looks like a badly calibrated camera, not like a mirror.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 pycolmap==4.2.1 \
    numpy-quaternion==2024.0.13 transforms3d==0.4.2 trimesh==5.2.0 usd-core==26.11 scipy==1.17.1 numpy==2.4.6
venv/bin/python - <<'PY'
import sys
import warnings

import cv2
import numpy as np
import pycolmap
import quaternion
import transforms3d
import trimesh
from pxr import Gf
from scipy.spatial.transform import Rotation

warnings.simplefilter("error")


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def rounded(values):
    return [round(float(x), 3) + 0.0 for x in values]


def by_opencv(m):
    return rounded(cv2.Rodrigues(m)[0].ravel())  # axis times angle


def by_pycolmap(m):
    x, y, z, w = pycolmap.Rotation3d(m).quat
    return rounded((w, x, y, z))


def by_numpy_quaternion(m):
    return rounded(quaternion.as_float_array(quaternion.from_rotation_matrix(m)))


def by_transforms3d(m):
    return rounded(transforms3d.quaternions.mat2quat(m))


def by_trimesh(m):
    whole = np.eye(4)
    whole[:3, :3] = m
    return rounded(trimesh.transformations.quaternion_from_matrix(whole))


def by_usd(m):
    q = Gf.Matrix4d(Gf.Matrix3d(*m.T.ravel()), Gf.Vec3d(0)).ExtractRotationQuat()
    return rounded((q.GetReal(), *q.GetImaginary()))


mirror = np.diag([1.0, 1.0, -1.0])
check("OpenCV", by_opencv(mirror), [1.111, 1.111, 0.0])
check("pycolmap", by_pycolmap(mirror), [0.707, 0.0, 0.0, 0.0])
check("usd-core", by_usd(mirror), [0.0, 0.0, 0.707, 0.0])
for function in (by_numpy_quaternion, by_transforms3d, by_trimesh):
    q = function(mirror)
    print(f"{function.__name__}: {q}")
    check("its length", round(float(np.linalg.norm(q)), 3), 1.0)
try:
    Rotation.from_matrix(mirror)
    sys.exit("changed: scipy takes a mirror")
except ValueError as error:
    print("scipy:", str(error).split(":")[0])
PY
