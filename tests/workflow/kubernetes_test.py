# SPDX-License-Identifier: Apache-2.0
"""The workflow's objects of Kubernetes, without a cluster: what users apply, and what Snakemake's executor sends while
it makes a good subject and a broken one with workflow/profiles/kubernetes. All are checked by the published schema, in
which unknown fields count as faults. A server in this test stands for that of a cluster. It takes an object only if that
has no fault and the role that users apply allows it, and runs the container's command on this machine, in a folder of
its own.

    python tests/workflow/kubernetes_test.py BIN WORK     the folder of built programs, and one for the runs

Python must have Snakemake, its executor for Kubernetes, and its storage plugin fs. Jobs install that plugin by pip."""

import base64
import copy
import csv
import json
import os
import shutil
import subprocess
import sys
import threading
import unittest
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlparse

import yaml

sys.dont_write_bytecode = True
from kubernetes_schema import faults_of  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
PROFILE = ROOT / "workflow" / "profiles" / "kubernetes"
CLUSTER = list(yaml.safe_load_all((PROFILE / "cluster.yaml").read_text()))
BIN, WORK = Path(), Path()


def of_kind(kind):
    return copy.deepcopy(next(content for content in CLUSTER if content["kind"] == kind))


class Server(ThreadingHTTPServer):
    """Answers as the server of a cluster does, as far as Snakemake's executor asks it."""

    def __init__(self, environment):
        super().__init__(("127.0.0.1", 0), Handler)
        self.environment = environment
        self.lock = threading.Lock()
        self.secrets, self.jobs, self.objects = {}, {}, []
        self.refused = []  # requests, with the reason
        self.used = set()  # (group, resource, verb)
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def allows(self, group, resource, verb):
        return any(
            group in rule["apiGroups"] and resource in rule["resources"] and verb in rule["verbs"]
            for rule in of_kind("Role")["rules"]
        )

    def start(self, job):
        """Runs a job's container."""
        name = job["metadata"]["name"]
        (container,) = job["spec"]["template"]["spec"]["containers"]
        secret = {key: base64.b64decode(value).decode() for key, value in
                  next(iter(self.secrets.values()))["data"].items()}  # fmt: skip
        variables = {
            variable["name"]: secret[variable["valueFrom"]["secretKeyRef"]["key"]]
            for variable in container.get("env", [])
        }
        folder = WORK / "pods" / name
        folder.mkdir(parents=True)
        with (folder / "log").open("wb") as log:
            self.jobs[name] = subprocess.Popen(
                [*container["command"], *container["args"]], cwd=folder, stdin=subprocess.DEVNULL, stdout=log,
                stderr=subprocess.STDOUT, env=self.environment | variables)  # fmt: skip


class Handler(BaseHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def answer(self, code, content):
        body = content.encode() if isinstance(content, str) else json.dumps(content).encode()
        self.send_response(code)
        self.send_header("Content-Type", "text/plain" if isinstance(content, str) else "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def refuse(self, code, message):
        self.server.refused.append(f"{self.command} {self.path}: {message}")
        self.answer(code, {"kind": "Status", "apiVersion": "v1", "status": "Failure", "code": code, "message": message})

    def do_request(self):
        url = urlparse(self.path)
        place, _, rest = url.path.partition("/namespaces/default/")
        group = place.split("/")[2] if place.startswith("/apis/") else ""
        resource, name, part = (*rest.split("/"), "", "")[:3]
        kind = f"{resource}/{part}" if part else resource
        verb = {"POST": "create", "DELETE": "delete"}.get(self.command, "get" if name else "list")
        length = int(self.headers.get("Content-Length") or 0)
        content = json.loads(self.rfile.read(length)) if length else {}
        with self.server.lock:
            self.server.used.add((group, kind, verb))
            if not self.server.allows(group, kind, verb):
                return self.refuse(403, f"{verb} of {kind} is not allowed to the account")
            if verb == "create":
                # The client leaves out what the address tells.
                content = {"apiVersion": "v1", "kind": "Secret"} | content if resource == "secrets" else content
                content = {"apiVersion": "batch/v1", "kind": "Job"} | content if resource == "jobs" else content
                self.server.objects.append(content)
                if faults := faults_of(content):
                    return self.refuse(422, "; ".join(faults))
                if resource == "secrets":
                    self.server.secrets[content["metadata"]["name"]] = content
                else:
                    self.server.start(content)
                return self.answer(201, content)
            if verb == "delete":
                return self.answer(200, {"kind": "Status", "apiVersion": "v1", "status": "Success"})
            if kind == "jobs/status":
                code = self.server.jobs[name].poll()
                count = {} if code is None else {"failed": 1} if code else {"succeeded": 1}
                return self.answer(200, {"apiVersion": "batch/v1", "kind": "Job", "status": count})
            if kind == "pods":
                job = parse_qs(url.query)["labelSelector"][0].removeprefix("job-name=")
                return self.answer(200, {"apiVersion": "v1", "kind": "PodList", "items": [self.pod_of(job)]})
            if parse_qs(url.query).get("previous", [""])[0].lower() == "true":  # kubelet keeps none of a first start
                return self.refuse(400, f'previous terminated container "snakemake" in pod "{name}" not found')
            return self.answer(200, (WORK / "pods" / name / "log").read_text())

    do_GET = do_POST = do_DELETE = do_request

    def pod_of(self, job):
        code = self.server.jobs[job].poll()
        state = {"running": {}} if code is None else {"terminated": {"exitCode": abs(code)}}
        container = {"name": "snakemake", "image": "", "imageID": "", "ready": code is None, "restartCount": 0}
        return {"metadata": {"name": job}, "status": {"containerStatuses": [container | {"state": state}]}}


class Manifests(unittest.TestCase):
    def test_what_users_apply_has_no_faults(self):
        for content in CLUSTER:
            self.assertEqual(faults_of(content), [], content["kind"])

    def test_profile_and_manifests_name_the_same_account_and_volume(self):
        profile = yaml.safe_load((PROFILE / "config.yaml").read_text())
        self.assertEqual(profile["kubernetes-service-account-name"], of_kind("ServiceAccount")["metadata"]["name"])
        claim, _, folder = profile["kubernetes-persistent-volumes"][0].partition(":")
        self.assertEqual(claim, of_kind("PersistentVolumeClaim")["metadata"]["name"])
        self.assertEqual(folder, of_kind("Pod")["spec"]["containers"][0]["volumeMounts"][0]["mountPath"])
        self.assertEqual(of_kind("RoleBinding")["roleRef"]["name"], of_kind("Role")["metadata"]["name"])

    def test_faults_are_found(self):
        def change(kind, edit):
            content = of_kind(kind)
            edit(content)
            return faults_of(content)

        container = lambda pod: pod["spec"]["containers"][0]  # noqa: E731
        for kind, edit, fault in (
            ("Pod", lambda pod: container(pod).update(imagePullPolice="Always"), "imagePullPolice: is no field"),
            ("Pod", lambda pod: container(pod).pop("name"), "containers[0]: Invalid value for `name`"),
            ("Pod", lambda pod: container(pod).update(command="sleep"), "command: found 'sleep', expected a list"),
            ("Pod", lambda pod: pod["spec"].update(hostNetwork="yes"), "hostNetwork: found 'yes', expected bool"),
            ("Pod", lambda pod: pod["spec"].update(priority=True), "priority: found True, expected int"),
            ("Role", lambda role: role.update(apiVersion="v1"), "found the kind Role of v1"),
            ("Role", lambda role: role["rules"][0].pop("verbs"), "rules[0]: Invalid value for `verbs`"),
            ("Pod", lambda pod: pod.update(kind="Pode"), "found the kind Pode"),
            ("PersistentVolumeClaim", lambda claim: claim["spec"].update(resources=[]), "expected an object"),
        ):
            faults = change(kind, edit)
            self.assertEqual(len(faults), 1, faults)
            self.assertIn(fault, faults[0])


class Run(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        (WORK / "people" / "config").mkdir(parents=True)
        (WORK / "checkpoints").mkdir()
        subprocess.run([BIN / "08-film-a-capture", WORK / "bucket", "64", "4"], check=True, capture_output=True)

    def test_subjects_are_made_as_the_role_allows_and_a_failure_stops_no_other(self):
        people = WORK / "people"
        (people / "config" / "config.yaml").write_text(
            f"programs: {BIN}\nbody: 08_capture/body.npz\nstaged: true\ncheckpoints: {WORK}/checkpoints\n"
            "reconstruct: {options: --steps 40 --gaussians 1500, threads: 1}\n"
        )
        (people / "config" / "subjects.csv").write_text("name,capture,options\nbad,08_capture/soft,--stepz 3\nann,08_capture/hard,\n")
        shutil.copytree(ROOT / "workflow", people / "workflow", ignore=shutil.ignore_patterns("__pycache__"))
        git = ["git", "-c", "user.name=test", "-c", "user.email=test@example.org"]
        for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "project"]):
            subprocess.run([*git, *words], cwd=people, check=True)
        environment = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "HOME": str(WORK)}
        server = Server(environment)
        (WORK / "kubeconfig").write_text(json.dumps({
            "apiVersion": "v1", "kind": "Config", "current-context": "test",
            "clusters": [{"name": "test", "cluster": {"server": f"http://127.0.0.1:{server.server_port}"}}],
            "users": [{"name": "test", "user": {}}],
            "contexts": [{"name": "test", "context": {"cluster": "test", "user": "test"}}],
        }))  # fmt: skip
        run = subprocess.run(
            [sys.executable, "-m", "snakemake", "--snakefile", "workflow/Snakefile", "--profile",
             "workflow/profiles/kubernetes", "--default-storage-provider", "fs", "--default-storage-prefix",
             f"{WORK}/bucket", "--kubernetes-persistent-volumes", f"gsh-checkpoints:{WORK}/checkpoints",
             "--seconds-between-status-checks", "1", "--retries", "0"],
            cwd=people, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env=os.environ | environment | {"KUBECONFIG": str(WORK / "kubeconfig")}, check=False)  # fmt: skip
        self.assertEqual(server.refused, [], run.stdout)
        self.assertEqual(run.returncode, 1, run.stdout)
        jobs = [content for content in server.objects if content["kind"] == "Job"]
        self.assertEqual(len(jobs), 3, run.stdout)
        with (people / "results" / "subjects.csv").open(newline="") as file:
            rows = {row["subject"]: row for row in csv.DictReader(file)}
        self.assertEqual({name: row["state"] for name, row in rows.items()}, {"bad": "failed", "ann": "done"}, run.stdout)
        self.assertIn("--stepz", rows["bad"]["line"])
        self.assertTrue((WORK / "bucket" / "results" / "ann" / "avatar" / "avatar.gsh").exists())
        self.assertEqual([path.name for path in (WORK / "checkpoints").iterdir()], ["records"])
        for job in jobs:
            pod = job["spec"]["template"]["spec"]
            self.assertEqual(pod["serviceAccountName"], "gsh")
            self.assertIn({"name": "gsh-checkpoints", "mountPath": f"{WORK}/checkpoints"},
                          pod["containers"][0]["volumeMounts"])  # fmt: skip
        allowed = {(group, resource, verb) for rule in of_kind("Role")["rules"] for group in rule["apiGroups"]
                   for resource in rule["resources"] for verb in rule["verbs"]}  # fmt: skip
        self.assertEqual(allowed - server.used, {("", "pods", "delete")})  # only later versions of the executor do that


if __name__ == "__main__":
    BIN, WORK = (Path(word).resolve() for word in sys.argv[1:3])
    unittest.main(argv=sys.argv[:1], verbosity=2)
