# SPDX-License-Identifier: Apache-2.0
"""Masks of the person, and the background without the person (the plate) of a camera that stands still.

Every pixel has a logarithm of how much likelier the person is than the background, from three sources:
- the place: the distance to an outline, that of MediaPipe's coarse mask and the limbs, or that of a fitted body,
- the colour: how often the person has it in all frames, against the plate at this pixel, also in a shadow,
- where there is no plate: how often the background has the colour elsewhere.
The outline is then the minimum cut of these numbers and of the image's edges. OpenCV's grabCut finds it; its own models
of colour do not take part, because they are one for the whole image, and lose a leg in front of a thing of its colour.
"""

import warnings

import cv2
import numpy as np

# Limbs between two landmarks, their radius in sizes of the body, and the part of the body, which has its own colours;
# places with several landmarks are their mean.
SHOULDERS, EARS = (11, 12), (7, 8)
HEAD, TRUNK, UPPER_ARM, LOWER_ARM, HAND, THIGH, SHIN, FOOT = PARTS = range(8)
LIMBS = (
    ((11,), (13,), 0.0375, UPPER_ARM),
    ((13,), (15,), 0.0275, LOWER_ARM),
    ((12,), (14,), 0.0375, UPPER_ARM),
    ((14,), (16,), 0.0275, LOWER_ARM),
    ((15,), (19,), 0.03, HAND),
    ((16,), (20,), 0.03, HAND),
    ((11,), (12,), 0.045, TRUNK),
    ((11,), (23,), 0.06, TRUNK),
    ((12,), (24,), 0.06, TRUNK),
    ((23,), (24,), 0.055, TRUNK),
    ((23,), (25,), 0.0475, THIGH),
    ((25,), (27,), 0.035, SHIN),
    ((24,), (26,), 0.0475, THIGH),
    ((26,), (28,), 0.035, SHIN),
    ((27,), (29,), 0.025, FOOT),
    ((28,), (30,), 0.025, FOOT),
    ((27,), (31,), 0.025, FOOT),
    ((28,), (32,), 0.025, FOOT),
    ((29,), (31,), 0.0225, FOOT),
    ((30,), (32,), 0.0225, FOOT),
    (SHOULDERS, EARS, 0.03, HEAD),
    (EARS, EARS, 0.075, HEAD),
)
CORE, WIDTH, NEAR = (
    0.12,
    0.45,
    2.2,
)  # radii as multiples: surely the person; a guess; beyond it is surely the background
NOISE = 7.0  # least spread of the plate's colours, of 255
BINS = 16  # of a colour histogram, in each channel
SHADOWS = (1.0, 0.93, 0.86, 0.78, 0.7)
EDGE = 0.012  # the coarse outline is believed this many sizes of the body farther in or out
COLOUR, PLACE, FAR = 1.0, 2.0, 2.0  # weights; FAR for what lies four times farther from the coarse outline
SURE = 1.0  # weight of MediaPipe's own certainty
COLOUR_LIMIT = 6.0
CUT = 10.0  # weight in the minimum cut


def body_size(pose):
    p = pose[:, :2]
    return max(
        1.25 * float(np.linalg.norm(p[[11, 12]].mean(0) - p[[27, 28]].mean(0))),
        2.0 * float(np.linalg.norm(p[[11, 12]].mean(0) - p[[23, 24]].mean(0))),
        8.0,
    )


def limb_end(pose, landmarks):
    """The mean place of some landmarks in sixteenths of a pixel, for OpenCV's lines."""
    return tuple(int(v) for v in np.round(16 * (pose[list(landmarks), :2].mean(0) - 0.5)))


def trunk_corners(pose):
    """Shoulders and hips, for OpenCV's polygons."""
    return np.round(pose[[11, 12, 24, 23], :2] - 0.5).astype(np.int32)


def draw_limbs(shape, pose, size, factor):
    """Where the limbs are, if their radii are multiplied by `factor`."""
    image = np.zeros(shape, np.uint8)
    for a, b, radius, _ in LIMBS:
        thickness = max(1, int(round(2 * factor * radius * size)))
        cv2.line(image, limb_end(pose, a), limb_end(pose, b), 255, thickness, cv2.LINE_AA, 4)
    cv2.fillConvexPoly(image, trunk_corners(pose), 255)
    return image > 0


def dilate(mask, radius):
    k = 2 * max(1, int(round(radius))) + 1
    return cv2.dilate(mask.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (k, k))) > 0


def histogram(pixels):
    counts = np.histogramdd(pixels.reshape(-1, 3).astype(np.float32), bins=(BINS,) * 3, range=((0, 256),) * 3)[0]
    for axis in range(3):  # neighbouring bins count, too
        padded = np.pad(counts, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
        cut = lambda s: padded[tuple(slice(s, s + BINS) if a == axis else slice(None) for a in range(3))]
        counts = 0.25 * cut(0) + 0.5 * cut(1) + 0.25 * cut(2)
    return ((counts + 1e-9) / max(counts.sum(), 1e-9) * (BINS / 256) ** 3).astype(np.float32)


def look_up(table, image):
    i = (image.astype(np.int32) * BINS) >> 8
    return table.ravel()[(i[..., 0] * BINS + i[..., 1]) * BINS + i[..., 2]]


class Background:
    """Median over time of what is surely not the person."""

    def __init__(self, images, covered):
        """Images may be any iterable of RGB; `covered` are the pixels of each that may show the person."""
        stack, person = list(images), list(covered)
        h, w = stack[0].shape[:2]
        self.plate, self.spread = np.zeros((h, w, 3), np.float32), np.zeros((h, w), np.float32)
        free = np.zeros((h, w), int)
        for y in range(0, h, 32):  # in strips, for memory
            part = np.stack([i[y : y + 32] for i in stack]).astype(np.float32)
            visible = ~np.stack([p[y : y + 32] for p in person])
            part[~visible] = np.nan
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # pixels that always show the person
                median = np.nanmedian(part, 0)
                spread = 1.48 * np.nanmedian(np.abs(part - median), 0).max(-1)
            self.plate[y : y + 32] = np.nan_to_num(median)
            self.spread[y : y + 32] = np.nan_to_num(spread, nan=255)
            free[y : y + 32] = visible.sum(0)
        self.known = (free >= max(3, 0.06 * len(stack))) & (self.spread < 18)
        self.elsewhere = histogram(self.plate[self.known]) if self.known.sum() > 100 else None

    def image(self):
        """The plate as an image; what was never seen is filled from its surroundings."""
        unknown = (~self.known).astype(np.uint8)
        return (
            cv2.inpaint(np.rint(self.plate).astype(np.uint8), unknown, 3, cv2.INPAINT_TELEA)
            if unknown.any()
            else np.rint(self.plate).astype(np.uint8)
        )


def camera_moves(images, coarse):
    """Whether the background moves: corners outside of the person are followed from the first image to the others."""
    first = cv2.cvtColor(images[0], cv2.COLOR_RGB2GRAY)
    outside = [(~dilate(m > 0.2, 0.02 * max(m.shape))).astype(np.uint8) for m in coarse]
    corners = cv2.goodFeaturesToTrack(first, 300, 0.01, 8, mask=outside[0])
    if corners is None or len(corners) < 12:
        return False  # a plain background: nothing tells, and nothing depends on it
    moved = []
    for image, free in zip(images[1:], outside[1:]):
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        there, found, _ = cv2.calcOpticalFlowPyrLK(first, grey, corners, None, winSize=(21, 21), maxLevel=4)
        back, found_back, _ = cv2.calcOpticalFlowPyrLK(grey, first, there, None, winSize=(21, 21), maxLevel=4)
        good = (found.ravel() & found_back.ravel()) > 0
        good &= np.linalg.norm(back - corners, axis=2).ravel() < 1
        at = np.clip(there.reshape(-1, 2).astype(int), 0, [grey.shape[1] - 1, grey.shape[0] - 1])
        good &= free[at[:, 1], at[:, 0]] > 0
        step = np.linalg.norm((there - corners).reshape(-1, 2), axis=1)
        moved.append(np.median(step[good]) if good.sum() >= 0.3 * len(corners) else 99.0)
    return float(np.median(moved)) > 0.7 or float(np.quantile(moved, 0.9)) > 2.0


def covered_and_own(image, coarse, pose):
    """Pixels that may show the person, and the colours of those that surely do."""
    size = body_size(pose)
    covered = dilate((coarse > 0.35) | draw_limbs(coarse.shape, pose, size, 0.9), 0.01 * size)
    inside = cv2.erode((coarse > 0.8).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    sure = inside & draw_limbs(coarse.shape, pose, size, 0.5)
    return covered, image[sure | draw_limbs(coarse.shape, pose, size, 0.15)]


def person_mask(image, coarse, pose, colours, background):
    """8-bit mask with a soft edge, by MediaPipe's coarse mask and landmarks. `colours` is the person's histogram;
    `background` is None where the camera moves."""
    size, shape = body_size(pose), coarse.shape
    near = draw_limbs(shape, pose, size, NEAR) | dilate(coarse > 0.5, 4)
    core = draw_limbs(shape, pose, size, CORE) & near
    outline = ((coarse > 0.5) | draw_limbs(shape, pose, size, WIDTH)).astype(np.uint8)
    place = place_term(outline, EDGE * size) + SURE * (2 * coarse - 1)
    part = part_around(near)
    likely = look_up(colours, image[part])
    ratio = PLACE * place[part] + colour_term(image, near, near | (coarse >= 0.05), likely, colours, background, part)
    return smooth_mask(minimum_cut(image[part], ratio, ~near[part], core[part], CUT), core, part)


def part_around(near):
    """The part of an image that holds all pixels that are near, and a few more."""
    ys, xs = np.nonzero(near)
    return np.s_[max(0, ys.min() - 4) : ys.max() + 5, max(0, xs.min() - 4) : xs.max() + 5]


def smooth_mask(cut, core, part):
    """The mask of a whole image, from the cut of a part: pieces without a pixel of the core are not the person."""
    mask = np.zeros(core.shape, np.uint8)
    mask[part] = cut
    count, labels = cv2.connectedComponents(mask)
    if count > 2:
        keep = np.zeros(count, bool)
        keep[np.unique(labels[core & (mask > 0)])] = True
        keep[0] = False
        mask = np.where(keep[labels], 255, 0).astype(np.uint8)
    return cv2.GaussianBlur(cv2.medianBlur(mask, 3), (0, 0), 0.7)


def place_term(outline, edge):
    """From the distance to the border of `outline` (1 inside), in units of `edge` pixels."""
    distance = cv2.distanceTransform(outline, cv2.DIST_L2, 3) - cv2.distanceTransform(1 - outline, cv2.DIST_L2, 3)
    distance = cv2.GaussianBlur(distance, (0, 0), 1) / edge
    return np.clip(distance, -1, 1) + FAR * np.clip(distance / 4, -1, 1)


def colour_term(image, near, maybe, likely, colours, background, part):
    """Of the pixels of a part. `likely`: how often the person has their colours; `maybe`: pixels of the image that may
    show the person; `colours`: the person's histogram, which stands for a background of which nothing is known."""
    elsewhere = background.elsewhere if background else None
    if elsewhere is None:  # the colours around the person in this image
        ring = ~near & dilate(near, 0.1 * max(near.shape))
        elsewhere = histogram(image[ring]) if ring.sum() > 100 else colours
    unlikely = look_up(elsewhere, image[part]) + 1e-9
    if background:
        far = background.known & ~maybe
        gain = np.median(image[far] / np.maximum(background.plate[far], 8), 0) if far.sum() > 500 else 1.0
        plate = background.plate[part] * np.asarray(gain, np.float32)
        spread = np.maximum(background.spread[part], NOISE)
        peak = (2.5066 * spread) ** -3
        pixels, best = image[part].astype(np.float32), np.zeros(likely.shape, np.float32)
        for k, shade in enumerate(SHADOWS):
            error = (((pixels - shade * plate) / spread[..., None]) ** 2).sum(-1)
            best = np.maximum(best, (1.0 if k == 0 else 0.5) * np.exp(-0.5 * np.minimum(error, 80)) * peak)
        unlikely = np.where(background.known[part], 0.97 * best + 0.01 * unlikely, unlikely)
    person = 0.9 * likely + 0.1 / 256**3
    ratio = np.clip(np.log(person / np.maximum(unlikely, 1e-12)), -COLOUR_LIMIT, COLOUR_LIMIT)
    return COLOUR * cv2.GaussianBlur(ratio.astype(np.float32), (0, 0), 0.8)


def minimum_cut(image, ratio, surely_not, surely, weight):
    """grabCut with given likelihoods: its first channel is the logarithm of their ratio, of which the models of person
    and background are two Gaussians of equal width; the other channels are brightness and colour, which only its edges
    see, because there the Gaussians are wide. `weight` is that of the numbers against edges, which count up to 50."""
    step = 6.0
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB).astype(np.float32)
    channels = np.dstack([128 + step * ratio, lab[..., 0], lab[..., 1] + lab[..., 2] - 128])
    spread = 128 * step / weight
    model = lambda mean: np.concatenate(
        [[1, 0, 0, 0, 0], np.tile([mean, 128, 128], 5), np.tile(np.diag([spread, 1e7, 1e7]).ravel(), 5)]
    )[None].astype(np.float64)
    labels = np.where(ratio > 0, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[surely_not] = cv2.GC_BGD
    labels[surely] = cv2.GC_FGD
    cv2.grabCut(
        np.clip(channels, 0, 255).astype(np.uint8),
        labels,
        None,
        model(64.0),
        model(192.0),
        1,
        cv2.GC_EVAL_FREEZE_MODEL,
    )
    return np.where(labels & 1, 255, 0).astype(np.uint8)
