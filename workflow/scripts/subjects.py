# SPDX-License-Identifier: Apache-2.0
"""The table of subjects and the settings: read, checked, and refused by messages that a user can act on."""

from __future__ import annotations

import csv
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from jsonschema.exceptions import ValidationError
from snakemake.exceptions import WorkflowError
from snakemake.utils import validate

SCHEMAS = Path(__file__).resolve().parent.parent / "schemas"


@dataclass(frozen=True)
class Subject:
    """A row of the table: a capture of one person or several, or videos of one."""

    name: str
    capture: str = ""
    videos: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    poses: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    formats: tuple[str, ...] = ()
    findings: str = "stop"

    def avatars(self) -> list[str]:
        """The names of the avatars without ending: "avatar", or "avatar-ann" for each of several people."""
        if len(self.poses) < 2:
            return ["avatar"]
        return [f"avatar-{PurePath(poses).stem}" for poses in self.poses]

    def image_memory(self) -> str | None:
        """The value of --image-memory among the options; None without it."""
        for option, following in zip(self.options, (*self.options[1:], None)):
            name, equals, value = option.partition("=")
            if name == "--image-memory":
                return value if equals else following
        return None


def read_subjects(path: str | Path, config: dict[str, Any]) -> dict[str, Subject]:
    """The subjects of a table, by name. Cells that a row leaves empty have the values of the settings.

    Raises WorkflowError that names the table, the row, the column, what was found, and what was expected.
    """
    lines, rows = _rows_of(Path(path))
    try:
        validate({"subjects": rows}, str(SCHEMAS / "subjects.schema.yaml"))
    except WorkflowError as error:
        raise WorkflowError(_table_message(path, lines, _validation_of(error))) from None
    subjects: dict[str, Subject] = {}
    for line, row in zip(lines, rows):
        subject = _subject_of(f"{path}: line {line}", row, config)
        if subject.name in subjects:
            raise WorkflowError(
                f"{path}: line {line}, column name: found {subject.name!r} a second time, "
                "expected another name for each subject"
            )
        subjects[subject.name] = subject
    return subjects


def check_config(config: dict[str, Any], path: str = "config") -> None:
    """Fills in the settings' defaults. Raises WorkflowError that names the setting, what was found and expected."""
    try:
        validate(config, str(SCHEMAS / "config.schema.yaml"))
    except WorkflowError as error:
        cause = _validation_of(error)
        key = ".".join(str(word) for word in cause.absolute_path) or "the settings"
        raise WorkflowError(f"{path}: {key}: {_found_and_expected(cause)}") from None
    if config["staged"] and not config["checkpoints"]:
        raise WorkflowError(
            f"{path}: checkpoints: found nothing, expected a folder that all machines see, because of staged: true"
        )


def _rows_of(path: Path) -> tuple[list[int], list[dict[str, str]]]:
    """The numbers of the lines that hold rows, and the cells that are not empty."""
    separator = {".csv": ",", ".tsv": "\t"}.get(path.suffix.lower())
    if separator is None:
        raise WorkflowError(f"{path}: found the ending {path.suffix!r}, expected a table .csv or .tsv")
    lines, rows = [], []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, delimiter=separator, strict=True)
            if reader.fieldnames and len(set(reader.fieldnames)) < len(reader.fieldnames):
                raise WorkflowError(f"{path}: line 1: found a column twice, expected each once")
            for row in reader:
                if None in row:
                    raise WorkflowError(
                        f"{path}: line {reader.line_num}: found {len(row) - 1 + len(row[None])} cells, "
                        f"expected {len(row) - 1}, as many as line 1 has columns; put quotes around a "
                        "cell that holds the separator"
                    )
                cells = {key.strip(): value.strip() for key, value in row.items() if value and value.strip()}
                if cells and not next(iter(row.values())).lstrip().startswith("#"):
                    lines.append(reader.line_num)
                    rows.append(cells)
    except OSError as error:
        raise WorkflowError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise WorkflowError(f"{path}: byte {error.start}: found no UTF-8, expected a table in UTF-8") from None
    except csv.Error as error:
        raise WorkflowError(f"{path}: line {reader.line_num}: {error}") from None
    return lines, rows


def _subject_of(where: str, row: dict[str, str], config: dict[str, Any]) -> Subject:
    def refuse(column: str, found: str, expected: str) -> None:
        raise WorkflowError(f"{where}, column {column}: found {found}, expected {expected}")

    if ("capture" in row) == ("video" in row):
        refuse("capture", "a video, too" if "video" in row else "nothing", "a capture, or a video in column video")
    if "video" in row and "poses" in row:
        refuse("poses", repr(row["poses"]), "nothing, because poses are fitted to a video")

    def words(column: str, text: str) -> tuple[str, ...]:
        try:
            return tuple(shlex.split(text))
        except ValueError as error:
            refuse(column, f"{text!r} ({error})", "words as in a command line")
            raise AssertionError from error

    kind = "video" if "video" in row else "reconstruct"
    subject = Subject(
        name=row["name"],
        capture=row.get("capture", ""),
        videos=words("video", row.get("video", "")),
        bodies=_listed(row.get("body", config["body"])),
        poses=_listed(row.get("poses", "")),
        options=words("options", config[kind]["options"]) + words("options", row.get("options", "")),
        formats=tuple(row.get("formats", config["export"]["formats"]).split()),
        findings=row.get("findings", config["findings"]),
    )
    avatars = subject.avatars()
    if len(set(avatars)) < len(avatars):
        refuse("poses", repr(row["poses"]), "files of different names, because avatars are named after them")
    if len(set(subject.formats)) < len(subject.formats):
        refuse("formats", repr(" ".join(subject.formats)), "each format once")
    return subject


def _listed(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _validation_of(error: WorkflowError) -> ValidationError:
    """The error of jsonschema in one of Snakemake's."""

    def causes() -> Iterator[BaseException | str]:
        yield from error.args
        yield from (cause for cause in (error.__cause__, error.__context__) if cause)

    for cause in causes():
        if isinstance(cause, ValidationError):
            return cause
    raise error


def _table_message(path: str | Path, lines: list[int], cause: ValidationError) -> str:
    place = list(cause.absolute_path)[1:]
    if not place:
        return f"{path}: found no row, expected a row of column names and at least one subject below it"
    where = f"{path}: line {lines[int(place[0])]}"
    if cause.validator == "required":
        return f"{where}, column name: found nothing, expected a name for each subject"
    if cause.validator == "additionalProperties":
        columns = ", ".join(cause.schema["properties"])
        unknown = ", ".join(key for key in cause.instance if key not in cause.schema["properties"])
        return f"{path}: line 1: found the column {unknown}, expected some of {columns}"
    return f"{where}, column {place[1]}: {_found_and_expected(cause)}"


def _found_and_expected(cause: ValidationError) -> str:
    if cause.validator == "additionalProperties":
        unknown = ", ".join(key for key in cause.instance if key not in cause.schema["properties"])
        return f"found the key {unknown}, expected some of {', '.join(cause.schema['properties'])}"
    return f"found {cause.instance!r}, expected {cause.schema.get('description', cause.message)}"
