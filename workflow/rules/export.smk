# SPDX-License-Identifier: Apache-2.0
# Writes an avatar in a format.


rule export:
    input:
        f"{RESULTS}/{{subject}}/avatar/metrics.json",
        lambda wildcards: f"{RESULTS}/{wildcards.subject}/avatar/avatar.gsh" if wildcards.avatar == "avatar" else [],
    output:
        f"{RESULTS}/{{subject}}/exports/{{avatar}}.{{format}}",
    log:
        log_of("export-{avatar}.{format}"),
    params:
        record=record_of("export-{avatar}.{format}"),
        options=lambda wildcards: shlex.join(shlex.split(config["export"]["options"].get(wildcards.format, ""))),
    wildcard_constraints:
        avatar="avatar|avatar-[^/]+?",
        format="[a-z0-9.]+",
    resources:
        attempt=attempt_of,
        mem_mb=always(1000),
        runtime=always(10),
    shell:
        "exec {RUN_STAGE} --record {params.record:q} --log {log:q} --attempt {resources.attempt}"
        " -- {PROGRAMS}gsh-export $(dirname {input[0]:q})/{wildcards.avatar:q}.gsh --to {output:q} {params.options}"
        " --threads {threads}"
