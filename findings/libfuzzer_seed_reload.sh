#!/usr/bin/env bash
# libFuzzer (in atheris 2.3.0): with a fixed seed and a fixed number of runs, a slower machine tries other inputs.
#
# Expected: -seed makes a fuzzer's choices repeatable. A single process with the same seed, the same corpus and the same
#   -runs tries the same inputs, however fast it is. Tests in a build rely on that.
# Seen: once a second, libFuzzer looks through its own corpus folder for files that other processes left there
#   (-reload=1, the default). It takes those that it does not hold for new, and among them are its own: inputs that it
#   has replaced by shorter ones since (REDUCE). It runs them again, they count as runs, and what follows is different.
#   No line of its output tells (RELOAD is printed only if an input is kept). With -reload=0, the inputs are the same.
# Output: a digest of all inputs, for a target that waits 0, 0.2 and 0.4 ms in each run, with both settings.
# Matters: a build that tries a fixed number of mutations of a reader fails on one machine and not on another, or not
#   again, though nothing was changed. gsh's own scripts/fuzz therefore sets -reload=0 for such runs.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check atheris==2.3.0 >log.txt 2>&1

cat >target.py <<'PY'
import hashlib, sys, time
import atheris

wait, result = float(sys.argv[1]), sys.argv[2]
runs, digest = 0, hashlib.sha256()


@atheris.instrument_func
def target(data):
    global runs
    runs += 1
    digest.update(len(data).to_bytes(4, "little") + data)
    if runs % 100 == 0:
        time.sleep(100 * wait)
    if runs % 1000 == 0:
        with open(result, "w") as file:
            file.write(digest.hexdigest()[:16])
    found, seen = set(data), ""  # a shorter input may have the same bytes
    if 65 in found: seen += "a"
    if 66 in found: seen += "b"
    if 90 in found: seen += "c"
    if 200 in found: seen += "d"
    if 0 in found: seen += "e"
    if 10 in found: seen += "f"
    if 65 in found and 90 in found: seen += "g"
    if 200 in found and 7 in found: seen += "h"
    if 123 in found and 231 in found: seen += "i"


atheris.Setup(sys.argv[:1] + sys.argv[3:], target)
atheris.Fuzz()
PY

# digests OPTION...: those of the three waits, a line each
digests() {
  for wait in 0 0.0002 0.0004; do
    rm -rf corpus result && mkdir corpus
    for byte in $(seq 0 255); do printf "\\x$(printf %x "$byte")"; done >corpus/seed
    venv/bin/python target.py "$wait" result -seed=1 -runs=20000 -max_len=400 -len_control=0 "$@" corpus >run.txt 2>&1
    cat result
    echo
  done
}

echo "by default:"
digests | tee default.txt
echo "with -reload=0:"
digests -reload=0 | tee fixed.txt
[ "$(sort -u default.txt | wc -l)" -gt 1 ] && [ "$(sort -u fixed.txt | wc -l)" -eq 1 ]
