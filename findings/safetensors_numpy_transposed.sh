#!/usr/bin/env bash
# safetensors 0.8.0: safetensors.numpy writes a transposed or sliced array with its numbers in another order.
#
# Expected: the values that an array shows are saved, as numpy.save does and as safetensors 0.7.0 did, or the array is
#   refused. The documentation asks for "contiguous and dense" arrays, but nothing checks it. A transposed array is
#   contiguous in NumPy's terms, too (F_CONTIGUOUS).
# Seen: the shape is the array's, and the numbers are those that lie in memory from its first one on. No error, no
#   warning. The file is valid and has the right shape and type. (Reported in safetensors' issue 825.)
# Output: for each array, whether it comes back, with both versions: all with 0.7.0; with 0.8.0, only the copy made by
#   ascontiguousarray. A column of vertices comes back as the first vertices' x, y, z.
# Matters: blend shapes from NumPy's singular value decomposition are a transposed matrix, and a property of a PLY in
#   plyfile is a slice of its table. Call numpy.ascontiguousarray on each array first.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 plyfile==1.1.5
for version in 0.7.0 0.8.0; do
  venv/bin/pip install --quiet --disable-pip-version-check --no-deps --target "$version" "safetensors==$version"
done
cat >save.py <<'PY'
import sys

import numpy as np
import safetensors
from plyfile import PlyData, PlyElement
from safetensors.numpy import load, load_file, save, save_file


def check(what, seen, stated):
    print(f"{safetensors.__version__} {what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


version = sys.argv[1]
check("is the version under test", safetensors.__version__ == version, True)
kept = version == "0.7.0"

rows = np.arange(6, dtype=np.float32).reshape(2, 3)
check("a transposed array in memory", load(save({"a": rows.T}))["a"].tolist(),
      [[0, 3], [1, 4], [2, 5]] if kept else [[0, 1], [2, 3], [4, 5]])
save_file({"a": rows.T}, "a.safetensors")
check("a transposed array in a file comes back", np.array_equal(load_file("a.safetensors")["a"], rows.T), kept)
copy = np.ascontiguousarray(rows.T)
check("its contiguous copy comes back", np.array_equal(load(save({"a": copy}))["a"], copy), True)

bodies = np.random.default_rng(7).normal(size=(20, 30))
shapes = np.linalg.svd(bodies, full_matrices=False).Vh.T[:, :5]
check("blend shapes come back", np.array_equal(load(save({"a": shapes}))["a"], shapes), kept)

vertices = np.array([(1, 2, 3), (4, 5, 6), (7, 8, 9)], dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
PlyData([PlyElement.describe(vertices, "vertex")]).write("a.ply")
x = PlyData.read("a.ply")["vertex"]["x"]
check("a PLY's x", load(save({"x": x}))["x"].tolist(), [1, 4, 7] if kept else [1, 2, 3])
PY
for version in 0.7.0 0.8.0; do
  PYTHONPATH=$version venv/bin/python save.py "$version"
done
