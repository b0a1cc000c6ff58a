#!/usr/bin/env bash
# spz 0.0.1 (PyPI): the package cannot be imported, and what is inside it refuses the format's current version.
#
# Expected: `pip install spz` and `import spz`, as the package's page shows; and reading of SPZ 4, which
#   nianticlabs/spz has written by default since spring 2026.
# Seen: the wheel's __init__.py imports a name from itself before it exists. Loaded past it, its compiled part reads
#   versions 2 and 3, and fails for 4. It has a wheel for Python 3.13 alone; elsewhere pip builds it from Rust sources.
# Output: ImportError: cannot import name 'BoundingBox' from partially initialized module 'spz'.
# Matters: the name looks like the format's own library. gsply and GaussForge read and write SPZ from Python.
# It needs Python 3.13.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python=${PYTHON313:-python3.13}
"$python" --version >/dev/null 2>&1 || python=$(ls "$HOME"/.pyenv/versions/3.13*/bin/python3.13 | tail -1)
"$python" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check --only-binary :all: spz==0.0.1 zstandard==0.25.0
venv/bin/python - <<'PY'
import gzip
import importlib.machinery
import importlib.util
import pathlib
import struct
import sys
import sysconfig

import zstandard


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


try:
    import spz
    sys.exit("changed: spz can be imported")
except ImportError as error:
    check("import spz", str(error).split(" (")[0],
          "cannot import name 'BoundingBox' from partially initialized module 'spz'")
sys.modules.pop("spz", None)

library = next((pathlib.Path(sysconfig.get_path("purelib")) / "spz").glob("spz.*.so"))
loader = importlib.machinery.ExtensionFileLoader("spz", str(library))
spz = importlib.util.module_from_spec(importlib.util.spec_from_loader("spz", loader))
loader.exec_module(spz)

streams = [bytes(9), bytes([200]), bytes([128] * 3), bytes([100] * 3), struct.pack("<I", 3 << 30)]
with gzip.open("three.spz", "wb") as f:
    f.write(struct.pack("<IIIBBBB", 0x5053474E, 3, 1, 0, 12, 0, 0) + b"".join(streams))
packed = [zstandard.compress(s) for s in streams]
with open("four.spz", "wb") as f:
    f.write(struct.pack("<IIIBBBBI12x", 0x5053474E, 4, 1, 0, 12, 0, len(streams), 32))
    f.write(b"".join(struct.pack("<QQ", len(p), len(s)) for p, s in zip(packed, streams)) + b"".join(packed))


def loads(path):
    try:
        return spz.load(path).num_points
    except ValueError as error:
        return str(error)


check("version 3", loads("three.spz"), 1)
check("version 4", loads("four.spz"), "Failed to load SPZ file: unable to load packed file")
PY
