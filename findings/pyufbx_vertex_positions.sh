#!/usr/bin/env bash
# pyufbx 0.0.7: vertices of an FBX are the halves of other numbers.
#
# Expected: mesh.vertex_positions, "vertex positions as numpy array (N, 3)", gives the file's vertices. ufbx, the
#   library beneath, keeps reals as doubles unless it is built otherwise.
# Seen: the doubles are handed out as twice as many floats, of which the first N x 3 are taken. Counts, indices, names
#   and transforms of nodes are right, so a body seems to be there.
# Output: vertices (0, 0, 0) (1, 0, 0) (0, 2, 3) are given as (0, 0, 0) (0, 0, 0) (0, 1.875, 0): 1.875 is what the upper
#   half of the double 1 says as a float.
# Matters: it is the nearest way from FBX to numpy, and half of all coordinates come out as 0 or as noise.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyufbx==0.0.7 numpy==2.4.6
cat > body.fbx <<'FBX'
; FBX 7.4.0 project file
FBXHeaderExtension:  {
	FBXHeaderVersion: 1003
	FBXVersion: 7400
}
Objects:  {
	Geometry: 1, "Geometry::body", "Mesh" {
		Vertices: *9 {
			a: 0,0,0,1,0,0,0,2,3
		}
		PolygonVertexIndex: *3 {
			a: 0,1,-3
		}
		GeometryVersion: 124
	}
	Model: 2, "Model::body", "Mesh" {
		Version: 232
		Properties70:  {
			P: "Lcl Translation", "Lcl Translation", "", "A",5,6,7
		}
	}
}
Connections:  {
	C: "OO",2,0
	C: "OO",1,2
}
FBX
venv/bin/python - <<'PY'
import sys

import numpy as np
import ufbx


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


stored = np.array([0, 0, 0, 1, 0, 0, 0, 2, 3], float)
scene = ufbx.load_file("body.fbx")
mesh = scene.meshes[0]
node = next(n for n in scene.nodes if n.name == "body")
check("vertices", mesh.num_vertices, 3)
check("indices", mesh.indices.tolist(), [0, 1, 2])
check("translation of the node", node.local_transform[3, :3].tolist(), [5.0, 6.0, 7.0])
check("positions", mesh.vertex_positions.tolist(), [[0, 0, 0], [0, 0, 0], [0, 1.875, 0]])
check("halves of the stored doubles", stored.view("f4")[:9].reshape(3, 3).tolist(), mesh.vertex_positions.tolist())
PY
