#!/usr/bin/env bash
# pycolmap 4.2.1: Rotation3d of a quaternion that is not of length 1 is no rotation, silently.
#
# Expected: Rotation3d normalises, as scipy's Rotation does, or refuses. (COLMAP itself normalises what it reads from
#   images.txt.)
# Seen: the quaternion is kept as it is, and what it does to a point is neither a turn nor a turn and a scale.
# Output: for (x, y, z, w) = (0, 0, 1, 2) the point (1, 0, 0) goes to (-1, 4, 0), of length 4.12 and 51 degrees off
#   (0.6, 0.8, 0), where the normalised quaternion takes it; z keeps its length.
# Matters: rot_0 … rot_3 of Gaussians, poses of optimisers and rounded text are seldom of length 1. A Rigid3d made of
#   them bends the scene.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pycolmap==4.2.1 scipy==1.17.1 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import numpy as np
import pycolmap
from scipy.spatial.transform import Rotation


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def rounded(values):
    return [round(float(x), 3) + 0.0 for x in values]


point = np.array([1.0, 0.0, 0.0])
free = np.array([0.0, 0.0, 1.0, 2.0])
turn = pycolmap.Rotation3d(free)
check("scipy", rounded(Rotation.from_quat(free).apply(point)), [0.6, 0.8, 0.0])
check("matrix() times the point", rounded(turn.matrix() @ point), [-1.0, 4.0, 0.0])
check("the rotation times the point", rounded(turn * point), [-1.0, 4.0, 0.0])
check("the rotation times (0, 0, 1)", rounded(turn * np.array([0.0, 0.0, 1.0])), [0.0, 0.0, 1.0])
PY
