# SPDX-License-Identifier: Apache-2.0
# What the rules share: the settings, the subjects, and how a program is run.
import json
import math
import re
import shlex
import sys
from pathlib import Path

sys.path.insert(0, str(Path(workflow.basedir) / "scripts"))
from snakemake.exceptions import WorkflowError
from subjects import check_config, read_subjects

check_config(config)
SUBJECTS = read_subjects(config["subjects"], config)
CAPTURES = [name for name, subject in SUBJECTS.items() if subject.capture]
VIDEOS = [name for name, subject in SUBJECTS.items() if subject.videos]
TOGETHER = [name for name in CAPTURES if len(SUBJECTS[name].avatars()) > 1]
RESULTS = config["results"]
RECORDS = f"{config['checkpoints']}/records" if config["staged"] else RESULTS
PROGRAMS = shlex.quote(config["programs"] + "/") if config["programs"] else ""
RUN_STAGE = shlex.join([sys.executable, str(Path(workflow.basedir) / "scripts" / "run_stage.py")])


def only(names):
    """A pattern of the subjects with these names. It is matched for each job, so it lists the fewer ones."""
    names, others = set(names), set(SUBJECTS) - set(names)
    if len(names) < len(others):
        return "|".join(map(re.escape, sorted(names))) or "(?!)"
    return f"(?!(?:{'|'.join(map(re.escape, sorted(others)))})/)[^/]+" if others else "[^/]+"


def subject_of(wildcards):
    """The row of the table that a job belongs to."""
    if wildcards.subject not in SUBJECTS:
        raise WorkflowError(f"{config['subjects']} has no subject {wildcards.subject!r}")
    return SUBJECTS[wildcards.subject]


def inputs_of(wildcards):
    """The files of a subject that a job needs. On storage that all machines share, these are some by which a change is
    noticed, and what is missing is left to the program, so that one subject's mistake stops only that subject. Storage
    that is staged copies the whole capture."""
    subject = subject_of(wildcards)
    if config["staged"]:
        return {"capture": [subject.capture] if subject.capture else [], "videos": list(subject.videos),
                "bodies": list(subject.bodies)}
    capture = Path(subject.capture)
    marks = [capture / name for name in ("cameras.json", "cameras.npz", "intri.yml")] if subject.capture else []
    marks += [capture / poses for poses in subject.poses or ("poses.npz",)] if subject.capture else []
    marks += [Path(path) for path in (*subject.videos, *subject.bodies)]
    return {"files": [str(path) for path in marks if path.is_file()]}


def paths_of(wildcards, input):
    """Where a job finds the capture, the videos and the bodies of a subject."""
    subject = subject_of(wildcards)
    if config["staged"]:
        return [str(path) for path in input.capture], input.videos, input.bodies
    return [subject.capture], subject.videos, subject.bodies


def body_words(bodies):
    return [word for body in bodies for word in ("--body", body)]


def capture_words(wildcards, input):
    """The capture of a subject as words of a command: the folder, the bodies, the poses."""
    (capture,), _, bodies = paths_of(wildcards, input)
    poses = subject_of(wildcards).poses
    return [capture, *body_words(bodies), *(["--poses", ",".join(poses)] if poses else [])]


def reconstruct_words(wildcards, input):
    """The options of a reconstruction by which its avatar may differ."""
    words = ["--capture", *capture_words(wildcards, input), "--backend", config["reconstruct"]["backend"]]
    subject = subject_of(wildcards)
    memory = [] if subject.image_memory() else image_memory_words(subject)  # else it is among the options
    return shlex.join([*words, *memory, *subject.options])


def image_memory_words(subject):
    """The option --image-memory of a subject. Without one, all jobs hold all images, so that plan and run need the same
    memory, whatever their machines have."""
    return ["--image-memory", subject.image_memory() or "1000000000000000"]


def log_of(stage):
    """The log of a stage. Snakemake keeps it when the job fails."""
    return f"{RESULTS}/{{subject}}/logs/{stage}.log"


def record_of(stage):
    """The record of a stage, which Snakemake does not know of: reports read it, whatever becomes of the job."""
    return f"{RECORDS}/{{subject}}/logs/{stage}.json"


def attempt_of(wildcards, attempt):
    return attempt


def per_attempt(value, attempt):
    """A value for the first attempt, 1.5 times as much for the second, and twice as much for all others, because an
    attempt may also have ended by a preemption."""
    return math.ceil(value * (1 + min(attempt, 3)) / 2)


def always(value):
    """A resource of which each attempt gets more."""
    return lambda wildcards, attempt: per_attempt(value, attempt)


def capture_mb(wildcards):
    """Megabytes of a capture's image files: those of the first camera for each of them. Only one folder is listed."""
    images = Path(subject_of(wildcards).capture) / "images"
    cameras = sorted(folder for folder in images.iterdir() if folder.is_dir()) if images.is_dir() else []
    if not cameras:
        return 0
    return len(cameras) * sum(file.stat().st_size for file in cameras[0].iterdir()) / 1e6


def loading_mb(wildcards, attempt):
    """Memory to look at a capture. A decoded image takes about ten times its file."""
    images = 12 * capture_mb(wildcards)
    limit = subject_of(wildcards).image_memory()
    if limit and limit.isdecimal():
        images = min(images, int(limit) / 1e6)
    return per_attempt(500 + images, attempt)


def loading_minutes(wildcards, attempt):
    return per_attempt(5 + capture_mb(wildcards) / 200, attempt)


def planned(input, key):
    """A figure of a plan. Snakemake asks again if the plan is not made yet (FileNotFoundError)."""
    return json.loads(Path(str(input.plan)).read_text("utf-8"))[key]


def training_mb(wildcards, input, attempt):
    return per_attempt(100 + planned(input, "memory_bytes") / 1e6 * config["reconstruct"]["memory_margin"], attempt)


def training_minutes(wildcards, input, attempt):
    return per_attempt(2 + planned(input, "seconds") / 60 * config["reconstruct"]["time_margin"], attempt)


def on_gpu():
    """The resource of jobs that train, if they train on a GPU."""
    return {"gpu": 1, "gpu_manufacturer": "nvidia"} if config["reconstruct"]["backend"] == "cuda" else {}
