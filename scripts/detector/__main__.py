# SPDX-License-Identifier: Apache-2.0
"""scripts/detect: from videos of a person to images, landmarks and masks. docs/detection.md describes the files."""

import argparse
import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np

import calibration
import sides
import times
from failure import Failure
from folder import Folder, cameras_json, keypoints_json, landmarks_of, video_json, write_json

DETECTOR = "mediapipe 0.10.21"
CONTRACT = """
Each VIDEO is a file (mp4, mov, webm, ...) or a folder of images of one camera; its name is the camera's, unless
--camera NAME=PATH gives another. Several cameras were started together. OUT gets images/, masks/, plates/,
keypoints.json, video.json and, with --calibration, calibration.json; docs/detection.md describes them.

A run that was stopped goes on where it stopped, if it is started again with the same arguments.

Other detectors: gsh-video and gsh-fit --detector PROGRAM call PROGRAM OUT VIDEO... --fps N --frames N --size N
[--begin S] [--end S] [--calibration FILE] [--restart]. PROGRAM writes the same files into OUT, and ends with 0; or it
writes one line that says what is wrong to standard error, and ends with another code. keypoints.json is written last.

--bodies cuts the masks of OUT anew by the fitted bodies that gsh-fit has written to OUT/bodies, and puts them into
OUT/masks_by_body, which the next gsh-fit reads. gsh-video calls PROGRAM OUT --bodies if "masks_by_body" is true in the
video.json that PROGRAM wrote.
"""


def parse(arguments):
    parser = argparse.ArgumentParser(
        prog="scripts/detect",
        epilog=CONTRACT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Finds a person in videos: images, landmarks and masks for gsh-fit.",
    )
    parser.add_argument("out", metavar="OUT", help="the folder to write")
    parser.add_argument("videos", metavar="VIDEO", nargs="*", help="one per camera: a video, or a folder of images")
    parser.add_argument(
        "--camera", metavar="NAME=PATH", action="append", default=[], help="a video, and the name of its camera"
    )
    parser.add_argument(
        "--fps", type=float, default=10, metavar="N", help="frames per second to keep, at most (10)"
    )
    parser.add_argument(
        "--frames", type=int, default=150, metavar="N", help="frames of each camera to keep, at most (150)"
    )
    parser.add_argument("--begin", type=float, metavar="S", help="seconds from the start to the first frame")
    parser.add_argument("--end", type=float, metavar="S", help="seconds from the start to the last frame")
    parser.add_argument(
        "--size", type=int, default=960, metavar="N", help="longer side of the images, at most (960)"
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="calibrated cameras: cameras.json of gsh, .toml of Pose2Sim, "
        "Anipose or Caliscope, Qualisys' .qca.txt, or intri.yml (beside extri.yml)",
    )
    parser.add_argument(
        "--late",
        metavar="NAME=S",
        action="append",
        default=[],
        help="seconds by which the frames of a camera were taken later than those of the others, as gsh-fit finds them",
    )
    parser.add_argument(
        "--input-fps", type=float, default=30, metavar="N", help="frames per second of folders of images (30)"
    )
    parser.add_argument("--jobs", type=int, default=0, metavar="N", help="processes (one per core)")
    parser.add_argument(
        "--bodies", action="store_true", help="cut the masks of OUT anew, by bodies that gsh-fit has fitted"
    )
    parser.add_argument("--restart", action="store_true", help="discard what OUT holds of an earlier run")
    options = parser.parse_intermixed_args(arguments)
    for name, least in (("fps", 1e-3), ("frames", 1), ("size", 64), ("input_fps", 1e-3), ("jobs", 0)):
        if not getattr(options, name) >= least:
            parser.error(f"--{name.replace('_', '-')} must be at least {least:g}")
    if options.bodies and (options.videos or options.camera):
        parser.error("--bodies takes the images of OUT, and no VIDEO")
    if not options.bodies and not options.videos and not options.camera:
        parser.error("give a VIDEO")
    return options


def named_paths(options):
    found = {}
    pairs = [(Path(v).resolve().name if Path(v).is_dir() else Path(v).stem, v) for v in options.videos]
    for text in options.camera:
        name, _, path = text.partition("=")
        if not name or not path:
            raise Failure(f"--camera {text}: expected NAME=PATH")
        pairs.append((name, path))
    for name, path in pairs:
        if "/" in name or name.startswith("."):
            raise Failure(f"{name!r} cannot be the name of a camera; name it by --camera NAME={path}")
        if name in found:
            raise Failure(
                f"two videos have the name {name}: {found[name]} and {path}; name them by --camera NAME=PATH"
            )
        found[name] = path
    return found


def lateness(options, names):
    """Seconds of each camera."""
    late = dict.fromkeys(names, 0.0)
    for text in options.late:
        name, _, seconds = text.partition("=")
        try:
            late[name] += float(seconds)
        except (KeyError, ValueError):
            raise Failure(f"--late {text}: expected NAME=SECONDS with a name of {', '.join(names)}") from None
    return [late[name] for name in names]


def prepare(folder, options, sources):
    """Continues an earlier run with the same settings, and refuses a folder that holds something else."""

    def stamp(path):
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        return [len(files), sum(f.stat().st_size for f in files), max(int(f.stat().st_mtime) for f in files)]

    keys = ("fps", "frames", "begin", "end", "size", "input_fps", "late")
    settings = {
        "detector": DETECTOR,
        **{k: getattr(options, k) for k in keys},
        "videos": {s.name: [str(Path(s.path).resolve()), *stamp(Path(s.path))] for s in sources},
        "calibration": options.calibration
        and [str(Path(options.calibration).resolve()), *stamp(Path(options.calibration))],
    }
    file = folder.work / "settings.json"
    if file.exists() and not options.restart:
        old = json.loads(file.read_text())
        changed = [k for k in settings if old.get(k) != settings[k]]
        if changed:
            raise Failure(
                f"{folder.out} was begun with another {changed[0].replace('_', '-')} ({old.get(changed[0])}); "
                "begin anew with --restart, or name another folder"
            )
        return
    if folder.out.exists() and any(folder.out.iterdir()):
        if not file.exists():
            raise Failure(f"{folder.out} exists and is not of this program; name another folder")
        for name in ("images", "masks", "masks_detected", "masks_by_body", "bodies", "hidden", "plates", ".detect"):
            shutil.rmtree(folder.out / name, ignore_errors=True)
        for name in ("keypoints.json", "video.json", "calibration.json"):
            (folder.out / name).unlink(missing_ok=True)
    write_json(file, settings)


def run(options):
    import stages
    import video
    import workers

    jobs = options.jobs or os.cpu_count() or 1
    folder = Folder(options.out)
    if folder.out.exists() and not folder.out.is_dir():
        raise Failure(f"{folder.out} is a file; name a folder")
    sources = [video.open_source(n, p, options.input_fps) for n, p in named_paths(options).items()]
    for source in sources:
        for note in source.notes:
            print(note)
    late = lateness(options, [s.name for s in sources])
    choice = times.choose(
        [s.name for s in sources],
        [s.times for s in sources],
        options.fps,
        options.frames,
        options.begin,
        options.end,
        late,
    )
    lenses, cameras, placed = [], [], []
    calibrated, notes = calibration.read_calibration(options.calibration) if options.calibration else (None, [])
    matched = (
        calibration.match_cameras([s.name for s in sources], calibrated) if calibrated else [None] * len(sources)
    )
    for source, camera in zip(sources, matched):
        width, height = source.size
        scale = min(1.0, options.size / max(source.size))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        entry = {"name": source.name, "width": size[0], "height": size[1]}
        lens = None
        if camera:
            K, note = calibration.fit_to_size(camera, width, height)
            notes += [note] if note else []
            if np.any(camera.distortion):
                lens = (K, camera.distortion, camera.fisheye)
            K = np.diag([size[0] / width, size[1] / height, 1]) @ K
            placed.append((source.name, *size, K, camera.R, camera.t))
            entry.update(focal=round(float(K[0, 0]), 3), focal_from="calibration")
        elif source.focal:
            entry.update(focal=round(source.focal * scale, 3), focal_from=source.focal_from)
        lenses.append(lens)
        cameras.append(entry)
    for note in notes + choice.notes:
        print(note)
    count = len(choice.frames[0])
    if not count:
        raise Failure("no time is left at which all cameras have a frame")
    prepare(folder, options, sources)
    print(
        f"{count} frames of {len(sources)} camera{'s' if len(sources) > 1 else ''}, {choice.fps:.2f} a second, "
        f"{cameras[0]['width']} x {cameras[0]['height']}",
        flush=True,
    )
    if (folder.out / "keypoints.json").exists():
        print(f"{folder.out} is complete")
        return

    names = [s.name for s in sources]
    every = len(names) * count
    pieces = [(n, list(range(i, min(i + 12, count)))) for n in names for i in range(0, count, 12)]
    workers.run(
        "frames",
        jobs,
        stages.extract,
        [
            (folder, s, wanted, (c["width"], c["height"]), lens)
            for s, wanted, c, lens in zip(sources, choice.frames, cameras, lenses)
        ],
        every,
    )
    workers.run("search", jobs, stages.place_of, [(folder, n, count) for n in names], every)
    seen = [n for n in names if stages.load(folder.look(n, "place"))]
    for name in names:
        if name not in seen:
            print(f"{name}: no person was found in any frame")
    if not seen:
        raise Failure("no person was found in any frame; is the whole person visible, upright and not too dark?")
    looks = [(folder, n, count, d) for n in seen for d in ("forward", "backward") if not folder.look(n, d).exists()]
    workers.run("landmarks", jobs, stages.look, looks, len(looks) * count)
    parts = [(folder, n, [i for i in part if not folder.person(n, i).exists()]) for n, part in pieces if n in seen]
    parts = [p for p in parts if p[2]]
    workers.run("hands", jobs, stages.join, parts, sum(len(p[2]) for p in parts))
    for name in names:
        if name not in seen:
            for i in range(count):
                stages.save(folder.person(name, i), (None, None, None))
    found = [[stages.load(folder.person(n, i))[0] for i in range(count)] for n in names]
    seen = [n for n, frames in zip(names, found) if any(frames)]
    if not seen:
        raise Failure("no person was found in any frame; is the whole person visible, upright and not too dark?")
    plates = [(folder, n, count) for n in seen if not folder.look(n, "background").exists()]
    workers.run("background", jobs, stages.make_plate, plates, len(plates) * count)
    for name in seen:
        if not folder.plate(name).exists():
            print(f"{name}: the camera moves, or there are too few frames: masks are made without its background")
    workers.run("masks", jobs, stages.make_masks, [(folder, *p) for p in pieces], every)

    for name, frames in zip(names, found):
        exchanged = sides.exchange_sides(frames)
        if exchanged:
            print(f"{name}: left and right were confused in {len(exchanged)} of {count} frames, and are exchanged")
    kept = [s.times[f] + shift for s, f, shift in zip(sources, choice.frames, late)]
    write_json(folder.out / "video.json", video_json(choice.fps, cameras, sources, kept), indent=1)
    if placed:
        write_json(folder.out / "calibration.json", cameras_json(choice.fps, placed), indent=1)
    write_json(
        folder.out / "keypoints.json",
        keypoints_json([(c["name"], c["width"], c["height"]) for c in cameras], found, DETECTOR),
    )
    clean(folder)
    report(folder, names, found)


def clean(folder):
    """Removes what only a continued run needs."""
    for path in folder.work.iterdir():
        if path.name != "settings.json":
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def cut_by_bodies(options):
    """Masks anew, by bodies. They appear all at once."""
    import stages
    import workers

    folder = Folder(options.out)
    for path in (folder.out / "video.json", folder.out / "keypoints.json"):
        if not path.exists():
            raise Failure(f"{path} does not exist; find the person first: scripts/detect {folder.out} VIDEO...")
    if not (folder.out / "bodies").is_dir():
        raise Failure(f"{folder.out / 'bodies'} does not exist; fit the body first: gsh-fit {folder.out}")
    cameras = {c["name"]: len(c["times"]) for c in json.loads((folder.out / "video.json").read_text())["cameras"]}
    poses = landmarks_of(json.loads((folder.out / "keypoints.json").read_text()), cameras)
    folder.work.mkdir(exist_ok=True)
    clean(folder)
    jobs, every = options.jobs or os.cpu_count() or 1, sum(cameras.values())
    workers.run(
        "colours", jobs, stages.learn_bodies, [(folder, n, count, poses[n]) for n, count in cameras.items()], every
    )
    pieces = [(n, list(range(i, min(i + 12, count)))) for n, count in cameras.items() for i in range(0, count, 12)]
    alone = len(cameras) == 1
    workers.run(
        "masks", jobs, stages.make_masks_by_bodies, [(folder, *p, poses[p[0]], alone) for p in pieces], every
    )
    done = folder.out / "masks_by_body"
    shutil.rmtree(done, ignore_errors=True)
    os.replace(folder.work / "masks_by_body", done)
    clean(folder)
    print(f"wrote {done}")


def report(folder, names, found):
    people = [p for frames in found for p in frames]
    share = lambda key: 100 * sum(bool(p and key in p) for p in people) / len(people)
    hands = (share("mediapipe_left_hand") + share("mediapipe_right_hand")) / 2
    print(
        f"person in {share('mediapipe_pose'):.0f}% of the images, face in {share('mediapipe_face'):.0f}%, "
        f"hands in {hands:.0f}%"
    )
    missing = [f"{n} {sum(p is None for p in frames)}" for n, frames in zip(names, found) if not all(frames)]
    if missing:
        print(f"images without a person, whose masks are black: {', '.join(missing)}")
    print(f"wrote {folder.out}")


def main():
    options = parse(sys.argv[1:])
    try:
        cut_by_bodies(options) if options.bodies else run(options)
    except Failure as failure:
        print(f"detect: {failure}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"detect: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ndetect: stopped; the same command goes on from here", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
