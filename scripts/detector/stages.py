# SPDX-License-Identifier: Apache-2.0
"""What runs in parallel processes: each function does one camera, or some frames of it, and leaves files."""

import pickle
from itertools import islice

import cv2
import numpy as np

import bodies
import masks
import people
from failure import Failure
from folder import write_whole
from workers import frame_done


def write_image(path, image):
    ok, data = cv2.imencode(
        ".png",
        image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_PNG_COMPRESSION, 3],
    )
    if not ok:
        raise Failure(f"{path}: cannot be encoded")
    write_whole(path, data.tobytes())


def read_image(path):
    return cv2.cvtColor(cv2.imread(str(path), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def read_grey(path):
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def save(path, value):
    write_whole(path, pickle.dumps(value))


def load(path):
    return pickle.loads(path.read_bytes())


def extract(folder, source, wanted, size, lens):
    """Writes frames, without distortion, in their final size. `lens`: (K, coefficients, fisheye) or None."""
    first = next((i for i in range(len(wanted)) if not folder.image(source.name, i).exists()), len(wanted))
    frame_done(first)
    if first == len(wanted):
        return
    maps = None
    if lens:
        K, coefficients, fisheye = lens
        K = K.copy()
        K[:2, 2] -= 0.5  # OpenCV's pixels begin at the first one's centre
        straighten = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
        coefficients = coefficients[:4].reshape(4, 1) if fisheye else coefficients
        maps = straighten(K, coefficients, np.eye(3), K, source.size, cv2.CV_32FC1)
    for i, image in enumerate(source.frames(wanted[first:]), first):
        if maps is not None:
            image = cv2.remap(image, *maps, cv2.INTER_CUBIC)
        if (image.shape[1], image.shape[0]) != size:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        write_image(folder.image(source.name, i), image)
        frame_done()


def place_of(folder, camera, count):
    path = folder.look(camera, "place")
    if not path.exists():
        step = max(1, count // 40)
        place = people.find_person(read_image(folder.image(camera, i)) for i in range(0, count, step))
        if place is None and step > 1:
            place = people.find_person(read_image(folder.image(camera, i)) for i in range(count))
        save(path, place)
    frame_done(count)


def look(folder, camera, count, direction):
    place = load(folder.look(camera, "place"))
    order = range(count) if direction == "forward" else range(count - 1, -1, -1)
    images = (read_image(folder.image(camera, i)) for i in order)
    found = []
    for seen in (people.look_forward if direction == "forward" else people.look_backward)(images, place):
        found.append(seen)
        frame_done()
    save(folder.look(camera, direction), found if direction == "forward" else found[::-1])


def join(folder, camera, frames):
    """Joins both looks at some frames, and looks for the hands."""
    place = load(folder.look(camera, "place"))
    forward, backward = (load(folder.look(camera, d)) for d in ("forward", "backward"))
    hands = people.HandDetector()
    for i in frames:
        person, mask = people.join_looks(forward[i], backward[i])
        if person:
            hands(read_image(folder.image(camera, i)), person)
        save(folder.person(camera, i), (person, mask, place))
        frame_done()


def coarse_mask(folder, camera, i, shape):
    """MediaPipe's mask in [0, 1], and the landmarks; (None, None) without a person."""
    person, mask, place = load(folder.person(camera, i))
    if not person:
        return None, None
    (centre, side), pose = place, np.array(person["mediapipe_pose"])
    return people.paste(mask, np.floor(np.asarray(centre) - side / 2), max(2, int(np.ceil(side))), shape), pose


def make_plate(folder, camera, count):
    """The background of a camera: what masks need of it, and its picture if the camera stands still."""
    seen = [i for i in range(count) if load(folder.person(camera, i))[0]]
    seen = seen[:: max(1, len(seen) // 60)]
    images = [read_image(folder.image(camera, i)) for i in seen]
    coarse, poses = zip(*(coarse_mask(folder, camera, i, image.shape[:2]) for i, image in zip(seen, images)))
    still = len(seen) >= 3 and not masks.camera_moves(
        *(list(islice(v, 0, None, max(1, len(seen) // 12))) for v in (images, coarse))
    )
    pieces = [masks.covered_and_own(*of) for of in zip(images, coarse, poses)]
    background = masks.Background(images, [covered for covered, _ in pieces])
    colours = masks.histogram(np.concatenate([own for _, own in pieces]))
    if still:
        write_image(folder.plate(camera), background.image())
    save(folder.look(camera, "background"), (colours, background if still else None))
    frame_done(count)


def make_masks(folder, camera, frames):
    known = None
    for i in frames:
        if not folder.mask(camera, i).exists():
            image = read_image(folder.image(camera, i))
            coarse, pose = coarse_mask(folder, camera, i, image.shape[:2])
            if coarse is None:
                mask = np.zeros(image.shape[:2], np.uint8)
            else:
                known = known or load(folder.look(camera, "background"))
                mask = masks.person_mask(image, coarse, pose, *known)
            write_image(folder.mask(camera, i), mask)
        frame_done()


def body_pose(folder, camera, i, poses):
    """The image of the fitted body, and the landmarks; None where there is no body, or no landmarks."""
    path, pose = folder.body(camera, i), poses.get(i)
    if pose is None or not path.exists():
        return None
    body = read_grey(path)
    return (body, pose) if (body == bodies.CORE).any() else None


def learn_bodies(folder, camera, count, poses):
    """What masks by bodies need of a camera: the person's colours, and the background if the camera stands still."""
    seen = [(i, found) for i in range(count) if (found := body_pose(folder, camera, i, poses))]
    samples, images, covered = [], [], []
    step = max(1, len(seen) // 60)
    for k, (i, (body, pose)) in enumerate(seen):
        image, mask = read_image(folder.image(camera, i)), read_grey(folder.first_mask(camera, i))
        samples.append(bodies.own_colours(image, body, mask, bodies.part_map(body.shape, pose)))
        if k % step == 0:
            images.append(image)
            covered.append(masks.dilate((body > 0) | (mask > 127), 1))
        frame_done()
    frame_done(count - len(seen))
    if not seen:
        return
    known = bodies.Colours(samples), masks.Background(images, covered) if folder.plate(camera).exists() else None
    save(folder.look(camera, "bodies"), known)


def make_masks_by_bodies(folder, camera, frames, poses, alone):
    """`alone`: there is no other camera."""
    known = None
    for i in frames:
        found, path = body_pose(folder, camera, i, poses), folder.new_mask(camera, i)
        if found:
            known = known or load(folder.look(camera, "bodies"))
            body, pose = found
            image, first = read_image(folder.image(camera, i)), read_grey(folder.first_mask(camera, i))
            write_image(path, bodies.mask_by_body(image, body, first, pose, *known, alone))
        elif folder.first_mask(camera, i).exists():
            write_whole(path, folder.first_mask(camera, i).read_bytes())
        frame_done()
