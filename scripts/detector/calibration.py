# SPDX-License-Identifier: Apache-2.0
"""Reads calibrated cameras: gsh's cameras.json, TOML of Pose2Sim, Anipose and Caliscope, Qualisys' XML, and OpenCV's
YAML (intri.yml, extri.yml). Needs only NumPy (and tomli before Python 3.11).

All become: x_cam = R x_world + t, camera x right, y down, z forward; metres; world y up; pixels from the image's
corner.
"""

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from failure import Failure


@dataclass
class Camera:
    name: str
    size: tuple  # width, height of the images that it was calibrated on; None if the file does not tell
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    distortion: np.ndarray  # OpenCV's k1, k2, p1, p2 and k3 …, or the four of its fisheye model
    fisheye: bool = False


def read_calibration(path):
    """Returns the cameras, and sentences on what was assumed."""
    path = Path(path)
    if path.is_dir():
        path = next((path / n for n in ("cameras.json", "intri.yml") if (path / n).is_file()), path)
    if not path.is_file():
        raise Failure(f"{path}: no such calibration file")
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        if path.suffix == ".json":
            return read_gsh(text), []
        if path.suffix == ".toml":
            cameras, metric = read_toml(text), False
        elif path.suffix in (".yml", ".yaml"):
            cameras, metric = read_opencv(path), False
        elif text.lstrip().startswith("<"):
            cameras, metric = read_qualisys(text), True
        else:
            raise Failure(
                f"{path}: unknown kind of calibration; expected cameras.json of gsh, .toml of Pose2Sim, Anipose "
                "or Caliscope, Qualisys' XML (.qca.txt), or intri.yml beside extri.yml"
            )
        if not cameras:
            raise Failure(f"{path}: holds no camera")
        return cameras, to_metres(cameras, metric) + to_y_up(cameras)
    except (KeyError, ValueError, TypeError, AttributeError, ElementTree.ParseError) as error:
        raise Failure(f"{path}: cannot be read as a calibration: {type(error).__name__}: {error}") from error


def read_gsh(text):
    return [
        Camera(
            c["name"],
            (int(c["width"]), int(c["height"])),
            matrix(c["K"], 3, 3),
            matrix(c["R"], 3, 3),
            matrix(c["t"], 3),
            np.array(c.get("distortion") or [0.0] * 5, float),
        )
        for c in json.loads(text)["cameras"]
    ]


def read_toml(text):
    """A section for each camera; Caliscope may nest them in `cameras`, and numbers its cameras."""
    sections = load_toml(text)
    nested = sections.get("cameras")
    if isinstance(nested, dict):
        sections = nested
    cameras = []
    for section, c in sections.items():
        if not isinstance(c, dict) or "matrix" not in c or c.get("rotation") is None or c.get("ignore"):
            continue  # metadata, or a camera without a place
        number = c.get("cam_id", c.get("port"))
        name = c.get("name", section if number is None else f"cam_{number}")
        rotation = np.array(c["rotation"], float)
        size = tuple(int(round(v)) for v in c["size"]) if "size" in c else None
        cameras.append(
            Camera(
                str(name),
                size,
                corner_based(matrix(c["matrix"], 3, 3)),
                rotation if rotation.shape == (3, 3) else rodrigues(rotation.ravel()),
                matrix(c["translation"], 3),
                np.array(c.get("distortions", [0] * 5), float).ravel(),
                bool(c.get("fisheye", False)),
            )
        )
    return cameras


def load_toml(text):
    try:
        import tomllib
    except ImportError:  # Python 3.10
        import tomli as tomllib
    return tomllib.loads(text)


def read_qualisys(text):
    """Intrinsics are in 1/64 pixel, places in millimetres; the axes of cameras are x right, y up, z backward."""
    cameras = []
    for c in ElementTree.fromstring(text).iter("camera"):
        lens, place, view = c.find("intrinsic"), c.find("transform"), c.find("fov_video")
        number = lambda node, key: float(node.get(key))
        R = np.diag([1.0, -1.0, -1.0]) @ np.array(
            [[number(place, f"r{i}{j}") for j in (1, 2, 3)] for i in (1, 2, 3)]
        )
        centre = np.array([number(place, axis) for axis in "xyz"]) / 1000
        K = (
            np.array(
                [
                    [
                        number(lens, "focalLengthU"),
                        number(lens, "skew") if lens.get("skew") else 0,
                        number(lens, "centerPointU"),
                    ],
                    [0, number(lens, "focalLengthV"), number(lens, "centerPointV")],
                    [0, 0, 64],
                ]
            )
            / 64
        )
        k = [
            number(lens, key) / 64
            for key in (
                "radialDistortion1",
                "radialDistortion2",
                "tangentalDistortion1",
                "tangentalDistortion2",
                "radialDistortion3",
            )
        ]
        size = tuple(int(view.get(b)) - int(view.get(a)) + 1 for a, b in (("left", "right"), ("top", "bottom")))
        cameras.append(Camera(c.get("serial"), size, corner_based(K), R, -R @ centre, np.array(k)))
    return cameras


def read_opencv(path):
    """intri.yml and extri.yml, as EasyMocap writes them: K_NAME, dist_NAME; Rot_NAME or R_NAME, T_NAME."""
    lens = opencv_matrices((path.parent / "intri.yml").read_text())
    file = path.parent / "extri.yml"
    if not file.is_file():
        raise Failure(f"{file} is missing; expected it beside intri.yml")
    place = opencv_matrices(file.read_text())
    cameras = []
    for key, K in lens.items():
        if not key.startswith("K_"):
            continue
        name = key[2:]
        R = place["Rot_" + name] if "Rot_" + name in place else rodrigues(place["R_" + name].ravel())
        size = tuple(int(lens[k + name].ravel()[0]) for k in ("W_", "H_")) if "W_" + name in lens else None
        cameras.append(
            Camera(
                name,
                size,
                corner_based(K),
                R,
                place["T_" + name].ravel(),
                lens.get("dist_" + name, np.zeros(5)).ravel(),
            )
        )
    return cameras


def opencv_matrices(text):
    """NAME: !!opencv-matrix with rows, cols and data; and NAME: NUMBER."""
    found = {}
    for m in re.finditer(
        r"^(\w[\w.-]*):\s*!!opencv-matrix\s+rows:\s*(\d+)\s+cols:\s*(\d+)\s+dt:\s*\w+\s+data:\s*\[([^\]]*)\]",
        text,
        re.M,
    ):
        found[m[1]] = np.array([float(v) for v in m[4].split(",")]).reshape(int(m[2]), int(m[3]))
    for m in re.finditer(r"^(\w[\w.-]*):[ \t]*([-+.\deE]+)[ \t\r]*$", text, re.M):
        found[m[1]] = np.array([[float(m[2])]])
    return found


def matrix(values, *shape):
    return np.array(values, float).reshape(shape)


def corner_based(K):
    """OpenCV's pixel coordinates begin at the first pixel's centre, gsh's at the image's corner."""
    K = K.copy()
    K[:2, 2] += 0.5
    return K


def rodrigues(v):
    angle = float(np.linalg.norm(v))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = np.asarray(v, float) / angle
    C = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * C + (1 - np.cos(angle)) * C @ C


def to_metres(cameras, metric):
    """Cameras around a person are not more than 50 m apart, so larger numbers are millimetres."""
    centres = np.array([-c.R.T @ c.t for c in cameras])
    extent = float(np.linalg.norm(centres - centres.mean(0), axis=1).max())
    if metric or extent <= 50:
        return []
    for c in cameras:
        c.t = c.t / 1000
    return [f"calibration: taken as millimetres, because the cameras stand {2 * extent:.0f} units apart"]


def to_y_up(cameras):
    """Turns the world so that y is up. Up is the axis of the world nearest to the mean of the cameras' own."""
    up = -np.mean([c.R[1] for c in cameras], 0)
    axis = int(np.argmax(np.abs(up)))
    sign = 1.0 if up[axis] > 0 else -1.0
    angle = float(np.degrees(np.arccos(np.clip(abs(up[axis]) / np.linalg.norm(up), 0, 1))))
    old_y = np.zeros(3)
    old_y[axis] = sign
    # The two other axes follow in their order, which makes a rotation: (x, y, z) from (x, z, -y) for z up.
    old_x = np.zeros(3)
    old_x[0 if axis != 0 else 1] = 1.0
    turn = np.stack([old_x, old_y, np.cross(old_x, old_y)])
    for c in cameras:
        c.R = c.R @ turn.T
    name = ("" if sign > 0 else "-") + "xyz"[axis]
    notes = [f"calibration: {name} is up in its world"]
    if angle > 30:
        notes[0] += f", a guess: the cameras' mean vertical is {angle:.0f} degrees from it"
    return notes if name != "y" or angle > 30 else []


def match_cameras(names, cameras):
    """The calibrated camera of each name; upper case, signs and leading zeros of numbers do not matter."""

    def plain(name):
        return re.sub(r"0*(\d+)", r"\1", re.sub(r"[^a-z0-9]", "", name.lower()))

    by_name, by_plain = {c.name: c for c in cameras}, {}
    for c in cameras:
        by_plain.setdefault(plain(c.name), []).append(c)
    found = []
    for name in names:
        alike = by_plain.get(plain(name), [])
        camera = by_name.get(name) or (alike[0] if len(alike) == 1 else None)
        if camera is None:
            known = ", ".join(c.name for c in cameras)
            raise Failure(
                f"camera {name} is not in the calibration, which has {known}; name videos by --camera NAME=PATH"
            )
        found.append(camera)
    return found


def fit_to_size(camera, width, height):
    """K for frames of this size. Returns K and a sentence, or None, on a difference.

    Codecs store whole blocks of 16 pixels. A camera that was calibrated on the padded images has the same K.
    """
    K = camera.K.copy()
    if camera.size is None or tuple(camera.size) == (width, height):
        return K, None
    w, h = camera.size
    if (w, h) in {
        (-(-width // 16) * 16, height),
        (width, -(-height // 16) * 16),
        (-(-width // 16) * 16, -(-height // 16) * 16),
    }:
        return K, (
            f"{camera.name}: calibrated on {w} x {h}, which is {width} x {height} with the padding of a codec at the "
            "right and bottom; K is kept"
        )
    if abs(w * height - h * width) <= 0.002 * w * height:
        K[0] *= width / w
        K[1] *= height / h
        return K, f"{camera.name}: calibrated on {w} x {h}; K is scaled to frames of {width} x {height}"
    turned = (
        ", turned by 90 degrees; calibrate on upright images"
        if (w > h) != (width > height)
        else "; give the video in the size of the calibration"
    )
    raise Failure(
        f"{camera.name}: calibrated on images of {w} x {h}, but the frames are {width} x {height}{turned}"
    )
