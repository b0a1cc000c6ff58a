# SPDX-License-Identifier: Apache-2.0
"""packaging/Containerfile installs what gsh needs: scripts/setup brings the packages to build it, and those at run time
are the owners of the libraries that the built programs load.

    python tests/workflow/containerfile_test.py BIN     the folder of built programs"""

import platform
import re
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RECIPE = (ROOT / "packaging" / "Containerfile").read_text()
BUILD, RUNTIME = re.split(r"^FROM .*$", RECIPE, flags=re.MULTILINE)[1:]
BIN = Path()
IN_DEBIAN = {"libc6", "libgcc-s1", "libstdc++6"}  # which apt itself loads
TOOLS = {"ca-certificates", "git", "python3-venv"}  # of the workflow


def packages_of(stage):
    """The packages that a stage installs by apt-get."""
    text = stage.replace("\\\n", " ")
    found = re.findall(r"apt-get install((?:\s+[^&\s]+)+)", text)
    return {word for words in found for word in words.split() if not word.startswith("-")}


def owners_of_libraries():
    """The packages of the libraries that programs in BIN name."""
    names = set()
    for program in BIN.glob("gsh-*"):
        listed = subprocess.run(["readelf", "--dynamic", program], check=True, capture_output=True, text=True).stdout
        names |= set(re.findall(r"\(NEEDED\).*\[(.+)\]", listed))
    cache = subprocess.run(["/sbin/ldconfig", "-p"], check=True, capture_output=True, text=True).stdout
    lines = re.findall(r"^\s+(\S+) \(.*\) => (.+)$", cache, flags=re.MULTILINE)
    paths = dict(reversed(lines))  # the first of a name is of this machine's own architecture
    files = {str(Path(paths[name]).resolve()) for name in names if name in paths}
    spelled = sorted(files | {path.removeprefix("/usr") for path in files})  # Debian 12 lists some by their old place
    found = subprocess.run(["dpkg-query", "--search", *spelled], capture_output=True, text=True, check=False).stdout
    return {line.split(":")[0] for line in found.splitlines()}


class Containerfile(unittest.TestCase):
    def test_the_build_takes_its_packages_from_setup(self):
        self.assertRegex(BUILD, r"COPY scripts/setup .*")
        self.assertRegex(BUILD, r"RUN .*\bscripts/setup\b")
        self.assertEqual(packages_of(BUILD), set())

    def test_every_folder_that_is_copied_exists(self):
        for stage in (BUILD, RUNTIME):
            for line in re.findall(r"^COPY (?!--from)(.*)$", stage, flags=re.MULTILINE):
                for name in line.split()[:-1]:
                    self.assertTrue((ROOT / name).exists(), name)

    @unittest.skipUnless(
        shutil.which("dpkg-query") and platform.freedesktop_os_release().get("VERSION_CODENAME") == "bookworm",
        "names of libraries' packages are those of Debian 12",
    )
    def test_libraries_of_the_programs_are_installed_and_no_others(self):
        owners = owners_of_libraries()
        self.assertIn("libtbb12", owners)
        self.assertEqual(packages_of(RUNTIME) - TOOLS, owners - IN_DEBIAN)


if __name__ == "__main__":
    BIN = Path(sys.argv[1]).resolve()
    unittest.main(argv=sys.argv[:1], verbosity=2)
