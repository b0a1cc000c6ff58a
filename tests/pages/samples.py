# SPDX-License-Identifier: Apache-2.0
"""Samples on the pages: code blocks by language, and the command lines in them."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]


class Sample(NamedTuple):
    page: str  # path in the repository
    line: int  # of its first line, from 1
    language: str  # of a fenced block; "indented" or "inline" for other code
    text: str

    @property
    def where(self):
        return f"{self.page}:{self.line}"


def pages():
    """The pages for users. CHANGELOG.md is about the past, when other options were right."""
    found = [ROOT / name for name in ("README.md", "examples/README.md")]
    return found + sorted((ROOT / "docs").rglob("*.md"))


def samples_of(page):
    """All code of a page, in its order."""
    name = str(page.relative_to(ROOT))
    fence, block, first, prose = None, [], 0, []
    for number, line in enumerate(page.read_text().split("\n"), 1):
        opening = re.match(r" *```(\w*)$", line)
        if fence is None and opening:
            fence, block, first = opening[1], [], number + 1
            prose.append("")
        elif fence is not None:
            if line.strip() == "```":
                yield Sample(name, first, fence, "\n".join(block) + "\n")
                fence = None
            else:
                block.append(line)
            prose.append("")
        else:
            prose.append(line)
    text = "\n".join(prose)
    for match in re.finditer(r"(?<=\n\n)(?:    .*\n)+", text):
        yield Sample(name, text.count("\n", 0, match.start()) + 1, "indented", re.sub(r"(?m)^    ", "", match[0]))
    text = re.sub(r"(?m)^    .*$", "", text)
    for match in re.finditer(r"`([^`]+)`", text):
        yield Sample(name, text.count("\n", 0, match.start()) + 1, "inline", match[1].replace("\n", " "))


def commands_of(text):
    """The words of each command in shell code, without comments, redirections' operators and assignments."""
    text = re.sub(r"\\\n", " ", text)
    text = re.sub(r"(?m)(^|\s)#.*$", "", text)
    for command in re.split(r"\n|&&|\|\|?|;|\$\(", text):
        try:
            words = shlex.split(command)
        except ValueError:  # half of a quotation, as in prose
            words = command.split()
        while words and (re.match(r"\w+=", words[0]) or words[0] in ("sudo", "time", "cd")):
            words.pop(0)
        if words:
            yield words
