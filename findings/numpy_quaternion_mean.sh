#!/usr/bin/env bash
# numpy-quaternion 2024.0.13: the mean of rotations hangs on the signs of their quaternions.
#
# Expected: q and -q are one rotation. mean_rotor_in_chordal_metric() returns the "rotor that is closest to all R",
#   and scipy's Rotation.mean(), which minimises the same distance, gives one answer for either sign.
# Seen: the components are added as they are and normalised. With one sign changed the mean of two near rotations is
#   nearly opposite to both; of q and -q it is NaN.
# Output: turns of 0.1 and 0.3 about z have the mean 0.2; with the second quaternion negated it is -2.9416 (0.2 less
#   half a turn).
# Matters: quaternions from trackers, from matrices and from files have either sign; averaging skinning rotations or
#   camera orientations with it works until one of them crosses over.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy-quaternion==2024.0.13 scipy==1.17.1 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import numpy as np
import quaternion
from scipy.spatial.transform import Rotation


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def mean(a, b):
    q = quaternion.mean_rotor_in_chordal_metric(np.array([a, b]))
    return round(float(quaternion.as_rotation_vector(q)[2]), 4)


def by_scipy(a, b):
    q = quaternion.as_float_array(np.array([a, b]))
    return round(float(Rotation.from_quat(q, scalar_first=True).mean().as_rotvec()[2]), 4)


a, b = (quaternion.from_rotation_vector([0, 0, angle]) for angle in (0.1, 0.3))
check("mean", mean(a, b), 0.2)
check("mean, one sign changed", mean(a, -b), -2.9416)
check("scipy", by_scipy(a, b), 0.2)
check("scipy, one sign changed", by_scipy(a, -b), 0.2)
both = quaternion.as_float_array(quaternion.mean_rotor_in_chordal_metric(np.array([a, -a])))
check("mean of q and -q is NaN", bool(np.isnan(both).all()), True)
PY
