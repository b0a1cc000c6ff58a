#!/usr/bin/env bash
# gsplat 1.5.3 (PyPI): DefaultStrategy never resets opacities.
#
# Expected: as its documentation says ("Periodically reset GSs to a lower opacity", reset_every = 3000), opacities are
#   at most 2 * prune_opa = 0.01 after steps 3000, 6000 and so on.
# Seen: they stay as they are. The condition is `step % self.reset_every == 0 & step > 0`; & binds closer than ==, so
#   this is `(step % reset_every == 0) and (0 > 0)`.
# Output: "largest opacity after step 3000: 0.8808".
# Matters: density control after Kerbl et al. relies on the reset to prune what is not seen. Trainings with the released
#   gsplat, and comparisons with it, are without it. gsplat's main branch has `and` in this place.
# It needs 6 GB of disk, for torch.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check torch==2.15.0 numpy==2.4.6 rich
venv/bin/pip install --quiet --disable-pip-version-check --no-deps gsplat==1.5.3 jaxtyping
venv/bin/python - <<'PY'
import sys

import torch
from gsplat import DefaultStrategy

shapes = {"means": (4, 3), "scales": (4, 3), "quats": (4, 4), "opacities": (4,)}
params = {name: torch.nn.Parameter(torch.full(shape, 2.0)) for name, shape in shapes.items()}
optimizers = {name: torch.optim.Adam([{"params": [p], "name": name}]) for name, p in params.items()}
for name, p in params.items():
    p.grad = torch.zeros_like(p)
    optimizers[name].step()
strategy = DefaultStrategy(refine_start_iter=10**6)  # nothing else changes
state = strategy.initialize_state()
means2d = torch.zeros(1, 4, 2, requires_grad=True)
means2d.grad = torch.zeros(1, 4, 2)
info = {"width": 10, "height": 10, "n_cameras": 1, "radii": torch.ones(1, 4, 2, dtype=torch.int32),
        "gaussian_ids": None, "means2d": means2d}
assert strategy.reset_every == 3000
for step in (3000, 6000):
    strategy.step_post_backward(params, optimizers, state, step, info)
    largest = torch.sigmoid(params["opacities"]).max().item()
    print(f"largest opacity after step {step}: {largest:.4f}")
    if largest < 0.5:
        sys.exit("changed: opacities are reset")
PY
