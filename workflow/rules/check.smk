# SPDX-License-Identifier: Apache-2.0
# Whether images, cameras, poses and body of a capture agree, and then what its reconstruction will take: two short
# stages in one job.


def check_words(wildcards, input):
    return shlex.join(capture_words(wildcards, input) + image_memory_words(subject_of(wildcards)))


rule check:
    input:
        unpack(inputs_of),
    output:
        check=f"{RESULTS}/{{subject}}/check/check.json",
        plan=f"{RESULTS}/{{subject}}/plan.json",
    log:
        check=log_of("check"),
        plan=log_of("plan"),
    params:
        check_record=record_of("check"),
        plan_record=record_of("plan"),
        words=check_words,
        reconstruction=reconstruct_words,
        accept=lambda wildcards: "--accept 1" if subject_of(wildcards).findings == "ignore" else "",
    wildcard_constraints:
        subject=only(CAPTURES),
    threads: config["reconstruct"]["threads"]
    resources:
        attempt=attempt_of,
        mem_mb=loading_mb,
        runtime=loading_minutes,
    shell:
        "{RUN_STAGE} --record {params.check_record:q} --log {log.check:q} --attempt {resources.attempt} {params.accept}"
        " --then {params.plan_record:q}"
        " --findings {output.check:q} --out $(dirname {output.check:q})"
        " -- {PROGRAMS}gsh-check {params.words} --threads {threads} &&"
        " exec {RUN_STAGE} --record {params.plan_record:q} --log {log.plan:q} --attempt {resources.attempt}"
        " --stdout {output.plan:q} -- {PROGRAMS}gsh-reconstruct {params.reconstruction} --threads {threads} --plan"
