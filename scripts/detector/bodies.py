# SPDX-License-Identifier: Apache-2.0
"""Masks that are cut anew by fitted bodies: gsh-fit writes where each body is, and how far clothes and hair usually
stand off it. This is nearer to the outline than MediaPipe's mask, in all cameras alike, and says which part of the body
is where: trousers then cannot take a chair of the jacket's colour.

A pixel of bodies/CAMERA/*.png is CORE where the body surely is, USUAL where masks usually show the person, ALLOWED
where a mask may, and 0 elsewhere.
"""

import cv2
import numpy as np

import masks
from masks import LIMBS, PARTS

ALLOWED, USUAL, CORE = 85, 170, 255
EDGE = 0.01  # the body's outline is believed this many sizes of the body farther in or out
WHOLE = 0.1  # share of the whole person's colours in those of a part: clothes do not end at joints
CUT = 5.0  # weight in the minimum cut: outlines of bodies need fewer corrections, and are smoother
DOUBT = 0.5  # share of the place's weight where the body is and the first mask has nobody
SCALE = 4  # parts need no fine borders


def part_map(shape, pose):
    """Which part of the body is nearest, for each pixel."""
    h, w = shape[0] // SCALE + 1, shape[1] // SCALE + 1
    size, pose = masks.body_size(pose) / SCALE, pose[:, :2] / SCALE
    nearest, part = np.full((h, w), 1e9, np.float32), np.zeros((h, w), np.uint8)

    def draw(of, radius, paint):
        image = np.ones((h, w), np.uint8)
        paint(image)
        distance = cv2.distanceTransform(image, cv2.DIST_L2, 3) - radius * size
        closer = distance < nearest
        nearest[closer], part[closer] = distance[closer], of

    draw(masks.TRUNK, 0.0, lambda image: cv2.fillConvexPoly(image, masks.trunk_corners(pose), 0))
    for a, b, radius, of in LIMBS:
        ends = masks.limb_end(pose, a), masks.limb_end(pose, b)
        draw(of, radius, lambda image: cv2.line(image, *ends, 0, 1, cv2.LINE_8, 4))
    return cv2.resize(part, (w * SCALE, h * SCALE), interpolation=cv2.INTER_NEAREST)[: shape[0], : shape[1]]


class Colours:
    """Histograms of the person, and of each part of the body."""

    def __init__(self, samples):
        """`samples`: of each frame, the colours of each part."""
        by_part = [np.concatenate(of) for of in zip(*samples)]
        self.whole = masks.histogram(np.concatenate(by_part))
        self.parts = [masks.histogram(of) if len(of) > 200 else self.whole for of in by_part]

    def likely(self, image, parts):
        of_part = np.zeros(parts.shape, np.float32)
        for part in PARTS:
            here = parts == part
            if here.any():
                of_part[here] = masks.look_up(self.parts[part], image)[here]
        return (1 - WHOLE) * of_part + WHOLE * masks.look_up(self.whole, image)


def own_colours(image, body, mask, parts):
    """Of each part of the body, where the first mask shows the person, too."""
    sure = (body == CORE) & (mask > 127)
    return [image[sure & (parts == part)] for part in PARTS]


def mask_by_body(image, body, first, pose, colours, background, alone):
    """8-bit mask with a soft edge. `first` is the mask before; `background` is None where the camera moves.

    Where the body is, but the first mask has nobody, the mask may have lost a limb, or something may stand in front:
    the colour decides. A camera that is `alone` sees no depth, so its body may lie beside the person; there the outline
    is that of body and first mask together.
    """
    near, core, shown = body >= ALLOWED, body == CORE, first > 127
    part = masks.part_around(near)
    outline = (body >= USUAL) | (shown & near) if alone else body >= USUAL
    place = masks.place_term(outline.astype(np.uint8), EDGE * masks.body_size(pose))
    place[core & ~shown] *= DOUBT
    likely = colours.likely(image[part], part_map(body.shape, pose)[part])
    ratio = masks.PLACE * place[part] + masks.colour_term(image, near, near, likely, colours.whole, background, part)
    sure = core & shown
    return masks.smooth_mask(masks.minimum_cut(image[part], ratio, ~near[part], sure[part], CUT), sure, part)
