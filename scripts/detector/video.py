# SPDX-License-Identifier: Apache-2.0
"""Sources of frames: a video (through PyAV, i.e. FFmpeg's libraries), or a folder of images."""

import re
import shlex
from pathlib import Path

import av
import cv2
import numpy as np

import color
from failure import Failure

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}
BT709, BT601, BT2020 = 1, 5, 9  # colour matrices, numbered as in ITU-T H.273


def convert_command(path, filters=""):
    out = Path(path).stem + "_converted.mp4"
    filters = f" -vf {filters}" if filters else ""
    return f"ffmpeg -i {shlex.quote(str(path))}{filters} -c:v libx264 -crf 14 -pix_fmt yuv420p {shlex.quote(out)}"


def open_source(name, path, folder_fps):
    path = Path(path)
    if path.is_dir():
        return ImageFolder(name, path, folder_fps)
    if not path.exists():
        raise Failure(f"{path}: no such file")
    return Video(name, path)


class Video:
    """`times`: seconds of all frames since the first one. `size`: of upright frames with square pixels."""

    def __init__(self, name, path):
        self.name, self.path, self.notes = name, path, []
        if not path.stat().st_size:
            raise Failure(f"{path}: is empty; copy it again from the camera")
        try:
            with av.open(str(path)) as container:
                if not container.streams.video:
                    raise Failure(f"{path}: holds no video")
                self._read_header(container, container.streams.video[0])
        except av.error.FFmpegError as error:
            raise Failure(
                f"{path}: cannot be read as a video ({error.strerror}): it is cut off, or of "
                f"another kind; copy it again, or convert it: {convert_command(path)}"
            ) from error
        except (PermissionError, OSError) as error:
            raise Failure(f"{path}: {error.strerror or error}") from error

    def _read_header(self, container, stream):
        context = stream.codec_context
        if context is None:
            raise Failure(f"{self.path}: its codec is not known; convert it: {convert_command(self.path)}")
        stamps = sorted(
            {
                p.pts if p.pts is not None else p.dts
                for p in container.demux(stream)
                if p.size and (p.pts is not None or p.dts is not None) and not p.is_discard
            }
        )
        if not stamps:
            raise Failure(f"{self.path}: the video has 0 frames; it may be cut off: copy it again from the camera")
        self.start = stamps[0] * stream.time_base
        self.times = np.array([float(s * stream.time_base - self.start) for s in stamps])
        self.fps = round((len(stamps) - 1) / self.times[-1], 3) if len(stamps) > 1 and self.times[-1] > 0 else 30.0
        with av.open(str(self.path)) as again:  # not every container can be rewound
            first = next(iter(again.decode(video=0)), None)
        if first is None:
            raise Failure(f"{self.path}: no frame can be decoded; convert it: {convert_command(self.path)}")
        self.transfer = int(context.color_trc)
        self.hdr = self.transfer in (color.PQ, color.HLG)
        self.pixel_aspect = float(stream.sample_aspect_ratio or 1) or 1.0
        self.rotation = int(round(first.rotation / 90)) % 4 * 90  # degrees, against the clock
        self.matrix = int(first.colorspace)
        if self.matrix not in (BT709, BT601, 6, 4, 7, BT2020, 10):  # not stated: what players assume
            self.matrix = BT2020 if self.hdr else BT709 if max(first.width, first.height) > 1024 else BT601
        image = self._upright(first)
        self.size = image.shape[1], image.shape[0]
        tags = {**container.metadata, **stream.metadata}
        self.focal, self.focal_from = focal_of_tags(tags, max(self.size)), "metadata"
        if self.hdr:
            self.notes.append(
                f"{self.name}: {'PQ' if self.transfer == color.PQ else 'HLG'} video of high dynamic range is "
                "converted to sRGB; highlights above paper white are compressed"
            )
        if self.rotation:
            self.notes.append(f"{self.name}: turned upright, as the video states ({self.rotation} degrees)")
        if first.interlaced_frame:
            self.notes.append(
                f"{self.name}: is interlaced: moving limbs have combs; convert it first: "
                f"{convert_command(self.path, 'bwdif')}"
            )

    def _upright(self, frame):
        if self.hdr:  # full-range RGB of 16 bits; the transfer function is ours
            rgb = frame.reformat(
                format="rgb48le", src_colorspace=self.matrix, dst_color_range="JPEG", interpolation="BICUBIC"
            ).to_ndarray()
            rgb = color.srgb_from_hdr(rgb, self.transfer)
        else:
            rgb = frame.reformat(
                format="rgb24", src_colorspace=self.matrix, dst_color_range="JPEG", interpolation="BICUBIC"
            ).to_ndarray()
        if abs(self.pixel_aspect - 1) > 1e-3:
            rgb = cv2.resize(
                rgb, (int(round(rgb.shape[1] * self.pixel_aspect)), rgb.shape[0]), interpolation=cv2.INTER_CUBIC
            )
        return np.ascontiguousarray(np.rot90(rgb, self.rotation // 90))

    def frames(self, wanted):
        """Yields RGB images of the frames with these positions in `times`, in order."""
        targets = [float(self.times[i]) for i in wanted]
        for seek in (True, False) if targets[0] > 5 else (False,):  # not every container finds a time
            k = 0
            for k, image in enumerate(self._decode(targets, seek), 1):
                yield image
            if k == len(targets):
                return
            if k:
                break
        raise Failure(
            f"{self.path}: the frame at {targets[k]:.2f} s cannot be decoded; leave the rest out with --end "
            f"{targets[max(0, k - 1)]:.2f}, or convert it: {convert_command(self.path)}"
        )

    def _decode(self, targets, seek):
        k = 0
        try:
            with av.open(str(self.path)) as container:
                stream = container.streams.video[0]
                stream.thread_type = "AUTO"
                if seek:
                    container.seek(int((self.start + targets[0]) / stream.time_base), stream=stream)
                for frame in container.decode(stream):
                    stamp = frame.pts if frame.pts is not None else frame.dts
                    now = float(stamp * stream.time_base - self.start) if stamp is not None else -1.0
                    if now > targets[k] + 1e-3:  # the wanted frame was not decoded
                        return
                    if now > targets[k] - 1e-3:
                        yield self._upright(frame)
                        k += 1
                        if k == len(targets):
                            return
        except av.error.FFmpegError:
            return  # the caller names the time


class ImageFolder:
    """Images in the order of the numbers in their names."""

    def __init__(self, name, path, fps):
        self.name, self.path, self.notes = name, path, []
        self.files = sorted(
            (f for f in path.iterdir() if f.suffix.lower() in IMAGES and not f.name.startswith(".")),
            key=lambda f: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", f.name)],
        )
        if not self.files:
            raise Failure(
                f"{path}: holds no images (PNG, JPEG, TIFF, WebP or BMP); HEIC: convert them, for instance with "
                "`mogrify -format png *.heic`"
            )
        self.times, self.fps, self.rotation = np.arange(len(self.files)) / fps, fps, 0
        first = self._read(self.files[0])
        self.size = first.shape[1], first.shape[0]
        self.focal, self.focal_from = focal_of_exif(self.files[0], max(self.size)), "exif"

    def _read(self, file):
        image = cv2.imread(str(file), cv2.IMREAD_COLOR)  # turns it as Exif states
        if image is None:
            raise Failure(f"{file}: cannot be read as an image; write it anew as PNG")
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)

    def frames(self, wanted):
        for i in wanted:
            image = self._read(self.files[i])
            if (image.shape[1], image.shape[0]) != self.size:
                raise Failure(
                    f"{self.files[i]}: has {image.shape[1]} x {image.shape[0]} pixels, the first image of the folder "
                    f"{self.size[0]} x {self.size[1]}; all images of a camera have one size"
                )
            yield image


def focal_of_tags(tags, longer_side):
    """Pixels, from the focal length that a lens of a 36 mm wide film would have, as phones write it; or None."""
    for key, value in tags.items():
        if "35mm" in key.lower().replace("_", "").replace(".", ""):
            try:
                return plausible(float(str(value).split()[0]), longer_side)
            except ValueError:
                pass
    return None


def focal_of_exif(file, longer_side):
    from PIL import Image

    try:
        with Image.open(file) as image:
            exif = image.getexif()
            return plausible(float(exif.get_ifd(0x8769).get(0xA405) or exif.get(0xA405) or 0), longer_side)
    except (OSError, ValueError, TypeError):
        return None


def plausible(millimetres, longer_side):
    return millimetres / 36 * longer_side if 8 <= millimetres <= 500 else None
