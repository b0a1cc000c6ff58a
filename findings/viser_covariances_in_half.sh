#!/usr/bin/env bash
# viser 1.1.1: Gaussians finer than 0.17 mm vanish, flat ones of millimetres get impossible covariances.
#
# Expected: add_gaussian_splats() takes float covariances ("second moment for each Gaussian") in metres, and shows
#   them with the precision of a screen.
# Seen: the six numbers are sent as half floats, whose smallest step is 6e-8. A covariance is a length squared, so in
#   metres that is a sigma of 0.24 mm, and what is below 0.17 mm becomes 0. The entries of a turned flat Gaussian are
#   rounded one by one, so many are no covariance any more (a negative eigenvalue). From 256 on (a scene in millimetres)
#   they are infinite. There is no option for more bits, and no word in the page.
# Output: sigma 1 mm is kept within 1 %, 0.2 mm becomes 0.244 mm, 0.17 mm becomes 0; of 1,000 turned Gaussians with
#   sigmas of 3, 1 and 0.1 mm 337 have a negative eigenvalue.
# Matters: avatars are made of Gaussians of just that size; hair and skin get spikes or holes that the trained model
#   does not have. Scaling the scene by 100 before it is sent avoids it.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check viser==1.1.1 numpy==2.4.6
venv/bin/python - <<'PY'
import socket
import sys
import warnings

import numpy as np
import viser

warnings.simplefilter("ignore")
with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        server.stop()
        sys.exit(f"changed: {what} was {stated}")


def shown(covariances):
    count = len(covariances)
    splats = server.scene.add_gaussian_splats("/g", centers=np.zeros((count, 3)), covariances=covariances,
                                              rgbs=np.ones((count, 3)), opacities=np.ones((count, 1)))
    return np.asarray(splats.covariances, float)


def sigma(metres):
    return float(np.sqrt(shown(np.eye(3)[None] * metres**2)[0, 0, 0]))


check("sigma of 1 mm, in mm", round(1000 * sigma(0.001), 3), 1.007)
check("sigma of 0.2 mm, in mm", round(1000 * sigma(0.0002), 3), 0.244)
check("sigma of 0.17 mm, in mm", 1000 * sigma(0.00017), 0.0)
check("sigma of 300", sigma(300.0), float("inf"))

rng = np.random.default_rng(0)
w, x, y, z = (q := rng.normal(size=(1000, 4))).T / np.linalg.norm(q, axis=1)
turns = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                  2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                  2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], 1).reshape(-1, 3, 3)
flat = turns @ np.diag([0.003, 0.001, 0.0001]) ** 2 @ turns.transpose(0, 2, 1)
check("of 1,000 flat ones, negative before", int((np.linalg.eigvalsh(flat)[:, 0] < 0).sum()), 0)
check("of 1,000 flat ones, negative after", int((np.linalg.eigvalsh(shown(flat))[:, 0] < 0).sum()), 337)
server.stop()
PY
