# SPDX-License-Identifier: Apache-2.0
"""The workflow on Slurm itself: four virtual nodes on this machine, of which one is killed and comes back and one is
drained, while subjects of the built-in actor are made. A tenth of them is broken. Every good one must end with the
bytes of a run alone, every broken one with its own line, and no process may remain.

    python tests/workflow/slurm_test.py BIN WORK [SUBJECTS]

Needs root, slurm-wlm and munge of Debian, and a Python with Snakemake and its executor for Slurm. Daemons and jobs run
in namespaces of their own (unshare), in which /etc/slurm is this test's: nothing of the machine changes, and all ends
with the test."""

import csv
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.dont_write_bytecode = True
from broken import BROKEN  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
NODES = ("n1", "n2", "n3", "n4")
OPTIONS = "--steps 60 --gaussians 1500"

SLURM_CONF = """\
ClusterName=gsh
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort=17600
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
SlurmdTimeout=10
KillWait=10
MinJobAge=600
ReturnToService=2
MpiDefault=none
NodeName=n[1-4] NodeHostname={host} NodeAddr=127.0.0.1 Port=[17601-17604] CPUs=1 RealMemory=3000 State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


class Cluster:
    """Slurm's daemons. Nodes are processes slurmd on this machine."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("munge", "state", "spool", "etc"):
            (folder / name).mkdir(parents=True)
        (folder / "munge").chmod(0o700)
        key = folder / "munge" / "key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        conf = SLURM_CONF.format(folder=folder, host=socket.gethostname().split(".")[0])
        (folder / "etc" / "slurm.conf").write_text(conf)
        run("mount", "--bind", folder / "etc", "/etc/slurm")
        run("munged", "--force", *(f"--{word}-file={folder}/munge/{word}" for word in ("key", "pid", "log", "seed")),
            f"--socket={folder}/munge/socket")  # fmt: skip
        run("slurmctld")
        for node in NODES:
            self.start(node)
        wait_for(lambda: output("sinfo", "-h", "-N", "-o", "%t").split().count("idle") == len(NODES), "idle nodes", 60)

    @staticmethod
    def start(node: str) -> None:
        run("slurmd", "-N", node)

    def kill(self, node: str) -> int:
        """Kills a node with everything that runs on it, as if its power failed. Returns the number of its jobs."""
        jobs = output("squeue", "-h", "-w", node, "-t", "R", "-o", "%A").split()
        os.kill(int((self.folder / f"{node}.pid").read_text()), signal.SIGKILL)
        for process, words, variables in processes():
            step = words.startswith(b"slurmstepd: [") and words.split(b"[")[1].split(b".")[0].decode() in jobs
            if step or f"SLURMD_NODENAME={node}".encode() in variables:
                try:
                    os.kill(process, signal.SIGKILL)
                except ProcessLookupError:
                    pass
        return len(jobs)


def run(*words: object) -> None:
    subprocess.run([str(word) for word in words], check=True)


def output(*words: str) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def wait_for(condition: Callable[[], bool], what: str, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise SystemExit(f"no {what} after {seconds:.0f} s")
        time.sleep(0.1)


def processes() -> list[tuple[int, bytes, list[bytes]]]:
    """The number, the command line and the environment of each process."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes()
            found.append((int(folder.name), words, (folder / "environ").read_bytes().split(b"\0")))
        except OSError:  # it has ended
            continue
    return found


def make_subjects(bin_folder: Path, work: Path, count: int) -> dict[str, str]:
    """Writes captures, table and settings. Returns the words that are expected of each broken subject."""
    subprocess.run([bin_folder / "08-film-a-capture", work, "64", "4"], check=True, capture_output=True)
    film = work / "08_capture" / "hard"
    rows, expected = ["name,capture,options"], {}
    kinds = list(BROKEN.items())
    for k in range(count):
        if k % 10 == 5:
            kind, (damage, options, words) = kinds[k // 10 % len(kinds)]
            name = f"s{k:03}-{kind}"
            shutil.copytree(film, work / "captures" / name)
            damage(work / "captures" / name)
            rows.append(f"{name},captures/{name},{options}")
            expected[name] = words
        else:
            rows.append(f"s{k:03},{film},")
    (work / "config").mkdir()
    (work / "config" / "subjects.csv").write_text("\n".join(rows) + "\n")
    (work / "config" / "config.yaml").write_text(
        f"programs: {bin_folder}\nbody: {work / '08_capture' / 'body.npz'}\n"
        f"reconstruct: {{options: {OPTIONS}, threads: 1, checkpoint_interval: 0.2}}\n"
    )
    return expected


def trouble(cluster: Cluster, work: Path) -> None:
    """Kills a node in the middle of a training, which comes back, and drains another for a while."""
    wait_for(lambda: any(work.glob("results/*/avatar/checkpoint.gsh")), "training", 600)
    nodes = [
        words.split("=")[1]
        for _, line, variables in processes()
        if b"gsh-reconstruct" in line.split(b"\0")[0] and b"--continue" in line
        for words in [next((v.decode() for v in variables if v.startswith(b"SLURMD_NODENAME=")), "=")]
        if words != "="
    ]
    victim = nodes[0] if nodes else NODES[0]
    print(f"killed {victim} with {cluster.kill(victim)} jobs", flush=True)
    drained = next(node for node in NODES if node != victim)
    run("scontrol", "update", f"nodename={drained}", "state=drain", "reason=test")
    time.sleep(5)
    cluster.start(victim)
    time.sleep(10)
    run("scontrol", "update", f"nodename={drained}", "state=resume")
    print(f"{victim} and {drained} are back", flush=True)


def inside(bin_folder: Path, work: Path, count: int) -> int:
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    expected = make_subjects(bin_folder, work, count)
    command = [bin_folder / "gsh-reconstruct", "--capture", work / "08_capture" / "hard", "--body",
               work / "08_capture" / "body.npz", *OPTIONS.split(), "--out", work / "alone"]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True)
    cluster = Cluster(work / "slurm")
    start = time.monotonic()
    with (work / "snakemake.log").open("w") as log:
        snakemake = subprocess.Popen(
            [sys.executable, "-m", "snakemake", "--snakefile", ROOT / "workflow" / "Snakefile", "--profile",
             ROOT / "workflow" / "profiles" / "slurm", "--slurm-status-command", "squeue", "--slurm-no-account",
             "--seconds-between-status-checks", "2", "--slurm-init-seconds-before-status-checks", "2",
             "--latency-wait", "5", "--default-resources", "mem_mb=500", "runtime=10", "slurm_partition=main"],
            cwd=work, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT)  # fmt: skip
        trouble(cluster, work)
        code = snakemake.wait()
    seconds = time.monotonic() - start

    faults = [] if code == (1 if expected else 0) else [f"Snakemake ended with code {code}"]
    with (work / "results" / "subjects.csv").open(newline="") as file:
        rows = {row["subject"]: row for row in csv.DictReader(file)}
    alone = (work / "alone" / "avatar.gsh").read_bytes()
    for name, row in rows.items():
        if name in expected:
            if row["state"] != "failed" or expected[name] not in row["line"]:
                faults.append(f"{name}: {row['state']}, {row['line']!r}, expected {expected[name]!r}")
        elif row["state"] != "done":
            faults.append(f"{name}: {row['state']}, {row['line']!r}")
        elif (work / "results" / name / "avatar" / "avatar.gsh").read_bytes() != alone:
            faults.append(f"{name}: other bytes than a run alone")
    remain = [words for _, words, _ in processes() if b"/gsh-" in words.split(b"\0")[0]]
    faults += [f"a process remains: {words!r}" for words in remain]
    print("\n".join(faults) or "all as expected")
    print(f"{len(rows)} subjects, {len(expected)} of them broken, in {seconds:.0f} s")
    return 1 if faults else 0


if __name__ == "__main__":
    if sys.argv[1] != "--inside":
        namespaces = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc", "--"]
        sys.exit(subprocess.run([*namespaces, sys.executable, __file__, "--inside", *sys.argv[1:]]).returncode)
    sys.exit(inside(Path(sys.argv[2]).resolve(), Path(sys.argv[3]).resolve(), int((sys.argv[4:] or ["20"])[0])))
