# SPDX-License-Identifier: Apache-2.0
"""The installed package: its version, and the choice of the instruction set."""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import gsh
import pytest


def test_version_is_that_of_the_headers():
    config = Path(__file__).parents[2] / "include/gsh/core/config.hpp"
    parts = re.findall(r"#define GSH_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", config.read_text())
    assert gsh.__version__ in (".".join(parts), "0")


def run_without(feature):
    environment = dict(os.environ, GLIBC_TUNABLES=f"glibc.cpu.hwcaps=-{feature}")
    return subprocess.run([sys.executable, "-c", "import gsh; print(gsh.instruction_set)"], env=environment,
                          capture_output=True, text=True)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="levels are for x86-64")
def test_instruction_set_is_chosen_at_import():
    assert gsh.instruction_set.startswith("avx")
    assert run_without("AVX512F").stdout.strip() == "avx2"
    refused = run_without("AVX2")
    assert refused.returncode != 0
    assert "ImportError: gsh: this processor has none of the instruction sets" in refused.stderr
