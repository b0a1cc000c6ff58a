#!/usr/bin/env bash
# gsply 0.4.6: saving a GSData that holds linear values changes the object and the caller's own arrays.
#
# Expected: writing a file leaves what is written as it is. save() is documented as "save to PLY file", and
#   from_arrays(..., format="linear") as the way to wrap a renderer's linear scales and opacities.
# Seen: save() converts to logarithms and logits in place, in the very arrays that the caller passed in, and
#   clamps alpha to 0.0001 .. 0.9999 on the way.
# Output: a scale of 0.01 is -4.6052 after save(), opacities 0, 0.5, 1 are -9.2102, 0, 9.2101.
# Matters: a training loop that saves a snapshot goes on with logarithms where it had lengths.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gsply==0.4.6 numpy==2.4.6 numba==0.68.1
venv/bin/python - <<'PY'
import sys

import gsply
import numpy as np


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


scales = np.full((3, 3), 0.01, "f4")
opacities = np.array([0, 0.5, 1], "f4")
data = gsply.GSData.from_arrays(means=np.eye(3, dtype="f4"), scales=scales, opacities=opacities,
                                quats=np.tile(np.array([1, 0, 0, 0], "f4"), (3, 1)),
                                sh0=np.zeros((3, 3), "f4"), format="linear")
data.save("snapshot.ply")
check("the caller's scales after save()", round(float(scales[0, 0]), 4), -4.6052)
check("the caller's opacities after save()", [round(float(x), 4) for x in opacities], [-9.2102, 0.0, 9.2101])
check("the object says that it is linear", data.is_scales_linear, False)
PY
