# SPDX-License-Identifier: Apache-2.0
"""Tests of scripts/detector that need only NumPy: which frames are kept, calibrations, sides, files."""

import copy
import json
import sys
import tempfile
import unittest
from pathlib import Path

try:
    import numpy as np
except ImportError:
    print("SKIPPED: python3 has no numpy")
    sys.exit(77)

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "detector"))
import calibration  # noqa: E402
import folder  # noqa: E402
import sides  # noqa: E402
import times  # noqa: E402
from failure import Failure  # noqa: E402


class Times(unittest.TestCase):
    def test_constant_rate_takes_every_nth_frame(self):
        stamps = np.round(np.arange(300) / 59.94, 3)  # milliseconds, as many containers store them
        choice = times.choose(["a"], [stamps], fps=10)
        self.assertEqual(choice.frames, [list(range(0, 300, 6))])
        self.assertAlmostEqual(choice.fps, 9.99, places=2)
        self.assertEqual(times.choose(["a"], [np.arange(50) / 25], fps=10).frames, [list(range(0, 50, 3))])

    def test_at_most_so_many_frames(self):
        for count in (150, 151, 299, 301, 1000):
            kept = times.choose(["a"], [np.arange(count) / 10], fps=10, most=150).frames[0]
            self.assertLessEqual(len(kept), 150)
            self.assertGreater(len(kept), 74)

    def test_begin_and_end(self):
        kept = times.choose(["a"], [np.arange(100) / 10], begin=2.0, end=4.0).frames[0]
        self.assertEqual(kept, list(range(20, 41)))
        with self.assertRaisesRegex(Failure, "nothing is left"):
            times.choose(["a"], [np.arange(100) / 10], begin=12)

    def test_variable_rate_follows_the_time_stamps(self):
        stamps = np.concatenate([np.arange(20) * 0.1, 2 + np.arange(40) / 30])
        choice = times.choose(["a"], [stamps], fps=10)
        self.assertLess(
            np.abs(stamps[choice.frames[0]] - np.arange(len(choice.frames[0])) / choice.fps).max(), 0.5 / 10
        )
        self.assertEqual(len(set(choice.frames[0])), len(choice.frames[0]))

    def test_cameras_of_other_rates_and_lengths_share_their_times(self):
        a, b = np.arange(301) / 30, np.arange(401) / 50
        choice = times.choose(["a", "b"], [a, b], fps=10)
        self.assertEqual(len(choice.frames[0]), 81)
        self.assertLess(np.abs(a[choice.frames[0]] - b[choice.frames[1]]).max(), 0.5 / 30 + 0.5 / 50)
        self.assertRegex(choice.notes[0], "different lengths .a 10.00 s, b 8.00 s.; only the first 8.00 s")

    def test_a_late_camera_gives_earlier_frames(self):
        stamps = np.arange(90) / 30
        kept = times.choose(["a", "b"], [stamps, stamps], fps=10, late=[0.0, 0.067]).frames
        self.assertEqual(len(kept[0]), len(kept[1]))
        for a, b in zip(*kept):
            self.assertLess(abs(stamps[a] - (stamps[b] + 0.067)), 0.018)  # half a frame
        self.assertEqual({a - b for a, b in zip(*kept)}, {2})
        same = times.choose(["a", "b"], [stamps, stamps], fps=10, late=[0.0, 0.0]).frames
        self.assertEqual(same, times.choose(["a", "b"], [stamps, stamps], fps=10).frames)

    def test_a_gap_of_one_camera_is_left_out_for_all(self):
        a, b = np.arange(100) / 30, np.delete(np.arange(100) / 30, np.arange(30, 60))
        choice = times.choose(["a", "b"], [a, b], fps=10)
        self.assertLess(np.abs(a[choice.frames[0]] - b[choice.frames[1]]).max(), 0.05)
        self.assertRegex(" ".join(choice.notes), "left out, because a camera has a gap")

    def test_one_frame(self):
        self.assertEqual(times.choose(["a"], [np.array([0.0])]).frames, [[0]])
        with self.assertRaisesRegex(Failure, "no frames"):
            times.choose(["a"], [np.array([])])


R = calibration.rodrigues(np.array([1.1, -0.3, 0.2]))
T = np.array([0.1, -0.2, 3.0])
K = np.array([[800.0, 0, 320], [0, 810, 240], [0, 0, 1]])
UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # a world whose z is up -> y is up


def look_at(centre, up=2):
    """R and t of a camera at `centre` that looks at the origin of a world whose axis `up` is up."""
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, np.eye(3)[up])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    return R, -R @ centre


class Calibrations(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def file(self, name, text):
        path = Path(self.folder.name) / name
        path.write_text(text)
        return path

    def check(self, camera, R, t, K=K):
        """A point of the file's world, z up, and of gsh's world are the same pixel, half a pixel from OpenCV's."""
        for point in np.array([[0.3, 0.2, 0.1], [-0.4, 0.1, 1.2], [0, 0, 0.5]]):
            seen = K @ (R @ point + t)
            ours = camera.K @ (camera.R @ (UP @ point) + camera.t)
            np.testing.assert_allclose(ours[:2] / ours[2], seen[:2] / seen[2] + 0.5, atol=1e-9)
        self.assertAlmostEqual(np.linalg.det(camera.R), 1)

    def test_toml(self):
        R, t = look_at(np.array([3.0, -2.0, 1.5]))
        angle = np.arccos((np.trace(R) - 1) / 2)
        vector = angle / (2 * np.sin(angle)) * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        np.testing.assert_allclose(calibration.rodrigues(vector), R, atol=1e-9)
        for t_file, note in ((t, "z is up"), (1000 * t, "millimetres")):
            far = np.linalg.norm(t_file)  # of a second camera
            path = self.file(
                "Calib.toml",
                f"""
[cam_01]
name = "front"
size = [640.0, 480.0]
matrix = {K.tolist()}
distortions = [-0.1, 0.02, 0.001, 0.0]
rotation = {vector.tolist()}
translation = {t_file.tolist()}
fisheye = false
[cam_02]
name = "back"
size = [640.0, 480.0]
matrix = {K.tolist()}
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = {[1.5707963, 0.0, 0.0]}
translation = [0.0, 0.0, {far}]
fisheye = false
[metadata]
adjusted = false
""",
            )
            try:
                cameras, notes = calibration.read_calibration(path)
            except ImportError:
                self.skipTest("Python before 3.11 without tomli")
            self.assertEqual([c.name for c in cameras], ["front", "back"])
            self.assertEqual(cameras[0].size, (640, 480))
            np.testing.assert_allclose(cameras[0].distortion, [-0.1, 0.02, 0.001, 0])
            self.check(cameras[0], R, t)
            self.assertRegex(" ".join(notes), note if note == "z is up" else "z is up|millimetres")

    def test_opencv_yaml(self):
        R, t = look_at(np.array([1.0, 3.0, 1.0]))
        block = lambda name, m: (
            f"{name}: !!opencv-matrix\n   rows: {m.shape[0]}\n   cols: {m.shape[1]}\n   dt: d\n   data: ["
            + ", ".join(f"{v:.15e}" for v in m.ravel())
            + "]\n"
        )
        head = '%YAML:1.0\n---\nnames:\n  - "01"\n'
        path = self.file("intri.yml", head + block("K_01", K) + block("dist_01", np.array([[0.1, 0, 0, 0, 0]])))
        with self.assertRaisesRegex(Failure, "extri.yml is missing"):
            calibration.read_calibration(path)
        self.file("extri.yml", head + block("Rot_01", R) + block("T_01", t[:, None]))
        cameras, _ = calibration.read_calibration(path)
        self.assertEqual(cameras[0].name, "01")
        self.check(cameras[0], R, t)

    def test_qualisys(self):
        centre = np.array([3.0, -2.0, 1.5])
        R, t = look_at(centre)
        theirs = np.diag([1, -1, -1]) @ R  # x right, y up, z backward
        numbers = " ".join(f'r{i + 1}{j + 1}="{theirs[i, j]}"' for i in range(3) for j in range(3))
        path = self.file(
            "Calib.qca.txt",
            f"""<?xml version='1.0'?><calibration><cameras>
<camera serial="cam01"><fov_video left="0" right="639" top="0" bottom="479"/>
<transform x="{1000 * centre[0]}" y="{1000 * centre[1]}" z="{1000 * centre[2]}" {numbers}/>
<intrinsic focalLengthU="{64 * 800}" focalLengthV="{64 * 810}" centerPointU="{64 * 320}" centerPointV="{64 * 240}"
 radialDistortion1="-6.4" radialDistortion2="0" radialDistortion3="0" tangentalDistortion1="0"
 tangentalDistortion2="0.64" skew="0"/></camera></cameras></calibration>""",
        )
        cameras, _ = calibration.read_calibration(path)
        self.assertEqual(cameras[0].size, (640, 480))
        np.testing.assert_allclose(cameras[0].distortion, [-0.1, 0, 0, 0.01, 0])
        self.check(cameras[0], R, t)

    def test_gsh(self):
        camera = {
            "name": "a",
            "role": "train",
            "width": 640,
            "height": 480,
            "K": K.tolist(),
            "R": R.tolist(),
            "t": T.tolist(),
        }
        cameras, notes = calibration.read_calibration(self.file("cameras.json", json.dumps({"cameras": [camera]})))
        np.testing.assert_array_equal(cameras[0].K, K)
        np.testing.assert_array_equal(cameras[0].R, R)
        self.assertEqual(notes, [])

    def test_errors(self):
        for name, text, message in (
            ("a.json", "{", "cannot be read"),
            ("a.toml", "[x]\ny=1", "holds no camera"),
            ("a.txt", "hello", "unknown kind"),
            ("b.txt", "<a", "cannot be read"),
        ):
            with self.assertRaisesRegex(Failure, message):
                calibration.read_calibration(self.file(name, text))
        with self.assertRaisesRegex(Failure, "no such"):
            calibration.read_calibration("/nonexistent.toml")

    def camera(self, name, size=(640, 480)):
        return calibration.Camera(name, size, K.copy(), R, T, np.zeros(5))

    def test_names(self):
        cameras = [self.camera(n) for n in ("cam_01", "Cam_02", "cam_10")]
        self.assertEqual(
            [c.name for c in calibration.match_cameras(["cam1", "cam02", "CAM10"], cameras)],
            ["cam_01", "Cam_02", "cam_10"],
        )
        with self.assertRaisesRegex(Failure, "left is not in the calibration, which has cam_01, Cam_02, cam_10"):
            calibration.match_cameras(["left"], cameras)

    def test_sizes(self):
        fit = lambda size, w, h: calibration.fit_to_size(self.camera("a", size), w, h)
        self.assertIsNone(fit((640, 480), 640, 480)[1])
        scaled, note = fit((640, 480), 320, 240)
        self.assertEqual(scaled[0, 0], 400)
        self.assertEqual(scaled[0, 2], 160)
        self.assertRegex(note, "scaled")
        kept, note = fit((1088, 1920), 1080, 1920)  # a codec's padding
        self.assertEqual(kept[0, 2], 320)
        self.assertRegex(note, "padding")
        with self.assertRaisesRegex(Failure, "turned by 90 degrees"):
            fit((1920, 1080), 1080, 1920)
        with self.assertRaisesRegex(Failure, "but the frames are"):
            fit((640, 480), 640, 360)


def walking(frames):
    """Landmarks of a person whose limbs move a little, with sides 20 pixels apart."""
    people = []
    for i in range(frames):
        points = [[100 + (20 if j % 2 else 0) + i, 10 * j + 3 * np.sin(i), 0.9] for j in range(33)]
        people.append(
            {
                "mediapipe_pose": points,
                "mediapipe_world": [[float(j), 0, 0] for j in range(33)],
                "mediapipe_left_hand": [[1.0, 2.0, 0.8]] * 21,
            }
        )
    return people


class Sides(unittest.TestCase):
    def test_a_confused_run_is_exchanged(self):
        truth = walking(20)
        people = copy.deepcopy(truth)
        for i in (7, 8, 9, 15):
            for group, (landmarks, _) in sides.GROUPS.items():
                sides.exchange(people[i], group, landmarks)
        self.assertEqual(sides.exchange_sides(people), [7, 8, 9, 15])
        for person, wanted in zip(people, truth):
            self.assertEqual(person["mediapipe_pose"], wanted["mediapipe_pose"])
            self.assertEqual(person["mediapipe_world"], wanted["mediapipe_world"])
            self.assertIn("mediapipe_left_hand", person)
            self.assertNotIn("mediapipe_right_hand", person)

    def test_legs_alone(self):
        people = walking(12)
        sides.exchange(people[5], "legs", sides.GROUPS["legs"][0])
        self.assertEqual(sides.exchange_sides(people), [5])

    def test_a_turn_in_large_steps_stays(self):
        for steps in (8, 10, 16, 40):
            people = walking(steps)
            for i, person in enumerate(people):
                for j, point in enumerate(person["mediapipe_pose"]):
                    point[0] = 100 + (40 if j % 2 else -40) * np.cos(2 * np.pi * i / steps)
            self.assertEqual(sides.exchange_sides(people), [], steps)

    def test_what_is_plausible_stays(self):
        people = walking(20)
        people[3] = None
        before = copy.deepcopy(people)
        self.assertEqual(sides.exchange_sides(people), [])
        self.assertEqual(people, before)
        self.assertEqual(sides.exchange_sides([None, None]), [])


class Files(unittest.TestCase):
    def test_keypoints(self):
        person = dict(walking(1)[0], sides_doubtful=["arms"])
        file = folder.keypoints_json([("a", 4, 5), ("b", 6, 7)], [[person, None], [None, person]], "mediapipe 1")
        self.assertEqual(
            [i["file_name"] for i in file["images"]], ["a/0000.png", "a/0001.png", "b/0000.png", "b/0001.png"]
        )
        self.assertEqual([a["image_id"] for a in file["annotations"]], [0, 3])
        self.assertEqual(file["images"][3]["width"], 6)
        self.assertNotIn("sides_doubtful", file["annotations"][0])
        self.assertEqual(len(file["annotations"][0]["mediapipe_pose"]), 99)  # one list, as COCO's
        self.assertEqual(file["annotations"][0]["mediapipe_pose"][:3], person["mediapipe_pose"][0])
        self.assertEqual(file["info"]["detector"], "mediapipe 1")

    def test_landmarks_come_back(self):
        person = {"mediapipe_pose": [[k, 2.0 * k, 0.5] for k in range(33)]}
        cameras = [("a", 64, 48), ("b", 64, 48)]
        file = folder.keypoints_json(cameras, [[None, person], [{"keypoints": []}, None]], "test")
        found = folder.landmarks_of(json.loads(json.dumps(file)), ["a", "b"])
        self.assertEqual({name: list(frames) for name, frames in found.items()}, {"a": [1], "b": []})
        self.assertEqual(found["a"][1].tolist(), person["mediapipe_pose"])

    def test_times_have_one_origin(self):
        class Source:
            path, fps = "a.mp4", 30.0

        file = folder.video_json(
            10,
            [{"name": "a", "width": 4, "height": 5, "focal": 7.0}, {"name": "b", "width": 4, "height": 5}],
            [Source(), Source()],
            [np.array([2.0, 2.1]), np.array([2.01, 2.11])],
        )
        self.assertEqual(file["cameras"][0]["times"], [0, 0.1])
        self.assertEqual(file["cameras"][1]["times"], [0.01, 0.11])
        self.assertEqual(file["cameras"][0]["focal"], 7)
        self.assertNotIn("focal", file["cameras"][1])

    def test_files_appear_whole(self):
        with tempfile.TemporaryDirectory() as out:
            path = Path(out) / "a" / "b.json"
            folder.write_json(path, {"x": 1})
            self.assertEqual(json.loads(path.read_text()), {"x": 1})
            self.assertEqual([p.name for p in path.parent.iterdir()], ["b.json"])


if __name__ == "__main__":
    unittest.main()
