# SPDX-License-Identifier: Apache-2.0
"""Ten ways in which a capture is broken, and words of the line that each must have in the report."""

import json
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path


def change(path: Path, edit: Callable[[dict], object]) -> None:
    """Edits the content of a JSON file in place."""
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))


def turn(cameras: dict) -> None:
    """Stores cameras as camera to world, as other programs do."""
    for camera in cameras["cameras"]:
        rotation = [list(column) for column in zip(*camera["R"])]
        camera["t"] = [-sum(a * b for a, b in zip(row, camera["t"])) for row in rotation]
        camera["R"] = rotation


def damage(path: Path) -> None:
    """Cuts a file off."""
    path.write_bytes(path.read_bytes()[:100])


def chunk(kind: bytes, data: bytes) -> bytes:
    return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")


def small_image(path: Path) -> None:
    """A picture of one pixel."""
    header = b"\0\0\0\1\0\0\0\1\x08\6\0\0\0"
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(5))) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)


# name: how the copy of a capture is broken, further options, words of the line
BROKEN: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "cut": (lambda folder: damage(folder / "images/cam00/0001.png"), "", "0001.png"),
    "turned": (lambda folder: change(folder / "cameras.json", turn), "", "camera-to-world"),
    "no-json": (lambda folder: (folder / "cameras.json").write_text("{"), "", "cameras.json"),
    "no-cameras": (lambda folder: (folder / "cameras.json").unlink(), "", "cameras.json: is missing"),
    "no-poses": (lambda folder: (folder / "poses.npz").unlink(), "", "poses.npz"),
    "cut-poses": (lambda folder: damage(folder / "poses.npz"), "", "poses.npz"),
    "small": (lambda folder: small_image(folder / "images/cam01/0000.png"), "", "0000.png"),
    "no-folder": (shutil.rmtree, "", "is not a folder"),
    "no-focus": (lambda folder: change(folder / "cameras.json", lambda c: c["cameras"][0].pop("K")), "", "K"),
    "bad-option": (lambda _folder: None, "--stepz 3", "--stepz"),
}
