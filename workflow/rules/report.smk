# SPDX-License-Identifier: Apache-2.0
# The report of all subjects. It is a rule, so that it is made when all of them are; and where some fail, it is made of
# the others when Snakemake ends. all.done is there only if nothing failed.
from report import Expected, write_report


def exports_of(subject):
    return [f"{avatar}.{ending}" for avatar in subject.avatars() for ending in subject.formats]


def products_of(subject):
    """The last files that the workflow makes of a subject."""
    folder = f"{RESULTS}/{subject.name}"
    files = [f"{folder}/avatar/metrics.json", *(f"{folder}/exports/{name}" for name in exports_of(subject))]
    if subject.capture and config["evaluate"]["configs"]:
        files.append(f"{folder}/evaluate/tables.json")
    return files


def expected_of(subject):
    """What a report expects of a subject: stages that have a record, and files where they can be seen."""
    stages = ["video"] if subject.videos else ["check", "plan", "reconstruct"]
    if subject.capture and config["evaluate"]["configs"]:
        stages.append("evaluate")
    stages += [f"export-{name}" for name in exports_of(subject)]
    return Expected(subject.name, tuple(stages), () if config["staged"] else tuple(products_of(subject)))


rule report:
    input:
        [file for subject in SUBJECTS.values() for file in products_of(subject)],
    output:
        page=f"{RESULTS}/report.html",
        table=f"{RESULTS}/subjects.csv",
        done=touch(f"{RESULTS}/all.done"),
    params:
        records=RECORDS,
        expected=[expected_of(subject) for subject in SUBJECTS.values()],
        pictures=config["report"]["pictures"],
    script:
        "../scripts/report_all.py"


onerror:
    folder = Path(RESULTS)
    (folder / "all.done").unlink(missing_ok=True)
    expected = [expected_of(subject) for subject in SUBJECTS.values()]
    pictures = config["report"]["pictures"]
    for line in write_report(RECORDS, expected, pictures, folder / "report.html", folder / "subjects.csv"):
        print(line, file=sys.stderr)
