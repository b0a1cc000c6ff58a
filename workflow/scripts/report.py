# SPDX-License-Identifier: Apache-2.0
"""The report of all subjects: one page in one file, and a table."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from statistics import fmean, median
from typing import Any

import jinja2
from run_stage import read_record, seconds_of, write_whole

FIGURES = ("psnr", "psnr_person", "psnr_face", "psnr_hands")
COLUMNS = (
    "subject",
    "state",
    *FIGURES,
    "seconds",
    "training_seconds",
    "peak_memory_bytes",
    "gaussians",
    "attempts",
    "stage",
    "line",
    "verdict",
    "report",
)
WORST = 10


@dataclass(frozen=True)
class Expected:
    """What the workflow makes of a subject: the stages that leave a record, and files, as far as they can be seen."""

    name: str
    stages: tuple[str, ...]
    files: tuple[str, ...] = ()


@dataclass
class Result:
    """What became of a subject. Figures are in dB, and NaN where there is none."""

    name: str
    state: str  # done, failed or missing
    stage: str = ""  # that failed
    line: str = ""  # why
    figures: dict[str, float] = field(default_factory=lambda: dict.fromkeys(FIGURES, math.nan))
    seconds: float = 0  # of all stages and all their attempts
    training_seconds: float = math.nan
    memory: int = 0  # bytes at most
    gaussians: int = 0
    attempts: int = 0  # of the stage that took most, those included that Slurm put back into the queue
    verdict: str = ""
    findings: list[str] = field(default_factory=list)
    page: str = ""  # of the avatar, relative to the report
    picture: str = ""  # PNG in base64

    @property
    def is_done(self) -> bool:
        return self.state == "done"

    def row(self) -> dict[str, Any]:
        cells = {key: "" if math.isnan(value) else f"{value:.3f}" for key, value in self.figures.items()}
        training = "" if math.isnan(self.training_seconds) else f"{self.training_seconds:.2f}"
        return cells | {
            "subject": self.name, "state": self.state, "seconds": f"{self.seconds:.2f}", "training_seconds": training,
            "peak_memory_bytes": self.memory, "gaussians": self.gaussians or "", "attempts": self.attempts,
            "stage": self.stage, "line": self.line, "verdict": self.verdict, "report": self.page,
        }  # fmt: skip


def read_result(records: Path, expected: Expected) -> Result:
    """What the records of a subject tell. A subject is done if all its stages are, and its files are there."""
    found = [read_record(records / expected.name / "logs" / f"{stage}.json") for stage in expected.stages]
    result = Result(expected.name, "missing")
    if all(record.get("state") == "done" for record in found) and all(Path(path).exists() for path in expected.files):
        result.state = "done"
    for stage, record in zip(expected.stages, found):
        if record.get("state") not in (None, "done"):
            result.state, result.stage, result.line = "failed", stage, str(record.get("line", ""))
            break  # later stages are of an earlier run
    result.seconds = sum(seconds_of(record) for record in found)
    result.memory = max((int(record.get("peak_memory_bytes", 0)) for record in found), default=0)
    result.attempts = max((int(record.get("starts", 1)) for record in found if record), default=0)
    result.findings = [text for record in found for text in record.get("findings", [])]
    for record in found:
        if figures := record.get("figures"):
            result.figures = {key: math.nan if figures.get(key) is None else float(figures[key]) for key in FIGURES}
            result.training_seconds = float(figures.get("seconds") or math.nan)
            result.gaussians = int(figures.get("gaussians") or 0)
            result.verdict = str(figures.get("verdict") or "")
            result.page = f"{expected.name}/avatar/report.html"
            result.picture = str(record.get("preview", ""))
    return result


def by_quality(results: Iterable[Result]) -> list[Result]:
    """Finished subjects, the worst first: by the PSNR on the person, of the whole image where no person is judged."""

    def quality(result: Result) -> tuple[bool, float, str]:
        person, image = result.figures["psnr_person"], result.figures["psnr"]
        value = image if math.isnan(person) else person
        return math.isnan(value), 0 if math.isnan(value) else value, result.name

    return sorted((result for result in results if result.is_done), key=quality)


def write_report(
    records: str | Path, expected: Iterable[Expected], pictures: int, page: str | Path, table: str | Path
) -> list[str]:
    """Writes the page and the table of what is expected, by the records that are in the folder `records`. `pictures` is
    the number of subjects with a picture on the page, the worst first. Returns a line for each subject that is not
    done."""
    found = [read_result(Path(records), subject) for subject in expected]
    done = by_quality(found)
    others = sorted((result for result in found if not result.is_done), key=lambda result: (result.state, result.name))
    images = {result.name: result.picture for result in done[:pictures] if result.picture}
    text = _template().render(
        done=done,
        failed=[result for result in others if result.state == "failed"],
        missing=[result for result in others if result.state == "missing"],
        worst=done[:WORST],
        pictures=images,
        totals=_totals(found, done),
        made=datetime.now(timezone.utc),
    )
    for path in (page, table):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_whole(Path(page), text)
    rows = io.StringIO()
    writer = csv.DictWriter(rows, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(result.row() for result in found)
    write_whole(Path(table), rows.getvalue())
    return [f"{result.name}: {result.stage or 'not run'}: {result.line or 'nothing was tried'}" for result in others]


def _totals(found: list[Result], done: list[Result]) -> dict[str, Any]:
    """Numbers of subjects, sums of seconds, the most memory, and mean, median and least of each figure."""

    def spread(key: str) -> dict[str, float] | None:
        values = [result.figures[key] for result in done if not math.isnan(result.figures[key])]
        return {"mean": fmean(values), "median": median(values), "least": min(values)} if values else None

    return {
        "subjects": len(found),
        "done": len(done),
        "failed": sum(result.state == "failed" for result in found),
        "missing": sum(result.state == "missing" for result in found),
        "seconds": sum(result.seconds for result in found),
        "memory": max((result.memory for result in found), default=0),
        "figures": {key: spread(key) for key in FIGURES},
    }


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).resolve().parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["db"] = lambda value: "–" if value is None or math.isnan(value) else f"{value:.2f}"
    environment.filters["duration"] = _duration
    environment.filters["megabytes"] = lambda value: f"{value / 1e6:,.0f} MB" if value else "–"
    return environment.get_template("report.html.jinja")


def _duration(seconds: float) -> str:
    if math.isnan(seconds):
        return "–"
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
