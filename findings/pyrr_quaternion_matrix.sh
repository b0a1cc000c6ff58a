#!/usr/bin/env bash
# pyrr 0.10.3: a quaternion and its own matrix turn a vector in opposite directions, and Euler angles about other axes.
#
# Expected: `q * v`, `q.matrix33 * v` and `q.matrix44 * v` are the same vector, since the class converts between the
#   forms. from_eulers of Quaternion and of Matrix33 take the same triple and give one rotation.
# Seen: with q = Quaternion.from_z_rotation(pi / 2), `q * v` turns x to y, and `q.matrix33 * v` turns x to -y. The
#   matrix is the usual one for columns, but `matrix * v` is the row v times the matrix. So the two turns are each
#   other's inverse, for any q. from_eulers of (0, 0.3, 0) turns about y as a quaternion and about z as a matrix.
#   `q * v` with a v of whole numbers is computed in whole numbers, and a unit vector becomes 0.
# Output: the three products, the axes of from_eulers for each of the three angles, and the vector of whole numbers.
# Matters: a skeleton's joints turn the other way as soon as a program changes from quaternions to matrices, or passes a
#   matrix to another library. Nothing warns, and each form for itself is consistent.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyrr==0.10.3 numpy==2.4.6 multipledispatch==1.0.0
venv/bin/python - <<'PY'
import sys

import numpy as np
from pyrr import Matrix33, Quaternion, Vector3


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def rounded(vector):
    return (np.round(np.asarray(vector, float), 6) + 0.0).tolist()


quarter = Quaternion.from_z_rotation(np.pi / 2)
x = Vector3([1.0, 0.0, 0.0])
check("q * x", rounded(quarter * x), [0, 1, 0])
check("q.matrix33 * x", rounded(quarter.matrix33 * x), [0, -1, 0])
check("q.matrix44 * x", rounded(quarter.matrix44 * x), [0, -1, 0])
check("Matrix33.from_z_rotation * x", rounded(Matrix33.from_z_rotation(np.pi / 2) * x), [0, -1, 0])
check("np.asarray(q.matrix33) @ x", rounded(np.asarray(quarter.matrix33) @ np.asarray(x)), [0, 1, 0])

inverse = True
for numbers in np.random.default_rng(7).normal(size=(1000, 7)):
    q, v = Quaternion(numbers[:4]).normalized, Vector3(numbers[4:])
    inverse = inverse and np.allclose(np.asarray(q.matrix33 * v), np.asarray(~q * v))
check("q.matrix33 * v is ~q * v for 1000 random pairs", inverse, True)


def axis(rotation):
    """The axis of a quaternion that turns about one of the three, by the letter."""
    return "xyz"[int(np.argmax(np.abs(np.asarray(rotation)[:3])))]


for place, quaternion, matrix in (0, "x", "x"), (1, "y", "z"), (2, "z", "y"):
    angles = np.zeros(3)
    angles[place] = 0.3
    check(f"axes of from_eulers({angles.tolist()}) as quaternion and as matrix",
          axis(Quaternion.from_eulers(angles)) + axis(Quaternion(Matrix33.from_eulers(angles))), quaternion + matrix)

check("q * [1, 0, 0]", rounded(quarter * Vector3([1, 0, 0])), [0, 0, 0])
PY
