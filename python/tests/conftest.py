# SPDX-License-Identifier: Apache-2.0
"""An avatar, a motion and a camera for the tests, made by gsh-python-example; its path is GSH_PYTHON_EXAMPLE, or it is
trained by the programs of the package."""

import json
import os
import struct
import subprocess
import zlib
from pathlib import Path

import pytest


def has_programs():
    from gsh import _programs

    return os.path.exists(os.path.join(_programs.FOLDER, "gsh-reconstruct"))


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """Folder of a short reconstruction of the built-in actor."""
    if not has_programs():
        pytest.skip("the package was built without programs")
    import gsh

    folder = tmp_path_factory.mktemp("trained")
    gsh.reconstruct(synthetic=True, out=folder, steps=3, gaussians=3000)
    return folder


@pytest.fixture(scope="session")
def example(request, tmp_path_factory):
    """Folder with avatar.gsh, motion.npz and camera.json."""
    program = os.environ.get("GSH_PYTHON_EXAMPLE")
    folder = tmp_path_factory.mktemp("example")
    if program:
        subprocess.run([program, folder], check=True)
        return folder
    trained = request.getfixturevalue("trained")
    import gsh

    os.symlink(trained / "avatar.gsh", folder / "avatar.gsh")
    write_motion(folder / "motion.bvh")
    gsh.retarget(folder / "motion.bvh", folder / "motion.npz", trained / "avatar.gsh")
    camera = gsh.Camera.look_at((0.8, 0.3, 2.5), (0, 0, 0), 120, 160)
    (folder / "camera.json").write_text(json.dumps(
        {"width": camera.width, "height": camera.height, "K": camera.K, "R": camera.R, "t": camera.t}))
    return folder


@pytest.fixture(scope="session")
def capture(trained, tmp_path_factory):
    """A capture of the trained avatar, filmed by gsh.render: its folder, and the body's file."""
    np = pytest.importorskip("numpy")
    import gsh

    folder = tmp_path_factory.mktemp("capture")
    write_motion(folder / "m.bvh")
    gsh.retarget(folder / "m.bvh", folder / "poses.npz", trained / "avatar.gsh")
    with np.load(trained / "avatar.gsh") as stored:
        body = {name[len("body/"):]: stored[name] for name in stored.files if name.startswith("body/")}
    np.savez(folder / "body.npz", **body)
    avatar = gsh.load_avatar(trained / "avatar.gsh")
    motion = avatar.load_motion(folder / "poses.npz")
    places = {"front": (0, 0.1, 3), "left": (3, 0.1, 0.2), "right": (-3, 0.2, 0), "back": (0.3, 0.1, -3)}
    cameras = []
    for name, place in places.items():
        camera = gsh.Camera.look_at(place, (0, -0.1, 0), 96, 128, vertical_fov=0.7)
        cameras.append({"name": name, "role": "test" if name == "back" else "train", "width": camera.width,
                        "height": camera.height, "K": camera.K, "R": camera.R, "t": camera.t})
        (folder / "images" / name).mkdir(parents=True)
        for frame in range(len(motion)):
            picture = gsh.render(avatar.pose(motion, frame=frame, camera=camera), camera)
            alpha = np.asarray(picture.alpha)[..., None]
            color = np.where(alpha > 0, np.asarray(picture.color) / np.maximum(alpha, 1e-3), 0)
            pixels = np.clip(np.concatenate([color, alpha], axis=-1) * 255 + 0.5, 0, 255).astype(np.uint8)
            write_png(folder / "images" / name / f"{frame:04d}.png", pixels)
    (folder / "cameras.json").write_text(json.dumps({"cameras": cameras, "fps": 4}))
    return folder, folder / "body.npz"


def write_png(path, pixels):
    """Pixels [height, width, 4] of uint8."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)) +
                     chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def write_motion(path):
    """A BVH file of a person who lifts an arm: two seconds, 8 frames."""
    lines = ["HIERARCHY"]
    channels = "Zrotation Xrotation Yrotation"

    def begin(depth, name, offset, root=False):
        pad = "  " * depth
        lines.append(f"{pad}{'ROOT' if root else 'JOINT'} {name}")
        lines.append(pad + "{")
        lines.append(f"{pad}  OFFSET {offset[0]} {offset[1]} {offset[2]}")
        lines.append(f"{pad}  CHANNELS {'6 Xposition Yposition Zposition' if root else '3'} {channels}")

    def chain(depth, parts):
        (name, offset), rest = parts[0], parts[1:]
        begin(depth, name, offset)
        if rest:
            chain(depth + 1, rest)
        else:
            pad = "  " * (depth + 1)
            lines.extend([pad + "End Site", pad + "{", pad + "  OFFSET 0 -5 0", pad + "}"])
        lines.append("  " * depth + "}")

    begin(0, "Hips", (0, 0, 0), True)
    begin(1, "Spine", (0, 20, 0))
    chain(2, [("Neck", (0, 30, 0)), ("Head", (0, 10, 0))])
    for side, sign in (("Left", 1), ("Right", -1)):
        chain(2, [(side + "Arm", (15 * sign, 25, 0)), (side + "ForeArm", (28 * sign, 0, 0)),
                  (side + "Hand", (25 * sign, 0, 0))])
    lines.append("  }")
    for side, sign in (("Left", 1), ("Right", -1)):
        chain(1, [(side + "UpLeg", (9 * sign, -5, 0)), (side + "Leg", (0, -40, 0)), (side + "Foot", (0, -42, 0))])
    lines.append("}")
    count = 16
    lines += ["MOTION", "Frames: 8", "Frame Time: 0.25"]
    for frame in range(8):
        numbers = [0] * (3 + 3 * count)
        numbers[3 + 3 * 4] = 10 * frame  # the left arm
        lines.append(" ".join(map(str, numbers)))
    Path(path).write_text("\n".join(lines) + "\n")
