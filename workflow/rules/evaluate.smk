# SPDX-License-Identifier: Apache-2.0
# Compares configurations on a capture. The figures of the avatar itself come with its reconstruction. This trains one
# avatar more for each configuration, so it runs only if the settings list some.


def evaluate_words(wildcards, input):
    words = ["--capture", *capture_words(wildcards, input), "--configs", ",".join(config["evaluate"]["configs"])]
    return shlex.join(words + image_memory_words(subject_of(wildcards)) + shlex.split(config["evaluate"]["options"]))


def evaluating_minutes(wildcards, input, attempt):
    return training_minutes(wildcards, input, attempt) * len(config["evaluate"]["configs"])


rule evaluate:
    input:
        unpack(inputs_of),
        plan=f"{RESULTS}/{{subject}}/plan.json",
        metrics=f"{RESULTS}/{{subject}}/avatar/metrics.json",
    output:
        f"{RESULTS}/{{subject}}/evaluate/tables.json",
    log:
        log_of("evaluate"),
    params:
        record=record_of("evaluate"),
        words=evaluate_words,
    wildcard_constraints:
        subject=only(CAPTURES),
    threads: config["reconstruct"]["threads"]
    resources:
        attempt=attempt_of,
        mem_mb=training_mb,
        runtime=evaluating_minutes,
        **on_gpu(),
    shell:
        "exec {RUN_STAGE} --record {params.record:q} --log {log:q} --attempt {resources.attempt}"
        " --out $(dirname {output:q}) -- {PROGRAMS}gsh-evaluate {params.words} --threads {threads}"
