# SPDX-License-Identifier: Apache-2.0
"""MediaPipe's landmarks and coarse masks of one person in the frames of one camera.

Each frame is looked at twice: forward in time, and backward in time in a mirror image. MediaPipe then searches a person
where the frame before had one, which fails less than a search in every frame: in front of furniture it takes a person
in profile for a smaller one (measured: docs/detection.md). Where both agree, their mean is taken; where they differ,
MediaPipe guesses, and the landmark gets a lower visibility. Hands are searched once more in an enlarged square.

MediaPipe's normalised x times the width is a coordinate from the image's corner, as in gsh.
"""

import cv2
import numpy as np

from sides import GROUPS, OTHER_SIDE

ARMS = {"left": (13, 15, 19, 17), "right": (14, 16, 20, 18)}  # elbow, wrist, knuckles of index and little finger
PERSON_PIXELS, HAND_PIXELS, MASK_PIXELS = (
    768,
    384,
    256,
)  # sides of squares; 256 is the resolution of MediaPipe's masks
# A landmark that differs by this share of the person's size between both looks has half the visibility. (A_multi: up to
# 1% it is 0.5% from its place as other cameras see it, from 2 to 4% on 2%, then 6 to 8%.) For fingers: of the hand.
PERSON_SPREAD, HAND_SPREAD = 0.02, 0.10
APART = 0.10  # looks whose limbs differ by more than this share of the person's size saw different things


class Square:
    """A square part of an image, scaled to `pixels`, possibly mirrored. Outside of the image it is grey."""

    def __init__(self, image, centre, side, pixels, mirrored=False):
        self.side, self.mirrored = max(2, int(np.ceil(side))), mirrored
        self.corner = np.floor(np.asarray(centre, float) - side / 2)
        x, y = self.corner.astype(int)
        h, w = image.shape[:2]
        x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + self.side, w), min(y + self.side, h)
        part = np.full((self.side, self.side, 3), 128, np.uint8)
        if x1 > x0 and y1 > y0:
            part[y0 - y : y1 - y, x0 - x : x1 - x] = image[y0:y1, x0:x1]
        part = cv2.resize(
            part, (pixels, pixels), interpolation=cv2.INTER_CUBIC if pixels > self.side else cv2.INTER_AREA
        )
        self.image = np.ascontiguousarray(part[:, ::-1]) if mirrored else part

    def points(self, landmarks):
        """In pixels of the whole image."""
        q = np.array([[p.x, p.y] for p in landmarks.landmark])
        if self.mirrored:
            q[:, 0] = 1 - q[:, 0]
        return q * self.side + self.corner

    def pose(self, seen):
        """x, y, visibility and metres of the 33 landmarks [33, 6], and the mask; sides are the person's."""
        sign = -1 if self.mirrored else 1
        rows = np.array(
            [
                [p.visibility, sign * m.x, m.y, m.z]
                for p, m in zip(seen.pose_landmarks.landmark, seen.pose_world_landmarks.landmark)
            ]
        )
        rows = np.hstack([self.points(seen.pose_landmarks), rows])
        mask = cv2.resize(
            seen.segmentation_mask[:, ::sign], (MASK_PIXELS, MASK_PIXELS), interpolation=cv2.INTER_AREA
        )
        return rows[OTHER_SIDE] if self.mirrored else rows, np.rint(255 * np.clip(mask, 0, 1)).astype(np.uint8)


def paste(mask, corner, side, shape):
    """A mask of a square in the place of the square, in an image of `shape`; zero outside."""
    (x, y), (h, w) = np.asarray(corner).astype(int), shape
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + side, w), min(y + side, h)
    whole = np.zeros(shape, np.float32)
    whole[y0:y1, x0:x1] = cv2.resize(mask.astype(np.float32) / 255, (side, side))[y0 - y : y1 - y, x0 - x : x1 - x]
    return whole


def model(name, moving, **options):
    from mediapipe.python import solutions

    return getattr(getattr(solutions, name), {"pose": "Pose", "holistic": "Holistic", "hands": "Hands"}[name])(
        static_image_mode=not moving, model_complexity=1, **options
    )


def find_person(images):
    """Centre and side of a square that holds the person in all frames; None if there is nobody."""
    pose, found = model("pose", False, min_detection_confidence=0.4), []
    for image in images:
        h, w = image.shape[:2]
        landmarks = pose.process(image).pose_landmarks
        if landmarks:
            q = np.array([[p.x * w, p.y * h, p.visibility] for p in landmarks.landmark])
            found.append((q[:, 2].mean(), q[:, :2].min(0), q[:, :2].max(0)))
    if not found:
        return None
    # Boxes of guesses are too small or elsewhere; guesses have low visibilities.
    enough = min(0.5, np.quantile([f[0] for f in found], 0.7))
    low = np.min([f[1] for f in found if f[0] >= enough], 0)
    high = np.max([f[2] for f in found if f[0] >= enough], 0)
    return (low + high) / 2, 1.25 * float((high - low).max())


def look_forward(images, place):
    """Per frame a dict of pose, mask, and what was found of face, left_hand and right_hand; None if there is nobody."""
    holistic = model(
        "holistic",
        True,
        smooth_landmarks=False,
        enable_segmentation=True,
        smooth_segmentation=False,
        refine_face_landmarks=True,
        min_detection_confidence=0.4,
    )
    for image in images:
        square = Square(image, *place, PERSON_PIXELS)
        seen = holistic.process(square.image)
        if not seen.pose_landmarks:
            yield None
            continue
        found = dict(zip(("pose", "mask"), square.pose(seen)))
        for key in ("face", "left_hand", "right_hand"):
            landmarks = getattr(seen, f"{key}_landmarks")
            if landmarks:
                found[key] = square.points(landmarks)
        yield found


def look_backward(images, place):
    """The same, of pose and mask, for mirrored images; the caller gives them from last to first."""
    pose = model(
        "pose",
        True,
        smooth_landmarks=False,
        enable_segmentation=True,
        smooth_segmentation=False,
        min_detection_confidence=0.4,
    )
    for image in images:
        square = Square(image, *place, PERSON_PIXELS, mirrored=True)
        seen = pose.process(square.image)
        yield dict(zip(("pose", "mask"), square.pose(seen))) if seen.pose_landmarks else None


def join_looks(forward, backward):
    """One annotation of both looks at a frame, and the coarse mask of the square; (None, None) if there is nobody.

    The field `sides_doubtful` is for sides.py: groups of limbs whose sides differ between the looks.
    """
    looks = [look for look in (forward, backward) if look]
    if not looks:
        return None, None
    if len(looks) == 1:
        rows, doubtful, mask = looks[0]["pose"].copy(), [], looks[0]["mask"]
        rows[:, 2] *= 0.5
    else:
        rows, doubtful, mask = mean_look(*looks)
    person = {
        "mediapipe_pose": triples(rows[:, :2], rows[:, 2]),
        "mediapipe_world": [[round(float(v), 5) for v in row[3:]] for row in rows],
    }
    if doubtful:
        person["sides_doubtful"] = doubtful
    for key in ("face", "left_hand", "right_hand"):
        if forward and key in forward and (mask is not backward["mask"] if backward else True):
            person[f"mediapipe_{key}"] = triples(forward[key], 1.0)
    return person, mask


def mean_look(first, second):
    a, b = first["pose"], second["pose"]
    size = max(np.ptp(p[:, :2], axis=0).max() for p in (a, b))
    same = np.linalg.norm(a[:, :2] - b[:, :2], axis=1)
    exchanged = np.linalg.norm(a[:, :2] - b[OTHER_SIDE][:, :2], axis=1)
    if np.minimum(same, exchanged).mean() > APART * size:  # one of the looks is wrong
        better = first if a[:, 2].mean() >= b[:, 2].mean() else second
        rows = better["pose"].copy()
        rows[:, 2] *= 0.5
        return rows, [], better["mask"]
    rows, doubtful = a.copy(), []
    for group, (landmarks, limbs) in GROUPS.items():
        j = list(landmarks)
        if exchanged[list(limbs)].mean() < same[list(limbs)].mean():
            doubtful.append(group)
            rows[j, 2] *= 0.5
            continue
        rows[j] = (a[j] + b[j]) / 2
        rows[j, 2] /= 1 + (same[j] / size / PERSON_SPREAD) ** 2
    return rows, doubtful, ((first["mask"].astype(int) + second["mask"]) // 2).astype(np.uint8)


class HandDetector:
    """Improves the hands of an annotation, by a look at an enlarged square around each."""

    def __init__(self):
        self.hands = model("hands", False, max_num_hands=2, min_detection_confidence=0.3)

    def __call__(self, image, person):
        pose = np.array(person["mediapipe_pose"])[:, :2]
        for side, arm in ARMS.items():
            first = person.pop(f"mediapipe_{side}_hand", None)
            hand = self.hand(
                image,
                pose[list(arm)],
                0.16 * np.ptp(pose, axis=0).max(),
                side,
                np.array(first)[:, :2] if first else None,
            )
            if hand:
                person[f"mediapipe_{side}_hand"] = triples(*hand)

    def hand(self, image, arm, least_size, side, first):
        """Points and confidence. MediaPipe guesses the side of a hand: where it errs, so do often the fingers."""
        elbow, wrist, index, little = arm
        size = max(np.linalg.norm(wrist - elbow), least_size)
        square = Square(image, wrist + 0.8 * ((index + little) / 2 - wrist), 2.5 * size, HAND_PIXELS)
        result = self.hands.process(square.image)
        second, confidence, nearest = None, 0.0, 0.5 * size  # farther from the wrist, it is the other hand
        for landmarks, kind in zip(result.multi_hand_landmarks or [], result.multi_handedness or []):
            points, kind = square.points(landmarks), kind.classification[0]
            distance = np.linalg.norm(points[0] - wrist)
            if distance < nearest:
                of_side = (kind.label == "Right") == (
                    side == "left"
                )  # MediaPipe names the sides of mirrored images
                second, confidence, nearest = points, kind.score if of_side else 1 - kind.score, distance
        if first is None or second is None:
            only = first if second is None else second
            return None if only is None else (only, 0.3 if second is None else 0.5 * confidence)
        distance = np.median(np.linalg.norm(first - second, axis=1)) / max(1.0, np.ptp(second, axis=0).max())
        confidence /= 1 + (distance / HAND_SPREAD) ** 2
        return ((first + second) / 2 if distance < HAND_SPREAD else second), confidence


def triples(points, third):
    third = np.broadcast_to(np.asarray(third, float), len(points))
    return [[round(float(x), 3), round(float(y), 3), round(float(c), 4)] for (x, y), c in zip(points, third)]
