#!/usr/bin/env bash
# snakemake-executor-plugin-kubernetes 0.5.1: the first job that fails stops the whole run, also with --keep-going.
#
# Expected: with --keep-going, jobs that do not depend on the failed one go on. Snakemake's other executors do so, and so
#   does 0.4.1 of this one.
# Seen: when a Kubernetes job fails, 0.5.1 asks for the log of the container's earlier start (previous=true). The pod of
#   such a job starts its container once (restartPolicy: Never), so there is none, and the server answers with status
#   400, as Kubernetes does. The executor reports "Kubernetes request failed", and Snakemake shuts down at once. What
#   other jobs make then is not used. 0.4.1 does not ask for that log.
# Output: for each version whether the other job was finished when Snakemake ended.
# Matters: of a thousand people that are reconstructed, one whose photographs are damaged ends the run of all.
# A server below answers as that of a cluster, as far as the executor asks: it takes jobs, tells their states and logs.
# It runs no container: the job `bad` fails at once, and the job `good` makes its file after 20 seconds.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
pip() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pip snakemake==9.27.1 kubernetes==32.0.1 snakemake-storage-plugin-fs==1.1.3 >log.txt 2>&1

cat >cluster.py <<'PY'
import json, sys, time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlparse

jobs, bucket = {}, Path(sys.argv[1])


class Handler(BaseHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def answer(self, code, content):
        body = (content if isinstance(content, str) else json.dumps(content)).encode()
        self.send_response(code)
        self.send_header("Content-Type", "text/plain" if isinstance(content, str) else "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def state(self, name):
        kind, begun = jobs[name]
        if kind == "bad":
            return "failed"
        if time.monotonic() < begun + 20:
            return "running"
        (bucket / "good.txt").write_text("made\n")
        return "succeeded"

    def do(self):
        url = urlparse(self.path)
        length = int(self.headers.get("Content-Length") or 0)
        content = json.loads(self.rfile.read(length)) if length else {}
        parts = url.path.split("/namespaces/default/")[1].split("/")
        if self.command == "POST":
            if parts[0] == "jobs":
                words = json.dumps(content["spec"]["template"]["spec"]["containers"][0])
                jobs[content["metadata"]["name"]] = ("bad" if "'bad:'" in words else "good", time.monotonic())
            return self.answer(201, content)
        if self.command == "DELETE":
            return self.answer(200, {"kind": "Status", "apiVersion": "v1", "status": "Success"})
        if parts[0] == "jobs":
            state = self.state(parts[1])
            status = {} if state == "running" else {state: 1}
            return self.answer(200, {"apiVersion": "batch/v1", "kind": "Job", "status": status})
        if parts[-1] == "log":
            if parse_qs(url.query).get("previous", [""])[0].lower() == "true":
                message = f'previous terminated container "snakemake" in pod "{parts[1]}" not found'
                return self.answer(400, {"kind": "Status", "apiVersion": "v1", "status": "Failure", "reason": "BadRequest",
                                         "code": 400, "message": message})
            return self.answer(200, "the log\n")
        name = parse_qs(url.query)["labelSelector"][0].removeprefix("job-name=")
        state = self.state(name)
        now = {"running": {}} if state == "running" else {"terminated": {"exitCode": int(state == "failed")}}
        container = {"name": "snakemake", "image": "", "imageID": "", "ready": False, "restartCount": 0, "state": now}
        return self.answer(200, {"apiVersion": "v1", "kind": "PodList", "items": [
            {"metadata": {"name": name}, "status": {"containerStatuses": [container]}}]})

    do_GET = do_POST = do_DELETE = do


server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
Path("kubeconfig").write_text(json.dumps({
    "apiVersion": "v1", "kind": "Config", "current-context": "here",
    "clusters": [{"name": "here", "cluster": {"server": f"http://127.0.0.1:{server.server_port}"}}],
    "users": [{"name": "here", "user": {}}],
    "contexts": [{"name": "here", "context": {"cluster": "here", "user": "here"}}]}))
server.serve_forever()
PY

# run VERSION: prints whether the other job was finished
run() {
  pip "snakemake-executor-plugin-kubernetes==$1" >>log.txt 2>&1
  rm -rf project bucket kubeconfig && mkdir project bucket
  cat >project/Snakefile <<'SMK'
rule all:
    input: "bad.txt", "good.txt"
rule bad:
    output: "bad.txt"
    shell: "exit 1"
rule good:
    output: "good.txt"
    shell: "echo made > {output}"
SMK
  git -C project init -q
  git -C project add .
  git -C project -c user.name=a -c user.email=a@example.org commit -qm project
  venv/bin/python cluster.py "$work/bucket" &
  local server=$!
  while [ ! -e kubeconfig ]; do sleep 0.1; done
  (cd project && KUBECONFIG=$work/kubeconfig HOME=$work "$work/venv/bin/python" -m snakemake --executor kubernetes \
    --jobs 2 --keep-going --retries 0 --default-storage-provider fs --default-storage-prefix "$work/bucket" \
    --seconds-between-status-checks 1) >"run-$1.txt" 2>&1 </dev/null || true
  kill "$server"
  wait "$server" 2>/dev/null || true
  [ -e bucket/good.txt ] && grep -q "1 of 3 steps" "run-$1.txt" && echo finished || echo "not finished"
}

for version in 0.4.1 0.5.1; do
  result=$(run "$version")
  echo "$version: the other job was $result"
  case "$version $result" in
    "0.4.1 finished" | "0.5.1 not finished") ;;
    *) tail -n 30 "run-$version.txt"; exit 1 ;;
  esac
done
grep -q "previous terminated container" run-0.5.1.txt || { tail -n 30 run-0.5.1.txt; exit 1; }
