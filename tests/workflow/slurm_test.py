# SPDX-License-Identifier: Apache-2.0
"""The workflow on Slurm itself: four virtual nodes on this machine make subjects of the built-in actor, while nodes are
killed, drained and restarted at random moments. A tenth of the subjects is broken. Every good one must end with the
bytes of a run alone, every broken one with its own line. No program may start again but those of a killed job, none may
run twice at a time for one subject, and no process and no file of work may remain.

    python tests/workflow/slurm_test.py BIN WORK [--subjects N] [--troubles N] [--seed N]

BIN is the folder of built programs, and WORK one for the runs, which is removed first. Each kind of trouble happens
--troubles times.

Needs root, slurm-wlm and munge of Debian, and a Python with Snakemake and its executor for Slurm. Daemons and jobs run
in namespaces of their own (unshare), in which /etc/slurm is this test's: nothing of the machine changes, and all ends
with the test."""

import argparse
import csv
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
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

    def jobs_on(self, node: str) -> set[str]:
        """The numbers of a node's jobs: by Slurm's queue, and by the sockets of their steps."""
        steps = (path.name.rpartition("_")[2].split(".")[0] for path in (self.folder / "spool" / node).glob("*_*.*"))
        return set(output("squeue", "-h", "-w", node, "-t", "R", "-o", "%A").split()) | set(steps)

    def stop(self, node: str, number: signal.Signals) -> None:
        """Ends a node's slurmd, and waits for that. Its jobs go on."""
        process = int((self.folder / f"{node}.pid").read_text())
        os.kill(process, number)
        wait_for(lambda: not Path(f"/proc/{process}/exe").exists(), f"end of slurmd on {node}", 30)

    def kill(self, node: str) -> list[str]:
        """Kills a node with everything that runs on it, as if its power failed. Returns what its jobs were: words
        rule_RULE_wildcards_SUBJECT."""
        self.stop(node, signal.SIGKILL)
        jobs: set[str] = set()
        while True:  # a process that started another one while it was looked at leaves that one for the next turn
            jobs |= self.jobs_on(node)
            found = [
                process
                for process, words, variables in processes()
                if words.startswith(b"slurmstepd: [") and words.split(b"[")[1].split(b".")[0].decode() in jobs
                or f"SLURMD_NODENAME={node}".encode() in variables
            ]  # fmt: skip
            if not found:
                break
            for process in found:
                try:
                    os.kill(process, signal.SIGKILL)
                except ProcessLookupError:
                    pass
        for path in (self.folder / "spool" / node).glob("*_*.*"):  # sockets of steps, which a power cut removes
            path.unlink()
        comments = dict(line.split(" ", 1) for line in output("squeue", "-h", "-t", "all", "-o", "%A %k").splitlines())
        return [comments[job] for job in sorted(jobs & set(comments))]


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


# Stands before a program: takes a lock of the subject, which the program keeps until it ends in whatever way, and
# notes the start: whether the lock was free, the stage, the subject, and whether there is a checkpoint to go on from.
WRAPPER = """\
#!/bin/sh
record=$(tr '\\0' '\\n' </proc/$PPID/cmdline | sed -n '/^--record$/{{n;p;q}}')
folder=${{record%/logs/*}} stage=${{record##*/}} how=alone checkpoint=
exec 9>>"{folder}/locks/${{folder##*/}}"
flock --nonblock 9 || how=twice
[ ! -e "$folder/avatar/checkpoint.gsh" ] || checkpoint=checkpoint
echo "$how ${{stage%.json}} ${{folder##*/}} $checkpoint" >>"{folder}/starts"
exec {program} "$@"
"""


def wrap_programs(bin_folder: Path, folder: Path) -> None:
    """Fills a folder with programs that note their starts."""
    (folder / "locks").mkdir(parents=True)
    for name in ("gsh-check", "gsh-reconstruct"):
        (folder / name).write_text(WRAPPER.format(folder=folder, program=bin_folder / name))
        (folder / name).chmod(0o755)


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
    wrap_programs(bin_folder, work / "programs")
    (work / "config").mkdir()
    (work / "config" / "subjects.csv").write_text("\n".join(rows) + "\n")
    (work / "config" / "config.yaml").write_text(
        f"programs: {work / 'programs'}\nbody: {work / '08_capture' / 'body.npz'}\n"
        f"reconstruct: {{options: {OPTIONS}, threads: 1, checkpoint_interval: 0.2}}\n"
    )
    return expected


class Trouble:
    """Kills, drains and restarts random nodes at random moments, each kind so many times. Kinds overlap in time, but no
    two strike the same node at once. A job that Slurm holds is released, as docs/many.md tells users."""

    def __init__(self, cluster: Cluster, work: Path, times: int, seed: int) -> None:
        self.cluster, self.work, self.times = cluster, work, times
        self.free, self.lock = set(NODES), threading.Lock()
        self.killed: Counter[str] = Counter()  # what the jobs of killed nodes were
        self.happened: Counter[str] = Counter()
        self.fault: BaseException | None = None
        self.over = threading.Event()
        self.threads = [
            threading.Thread(target=self.go, args=(kind, random.Random(f"{seed} {kind}")), daemon=True)
            for kind in ("kill", "drain", "restart")
        ] + [threading.Thread(target=self.release, daemon=True)]
        for thread in self.threads:
            thread.start()

    def go(self, kind: str, chance: random.Random) -> None:
        try:
            for k in range(self.times):
                if kind == "kill" and k == 0:
                    wait_for(lambda: bool(self.training() or self.over.is_set()), "training", 600)
                else:
                    self.over.wait(chance.uniform(5, 60))
                if self.over.is_set():
                    return
                with self.lock:
                    node = chance.choice(sorted(self.training() & self.free if kind == "kill" and k == 0 else ()) or
                                         sorted(self.free))  # fmt: skip
                    self.free.remove(node)
                getattr(self, kind)(node, chance)
                with self.lock:
                    self.free.add(node)
                    self.happened[kind] += 1
        except BaseException as error:
            self.fault = error

    def release(self) -> None:
        """Slurm 22.05 holds a job that comes back to a node where the folder of its killed start remains."""
        while not self.over.wait(5):
            for line in output("squeue", "-h", "-t", "PD", "-o", "%A %r").splitlines():
                job, reason = line.split(" ", 1)
                if "held" in reason:
                    print(f"released {job}: {reason}", flush=True)
                    run("scontrol", "release", job)
                    self.happened["release"] += 1

    def training(self) -> set[str]:
        """Nodes on which a subject that has a checkpoint is trained."""
        return {
            variable.split(b"=")[1].decode()
            for _, line, variables in processes()
            for words in [line.split(b"\0")]
            if words[0].endswith(b"/gsh-reconstruct") and b"--out" in words
            if (self.work / os.fsdecode(words[words.index(b"--out") + 1]) / "checkpoint.gsh").exists()
            for variable in variables
            if variable.startswith(b"SLURMD_NODENAME=")
        }

    def kill(self, node: str, chance: random.Random) -> None:
        jobs = self.cluster.kill(node)
        self.killed.update(jobs)
        away = chance.choice((chance.uniform(1, 5), chance.uniform(15, 30)))  # Slurm misses a node after 10 s
        print(f"killed {node} with {', '.join(jobs) or 'no job'} for {away:.0f} s", flush=True)
        time.sleep(away)
        self.cluster.start(node)

    def drain(self, node: str, chance: random.Random) -> None:
        run("scontrol", "update", f"nodename={node}", "state=drain", "reason=test")
        away = chance.uniform(5, 30)
        print(f"drained {node} for {away:.0f} s", flush=True)
        time.sleep(away)
        run("scontrol", "update", f"nodename={node}", "state=resume")

    def restart(self, node: str, chance: random.Random) -> None:
        self.cluster.stop(node, signal.SIGTERM)
        print(f"restarted slurmd of {node}", flush=True)
        time.sleep(chance.uniform(0, 5))
        self.cluster.start(node)

    def end(self) -> list[str]:
        """Waits for what is under way. Returns what did not happen as it should."""
        self.over.set()
        for thread in self.threads:
            thread.join()
        faults = [f"trouble ended by {self.fault!r}"] if self.fault else []
        return faults + [
            f"{kind}: happened {self.happened[kind]} times before all subjects were made, expected {self.times}"
            for kind in ("kill", "drain", "restart")
            if self.happened[kind] != self.times
        ]


def faults_of_starts(work: Path, trouble: Trouble) -> list[str]:
    """Prints how often programs started, and returns those that ran twice at a time, or again without a kill."""
    lines = [line.split() for line in (work / "programs" / "starts").read_text().splitlines()]
    starts = Counter((words[1], words[2]) for words in lines)
    rules = {"check": "check", "plan": "check", "reconstruct": "reconstruct"}
    again = sum(count - 1 for count in starts.values())
    resumed = sum(words[1:2] == ["reconstruct"] and len(words) == 4 for words in lines)
    print(f"{trouble.killed.total()} jobs killed; {len(lines)} programs started, {again} of them again, of which "
          f"{resumed} trainings from a checkpoint")  # fmt: skip
    faults = [f"{' '.join(words[1:3])}: ran twice at a time" for words in lines if words[0] == "twice"]
    for (stage, name), count in starts.items():
        killed = trouble.killed[f"rule_{rules[stage]}_wildcards_{name}"]
        if count > 1 + killed:
            faults.append(f"{name}: {stage} started {count} times, and its job was killed {killed} times")
    return faults


def faults_of_remains(work: Path, alone: Path, good: list[str]) -> list[str]:
    """Processes and files that should not remain."""
    faults = [f"a process remains: {words!r}" for _, words, variables in processes()
              if b"/gsh-" in words.split(b"\0")[0] or words.startswith(b"slurmstepd")
              or any(variable.startswith(b"SLURM_JOB_ID=") for variable in variables)]  # fmt: skip

    def files_of(folder: Path) -> set[str]:
        return {str(path.relative_to(folder)) for path in folder.rglob("*")}

    wanted = files_of(alone) - {"checkpoint.gsh"}
    for name in good:
        if (found := files_of(work / "results" / name / "avatar")) != wanted:
            faults.append(f"{name}: files {sorted(found ^ wanted)} are there or missing")
    strays = [path for path in (work / "results").rglob("*") if ".partial" in path.name or "checkpoint" in path.name]
    for folder in ("incomplete", "locks"):
        strays += (work / ".snakemake" / folder).glob("*")
    return faults + [f"a file remains: {path.relative_to(work)}" for path in strays]


def inside(bin_folder: Path, work: Path, count: int, times: int, seed: int) -> int:
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
        trouble = Trouble(cluster, work, times, seed)
        code = snakemake.wait()
    seconds = time.monotonic() - start
    faults = trouble.end()
    if code != (1 if expected else 0):
        faults.append(f"Snakemake ended with code {code}")
    wait_for(lambda: not output("squeue", "-h").strip(), "empty queue", 60)

    with (work / "results" / "subjects.csv").open(newline="") as file:
        rows = {row["subject"]: row for row in csv.DictReader(file)}
    if len(rows) != count:
        faults.append(f"the report has {len(rows)} subjects, expected {count}")
    good = []
    for name, row in rows.items():
        if name in expected:
            if row["state"] != "failed" or expected[name] not in row["line"]:
                faults.append(f"{name}: {row['state']}, {row['line']!r}, expected {expected[name]!r}")
        elif row["state"] != "done":
            faults.append(f"{name}: {row['state']}, {row['line']!r}")
        else:
            good.append(name)
    for file_name in ("avatar.gsh", "avatar.ply", "preview.png"):
        alone = (work / "alone" / file_name).read_bytes()
        faults += [f"{name}: {file_name}: other bytes than a run alone" for name in good
                   if (work / "results" / name / "avatar" / file_name).read_bytes() != alone]  # fmt: skip
    faults += faults_of_starts(work, trouble) + faults_of_remains(work, work / "alone", good)
    print("\n".join(faults) or "all as expected")
    print(f"{len(rows)} subjects, {len(expected)} of them broken, in {seconds:.0f} s")
    return 1 if faults else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("bin", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--subjects", type=int, default=20)
    parser.add_argument("--troubles", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.inside:
        # The shell is the first process of its namespace: it collects processes whose parents have ended.
        namespaces = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc", "--",
                      "sh", "-c", '"$@"; exit $?', "sh"]  # fmt: skip
        sys.exit(subprocess.run([*namespaces, sys.executable, __file__, "--inside", *sys.argv[1:]]).returncode)
    sys.exit(inside(options.bin.resolve(), options.work.resolve(), options.subjects, options.troubles, options.seed))
