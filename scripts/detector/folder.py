# SPDX-License-Identifier: Apache-2.0
"""The folder that is written: docs/detection.md describes it. Every file appears whole. Needs only NumPy."""

import json
import os
from pathlib import Path

import numpy as np


class Folder:
    def __init__(self, out):
        self.out, self.work = Path(out), Path(out) / ".detect"

    def image(self, camera, i):
        return self.out / "images" / camera / f"{i:04d}.png"

    def mask(self, camera, i):
        return self.out / "masks" / camera / f"{i:04d}.png"

    def first_mask(self, camera, i):
        """The mask that this program wrote first; gsh-fit has moved it if it has mended it."""
        moved = self.out / "masks_detected" / camera / f"{i:04d}.png"
        return moved if moved.exists() else self.mask(camera, i)

    def body(self, camera, i):
        return self.out / "bodies" / camera / f"{i:04d}.png"

    def new_mask(self, camera, i):
        return self.work / "masks_by_body" / camera / f"{i:04d}.png"

    def plate(self, camera):
        return self.out / "plates" / f"{camera}.png"

    def look(self, camera, direction):
        return self.work / f"{camera}.{direction}.pickle"

    def person(self, camera, i):
        return self.work / camera / f"{i:04d}.pickle"


def write_whole(path, data):
    """Bytes under a temporary name, which is then renamed: an interrupted run leaves no half file."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_bytes(data)
    os.replace(temporary, path)


def write_json(path, value, indent=None):
    write_whole(path, (json.dumps(value, indent=indent, ensure_ascii=False) + "\n").encode())


def flat(points):
    """The numbers of all points in one list, as COCO stores them."""
    return [number for point in points for number in point]


def keypoints_json(cameras, people, detector):
    """COCO's layout. `cameras`: (name, width, height); `people`: per camera and frame an annotation or None."""
    images, annotations = [], []
    for (name, width, height), frames in zip(cameras, people):
        for i, person in enumerate(frames):
            images.append({"id": len(images), "file_name": f"{name}/{i:04d}.png", "width": width, "height": height})
            if person:
                fields = {k: flat(v) for k, v in person.items() if k != "sides_doubtful"}
                annotations.append(
                    {"id": len(annotations), "image_id": images[-1]["id"], "category_id": 1, **fields}
                )
    return {
        "info": {"detector": detector},
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "person"}],
    }


def landmarks_of(keypoints, cameras):
    """Of what keypoints_json() made: for each camera, MediaPipe's landmarks [33, 3] of the frames that have some."""
    places = {image["id"]: image["file_name"] for image in keypoints["images"]}
    found = {name: {} for name in cameras}
    for person in keypoints["annotations"]:
        camera, _, file = places[person["image_id"]].partition("/")
        if "mediapipe_pose" in person and camera in found:
            found[camera][int(Path(file).stem)] = np.array(person["mediapipe_pose"]).reshape(33, 3)
    return found


def video_json(fps, cameras, sources, times):
    """`cameras`: dicts of name, width, height and perhaps focal; `times`: per camera, seconds in its own video."""
    origin = min(t[0] for t in times)
    return {
        "fps": round(fps, 6),
        "masks_by_body": True,
        "cameras": [
            {
                **camera,
                "source": str(source.path),
                "source_fps": source.fps,
                "times": [round(float(t - origin), 6) for t in kept],
            }
            for camera, source, kept in zip(cameras, sources, times)
        ],
    }


def cameras_json(fps, cameras):
    """`cameras`: (name, width, height, K, R, t) of undistorted images."""
    return {
        "fps": round(fps, 6),
        "cameras": [
            {
                "name": name,
                "role": "train",
                "width": width,
                "height": height,
                "K": K.tolist(),
                "R": R.tolist(),
                "t": t.tolist(),
            }
            for name, width, height, K, R, t in cameras
        ],
    }
