# SPDX-License-Identifier: Apache-2.0
# From a video to an avatar: gsh-video detects, fits, checks and reconstructs, and goes on where it was stopped. Its
# folders capture/, check/ and avatar/ have the names that the rules of captures give theirs.


def video_words(wildcards, input):
    _, videos, bodies = paths_of(wildcards, input)
    return shlex.join([*videos, *body_words(bodies), *subject_of(wildcards).options])


rule video:
    input:
        unpack(inputs_of),
    output:
        metrics=f"{RESULTS}/{{subject}}/avatar/metrics.json",
        report=f"{RESULTS}/{{subject}}/avatar/report.html",
        avatar=f"{RESULTS}/{{subject}}/avatar/avatar.gsh",
        stages=f"{RESULTS}/{{subject}}/report.html",
    log:
        log_of("video"),
    params:
        record=record_of("video"),
        words=video_words,
    wildcard_constraints:
        subject=only(VIDEOS),
    threads: config["video"]["threads"]
    resources:
        attempt=attempt_of,
        mem_mb=always(config["video"]["mem_mb"]),
        runtime=always(config["video"]["runtime"]),
    shell:
        "exec {RUN_STAGE} --record {params.record:q} --log {log:q} --attempt {resources.attempt}"
        " --out $(dirname {output.stages:q}) --figures avatar/metrics.json --remove 'avatar/checkpoint.*'"
        " -- {PROGRAMS}gsh-video {params.words} --threads {threads}"
