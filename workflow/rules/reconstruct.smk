# SPDX-License-Identifier: Apache-2.0
# Trains the avatar of a capture and evaluates it. A job that fails leaves a checkpoint, which Snakemake does not know
# of and therefore does not remove, and the next job goes on from it.


def work_of(wildcards):
    """Where training keeps its checkpoints, if it is not the folder of the avatar."""
    return shlex.join(["--work", f"{config['checkpoints']}/{wildcards.subject}"]) if config["checkpoints"] else ""


rule reconstruct:
    input:
        unpack(inputs_of),
        plan=f"{RESULTS}/{{subject}}/plan.json",
    output:
        metrics=f"{RESULTS}/{{subject}}/avatar/metrics.json",
        report=f"{RESULTS}/{{subject}}/avatar/report.html",
        avatar=f"{RESULTS}/{{subject}}/avatar/avatar.gsh",
    log:
        log_of("reconstruct"),
    params:
        record=record_of("reconstruct"),
        words=reconstruct_words,
        work=work_of,
    wildcard_constraints:
        subject=only(set(CAPTURES) - set(TOGETHER)),
    threads: config["reconstruct"]["threads"]
    resources:
        attempt=attempt_of,
        mem_mb=training_mb,
        runtime=training_minutes,
        **on_gpu(),
    shell:
        "exec {RUN_STAGE} --record {params.record:q} --log {log:q} --attempt {resources.attempt}"
        " --out $(dirname {output.metrics:q}) {params.work} --figures metrics.json"
        " --basis {input.plan:q} --remove 'checkpoint.*'"
        " -- {PROGRAMS}gsh-reconstruct {params.words} --threads {threads}"
        " --checkpoint-interval {config[reconstruct][checkpoint_interval]} --continue"


# Several people in one capture have avatars of their own names.
use rule reconstruct as reconstruct_people with:
    output:
        metrics=f"{RESULTS}/{{subject}}/avatar/metrics.json",
        report=f"{RESULTS}/{{subject}}/avatar/report.html",
    wildcard_constraints:
        subject=only(TOGETHER),
