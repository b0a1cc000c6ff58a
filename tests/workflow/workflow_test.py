# SPDX-License-Identifier: Apache-2.0
"""The workflow on subjects of the built-in actor: good ones are made, broken ones have their own line, a job that is
killed goes on with the same bits, and a second run makes nothing.

    python tests/workflow/workflow_test.py BIN WORK     the folder of built programs, and one for the runs

Python must have Snakemake (scripts/test keeps one in build/workflow-venv)."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest
from pathlib import Path

sys.dont_write_bytecode = True
from broken import BROKEN  # noqa: E402

SNAKEFILE = Path(__file__).resolve().parents[2] / "workflow" / "Snakefile"
BIN, WORK = Path(), Path()

CONFIG = """\
programs: {programs}
body: {body}
reconstruct: {{options: --steps 40 --gaussians 1500, threads: 1, checkpoint_interval: 0.001}}
export: {{formats: spz}}
"""
TABLE = "name,capture,findings\nann,film,\nbob,film,\ncut,cut,\nturned,turned,\n"


def snakemake(*words):
    """A run of the workflow in WORK that has not ended yet."""
    command = [sys.executable, "-m", "snakemake", "--snakefile", SNAKEFILE, "--cores", "2", *words]
    return subprocess.Popen(
        command, cwd=WORK, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def kill_in_training(name):
    """Sends SIGTERM to the training of a subject after its first checkpoint."""
    folder = WORK / "results" / name / "avatar"
    for _ in range(60000):  # ten minutes, where a machine is very busy
        if (folder / "checkpoint.gsh").exists():
            break
        time.sleep(0.01)
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has ended
            continue
        if words[0].endswith(b"gsh-reconstruct") and os.fsencode(f"results/{name}/avatar") in words:
            os.kill(int(process.name), signal.SIGTERM)
            return
    raise AssertionError(f"the training of {name} was not found")


class Workflow(unittest.TestCase):
    """The cases build on each other, in the order of their names."""

    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        (WORK / "config").mkdir(parents=True)
        subprocess.run(
            [BIN / "08-film-a-capture", WORK, "64", "4"],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        film = WORK / "08_capture" / "hard"
        shutil.copytree(film, WORK / "film")
        for name in ("cut", "turned"):
            shutil.copytree(film, WORK / name)
            BROKEN[name][0](WORK / name)
        config = CONFIG.format(programs=BIN, body=WORK / "08_capture" / "body.npz")
        (WORK / "config" / "config.yaml").write_text(config)
        (WORK / "config" / "subjects.csv").write_text(TABLE)

    def state_of(self):
        with (WORK / "results" / "subjects.csv").open(newline="") as file:
            return {row["subject"]: row for row in csv.DictReader(file)}

    def test_1_good_subjects_are_made_and_broken_ones_have_their_line(self):
        run = snakemake()
        kill_in_training("ann")
        output, _ = run.communicate()
        self.assertNotEqual(run.returncode, 0, output)
        states = self.state_of()
        self.assertEqual(
            [states[name]["state"] for name in ("ann", "bob", "cut", "turned")],
            ["done", "done", "failed", "failed"],
            output,
        )
        page = (WORK / "results" / "report.html").read_text()
        self.assertIn("2 of 4 avatars are made", page)
        self.assertEqual(page.count("data:image/png;base64,"), 4)  # two avatars, each twice
        for name in ("cut", "turned"):
            self.assertIn(BROKEN[name][2], states[name]["line"])
            self.assertIn(f"{name}: check: {states[name]['line']}", output)
            self.assertFalse((WORK / "results" / name / "avatar").exists())
        self.assertFalse((WORK / "results" / "all.done").exists())

    def test_2_a_killed_job_goes_on_with_the_same_bits(self):
        ann, bob = WORK / "results" / "ann", WORK / "results" / "bob"
        record = json.loads((ann / "logs" / "reconstruct.json").read_text())
        self.assertEqual((record["attempt"], record["starts"]), (2, 2))
        self.assertGreater(record["earlier_seconds"], 0)
        self.assertFalse((ann / "avatar" / "checkpoint.gsh").exists())
        for name in ("avatar/avatar.gsh", "avatar/avatar.ply", "avatar/preview.png", "exports/avatar.spz"):
            self.assertEqual((ann / name).read_bytes(), (bob / name).read_bytes(), name)

    def test_3_a_second_run_makes_nothing(self):
        (WORK / "config" / "subjects.csv").write_text(TABLE[: TABLE.index("cut")])
        made = {path: path.stat().st_mtime_ns for path in (WORK / "results").rglob("avatar.*")}
        output, _ = snakemake().communicate()
        self.assertTrue((WORK / "results" / "all.done").exists(), output)
        self.assertIn("2 of 2 avatars are made", (WORK / "results" / "report.html").read_text())
        run = snakemake()
        output, _ = run.communicate()
        self.assertEqual(run.returncode, 0, output)
        self.assertIn("Nothing to be done", output)
        self.assertEqual({path: path.stat().st_mtime_ns for path in made}, made)


if __name__ == "__main__":
    BIN, WORK = (Path(word).resolve() for word in sys.argv[1:3])
    unittest.main(argv=sys.argv[:1], verbosity=2, failfast=True)
