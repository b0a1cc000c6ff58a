# SPDX-License-Identifier: Apache-2.0
"""The rule report: Snakemake runs this with an object `snakemake` when all subjects are made. Because a rule names it,
Snakemake also brings this folder to machines that do not share a file system."""

from report import write_report

job = globals()["snakemake"]
write_report(job.params.records, job.params.expected, job.params.pictures, job.output.page, job.output.table)
