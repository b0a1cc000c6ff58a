# SPDX-License-Identifier: Apache-2.0
"""Python and JSON samples on the pages: all parse, and those of the pages below run, in the order of their page.

    python3 tests/pages/python_test.py              all parse
    PYTHON tests/pages/python_test.py --run AVATAR  also runs them, in a Python that has torch and imports gsh;
                                                    AVATAR is an avatar.gsh
"""

import ast
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

from samples import ROOT, pages, samples_of

# Pages of which every Python sample is a program, with what they say before: they need gsh, torch and avatar.gsh alone.
# Samples of other pages convert files of other programs, which are not here.
PROGRAMS = ["docs/python-torch.md", "docs/from-gsplat.md"]


def check(sample):
    """Raises unless the sample is of its language."""
    if sample.language == "json":
        json.loads(sample.text)
    else:
        ast.parse(sample.text)


def run(page, avatar):
    """Runs the samples of a page one after the other, in an empty folder with avatar.gsh; returns their number."""
    names, count, before = {}, 0, os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(avatar, Path(folder) / "avatar.gsh")
        os.chdir(folder)
        try:
            for sample in samples_of(ROOT / page):
                if sample.language == "python":
                    # As many empty lines before the code as on the page: messages then have its line numbers.
                    exec(compile("\n" * (sample.line - 1) + sample.text, page, "exec"), names)
                    count += 1
        finally:
            os.chdir(before)
    return count


def main():
    arguments = sys.argv[1:]
    if arguments and (len(arguments) != 2 or arguments[0] != "--run" or not Path(arguments[1]).is_file()):
        sys.exit("usage: python_test.py [--run AVATAR.gsh]")
    parsed = ran = 0
    for page in pages():
        for sample in samples_of(page):
            if sample.language in ("python", "json"):
                try:
                    check(sample)
                except (SyntaxError, ValueError) as error:
                    sys.exit(f"error: {sample.where}: no {sample.language}: {error}")
                parsed += 1
    if parsed == 0:
        sys.exit("error: no samples were found: are code blocks still read?")
    if arguments:
        for page in PROGRAMS:
            count = run(page, arguments[1])
            if count == 0:
                sys.exit(f"error: {page} has no Python sample, expected one or more")
            ran += count
    print(f"{parsed} samples parse" + (f", {ran} run" if arguments else ""))


main()
