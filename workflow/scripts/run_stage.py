# SPDX-License-Identifier: Apache-2.0
"""Runs a program of gsh as a stage of a subject, and leaves a record of it: what came of it, in which time and memory.

    run_stage.py --record FILE.json --log FILE.log [--attempt N] [--then FILE.json] [--accept CODE]... [--stdout FILE]
                 [--findings CHECK.json] [--out FOLDER [--work FOLDER] [--figures NAME] [--basis FILE] [--remove PATTERN]]
                 -- PROGRAM ARGUMENT...

SIGTERM and SIGINT reach the program as SIGTERM, which does no harm where it also comes from elsewhere, and the program
is waited for: gsh-reconstruct then writes a checkpoint. An input that a program refuses is as bad the second time, so a
later attempt ends at once with the same line. Attempts after a lack of memory, a kill or an interruption run again. A
record is there from the start of a program, so that one that was killed with this script has a record, too, and its
seconds count. Needs nothing but Python."""

from __future__ import annotations

import argparse
import base64
import contextlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

TRANSIENT = ("out of memory", "No space left on device", "is writing there")  # of messages: another attempt may succeed
INTERRUPTED = {130, -signal.SIGTERM, -signal.SIGINT}
NOTE_SECONDS = 0.5, 10.0  # the record notes that a program runs when its time has doubled; least and longest pause


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--record", type=Path, required=True)
    parser.add_argument("--log", type=Path, required=True)
    parser.add_argument("--attempt", type=int, default=1)
    parser.add_argument("--then", type=Path, help="the record of the next stage in the same job: if that was refused, "
                        "a later attempt ends at once")  # fmt: skip
    parser.add_argument("--accept", type=int, action="append", default=[0])
    parser.add_argument("--stdout", type=Path)
    parser.add_argument("--findings", type=Path, help="check.json of gsh-check, which says why it ended with code 1")
    parser.add_argument("--out", type=Path, help="the folder of the results, which the program gets as its --out")
    parser.add_argument("--work", type=Path, help="the program's --out instead, from which results go to that folder")
    parser.add_argument(
        "--figures",
        help="metrics.json in the folder of the results; its figures go to the record, with "
        "the picture preview.png beside it",
    )
    parser.add_argument("--basis", type=Path, help="a file that checkpoints in the folder of the results belong to")
    parser.add_argument("--remove", help="a pattern of files there that are not needed when the results are complete")
    parser.add_argument("command", nargs="+")
    options = parser.parse_args()
    if options.basis:
        forget_other_work(options.work or options.out, options.basis)
    if options.out:
        options.command += ["--out", str(options.work or options.out)]

    earlier = read_record(options.record)
    is_same = earlier.get("command") == options.command
    refusals = [earlier] if is_same else []
    if options.then:
        if options.attempt == 1:
            options.then.unlink(missing_ok=True)  # of an earlier run
        refusals.append(read_record(options.then))
    if options.attempt > 1:
        for refusal in refusals:
            if refusal.get("state") == "refused":
                print(refusal["line"], file=sys.stderr)
                return 1
    for path in (options.record, options.log, options.stdout):
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
    goes_on = is_same and earlier.get("state") != "done"
    basis = {
        "command": options.command,
        "attempt": options.attempt,
        "starts": int(earlier.get("starts", 0)) + 1 if goes_on else 1,
        "earlier_seconds": round(seconds_of(earlier), 3) if goes_on else 0.0,
        "host": os.uname().nodename,
    }

    def note(seconds: float) -> None:
        line = f"did not end: it still runs on {basis['host']}, or was killed with its job"
        content = {"state": "running", "line": line, "seconds": round(seconds, 3), **basis}
        with contextlib.suppress(OSError):  # on a full disk, the program may still end well
            write_whole(options.record, json.dumps(content, indent=2) + "\n")

    record = run(options.command, options.log, options.stdout, options.accept, note) | basis
    if options.findings and record["code"] == 1:
        record |= findings_of(options.findings, record)
    if options.out and record["state"] == "done":
        made = options.work or options.out
        if options.figures:
            record |= figures_of(made / options.figures)
        if options.remove:
            for path in made.glob(options.remove):
                path.unlink()
        if options.work:
            move_results(options.work, options.out)
    write_whole(options.record, json.dumps(record, indent=2) + "\n")
    if record["state"] == "done":
        return 0
    print(record["line"], file=sys.stderr)
    return 1


def run(
    command: list[str], log: Path, stdout: Path | None, accepted: list[int], note: Callable[[float], None]
) -> dict[str, Any]:
    """Runs a command to its end. Its output goes to the log, and its standard output to `stdout` if that is given.
    `note` is called with the seconds since the start, at once and again while the command runs."""
    start = time.monotonic()
    process: subprocess.Popen[bytes] | None = None
    stopped = False

    def stop(_number: int, _frame: object) -> None:
        nonlocal stopped
        stopped = True
        if process:
            process.terminate()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
    with log.open("wb") as errors, stdout.open("wb") if stdout else log.open("ab") as output:
        try:
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=errors)
        except OSError as error:
            line = f"{command[0]}: cannot be started: {error.strerror}"
            errors.write(line.encode() + b"\n")
            return {"state": "refused", "line": line, "code": 127, "seconds": 0.0, "peak_memory_bytes": 0}
        if stopped:  # before there was a process to tell
            process.terminate()
        code = None
        while code is None:
            seconds = time.monotonic() - start
            note(seconds)
            try:
                code = process.wait(min(max(seconds, NOTE_SECONDS[0]), NOTE_SECONDS[1]))
            except subprocess.TimeoutExpired:
                pass
    state, line = judge(code, last_line(log), accepted)
    return {
        "state": state,
        "line": line,
        "code": code,
        "seconds": round(time.monotonic() - start, 3),
        "peak_memory_bytes": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024,
    }


def seconds_of(record: dict[str, Any]) -> float:
    """The seconds of all attempts of a stage."""
    return float(record.get("seconds", 0)) + float(record.get("earlier_seconds", 0))


def judge(code: int, line: str, accepted: list[int]) -> tuple[str, str]:
    """What came of a program, and the line that says why: done, refused (the input is bad), or failed (another attempt
    may succeed)."""
    if code in accepted:
        return "done", ""
    if code in INTERRUPTED:
        return "failed", "interrupted; the next run goes on from the last checkpoint"
    if code < 0:
        return "failed", f"killed by {signal.Signals(-code).name}" + (
            ", probably for a lack of memory" if code == -signal.SIGKILL else ""
        )
    if any(words in line for words in TRANSIENT):
        return "failed", line
    return "refused", line or f"ended with code {code} and no message"


def forget_other_work(folder: Path, basis: Path) -> None:
    """Removes checkpoints that belong to another content of `basis`. A plan is made anew when the input changes, and no
    two plans are alike, because each holds the time that loading took."""
    noted, content = folder / "checkpoint.basis", basis.read_bytes()
    if noted.exists() and noted.read_bytes() == content:
        return
    for checkpoint in folder.glob("checkpoint*.gsh"):
        checkpoint.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    noted.write_bytes(content)


def figures_of(metrics: Path) -> dict[str, Any]:
    """What a report needs of metrics.json, and the picture beside it, so that it needs no file but the record."""
    content = read_record(metrics)
    regions = content.get("psnr_regions") or {}
    figures = {key: content.get(key) for key in ("psnr", "psnr_person", "seconds", "gaussians", "verdict")}
    figures |= {"psnr_face": regions.get("face"), "psnr_hands": regions.get("hands")}
    picture = metrics.with_name("preview.png")
    preview = base64.b64encode(picture.read_bytes()).decode("ascii") if picture.exists() else ""
    return {"figures": figures, "preview": preview}


def move_results(work: Path, out: Path) -> None:
    """Copies results to their place, which may be on another disk, and removes the folder."""
    shutil.copytree(work, out, ignore=shutil.ignore_patterns(".gsh-lock"), dirs_exist_ok=True)
    shutil.rmtree(work)


def findings_of(path: Path, record: dict[str, Any]) -> dict[str, Any]:
    """The findings of gsh-check, and the first of them as the line of a record that is not done."""
    findings = [str(finding.get("text")) for finding in read_record(path).get("findings", [])]
    if not findings or record["state"] == "done":
        return {"findings": findings}
    others = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
    return {"findings": findings, "line": f"gsh-check: {findings[0]}{others}"}


def last_line(log: Path) -> str:
    """The last line of a log that is not empty: gsh's programs end with one line about an error. gsh-video ends with a
    line about the stage that failed, below the line of that stage's program."""
    text = log.read_bytes()[-10_000:].decode("utf-8", "replace").replace("\r", "\n")
    lines = [line.strip() for line in text.split("\n") if line.strip() and "its message stands above" not in line]
    return lines[-1] if lines else ""


def read_record(path: Path) -> dict[str, Any]:
    """The object in a file of JSON; empty if there is none that can be read."""
    try:
        record = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def write_whole(path: Path, text: str) -> None:
    """Writes a file completely or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text, "utf-8")
    partial.replace(path)


if __name__ == "__main__":
    sys.exit(main())
