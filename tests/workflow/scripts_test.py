# SPDX-License-Identifier: Apache-2.0
"""Tests of workflow/scripts: the table of subjects, stages that end in every way, and the report."""

import json
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path
from unittest import mock

SCRIPTS = Path(__file__).resolve().parents[2] / "workflow" / "scripts"
sys.dont_write_bytecode = True
sys.path.insert(0, str(SCRIPTS))
import run_stage  # noqa: E402
from report import Expected, by_quality, read_result, write_report  # noqa: E402
from run_stage import last_line  # noqa: E402
from snakemake.exceptions import WorkflowError  # noqa: E402
from subjects import check_config, read_subjects  # noqa: E402


class InFolder(unittest.TestCase):
    def setUp(self):
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.folder = Path(place.name)


class Table(InFolder):
    def read(self, text, ending=".csv", **settings):
        path = self.folder / f"people{ending}"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        config = dict(settings)
        check_config(config)
        return read_subjects(path, config)

    def refuse(self, text, message, ending=".csv"):
        with self.assertRaises(WorkflowError) as caught:
            self.read(text, ending)
        self.assertEqual(str(caught.exception).replace(f"{self.folder}/", ""), message)

    def test_rows_become_subjects(self):
        subjects = self.read(
            'name,capture,video,body,poses,options,formats,findings\n\nann,"caps/a, b",,,,--set "a=b c",spz glb,\n'
            '# eve,off,,,,,,\nduo,d,,x.npz,"ann.npz,sub/bob.npz",,,ignore\nzoe,,"v.mp4 \'w 2.mp4\'",,,,html,\n',
            body="all.npz", reconstruct={"options": "--steps 9"}, export={"formats": "ply"},
        )  # fmt: skip
        self.assertEqual(list(subjects), ["ann", "duo", "zoe"])
        ann, duo, zoe = subjects.values()
        self.assertEqual((ann.capture, ann.bodies, ann.poses), ("caps/a, b", ("all.npz",), ()))
        self.assertEqual((ann.options, ann.formats), (("--steps", "9", "--set", "a=b c"), ("spz", "glb")))
        self.assertEqual((ann.findings, duo.findings), ("stop", "ignore"))
        self.assertEqual((duo.bodies, duo.formats), (("x.npz",), ("ply",)))
        self.assertEqual((ann.avatars(), duo.avatars()), (["avatar"], ["avatar-ann", "avatar-bob"]))
        self.assertEqual((zoe.videos, zoe.capture, zoe.options), (("v.mp4", "w 2.mp4"), "", ()))

    def test_image_memory_is_found_among_the_options(self):
        subjects = self.read(
            "name,capture,options\na,c,\nb,c,--image-memory 5 --steps 2\nd,c,--steps 3 --image-memory=7\n"
            "e,c,--image-memory\n"
        )
        self.assertEqual([s.image_memory() for s in subjects.values()], [None, "5", "7", None])

    def test_tabs_and_byte_order_marks_are_read(self):
        subjects = self.read(b"\xef\xbb\xbfname\tcapture\r\nann\ta,b\r\n", ".tsv")
        self.assertEqual(subjects["ann"].capture, "a,b")

    def test_mistakes_name_table_line_column_found_and_expected(self):
        self.refuse(
            "name,capture\na/b,c\n",
            "people.csv: line 2, column name: found 'a/b', expected 1 to 100 letters "
            "without accents, digits, '_', '-' and '.', of which the first is a letter or digit",
        )
        self.refuse(
            "name,capture\n\n,c\n", "people.csv: line 3, column name: found nothing, expected a name for each subject"
        )
        self.refuse(
            "name,capture\na,c\na,d\n",
            "people.csv: line 3, column name: found 'a' a second time, expected another name for each subject",
        )
        self.refuse(
            "name,capture,findings\na,c,never\n",
            "people.csv: line 2, column findings: found 'never', expected stop or ignore",
        )
        self.refuse(
            "name,capture,option\na,c,d\n",
            "people.csv: line 1: found the column option, expected some of name, "
            "capture, video, body, poses, options, formats, findings",
        )
        self.refuse(
            "name,capture,video\na,c,d\n",
            "people.csv: line 2, column capture: found a video, too, expected a capture, or a video in column video",
        )
        self.refuse(
            "name,capture\na,\n",
            "people.csv: line 2, column capture: found nothing, expected a capture, or a video in column video",
        )
        self.refuse(
            "name,video,poses\na,v,p\n",
            "people.csv: line 2, column poses: found 'p', expected nothing, because poses are fitted to a video",
        )
        self.refuse(
            'name,capture,poses\na,c,"p.npz,q/p.npz"\n',
            "people.csv: line 2, column poses: found "
            "'p.npz,q/p.npz', expected files of different names, because avatars are named after them",
        )
        self.refuse(
            "name,capture,options\na,c,--set 'b\n",
            'people.csv: line 2, column options: found "--set \'b" (No '
            "closing quotation), expected words as in a command line",
        )
        self.refuse(
            "name,capture,formats\na,c,spz spz\n",
            "people.csv: line 2, column formats: found 'spz spz', expected each format once",
        )
        self.refuse(
            "name,capture\na,b,c\n",
            "people.csv: line 2: found 3 cells, expected 2, as many as line 1 has "
            "columns; put quotes around a cell that holds the separator",
        )
        self.refuse("name,capture,name\na,b,c\n", "people.csv: line 1: found a column twice, expected each once")
        self.refuse(
            "name,capture\n",
            "people.csv: found no row, expected a row of column names and at least one subject below it",
        )
        self.refuse("", "people.csv: found no row, expected a row of column names and at least one subject below it")
        self.refuse(b"name,capture\na,\xff\n", "people.csv: byte 15: found no UTF-8, expected a table in UTF-8")
        self.refuse(
            "name,capture\na,b\n", "people.xlsx: found the ending '.xlsx', expected a table .csv or .tsv", ".xlsx"
        )

    def test_settings_are_checked_and_have_defaults(self):
        config = {"export": {"formats": "spz"}}
        check_config(config)
        self.assertEqual((config["subjects"], config["reconstruct"]["threads"]), ("config/subjects.csv", 4))
        for bad, message in (
            ({"reconstruct": {"threads": 0}}, "config: reconstruct.threads: found 0, expected a number of threads, at "
             "least 1"),
            ({"export": {"format": "spz"}}, "config: export: found the key format, expected some of formats, options"),
            ({"results": "out/"}, "config: results: found 'out/', expected the path of a folder, without a slash at its "
             "end"),
            ({"staged": True}, "config: checkpoints: found nothing, expected a folder that all machines see, because of "
             "staged: true"),
        ):  # fmt: skip
            with self.assertRaises(WorkflowError) as caught:
                check_config(bad)
            self.assertEqual(str(caught.exception), message)


class Stage(InFolder):
    def start(self, script, *words):
        command = [sys.executable, SCRIPTS / "run_stage.py", "--record", self.folder / "logs/s.json", "--log",
                   self.folder / "logs/s.log", *words, "--", "sh", "-c", script]  # fmt: skip
        return subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run_stage(self, script, *words):
        """The exit code, the record, and what was said."""
        process = self.start(script, *words)
        _, said = process.communicate()
        return process.returncode, json.loads((self.folder / "logs/s.json").read_text()), said

    def test_a_stage_that_ends_well(self):
        code, record, said = self.run_stage("echo 7; echo warning: x >&2", "--stdout", self.folder / "plan.json")
        self.assertEqual((code, record["state"], record["line"], said), (0, "done", "", ""))
        self.assertGreater(record["peak_memory_bytes"], 100_000)
        self.assertEqual((self.folder / "plan.json").read_text(), "7\n")
        self.assertEqual((self.folder / "logs/s.log").read_text(), "warning: x\n")

    def test_bad_input_is_not_tried_again_by_a_retry_but_by_a_new_run(self):
        script = f"echo run >>{self.folder}/runs; echo 'gsh: c.json: is bad' >&2; exit 2"
        for attempt, runs in (("1", 1), ("2", 1), ("3", 1), ("1", 2)):
            code, record, said = self.run_stage(script, "--attempt", attempt)
            self.assertEqual((code, record["state"], said), (1, "refused", "gsh: c.json: is bad\n"))
            self.assertEqual((self.folder / "runs").read_text().count("run"), runs)

    def test_kills_and_lack_of_memory_are_tried_again(self):
        for script, line in (
            ("kill -KILL $$", "killed by SIGKILL, probably for a lack of memory"),
            ("kill -SEGV $$", "killed by SIGSEGV"),
            ("exit 130", "interrupted; the next run goes on from the last checkpoint"),
            ("echo 'gsh: out of memory' >&2; exit 2", "gsh: out of memory"),
            ("echo 'gsh: o: p is writing there; wait' >&2; exit 2", "gsh: o: p is writing there; wait"),
        ):
            for attempt in ("1", "2"):
                code, record, _ = self.run_stage(script, "--attempt", attempt)
                self.assertEqual((code, record["state"], record["line"]), (1, "failed", line))
                self.assertEqual(record["attempt"], int(attempt))

    def test_a_stage_is_not_tried_again_where_the_next_one_refused(self):
        then, script = self.folder / "logs/then.json", f"echo run >>{self.folder}/runs"
        then.parent.mkdir()
        refusal = json.dumps({"state": "refused", "line": "gsh: --x is unknown"})
        for attempt, content, code, runs in (
            ("1", refusal, 0, 1),  # of an earlier run
            ("2", None, 0, 2),
            ("2", json.dumps({"state": "failed", "line": "killed"}), 0, 3),
            ("2", refusal, 1, 3),
        ):
            then.unlink(missing_ok=True)
            if content:
                then.write_text(content)
            found, _, said = self.run_stage(script, "--attempt", attempt, "--then", then)
            self.assertEqual((found, said), (code, "gsh: --x is unknown\n" if code else ""))
            self.assertEqual((self.folder / "runs").read_text().count("run"), runs)

    def test_seconds_and_starts_of_all_attempts_count_until_one_is_done(self):
        self.run_stage("sleep 0.2; exit 130")
        first = json.loads((self.folder / "logs/s.json").read_text())
        self.assertEqual((first["starts"], first["earlier_seconds"]), (1, 0))
        script = f"[ -e {self.folder}/again ] && exit 0; sleep 0.7; kill -KILL $PPID"  # with the script
        self.start(script).communicate()
        killed = json.loads((self.folder / "logs/s.json").read_text())
        self.assertEqual((killed["state"], killed["starts"], killed["earlier_seconds"]), ("running", 1, 0))
        self.assertGreaterEqual(killed["seconds"], 0.5)
        self.start(script).communicate()  # now of the same command
        (self.folder / "again").touch()
        _, record, _ = self.run_stage(script)
        self.assertEqual((record["state"], record["starts"]), ("done", 3))
        self.assertGreaterEqual(record["earlier_seconds"], 1)
        _, record, _ = self.run_stage(script)
        self.assertEqual((record["starts"], record["earlier_seconds"]), (1, 0))

    def test_a_record_grows_while_a_program_runs(self):
        seconds = []
        with mock.patch.object(run_stage, "NOTE_SECONDS", (0.05, 0.1)):
            record = run_stage.run(["sleep", "0.5"], self.folder / "log", None, [0], seconds.append)
        self.assertGreaterEqual(len(seconds), 4)
        self.assertEqual(seconds, sorted(seconds))
        self.assertLess(seconds[-1], record["seconds"])
        self.assertEqual(run_stage.seconds_of({"seconds": 2, "earlier_seconds": 3}), 5)

    def test_findings_are_the_line_unless_they_are_ignored(self):
        found = self.folder / "check.json"
        found.write_text('{"findings": [{"text": "turned"}, {"text": "small"}]}')
        self.assertEqual(self.run_stage("exit 1", "--findings", found)[1]["line"], "gsh-check: turned (and 1 more)")
        code, record, _ = self.run_stage("exit 1", "--findings", found, "--accept", "1")
        self.assertEqual((code, record["state"], record["findings"]), (0, "done", ["turned", "small"]))

    def test_a_signal_reaches_the_program_which_is_waited_for(self):
        process = self.start(f"trap 'sleep 0.3; echo saved >{self.folder}/saved; exit 130' TERM; "
                             f"echo on >{self.folder}/on; while :; do sleep 0.05; done")  # fmt: skip
        while not (self.folder / "on").exists():
            time.sleep(0.01)
        process.send_signal(signal.SIGTERM)
        process.communicate()
        self.assertEqual(process.returncode, 1)
        self.assertTrue((self.folder / "saved").exists())

    def test_results_leave_the_folder_of_work_when_they_are_complete(self):
        work, out = self.folder / "work", self.folder / "out"
        script = 'mkdir -p "$1" && touch "$1/checkpoint.gsh" "$1/metrics.json"; '
        self.run_stage(script + "exit 130", "--out", out, "--work", work)  # $0 is --out
        self.assertTrue((work / "checkpoint.gsh").exists())
        self.assertFalse(out.exists())
        self.run_stage(script, "--out", out, "--work", work, "--remove", "checkpoint.*")
        self.assertEqual([path.name for path in out.iterdir()], ["metrics.json"])
        self.assertFalse(work.exists())

    def test_checkpoints_of_another_input_are_removed(self):
        basis, checkpoint = self.folder / "plan.json", self.folder / "out/checkpoint.gsh"
        for content, kept in (("a", False), ("a", True), ("b", False), ("b", True)):
            basis.write_text(content)
            checkpoint.parent.mkdir(exist_ok=True)
            checkpoint.touch()
            script = f"[ -e {checkpoint} ] && echo kept >{self.folder}/kept; true"
            self.run_stage(script, "--out", checkpoint.parent, "--basis", basis)
            self.assertEqual((self.folder / "kept").exists(), kept)
            (self.folder / "kept").unlink(missing_ok=True)

    def test_figures_and_the_picture_go_to_the_record(self):
        (self.folder / "metrics.json").write_text('{"psnr": 30.5, "psnr_regions": {"face": 31}, "images": []}')
        (self.folder / "preview.png").write_bytes(b"PNG")
        _, record, _ = self.run_stage("", "--out", self.folder, "--figures", "metrics.json")
        self.assertEqual((record["figures"]["psnr"], record["figures"]["psnr_face"]), (30.5, 31))
        self.assertEqual((record["figures"]["psnr_hands"], record["preview"]), (None, "UE5H"))

    def test_a_program_that_is_not_there(self):
        command = [sys.executable, SCRIPTS / "run_stage.py", "--record", self.folder / "r.json", "--log",
                   self.folder / "r.log", "--", "gsh-none"]  # fmt: skip
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual((run.returncode, run.stderr), (1, "gsh-none: cannot be started: No such file or directory\n"))

    def test_progress_is_not_the_last_line(self):
        log = self.folder / "log"
        log.write_bytes(b"training 10%\rtraining 20%\n\xff: is bad\n\n")
        self.assertEqual(last_line(log), "\ufffd: is bad")
        log.write_bytes(
            b"gsh-fit: no person\ngsh-video: the stage 'x' ended with code 2; its message stands above. So\n"
        )
        self.assertEqual(last_line(log), "gsh-fit: no person")
        log.write_bytes(b"")
        self.assertEqual(last_line(log), "")


class Report(InFolder):
    def record(self, name, stage, **content):
        logs = self.folder / name / "logs"
        logs.mkdir(parents=True, exist_ok=True)
        (logs / f"{stage}.json").write_text(json.dumps(content))

    def make(self, name, person=30.0, preview="UE5H", **record):
        figures = {
            "psnr": 40.0,
            "psnr_person": person,
            "psnr_face": 33.0,
            "psnr_hands": None,
            "seconds": 12.5,
            "gaussians": 170000,
            "verdict": "Good.",
        }
        self.record(name, "check", state="done", seconds=5.0, peak_memory_bytes=1)
        self.record(name, "reconstruct", **{"state": "done", "seconds": 15.0, "peak_memory_bytes": 5,
                                            "figures": figures, "preview": preview} | record)  # fmt: skip

    def write(self, *names, pictures=200, files=()):
        page, table = self.folder / "out/report.html", self.folder / "out/subjects.csv"
        expected = [Expected(name, ("check", "reconstruct"), files) for name in names]
        lines = write_report(self.folder, expected, pictures, page, table)
        return lines, page.read_text(), table.read_text()

    def test_the_worst_come_first_and_those_without_figures_last(self):
        for name, person in (("a", 30.0), ("b", 20.0), ("c", 25.0), ("d", None)):
            self.make(name, person)
        results = [read_result(self.folder, Expected(name, ("reconstruct",))) for name in "abcd"]
        self.assertEqual([result.name for result in by_quality(results)], ["b", "c", "a", "d"])

    def test_the_page_holds_ten_worst_pictures_totals_and_failures(self):
        names = [f"s{k:02}" for k in range(12)]
        for k, name in enumerate(names):
            self.make(name, 20.0 + k)
        self.record("bad", "check", state="refused", line="c.json: <is> bad", starts=3, seconds=1)
        lines, page, table = self.write(*names, "bad", "later", pictures=11)
        self.assertEqual(lines, ["bad: check: c.json: <is> bad", "later: not run: nothing was tried"])
        self.assertIn("12 of 14 avatars are made", page)
        self.assertIn("c.json: &lt;is&gt; bad", page)
        self.assertEqual(page.count("<figure>"), 10)
        self.assertEqual(page.count("data:image/png;base64,UE5H"), 10 + 11)
        self.assertIn("4 min 1 s", page)  # 12 times 20 s, and 1 s
        self.assertIn('<td>person</td><td class="n">25.50</td><td class="n">25.50</td><td class="n">20.00</td>', page)
        self.assertNotIn("<td>hands</td>", page)
        self.assertNotIn('src="s', page)  # nothing is loaded from elsewhere
        self.assertIn("s03,done,40.000,23.000,33.000,,20.00,12.50,5,170000,1,,,Good.,s03/avatar/report.html\n", table)
        self.assertIn("bad,failed,,,,,1.00,,0,,3,check,c.json: <is> bad,,\n", table)

    def test_failures_of_a_new_run_count_and_those_of_stages_that_are_not_expected_do_not(self):
        self.make("a")
        self.record("a", "export-avatar.glb", state="refused", line="of a format that was asked for once")
        self.assertEqual(self.write("a")[0], [])
        self.record("a", "check", state="failed", line="killed by SIGKILL")
        self.assertEqual(self.write("a")[0], ["a: check: killed by SIGKILL"])

    def test_seconds_of_all_attempts_count_and_a_stage_that_did_not_end_is_a_failure(self):
        self.make("a", seconds=15.0, earlier_seconds=100.0, starts=4)
        self.assertIn("a,done,40.000,30.000,33.000,,120.00,12.50,5,170000,4,", self.write("a")[2])
        self.record("a", "reconstruct", state="running", line="did not end", seconds=7.0, earlier_seconds=1.0)
        lines, _, table = self.write("a")
        self.assertEqual(lines, ["a: reconstruct: did not end"])
        self.assertIn("a,failed,,,,,13.00,", table)

    def test_a_subject_whose_files_are_gone_is_not_done(self):
        self.make("a")
        self.assertEqual(self.write("a", files=(str(self.folder / "none"),))[0], ["a: not run: nothing was tried"])

    def test_damaged_records_make_no_error(self):
        self.make("a", preview="")
        (self.folder / "a/logs/check.json").write_text("{")
        (self.folder / "a/logs/reconstruct.json").write_text("[]")
        lines, page, _ = self.write("a")
        self.assertEqual(lines, ["a: not run: nothing was tried"])
        self.assertIn("0 of 1 avatars", page)

    def test_a_report_of_nothing(self):
        self.assertIn("0 of 0 avatars", self.write()[1])


if __name__ == "__main__":
    unittest.main()
