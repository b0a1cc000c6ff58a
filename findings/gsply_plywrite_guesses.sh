#!/usr/bin/env bash
# gsply 0.4.6: plywrite() given arrays guesses from the numbers whether they are logarithms, and may guess wrong.
#
# Expected: what plyread() returned and unpack() handed out is written back as it was. The package's first
#   page shows exactly that: `means, scales, quats, opacities, sh0, shN = data.unpack()`, then
#   `plywrite("output.ply", means, scales, quats, opacities, sh0, shN)`.
# Seen: scales without a negative one, and below 10, count as linear, and opacities of which more than 95 % lie
#   in 0 to 1 as alphas; plywrite() takes logarithm or logit of them once more. Nothing is said.
# Output: sigmas of 2 to 8 mm in a scene in millimetres shrink from a median of 4.95 to 1.60;
#   an alpha of 0.715, whose logit is 0.921, becomes an alpha of 0.921.
# Matters: bodies are often in millimetres (C3D, many scans), where all log-scales are positive. Passing the
#   GSData object instead of its arrays is safe.
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


rng = np.random.default_rng(0)
count = 1000
scales = np.log(rng.uniform(2, 8, (count, 3))).astype("f4")
logits = rng.uniform(0.05, 0.95, count).astype("f4")
rest = {"means": (rng.normal(size=(count, 3)) * 400).astype("f4"),
        "quats": rng.normal(size=(count, 4)).astype("f4"), "sh0": rng.normal(size=(count, 3)).astype("f4")}
gsply.GSData.from_arrays(scales=scales.copy(), opacities=logits.copy(), format="ply", **rest).save("in.ply")

data = gsply.plyread("in.ply")
check("the object is read as it was written",
      bool(np.allclose(data.scales, scales) and np.allclose(data.opacities, logits)), True)
gsply.plywrite("same.ply", gsply.plyread("in.ply"))
same = gsply.plyread("same.ply")
check("the object is written as it is",
      bool(np.allclose(same.scales, scales) and np.allclose(same.opacities, logits)), True)

gsply.plywrite("out.ply", *data.unpack())
back = gsply.plyread("out.ply")
check("scales are the logarithm of the logarithm", bool(np.allclose(back.scales, np.log(scales), atol=1e-5)), True)
check("opacities are the logit of the logit",
      bool(np.allclose(back.opacities, np.log(logits / (1 - logits)), atol=1e-4)), True)
print("median sigma in and out, mm:", float(np.median(np.exp(scales))), float(np.median(np.exp(back.scales))))
PY
