# SPDX-License-Identifier: Apache-2.0
"""Long jobs. Each runs a program of the package as a process of its own and follows its reports.

The results are therefore those of the programs, bit for bit. What a job needs of memory and threads is gone when it
ends, and a failure cannot take the interpreter with it.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import tempfile
import warnings
from pathlib import Path
from typing import Any, Callable, Mapping, Optional, Sequence, Union

from . import _programs

PathLike = Union[str, "os.PathLike[str]"]
Progress = Callable[[str, Optional[float], str], Any]

_ERRORS = {"ValueError": ValueError, "ShapeError": ValueError, "IoError": OSError, "bad_alloc": MemoryError}


def _path(where: str, name: str, value: Any) -> str:
    """A path as a word that cannot be taken for an option."""
    try:
        path = os.fspath(value)
    except TypeError:
        raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a path") from None
    if not isinstance(path, str):
        raise TypeError(f"{where}: {name} is {type(path).__name__}, expected a path of str")
    if not path or "\0" in path:
        raise ValueError(f"{where}: {name} is {path!r}, expected a path")
    return os.path.join(os.curdir, path) if path.startswith("-") else path


def _option_words(where: str, options: Mapping[str, Any]) -> list[str]:
    """Keyword arguments as options: steps=100 becomes --steps=100, True a flag, a list several options."""
    words = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if isinstance(value, Mapping):
            value = [f"{key}={_text(where, name, one)}" for key, one in value.items()]
        for one in value if isinstance(value, (list, tuple)) else [value]:
            words.append(option if one is True else f"{option}={_text(where, name, one)}")
    return words


def _text(where: str, name: str, value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, (str, int)) or hasattr(value, "__index__"):
        return str(value)
    if hasattr(value, "__float__"):
        return repr(float(value))
    raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a number, a text, a path or a list of them")


def _check_progress(where: str, progress: Optional[Progress]) -> None:
    if progress is not None and not callable(progress):
        raise TypeError(f"{where}: progress is {type(progress).__name__}, expected a function of "
                        "(stage, share, details)")


def _run(name: str, words: Sequence[str], progress: Optional[Progress], accepted: Sequence[int] = (0,)) -> int:
    """Runs a program to its end and returns its exit code; an interrupt or an error of ``progress`` ends it in order."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs, tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [_programs.path_of(name), *words], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log,
            pass_fds=[theirs.fileno()], env={**os.environ, "GSH_REPORT_SOCKET": str(theirs.fileno())},
            start_new_session=True)  # Ctrl-C of a terminal reaches it once, through us
        theirs.close()
        error = None
        try:
            for kind, *fields in _packets(ours, process):
                if kind == "error":
                    error = fields
                elif kind == "warning":
                    warnings.warn(fields[0], stacklevel=3)
                elif kind == "progress" and progress is not None:
                    title, share, details = fields
                    progress(title, float(share) if share else None, details)
            code = process.wait()
        except BaseException:
            _end(process, ours)
            raise
        if code in accepted:
            return code
        if error is not None:
            raise _ERRORS.get(error[0], RuntimeError)(error[1])
        log.seek(0, os.SEEK_END)
        log.seek(max(0, log.tell() - 2000))
        tail = log.read().decode("utf-8", "replace").strip()
    how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
    raise RuntimeError(f"gsh-{name} {how}" + (f": {tail}" if tail else ""))


def _packets(ours: socket.socket, process: subprocess.Popen[bytes]) -> Any:
    """The reports of a program until it ends, as lists of texts."""
    ours.settimeout(0.5)
    while True:
        try:
            packet = ours.recv(1 << 16)
        except socket.timeout:
            if process.poll() is not None:  # another process may have inherited its end
                return
            continue
        if not packet:
            return
        fields = packet.decode("utf-8", "replace").split("\t")
        if len(fields) == {"progress": 4, "warning": 2, "error": 3}.get(fields[0]):
            yield fields


def _end(process: subprocess.Popen[bytes], ours: socket.socket) -> None:
    """Ends a program as Ctrl-C does, so that it writes its checkpoint; a second Ctrl-C ends it at once."""
    try:
        process.send_signal(signal.SIGINT)
        for _ in _packets(ours, process):
            pass
        process.wait()
    except BaseException:
        process.kill()
        process.wait()
        raise


def _json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def reconstruct(capture: Optional[PathLike] = None, body: Optional[PathLike] = None, out: Optional[PathLike] = None, *,
                steps: Optional[int] = None, gaussians: Optional[int] = None, seed: Optional[int] = None,
                synthetic: bool = False, resume: bool = False, threads: Optional[int] = None,
                progress: Optional[Progress] = None, **options: Any) -> dict[str, Any]:
    """Trains an animatable avatar of a capture, writes it to the folder ``out``, and returns its figures.

    The same as the command ``gsh-reconstruct``; ``out`` has the same files (``avatar.gsh``, ``report.html``, ...).

    Parameters
    ----------
    capture
        folder with images, cameras and poses, in any layout that gsh reads. Lengths are metres.
    body
        body model, a file in the layout of SMPL, SMPL-H or SMPL-X (``.npz``); None if the capture has its own.
    out
        folder of the results. It is created if needed.
    steps, gaussians, seed
        of the training; None stands for the program's default. The same seed gives the same bits on any number of
        threads.
    synthetic
        films the built-in actor instead of reading ``capture`` and ``body``.
    resume
        goes on from the checkpoint in ``out`` of a run that was interrupted, with that run's options.
    threads
        number of CPU threads; None: all.
    progress
        a function of ``(stage, share, details)``, called after every step: the name of the stage, the share of it in
        [0, 1] that is done or None, and a text such as the step and the PSNR. An exception in it ends the run.
    **options
        any other option of the program, with ``_`` for ``-``: ``config="paper"``, ``refine=True``,
        ``hold_out_motion=0.25``, ``set={"sh_degree": 1}``. ``gsh-reconstruct --help`` lists them.

    Returns
    -------
    dict
        the contents of ``metrics.json``: ``psnr``, ``ssim``, ``verdict``, ``advice`` and more.

    Raises
    ------
    ValueError, OSError, MemoryError, RuntimeError
        with the message of the program. Nothing of the results is written then.
    KeyboardInterrupt
        on Ctrl-C, after the present step. Its checkpoint is in ``out``; ``resume=True`` goes on from there.
    """
    where = "gsh.reconstruct"
    _check_progress(where, progress)
    if out is None:
        raise TypeError(f"{where}: out is missing, expected the folder of the results")
    if capture is None and not (synthetic or resume):
        raise TypeError(f"{where}: capture is missing, expected a folder; or pass synthetic=True")
    folder = _path(where, "out", out)
    files = {"capture": capture, "body": body, "out": folder}
    words = [f"--{name}={_path(where, name, value)}" for name, value in files.items() if value is not None]
    words += _option_words(where, dict(steps=steps, gaussians=gaussians, seed=seed, synthetic=bool(synthetic),
                                       resume=bool(resume), threads=threads, **options))
    _run("reconstruct", words, progress)
    return _json(Path(folder, "metrics.json"))


def evaluate(capture: PathLike, body: Optional[PathLike], out: PathLike, configs: Union[str, Sequence[str]], *,
             steps: Optional[Union[int, Sequence[int]]] = None, gaussians: Optional[int] = None,
             threads: Optional[int] = None, progress: Optional[Progress] = None, **options: Any) -> dict[str, Any]:
    """Trains and compares configurations on a capture; the same as the command ``gsh-evaluate``.

    Parameters
    ----------
    capture, body, out, gaussians, threads, progress
        as for ``reconstruct``. Finished runs in ``out`` are kept, and an interrupted one goes on.
    configs
        names of configurations, or JSON files of settings. The others are compared with the first one.
    steps
        numbers of steps after which to evaluate; the largest is the length of a run.
    **options
        any other option of the program, as for ``reconstruct``.

    Returns
    -------
    dict
        the contents of ``tables.json``: ``figures``, ``differences`` and ``costs``.

    Raises
    ------
    as ``reconstruct``.
    """
    where = "gsh.evaluate"
    _check_progress(where, progress)
    folder = _path(where, "out", out)
    words = [f"--capture={_path(where, 'capture', capture)}", f"--out={folder}"]
    if body is not None:
        words.append(f"--body={_path(where, 'body', body)}")
    words += _option_words(where, dict(configs=configs, steps=steps, gaussians=gaussians, threads=threads, **options))
    _run("evaluate", words, progress)
    return _json(Path(folder, "tables.json"))


def check(capture: PathLike, body: Optional[PathLike] = None, out: Optional[PathLike] = None, *,
          frames: Optional[int] = None, threads: Optional[int] = None, progress: Optional[Progress] = None,
          **options: Any) -> dict[str, Any]:
    """Tests whether the images, cameras, poses and body of a capture match; the same as the command ``gsh-check``.

    Parameters
    ----------
    capture, body, threads, progress
        as for ``reconstruct``.
    out
        folder for ``check.json`` and pictures with the body drawn over each image; None: they are not kept.
    frames
        number of frames to check, evenly spaced; 0: all.

    Returns
    -------
    dict
        the contents of ``check.json``. ``findings`` lists the likely faults, each with a ``text``; it is empty if
        nothing is suspicious. ``mean_iou`` is the intersection over union of masks and posed bodies, in [0, 1].

    Raises
    ------
    as ``reconstruct``.
    """
    where = "gsh.check"
    _check_progress(where, progress)
    with tempfile.TemporaryDirectory() as temporary:
        folder = temporary if out is None else _path(where, "out", out)
        words = [_path(where, "capture", capture), f"--out={folder}"]
        if body is not None:
            words.append(f"--body={_path(where, 'body', body)}")
        words += _option_words(where, dict(frames=frames, threads=threads, **options))
        _run("check", words, progress, accepted=(0, 1))  # 1: there are findings
        return _json(Path(folder, "check.json"))


def _convert(where: str, program: str, name: str, source: PathLike, option: str, to: PathLike, other_name: str,
             other: Optional[PathLike], options: dict[str, Any], progress: Optional[Progress]) -> Path:
    """Runs a program that writes one file from another one, and from a second one if it is given."""
    _check_progress(where, progress)
    target = _path(where, "to", to)
    words = [_path(where, name, source), f"--{option}={target}"]
    if other is not None:
        words.append(f"--{other_name}={_path(where, other_name, other)}")
    _run(program, words + _option_words(where, options), progress)
    return Path(target)


def export(source: PathLike, to: PathLike, *, poses: Optional[PathLike] = None, frame: Optional[int] = None,
           frames: Optional[str] = None, threads: Optional[int] = None, progress: Optional[Progress] = None,
           **options: Any) -> Path:
    """Writes an avatar or a scene in a format that other programs show; the same as the command ``gsh-export``.

    Parameters
    ----------
    source
        an avatar (``.gsh``) or a scene of Gaussians.
    to
        the file to write. Its ending chooses the format: ``.ply``, ``.spz``, ``.glb``, ``.usda``, ``.html`` and more.
    poses, frame
        a motion, and the frame of it (from 0) for a still file; without one, the canonical pose.
    frames
        ``"A:B"`` or ``"A:B:S"`` for a moving file: frames A to B, both included, or every S-th of them.
    threads, progress, **options
        as for ``reconstruct``; for example ``mesh=True`` or ``gaussians=60000``.

    Returns
    -------
    pathlib.Path
        ``to``. The file is written completely or not at all.

    Raises
    ------
    as ``reconstruct``.
    """
    return _convert("gsh.export", "export", "source", source, "to", to, "poses", poses,
                    dict(frame=frame, frames=frames, threads=threads, **options), progress)


def retarget(motion: PathLike, to: PathLike, body: Optional[PathLike] = None, *, fps: Optional[float] = None,
             input_fps: Optional[float] = None, progress: Optional[Progress] = None, **options: Any) -> Path:
    """Converts a motion of any rig that gsh reads to a body; the same as the command ``gsh-motion``.

    ``Avatar.load_motion`` does this for an avatar, without a file.

    Parameters
    ----------
    motion
        ``.bvh``, ``.glb``, ``.gltf``, ``.vrm``, ``.vrma``, ``.npz`` (gsh, SMPL-X, AMASS, SAM 3D Body), or a folder.
    to
        the file to write: ``.npz`` (axis-angle in radians, metres, seconds), ``.bvh`` or ``.glb``.
    body
        whose motion it becomes: a body model (``.npz``) or an avatar (``.gsh``); None: the built-in actor, with the 55
        joints of SMPL-X.
    fps, input_fps
        frames per second of the result, and of the input if its file states another rate or none.
    **options
        any other option of the program: ``as_stored=True`` keeps the world of the file instead of turning it upright.

    Returns
    -------
    pathlib.Path
        ``to``.

    Raises
    ------
    as ``reconstruct``.
    """
    return _convert("gsh.retarget", "motion", "motion", motion, "out", to, "body", body,
                    dict(fps=fps, input_fps=input_fps, **options), progress)
