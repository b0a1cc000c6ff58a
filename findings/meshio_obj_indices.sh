#!/usr/bin/env bash
# meshio 5.3.5: an OBJ's texture coordinates go to vertices by their place in the file, and indices from the end are
# off by one.
#
# Expected: in an OBJ, a face says which `vt` belongs to which `v` ("f 1/4 2/3 …"), and the order of the `vt` lines is
#   free. A negative index counts from the end: -1 is the last vertex. A reader follows both, or refuses the file.
# Seen: meshio drops what follows the first slash, and takes the n-th `vt` for the n-th vertex. Of each index it
#   subtracts 1, also of a negative one, so -1 becomes the last vertex but one. Neither warns. Files with other numbers
#   of `vt` than of `v` (such as a mesh with a seam) raise a ValueError.
# Output: a square whose `vt` are listed backwards gets its picture upside down. Face "-3 -2 -1" of four vertices is the
#   triangle of vertices 1, 2, 3 and not 2, 3, 4, also in the STL that meshio makes of the file.
# Matters: a mesh whose texture has no seam, such as a garment's panel, is read with the wrong texture, and the check of
#   its counts passes. A mesh with indices from the end gets other triangles.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check meshio==5.3.5 numpy==2.4.6 trimesh==5.2.0 pillow==13.0.0
venv/bin/python - <<'PY'
import sys
import warnings

import meshio
import numpy as np
import trimesh

warnings.simplefilter("error")


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def written(name, text):
    with open(name, "w") as file:
        file.write(text)
    return name


square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
backwards = "vt 0 1\nvt 1 1\nvt 1 0\nvt 0 0\n"  # as far right and up as vertices 4, 3, 2, 1


def same_plane(positions, coordinates):
    """Whether each vertex has the texture coordinates that are its own x and y."""
    return np.allclose(np.asarray(positions)[:, :2], coordinates)


textured = written("textured.obj", square + backwards + "f 1/4 2/3 3/2 4/1\n")
other = trimesh.load_mesh(textured)
check("trimesh's texture coordinates are x and y", same_plane(other.vertices, other.visual.uv), True)
mesh = meshio.read(textured)
check("meshio's texture coordinates are x and y", same_plane(mesh.points, mesh.point_data["obj:vt"]), False)
check("they are those of the file's order", mesh.point_data["obj:vt"].tolist(), [[0, 1], [1, 1], [1, 0], [0, 0]])

from_end = written("from_end.obj", square + "f -3 -2 -1\n")
three = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0]])
other = trimesh.load_mesh(from_end)
check("trimesh's triangle has the last three vertices", np.allclose(other.triangles[0], three), True)
mesh = meshio.read(from_end)
check("meshio's indices", mesh.cells[0].data.tolist(), [[-4, -3, -2]])
check("they are the vertices", mesh.points[mesh.cells[0].data[0]].tolist(), [[0, 0, 0], [1, 0, 0], [1, 1, 0]])
mesh.write("from_end.stl")
other = trimesh.load_mesh("from_end.stl", process=False)
check("the STL has", other.triangles[0].tolist(), [[0, 0, 0], [1, 0, 0], [1, 1, 0]])

seam = written("seam.obj", square + backwards + "vt 0.5 0.5\nf 1/4 2/3 3/2\nf 1/5 3/2 4/1\n")
try:
    meshio.read(seam)
    check("a mesh with a seam", "read", "refused")
except ValueError as error:
    check("a mesh with a seam", "refused", "refused")
PY
