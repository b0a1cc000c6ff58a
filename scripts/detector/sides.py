# SPDX-License-Identifier: Apache-2.0
"""Exchanges left and right where MediaPipe confused them for some frames of a camera. Needs only NumPy.

A person seen from behind, or whose face is hidden, is sometimes taken for one seen from the front. Then all limbs jump
to the other side, and jump back later. Of all ways to exchange sides in single frames, the one is taken in which limbs
move least, where each exchange counts as a movement, too, so that MediaPipe is believed unless it is improbable.
"""

import numpy as np

OTHER_SIDE = np.array([0, 4, 5, 6, 1, 2, 3, 8, 7, 10, 9] + [i + 1 if i % 2 else i - 1 for i in range(11, 33)])
# Sides are confused for all limbs or for arms or legs alone: what goes together, and what shows it.
GROUPS = {"arms": (range(0, 23), (11, 12, 13, 14, 15, 16)), "legs": (range(23, 33), (23, 24, 25, 26, 27, 28))}
EXCHANGE = 0.01  # what an exchanged frame counts at least, in sizes of the person
MOVING = 0.6  # and in usual movements from frame to frame: where limbs move far, jumps tell little
OUTSIDE = 0.05  # and the first and the last frame more, since only one jump tells of them
FARTHEST = 0.15  # limbs that move farther than this in one step count as this


def exchange_sides(people):
    """`people`: the annotations of one camera by frame, None without a person. Exchanges in place, returns the frames.

    The field `sides_doubtful` names groups in which an image and its mirror image disagreed; there, exchanging is free.
    """
    frames = [i for i, p in enumerate(people) if p]
    poses = [np.array(people[i]["mediapipe_pose"])[:, :2] for i in frames]
    exchanged = set()
    for group, (landmarks, limbs) in GROUPS.items():
        for k in improbable(poses, limbs, [group in people[i].get("sides_doubtful", ()) for i in frames]):
            exchange(people[frames[k]], group, landmarks)
            exchanged.add(frames[k])
    return sorted(exchanged)


def improbable(poses, limbs, doubtful):
    """Positions in `poses` whose limbs move less if their sides are exchanged, by dynamic programming."""
    if len(poses) < 2:
        return []
    size = np.median([np.ptp(p, axis=0).max() for p in poses])
    ways = [np.stack([p[list(limbs)], p[OTHER_SIDE[list(limbs)]]]) / size for p in poses]  # as found, exchanged
    # moves[k][a, b]: from way a of frame k to way b of the next
    apart = [np.linalg.norm(a[:, None] - b[None], axis=-1) for a, b in zip(ways, ways[1:])]
    moves = [np.minimum(a, FARTHEST).mean(-1) for a in apart]
    price = max(EXCHANGE, MOVING * float(np.median([m.min() for m in moves])))
    cost, came_from = np.zeros((len(poses), 2)), np.zeros((len(poses), 2), int)
    for k in range(len(poses)):
        if k:
            total = cost[k - 1][:, None] + moves[k - 1]
            came_from[k], cost[k] = total.argmin(0), total.min(0)
        cost[k, 1] += 0 if doubtful[k] else price
        if k in (0, len(poses) - 1):
            cost[k, 1] += OUTSIDE
    way, found = int(cost[-1].argmin()), []
    for k in range(len(poses) - 1, -1, -1):
        if way:
            found.append(k)
        way = came_from[k][way]
    return found


def exchange(person, group, landmarks):
    for key in ("mediapipe_pose", "mediapipe_world"):
        old = person[key]
        person[key] = [old[OTHER_SIDE[j]] if j in landmarks else old[j] for j in range(33)]
    if group == "arms":
        left, right = (person.pop(f"mediapipe_{s}_hand", None) for s in ("left", "right"))
        for side, hand in (("left", right), ("right", left)):
            if hand:  # found as the other hand, so its fingers are doubtful
                person[f"mediapipe_{side}_hand"] = [[x, y, round(0.5 * c, 4)] for x, y, c in hand]
