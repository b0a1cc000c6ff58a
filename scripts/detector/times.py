# SPDX-License-Identifier: Apache-2.0
"""Which frames are kept: the same times of all cameras, chosen by the time stamps of their frames. Needs only NumPy."""

import math
from dataclasses import dataclass

import numpy as np

from failure import Failure


@dataclass
class Choice:
    fps: float  # of the frames that are kept
    frames: list  # per camera: indices into its time stamps, one per kept time
    notes: list  # sentences for the user


def constant_rate(times):
    """Frames per second if all frames are equally far apart (up to the rounding of time stamps), else None."""
    if len(times) < 3:
        return None
    steps = np.diff(times)
    step = (times[-1] - times[0]) / (len(times) - 1)
    return 1 / step if np.abs(steps - step).max() < max(0.0011, 0.05 * step) else None


def mean_rate(times):
    return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 0.0


def choose(names, times, fps=10.0, most=150, begin=None, end=None, late=None):
    """Times of each camera count from its first frame, because cameras are started together; `late` has for each the
    seconds by which its frames were taken later than that.

    The rate is at most `fps`, and so low that at most `most` frames are kept. Where all cameras have the same constant
    rate, every n-th frame is taken, so that the kept ones are equally far apart. Otherwise a regular clock is laid over
    the videos, and each camera gives its nearest frame; times in a gap of a camera (longer than the clock's step) are
    left out for all.
    """
    times = [np.asarray(t, float) for t in times]
    notes = []
    for name, t in zip(names, times):
        if len(t) == 0:
            raise Failure(f"{name}: the video has no frames")
    if late is not None:
        times = [t + shift for t, shift in zip(times, late)]
    lengths = [t[-1] for t in times]
    first, last = max([begin or 0.0, 0.0] + [t[0] for t in times]), min(lengths + ([end] if end is not None else []))
    if first > last:
        shortest = names[int(np.argmin(lengths))]
        raise Failure(
            f"nothing is left between --begin {first:g} and {last:g} s; the video of {shortest} has "
            f"{min(lengths):.2f} s"
        )
    steps = [1 / r for r in map(mean_rate, times) if r > 0]
    if len(times) > 1 and max(lengths) - min(lengths) > 1.5 * max(steps, default=0) and (end is None or end > last):
        span = ", ".join(f"{n} {length:.2f} s" for n, length in zip(names, lengths))
        notes.append(f"the videos have different lengths ({span}); only the first {last:.2f} s are used")

    rates = [constant_rate(t) for t in times]
    slack = 1e-3
    together = late is None or not any(late)
    if together and all(rates) and max(rates) - min(rates) < 1e-3 * max(rates):
        count = int(math.floor((last - first + slack) * rates[0])) + 1
        stride = max(1, math.ceil(rates[0] / fps - 0.01), math.ceil(count / most))
        start = int(math.ceil(first * rates[0] - slack * rates[0]))
        picked = np.arange(start, start + count, stride)
        picked = picked[picked < min(len(t) for t in times)]
        return Choice(rates[0] / stride, [picked.tolist() for _ in times], notes)

    rate = min([fps] + [mean_rate(t) for t in times if len(t) > 1])
    if (last - first) * rate + 1 > most:
        rate = (most - 1) / (last - first)
    clock = (
        first + np.arange(int(math.floor((last - first) * rate + slack)) + 1) / rate
        if rate > 0
        else np.array([first])
    )
    nearest = [nearest_frames(t, clock) for t in times]
    keep, used = [], [-1] * len(times)
    for k, now in enumerate(clock):
        found = [n[k] for n in nearest]
        if any(f <= u for f, u in zip(found, used)) or any(
            abs(t[f] - now) > 0.5 / rate for t, f in zip(times, found)
        ):
            continue
        keep.append(found)
        used = found
    if len(keep) < len(clock):
        notes.append(
            f"{len(clock) - len(keep)} of {len(clock)} times are left out, because a camera has a gap there"
        )
    return Choice(rate, [list(map(int, f)) for f in zip(*keep)], notes)


def nearest_frames(times, clock):
    after = (
        np.clip(np.searchsorted(times, clock), 1, max(1, len(times) - 1))
        if len(times) > 1
        else np.zeros(len(clock), int)
    )
    if len(times) == 1:
        return after
    before = after - 1
    return np.where(clock - times[before] <= times[after] - clock, before, after)
