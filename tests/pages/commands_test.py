# SPDX-License-Identifier: Apache-2.0
"""Command lines on the pages: programs, scripts and stories exist, each option is one that --help of its program
lists, presets and settings of CMake exist.

    python3 tests/pages/commands_test.py BIN     the folder of built programs
"""

import functools
import json
import re
import subprocess
import sys
from pathlib import Path

from samples import ROOT, commands_of, pages, samples_of

OPTION = re.compile(r"--[a-z][a-z0-9-]*")
# Options of GCC, Chromium and OpenPose in the text.
OTHERS = {"--param", "--disable-gpu", "--use-angle", "--hand", "--face"}


@functools.cache
def options_of_program(program, folder):
    """The options in the output of --help; None if there is no such program."""
    if not (folder / program).is_file():
        return None
    text = subprocess.run([folder / program, "--help"], capture_output=True, text=True, check=True).stdout
    found = {option for line in text.split("\n") if line.startswith("  -") for option in OPTION.findall(line[:60])}
    if "--help" not in found:
        raise RuntimeError(f"{program} --help lists no options")
    return found


@functools.cache
def options_of_script(script):
    """The options that the text of a script names; None if there is no such script."""
    path = ROOT / script
    if not path.is_file():
        return None
    text = path.read_text()
    if script == "scripts/detect":
        text += "".join(file.read_text() for file in (ROOT / "scripts/detector").glob("*.py"))
    return set(OPTION.findall(text)) | {"--help"}


@functools.cache
def options_of_all(folder):
    programs = [options_of_program(file.name, folder) for file in folder.glob("gsh-*")]
    scripts = [options_of_script(f"scripts/{file.name}") for file in (ROOT / "scripts").iterdir() if file.is_file()]
    return set().union(*programs, *scripts)


@functools.cache
def cmake_text():
    files = [ROOT / "CMakeLists.txt", *(ROOT / "cmake").rglob("*"), *ROOT.glob("*/CMakeLists.txt")]
    return "".join(file.read_text() for file in files if file.is_file())


@functools.cache
def presets():
    return {preset["name"] for preset in json.loads((ROOT / "CMakePresets.json").read_text())["configurePresets"]}


def errors_of(words, folder):
    """What is wrong with a command, and how many of its names were looked up."""
    words = [word.strip("[](),.…:") for word in words]
    name = re.sub(r"^(\./|build/[\w-]+/bin/)", "", words[0])
    known, owner = None, name
    if re.fullmatch(r"gsh-[a-z]+", name):
        known = options_of_program(name, folder)
        if known is None:  # targets are named like programs, but stand alone
            return ([f"there is no program {name}"] if len(words) > 1 else []), 0
    elif re.fullmatch(r"scripts/[\w-]+", name):
        known = options_of_script(name)
        if known is None and not (ROOT / name).is_dir():
            return [f"there is no {name}"], 0
    elif re.fullmatch(r"\d\d-[a-z-]+", name):
        story = ROOT / "examples" / name.replace("-", "_")
        there = story.with_suffix(".cpp").exists() or story.with_suffix(".cu").exists()
        return ([] if there else [f"there is no story {name}"]), 1
    elif name.startswith("--"):  # an option in the text, of the program that the text is about
        known, owner = options_of_all(folder) | OTHERS, "every program"
    errors, looked_up = [], 0
    for before, word in zip([""] + words, words):
        option = re.match(r"--[a-z][\w-]*", word)
        if option and known is not None and "_" not in option[0]:  # gsh's options have no underscores, OpenPose's do
            looked_up += 1
            if option[0] not in known:
                errors.append(f"{owner} lacks the option {option[0]}")
        if before == "--preset" and name in ("cmake", "ctest"):
            looked_up += 1
            if word not in presets():
                errors.append(f"there is no preset {word}")
        setting = re.match(r"(?:-D)?(GSH_[A-Z_]+)=", word)
        if setting and name in ("cmake", "-D"):
            looked_up += 1
            if not re.search(rf"\b{setting[1]}\b", cmake_text()):
                errors.append(f"CMake has no setting {setting[1]}")
    return errors, looked_up


def main():
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit("usage: commands_test.py BIN, the folder of built programs")
    folder, errors, commands, options = Path(sys.argv[1]).resolve(), [], 0, 0
    for page in pages():
        for sample in samples_of(page):
            if sample.language not in ("sh", "bash", "indented", "inline"):
                continue
            for words in commands_of(sample.text):
                found, looked_up = errors_of(words, folder)
                commands += looked_up > 0
                options += looked_up
                errors += [f"{sample.where}: {error}" for error in found]
    print(f"{commands} command lines, {options} names of options, presets and settings")
    if options < 500:
        errors.append(f"only {options} names were found, expected 500 or more: are code blocks still read?")
    for error in errors:
        print("error:", error)
    sys.exit(bool(errors))


main()
