#!/usr/bin/env bash
# trimesh 5.2.0: an OBJ with texture coordinates is not read vertex by vertex, with process=False neither.
#
# Expected: process=False is what body models' pages advise so that vertex i of the file is vertex i of the mesh.
# Seen: a vertex at a seam is doubled and the copies are put *beside* each other, so all indices behind them shift;
#   vertices without a face are left out. With maintain_order=True too the order is the file's, but unused vertices
#   are still left out, and one of the seam's two texture coordinates is lost.
# Output: the file's 5 vertices are 5 others with process=False (the first twice, the last missing), and 4 with
#   maintain_order=True.
# Matters: blend shapes and skinning weights of SMPL-X and the like go by index. A template read so tears at the
#   seams, or only at the end of its list.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.4.6
venv/bin/python - <<'PY'
import sys

import trimesh

# A square of two triangles, whose first corner has two texture coordinates, and a joint's marker without a face.
with open("body.obj", "w") as f:
    f.write("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.5\n"
            "f 1/1 2/2 3/3\nf 1/5 3/3 4/4\n")


def vertices(**options):
    return [tuple(int(x) for x in v) for v in trimesh.load("body.obj", **options).vertices]


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


check("process=False", vertices(process=False), [(0, 0, 0), (0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
check("process=False, maintain_order=True", vertices(process=False, maintain_order=True),
      [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
PY
