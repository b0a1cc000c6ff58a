# SPDX-License-Identifier: Apache-2.0
"""Avatars in memory: loading, posing and rendering.

Arrays are objects with the buffer protocol and DLPack, in the memory of the library: ``numpy.asarray(x)``,
``torch.from_dlpack(x)`` and ``jax.dlpack.from_dlpack(x)`` make views of them without a copy. Arguments may be such
arrays of float32 or float64 on the CPU, or (nested) lists of numbers.

Units are metres, radians and seconds; colours are display-referred sRGB in [0, 1].
"""

from __future__ import annotations

import os
import warnings
from typing import Any, NamedTuple, Optional, Sequence, Union

from ._gsh import posing as _gsh

PathLike = Union[str, "os.PathLike[str]"]
Array = Any  #: an object with __dlpack__ and the buffer protocol; as an argument also a (nested) list of numbers


def _path(where: str, value: Any) -> str:
    try:
        path = os.fspath(value)
    except TypeError:
        raise TypeError(f"{where}: path is {type(value).__name__}, expected a path") from None
    if not isinstance(path, str) or "\0" in path:
        raise ValueError(f"{where}: path is {path!r}, expected a path of str")
    return path


def _whole(where: str, name: str, value: Any, least: int, most: int) -> int:
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a whole number")
    number = value.__index__()
    if not least <= number <= most:
        raise ValueError(f"{where}: {name} is {number}, expected {least} to {most}")
    return number


def _number(where: str, name: str, value: Any) -> float:
    if isinstance(value, (bool, str)) or not hasattr(value, "__float__") and not hasattr(value, "__index__"):
        raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a number")
    return float(value)


def _kind(where: str, name: str, value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a gsh.{kind.__name__}")
    return value


def _text(where: str, name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a text")
    return value


class Camera:
    """A calibrated pinhole camera: ``x_cam = R x_world + t``, ``pixel = K x_cam / z``.

    The camera's x points right, y down, z forward. The image's corner is (0, 0) and the centre of the first pixel
    (0.5, 0.5).

    Parameters
    ----------
    width, height
        of the image, pixels.
    K
        [3, 3] intrinsics: fx 0 cx, 0 fy cy, 0 0 1; without skew.
    R, t
        [3, 3] rotation and [3] translation, camera from world, metres.

    Raises
    ------
    ValueError
        for numbers that do not form a camera.
    """

    __slots__ = ("_numbers",)

    def __init__(self, width: int, height: int, K: Array, R: Array, t: Array) -> None:
        most = 1 << 16
        self._numbers = _gsh.check_camera(_whole("Camera", "width", width, 1, most),
                                          _whole("Camera", "height", height, 1, most), K, R, t)

    @classmethod
    def _of(cls, numbers: tuple) -> Camera:
        camera = cls.__new__(cls)
        camera._numbers = numbers
        return camera

    @classmethod
    def look_at(cls, eye: Array, target: Array, width: int, height: int, *, up: Array = (0.0, 1.0, 0.0),
                vertical_fov: float = 0.6) -> Camera:
        """A camera at ``eye`` [3] that looks at ``target`` [3]; ``up`` [3] points up in the image.

        ``vertical_fov`` is in radians. The principal point is the image's centre.
        """
        where = "Camera.look_at"
        return cls._of(_gsh.look_at(eye, target, up, _number(where, "vertical_fov", vertical_fov),
                                    _whole(where, "width", width, 1, 1 << 16),
                                    _whole(where, "height", height, 1, 1 << 16)))

    @property
    def width(self) -> int:
        return self._numbers[0]

    @property
    def height(self) -> int:
        return self._numbers[1]

    @property
    def K(self) -> list[list[float]]:
        """Intrinsics, [3, 3] by rows, pixels."""
        return _rows(self._numbers[2])

    @property
    def R(self) -> list[list[float]]:
        """Rotation from world to camera, [3, 3] by rows."""
        return _rows(self._numbers[3])

    @property
    def t(self) -> list[float]:
        """Translation from world to camera, [3], metres."""
        return list(self._numbers[4])

    def __repr__(self) -> str:
        return f"Camera({self.width}, {self.height}, K={self.K}, R={self.R}, t={self.t})"


def _rows(numbers: Sequence[float]) -> list[list[float]]:
    return [list(numbers[i:i + 3]) for i in (0, 3, 6)]


def load_camera(path: PathLike, name: str = "") -> Camera:
    """Reads a camera file (JSON: width, height, K, R, t); ``name`` chooses one of several.

    Raises
    ------
    OSError, ValueError
        naming the file and the field.
    """
    return Camera._of(_gsh.read_camera(_path("load_camera", path), _text("load_camera", "name", name)))


class Motion:
    """The motion of a body over T frames, made by ``Avatar.load_motion``."""

    __slots__ = ("_handle", "_arrays")

    def __init__(self) -> None:
        raise TypeError("gsh.Motion: use Avatar.load_motion")

    @classmethod
    def _of(cls, handle: Any) -> Motion:
        motion = cls.__new__(cls)
        motion._handle, motion._arrays = handle, _gsh.motion_info(handle)
        return motion

    def __len__(self) -> int:
        return memoryview(self.timestamps).shape[0]

    @property
    def pose(self) -> Array:
        """[T, J, 3] float64, axis times angle in radians, each joint relative to its parent."""
        return self._arrays["pose"]

    @property
    def transl(self) -> Array:
        """[T, 3] float64, metres."""
        return self._arrays["transl"]

    @property
    def expression(self) -> Array:
        """[T, E] float64, coefficients of the face; E may be 0."""
        return self._arrays["expression"]

    @property
    def betas(self) -> Array:
        """[S] float64, the shape of all frames; empty for the avatar's own."""
        return self._arrays["betas"]

    @property
    def timestamps(self) -> Array:
        """[T] float64, seconds."""
        return self._arrays["timestamps"]

    def __repr__(self) -> str:
        return f"<gsh.Motion of {len(self)} frames>"


class Splats:
    """The Gaussians of an avatar in a pose, made by ``Avatar.pose``.

    The arrays are views of the library's memory, without a copy. Posing again with ``out`` changes them in place;
    otherwise they stay as they are, also after the avatar is gone. They may be written to, for example to colour a part.
    """

    __slots__ = ("_handle", "_arrays", "_avatar_handle")

    def __init__(self) -> None:
        raise TypeError("gsh.Splats: use Avatar.pose")

    @classmethod
    def _of(cls, avatar_handle: Any) -> Splats:
        splats = cls.__new__(cls)
        splats._avatar_handle = avatar_handle
        splats._handle = _gsh.make_splats(avatar_handle)
        splats._arrays = _gsh.splats_info(splats._handle)
        return splats

    def __len__(self) -> int:
        return memoryview(self.opacities).shape[0]

    @property
    def means(self) -> Array:
        """[N, 3] float32, centres in the world, metres."""
        return self._arrays["means"]

    @property
    def covariances(self) -> Array:
        """[N, 6] float32, square metres: xx, xy, xz, yy, yz, zz in the world's axes."""
        return self._arrays["covariances"]

    @property
    def opacities(self) -> Array:
        """[N] float32 in (0, 1)."""
        return self._arrays["opacities"]

    @property
    def colors(self) -> Array:
        """[N, 3] float32 sRGB as seen from the camera's centre, with the avatar's light and shadows."""
        return self._arrays["colors"]

    def __repr__(self) -> str:
        return f"<gsh.Splats of {len(self)} Gaussians>"


class Avatar:
    """An animatable avatar, made by ``load_avatar``: canonical Gaussians on the rig of a body.

    N Gaussians, J joints, S shape and E expression coefficients. Methods may be called from several threads; they
    release the GIL and take turns.
    """

    __slots__ = ("_handle", "_info")

    def __init__(self) -> None:
        raise TypeError("gsh.Avatar: use gsh.load_avatar")

    @classmethod
    def _of(cls, handle: Any) -> Avatar:
        avatar = cls.__new__(cls)
        avatar._handle, avatar._info = handle, _gsh.avatar_info(handle)
        return avatar

    def __len__(self) -> int:
        return memoryview(self.opacity_logits).shape[0]

    @property
    def is_lit(self) -> bool:
        """Whether a light shades it. Its own colours are then those of the surface, without light."""
        return self._info["lit"]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """[J] names, or empty if the body's file has none."""
        return self._info["joint_names"]

    @property
    def parents(self) -> Array:
        """[J] int32, the parent of each joint; -1 for the root."""
        return self._info["parents"]

    @property
    def rest_joints(self) -> Array:
        """[J, 3] float64, positions of the joints in the canonical pose, metres."""
        return self._info["rest_joints"]

    @property
    def betas(self) -> Array:
        """[S] float64, the body's shape."""
        return self._info["betas"]

    @property
    def expression_count(self) -> int:
        """E"""
        return self._info["expressions"]

    @property
    def means(self) -> Array:
        """[N, 3] float32, centres in the canonical pose, metres. Read-only, as are the arrays below."""
        return self._info["means"]

    @property
    def quats(self) -> Array:
        """[N, 4] float32, rotations w, x, y, z of the axes of the Gaussians, of any length."""
        return self._info["quats"]

    @property
    def log_scales(self) -> Array:
        """[N, 3] float32, logarithms of the standard deviations in metres."""
        return self._info["log_scales"]

    @property
    def opacity_logits(self) -> Array:
        """[N] float32, opacities before the sigmoid."""
        return self._info["opacity_logits"]

    @property
    def sh(self) -> Array:
        """[N, K, 3] float32, spherical harmonics of the colour, K = (degree + 1)²."""
        return self._info["sh"]

    def load_motion(self, path: PathLike, *, upright: bool = False, input_fps: float = 0.0,
                    animation: str = "") -> Motion:
        """Reads a motion in any layout that gsh reads, and retargets it to the avatar's body.

        ``upright`` turns the world of the file so that the body stands along +y. ``input_fps`` is the rate whatever the
        file states, ``animation`` the name of one of several in a glTF file.

        Raises
        ------
        OSError, ValueError
            naming the file and what is wrong, for example a motion of another body.
        """
        where = "Avatar.load_motion"
        rate = _number(where, "input_fps", input_fps)
        if not 0 <= rate <= 1e5:
            raise ValueError(f"{where}: input_fps is {rate}, expected 0 or more frames per second")
        handle, texts = _gsh.load_motion(self._handle, _path(where, path), bool(upright), rate,
                                         _text(where, "animation", animation))
        for text in texts:
            warnings.warn(text, stacklevel=2)
        return Motion._of(handle)

    def pose(self, pose: Union[Motion, Array, None] = None, transl: Optional[Array] = None, *, frame: int = 0,
             expression: Optional[Array] = None, betas: Optional[Array] = None, camera: Optional[Camera] = None,
             center: Optional[Array] = None, out: Optional[Splats] = None) -> Splats:
        """The avatar's Gaussians in a pose.

        Parameters
        ----------
        pose
            a ``Motion``, of which ``frame`` is taken; or [J, 3] axis times angle in radians, each joint relative
            to its parent; None: the canonical pose.
        transl, expression, betas
            [3] metres, [at most E], [at most S], if ``pose`` is not a motion. None: zero, zero, and the avatar's own
            shape.
        camera, center
            who looks at it: a ``Camera``, or a point [3] in the world, metres. Colours depend on it. None: the
            point (0, 0, 0).
        out
            splats of an earlier call, whose memory is used again.

        Raises
        ------
        TypeError, ValueError
            naming the argument. ``out`` is unchanged where arguments are wrong.
        """
        where = "Avatar.pose"
        if camera is not None and center is not None:
            raise TypeError(f"{where}: camera and center are both given, expected one of them")
        seen_by = None if camera is None else _kind(where, "camera", camera, Camera)._numbers
        if center is None:
            center = (0.0, 0.0, 0.0)
        if out is not None and _kind(where, "out", out, Splats)._avatar_handle is not self._handle:
            raise ValueError(f"{where}: out is of another avatar")
        splats = Splats._of(self._handle) if out is None else out
        if isinstance(pose, Motion):
            for name, value in (("transl", transl), ("expression", expression), ("betas", betas)):
                if value is not None:
                    raise TypeError(f"{where}: {name} is given beside a motion, which has its own")
            if len(pose) == 0:
                raise ValueError(f"{where}: the motion has no frames")
            _gsh.pose_frame(splats._handle, pose._handle, _whole(where, "frame", frame, 0, len(pose) - 1), seen_by,
                            center)
        else:
            _whole(where, "frame", frame, 0, 0)
            _gsh.pose_numbers(splats._handle, self._handle, pose, transl, expression, betas, seen_by, center)
        return splats

    def __repr__(self) -> str:
        return f"<gsh.Avatar of {len(self)} Gaussians>"


class Rendering(NamedTuple):
    """Images of ``render``, float32."""

    color: Array  #: [height, width, 3] sRGB
    alpha: Array  #: [height, width], 1 - transmittance, in [0, 1]
    depth: Optional[Array]  #: [height, width] sum of weight times z, metres; divided by alpha, the mean depth
    median_depth: Optional[Array]  #: [height, width] z where half of the light is taken, metres; 0 where it never is


def load_avatar(path: PathLike, *, threads: int = 0) -> Avatar:
    """Reads an avatar (``.gsh``). It works on so many CPU threads; 0: all.

    Raises
    ------
    OSError, ValueError
        naming the file and the member that is missing or wrong.
    """
    return Avatar._of(_gsh.load_avatar(_path("load_avatar", path), _whole("load_avatar", "threads", threads, 0, 1024)))


def render(splats: Union[Splats, Sequence[Splats]], camera: Camera, *, background: Array = (0.0, 0.0, 0.0),
           depths: bool = False) -> Rendering:
    """Renders posed avatars; the same picture, bit for bit, as the command ``gsh-render``.

    Parameters
    ----------
    splats
        of one avatar, or of several in one picture. Pose them for the same ``camera``.
    camera
        a ``Camera``.
    background
        [3] sRGB in [0, 1].
    depths
        whether the depths are rendered, too; otherwise they are None.

    Raises
    ------
    TypeError, ValueError
        naming the argument, or the Gaussian with a number that is not finite.
    """
    where = "render"
    several = [splats] if isinstance(splats, Splats) else splats
    if not isinstance(several, (list, tuple)) or not several:
        raise TypeError(f"{where}: splats is {type(splats).__name__}, expected gsh.Splats or a list of them")
    handles = [_kind(where, f"splats[{i}]", one, Splats)._handle for i, one in enumerate(several)]
    if background is None:
        raise TypeError(f"{where}: background is None, expected three numbers")
    return Rendering(*_gsh.render(handles, _kind(where, "camera", camera, Camera)._numbers, background, bool(depths)))
