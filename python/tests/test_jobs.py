# SPDX-License-Identifier: Apache-2.0
"""gsh.reconstruct, evaluate, check, export, retarget, and the commands: results, progress, errors, interrupts."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import threading
import time

import gsh
import pytest
from conftest import has_programs, write_motion

pytestmark = pytest.mark.skipif(not has_programs(), reason="the package was built without programs")


@pytest.fixture(scope="module")
def small(capture):
    """Arguments of a reconstruction that takes a second."""
    folder, body = capture
    return dict(capture=folder, body=body, gaussians=2000, config="baseline")


def words_of(small):
    return [f"--{name}={value}" for name, value in small.items()]


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def module(*words, **options):
    return subprocess.run([sys.executable, "-m", "gsh", *map(str, words)], capture_output=True, text=True, **options)


def test_a_reconstruction_reports_its_progress_and_returns_its_figures(small, tmp_path):
    calls = []
    figures = gsh.reconstruct(out=tmp_path / "a", steps=3, **small, progress=lambda *call: calls.append(call))
    assert figures == json.loads((tmp_path / "a/metrics.json").read_text())
    assert figures["psnr"] > 5
    steps = [share for stage, share, details in calls if stage == "training" and share is not None]
    assert steps == sorted(steps) and steps[-1] == 1 and len(steps) == 3
    assert all(isinstance(details, str) for _, _, details in calls)
    assert len(gsh.load_avatar(tmp_path / "a/avatar.gsh")) == 2000


def test_a_reconstruction_is_that_of_the_command(small, tmp_path):
    gsh.reconstruct(out=tmp_path / "a", steps=3, **small)
    run = module("reconstruct", *words_of(small), "--out", tmp_path / "b", "--steps", 3)
    assert run.returncode == 0, run.stderr
    assert digest(tmp_path / "b/avatar.gsh") == digest(tmp_path / "a/avatar.gsh")


def test_a_capture_on_disk_is_checked_reconstructed_and_evaluated(capture, tmp_path):
    folder, body = capture
    report = gsh.check(folder, body, frames=3)
    assert report["mean_iou"] > 0.5 and isinstance(report["findings"], list)
    assert gsh.check(folder, body, tmp_path / "check", frames=3) == json.loads((tmp_path / "check/check.json").read_text())
    figures = gsh.reconstruct(folder, body, tmp_path / "a", steps=3, gaussians=2000, config="baseline")
    assert figures["psnr"] > 5
    tables = gsh.evaluate(folder, body, tmp_path / "b", ["baseline", "paper"], steps=2, gaussians=2000, views=1)
    assert len(tables["figures"]) == 2
    with pytest.raises(ValueError, match="no-such"):
        gsh.evaluate(folder, body, tmp_path / "c", "no-such", steps=2)


def test_errors_have_the_words_of_the_library_and_leave_nothing(small, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(ValueError, match="steps"):
        gsh.reconstruct(out=out, steps=-3, **small)
    with pytest.raises(ValueError, match="no_such_option|no-such-option"):
        gsh.reconstruct(out=out, no_such_option=1, **small)
    with pytest.raises(OSError, match="no-body.npz"):
        gsh.reconstruct(small["capture"], tmp_path / "no-body.npz", out)
    with pytest.raises((ValueError, OSError), match="nowhere"):
        gsh.reconstruct(tmp_path / "nowhere", small["body"], out)
    with pytest.raises((ValueError, OSError), match="nowhere"):
        gsh.evaluate(tmp_path / "nowhere", small["body"], out, "light")
    with pytest.raises((ValueError, OSError), match="nowhere"):
        gsh.check(tmp_path / "nowhere", small["body"], out)
    with pytest.raises((ValueError, OSError), match="nowhere"):
        gsh.export(tmp_path / "nowhere.gsh", tmp_path / "a.ply")
    with pytest.raises((ValueError, OSError), match="nowhere"):
        gsh.retarget(tmp_path / "nowhere.bvh", tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())


def test_wrong_arguments_are_refused_by_name(tmp_path):
    for words, arguments in [
        ("out is missing", dict(synthetic=True)),
        ("capture is missing", dict(out=tmp_path)),
        ("out is int", dict(out=3, synthetic=True)),
        ("body is int", dict(out=tmp_path, capture=tmp_path, body=3)),
        ("progress is int", dict(out=tmp_path, synthetic=True, progress=3)),
        ("steps is dict_keys", dict(out=tmp_path, synthetic=True, steps={}.keys())),
    ]:
        with pytest.raises(TypeError, match="gsh.reconstruct: " + words):
            gsh.reconstruct(**arguments)
    with pytest.raises(ValueError, match="out is ''"):
        gsh.reconstruct(out="", synthetic=True)


def test_an_error_of_progress_ends_the_run_with_its_checkpoint(small, tmp_path):
    def progress(stage, share, details):
        if stage == "training" and share:
            raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        gsh.reconstruct(out=tmp_path / "a", steps=100000, **small, progress=progress)
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["checkpoint.gsh"]
    with pytest.raises(LookupError):
        gsh.reconstruct(out=tmp_path / "a", resume=True, progress=progress)


def test_ctrl_c_is_a_keyboard_interrupt_after_the_checkpoint(small, tmp_path):
    begun = threading.Event()

    def interrupt():
        begun.wait()
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a script's background jobs ignore the signal
    threading.Thread(target=interrupt).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            gsh.reconstruct(out=tmp_path / "a", steps=100000, **small,
                            progress=lambda stage, share, _: begun.set() if stage == "training" and share else None)
    finally:
        signal.signal(signal.SIGINT, before)
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["checkpoint.gsh"]


def test_a_run_ends_in_order_when_its_python_is_killed(small, tmp_path):
    code = ("import gsh, sys\n"
            "gsh.reconstruct(sys.argv[1], sys.argv[2], sys.argv[3], steps=100000, gaussians=2000, config='baseline',\n"
            "                progress=lambda stage, share, _: print(stage, share, flush=True))")
    process = subprocess.Popen([sys.executable, "-c", code, small["capture"], small["body"], tmp_path / "a"],
                               stdout=subprocess.PIPE, text=True)
    for line in process.stdout:
        if line.startswith("training 0."):
            break
    process.kill()
    process.wait()
    for _ in range(600):
        if not (tmp_path / "a/.gsh-lock").exists():
            break
        time.sleep(0.1)
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["checkpoint.gsh"]


def test_exports_and_motions(trained, tmp_path):
    write_motion(tmp_path / "m.bvh")
    assert gsh.retarget(tmp_path / "m.bvh", tmp_path / "m.npz", trained / "avatar.gsh") == tmp_path / "m.npz"
    avatar = gsh.load_avatar(trained / "avatar.gsh")
    assert len(avatar.load_motion(tmp_path / "m.npz")) == len(avatar.load_motion(tmp_path / "m.bvh")) == 8
    for name in ("a.ply", "a.spz"):
        path = gsh.export(trained / "avatar.gsh", tmp_path / name, poses=tmp_path / "m.npz", frame=2)
        assert path.stat().st_size > 10000
    with pytest.raises(ValueError, match="xyz"):
        gsh.export(trained / "avatar.gsh", tmp_path / "a.xyz")


def test_commands_have_the_programs_exit_codes_and_streams(tmp_path):
    assert module("render", "--help").stdout.startswith("Renders")
    wrong = module("render", "--frame", "x")
    assert wrong.returncode == 2 and wrong.stderr.startswith("gsh-render: ") and wrong.stdout == ""
    assert module("no-such-program").returncode == 2
    assert module().returncode == 2
    assert "demo" in module("--help").stdout


def test_a_command_is_interrupted_as_the_program_is(small, tmp_path):
    process = subprocess.Popen([sys.executable, "-m", "gsh", "reconstruct", *words_of(small), "--steps", "100000",
                                "--checkpoint-interval", "0.1", "--out", str(tmp_path / "a")],
                               stderr=subprocess.PIPE, text=True)
    checkpoint = tmp_path / "a/checkpoint.gsh"
    while not checkpoint.exists() and process.poll() is None:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    assert process.wait() == 130
    assert "--resume continues" in process.stderr.read()
    assert set(os.listdir(tmp_path / "a")) - {"checkpoint.before.gsh"} == {"checkpoint.gsh"}


def test_the_demo_runs(tmp_path):
    run = module("demo", "--steps", "3", "--gaussians", "3000", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "gsh-view out/demo/avatar.gsh --open" in run.stdout
    assert (tmp_path / "out/demo/avatar.gsh").exists()
    figures = json.loads((tmp_path / "out/demo/metrics.json").read_text())
    assert "new_motion" in figures
    assert module("demo", "--video", cwd=tmp_path).returncode != 0
