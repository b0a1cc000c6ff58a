# SPDX-License-Identifier: Apache-2.0
"""Tests of scripts/detector that need OpenCV: masks that are cut by fitted bodies. scripts/test --full runs them with
the detector's own Python."""

import sys
import unittest
from pathlib import Path

import cv2
import numpy as np

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "detector"))
import bodies  # noqa: E402
import masks  # noqa: E402

HEIGHT, WIDTH = 240, 200
SKIN, JACKET, TROUSERS, WALL = (205, 150, 125), (150, 40, 45), (40, 60, 140), (170, 175, 165)


def standing(x):
    """MediaPipe's landmarks of a person who stands at x, with arms a little off the body."""
    pose = np.tile([x, 30.0, 0.9], (33, 1))
    for k, (dx, y) in {
        7: (6, 32), 8: (-6, 32), 11: (18, 60), 12: (-18, 60), 13: (30, 90), 14: (-30, 90), 15: (38, 118),
        16: (-38, 118), 17: (40, 126), 18: (-40, 126), 19: (41, 128), 20: (-41, 128), 23: (11, 120), 24: (-11, 120),
        25: (13, 165), 26: (-13, 165), 27: (14, 210), 28: (-14, 210), 29: (14, 214), 30: (-14, 214), 31: (18, 218),
        32: (-18, 218),
    }.items():  # fmt: skip
        pose[k, :2] = x + dx, y
    return pose


def person(pose):
    """The true mask, and the image of the fitted body."""
    size = masks.body_size(pose)
    truth = masks.draw_limbs((HEIGHT, WIDTH), pose, size, 1.1)
    body = np.zeros(truth.shape, np.uint8)
    body[masks.dilate(truth, 7)] = bodies.ALLOWED
    body[np.roll(truth, 1, 1)] = bodies.USUAL  # the fit errs by a pixel
    body[cv2.erode(truth.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0] = bodies.CORE
    return truth, body


class MasksByBody(unittest.TestCase):
    def setUp(self):
        """Twelve frames of a person who steps from side to side, before a wall with a box of the trousers' colour."""
        rng = np.random.default_rng(3)
        wall = np.full((HEIGHT, WIDTH, 3), WALL, float)
        wall[50:130, 112:150] = TROUSERS
        self.poses = [standing(88 + 2 * k) for k in range(12)]
        self.truth, self.bodies = map(list, zip(*map(person, self.poses)))
        self.parts = [bodies.part_map((HEIGHT, WIDTH), pose) for pose in self.poses]
        colours = {masks.HEAD: SKIN, masks.LOWER_ARM: SKIN, masks.HAND: SKIN, masks.TRUNK: JACKET}
        colours |= {masks.UPPER_ARM: JACKET, masks.THIGH: TROUSERS, masks.SHIN: TROUSERS, masks.FOOT: SKIN}
        self.images = []
        for truth, parts in zip(self.truth, self.parts):
            image = wall.copy()
            for part, colour in colours.items():
                image[truth & (parts == part)] = colour
            self.images.append(np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8))

    def colours(self, first):
        """`first` are the masks before."""
        frames = zip(self.images, self.bodies, first, self.parts)
        return bodies.Colours([bodies.own_colours(*frame) for frame in frames])

    def cut(self, first, colours, background, alone):
        frames = zip(self.images, self.bodies, first, self.poses)
        return [bodies.mask_by_body(*frame, colours, background, alone) for frame in frames]

    def overlap(self, masks_of):
        both = [((m > 127) & t, (m > 127) | t) for m, t in zip(masks_of, self.truth)]
        return min(a.sum() / b.sum() for a, b in both)

    def test_parts_lie_where_limbs_are(self):
        pose, parts = self.poses[0], self.parts[0]
        at = lambda k: parts[int(pose[k, 1]), int(pose[k, 0])]
        self.assertEqual([at(0), at(31), at(19)], [masks.HEAD, masks.FOOT, masks.HAND])
        self.assertEqual([parts[90, 88], parts[140, 100], parts[190, 102]], [masks.TRUNK, masks.THIGH, masks.SHIN])
        self.assertEqual(parts[80, 62], masks.UPPER_ARM)
        self.assertEqual(parts.shape, (HEIGHT, WIDTH))

    def test_a_thing_of_the_trousers_colour_beside_the_jacket_is_left_out(self):
        first = [np.where(t, 255, 0).astype(np.uint8) for t in self.truth]
        for mask in first:  # which the first masks take in
            mask[60:120, 112:140] = 255
        colours = self.colours(first)
        covered = [masks.dilate((b > 0) | (m > 127), 1) for b, m in zip(self.bodies, first)]
        background = masks.Background(self.images, covered)
        self.assertLess(self.overlap(first), 0.93)
        for known in (background, None):  # a camera that stands still, and one that moves
            for alone, least in (True, 0.95), (False, 0.98):
                self.assertGreater(self.overlap(self.cut(first, colours, known, alone)), least)

    def test_a_lost_limb_comes_back_and_a_thing_in_front_stays_out(self):
        first = [np.where(t, 255, 0).astype(np.uint8) for t in self.truth]
        for mask in first:
            mask[160:195] = 0
        lost = self.cut(first, self.colours(first), None, False)
        self.assertGreater(self.overlap(lost), 0.97)
        for image, truth in zip(self.images, self.truth):  # a green bench before the shins, which is wider than they
            image[160:195, 40:160] = (60, 140, 70)
            truth[160:195] = False
        hidden = self.cut(first, self.colours(first), None, False)
        self.assertGreater(self.overlap(hidden), 0.95)

    def test_nothing_is_cut_from_the_core_or_added_beyond_what_is_allowed(self):
        first = [np.where(t, 255, 0).astype(np.uint8) for t in self.truth]
        mask = self.cut(first, self.colours(first), None, False)[3]
        inside = cv2.erode((self.bodies[3] == bodies.CORE).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        self.assertTrue((mask[inside] > 127).all())
        self.assertFalse((mask[~masks.dilate(self.bodies[3] > 0, 2)] > 0).any())


if __name__ == "__main__":
    unittest.main()
