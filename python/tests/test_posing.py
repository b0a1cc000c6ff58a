# SPDX-License-Identifier: Apache-2.0
"""gsh.load_avatar, Avatar.pose, load_camera, render: numbers, memory, and wrong arguments."""

import gc
import json
import subprocess
import threading

import gsh
import pytest
from conftest import has_programs

np = pytest.importorskip("numpy")


@pytest.fixture(scope="module")
def avatar(example):
    return gsh.load_avatar(example / "avatar.gsh", threads=2)


@pytest.fixture(scope="module")
def motion(avatar, example):
    return avatar.load_motion(example / "motion.npz")


@pytest.fixture(scope="module")
def camera(example):
    return gsh.load_camera(example / "camera.json")


def test_an_avatars_arrays_have_their_shapes_and_are_read_only(avatar):
    N, J = len(avatar), len(np.asarray(avatar.parents))
    shapes = {"means": (N, 3), "quats": (N, 4), "log_scales": (N, 3), "opacity_logits": (N,), "rest_joints": (J, 3)}
    for name, shape in shapes.items():
        array = np.asarray(getattr(avatar, name))
        assert array.shape == shape and np.isfinite(array).all() and not array.flags.writeable
    assert np.asarray(avatar.sh).ndim == 3
    assert np.asarray(avatar.parents)[0] == -1
    assert len(avatar.joint_names) in (0, J)


def test_pose_is_a_view_that_outlives_the_avatar(example, camera):
    avatar = gsh.load_avatar(example / "avatar.gsh")
    splats = avatar.pose(camera=camera)
    means = np.asarray(splats.means)
    assert means.__array_interface__["data"] == np.asarray(splats.means).__array_interface__["data"]
    kept = means.copy()
    del avatar, splats
    gc.collect()
    assert (means == kept).all()


def test_numbers_and_a_motions_frame_give_the_same_splats(avatar, motion, camera):
    by_motion = avatar.pose(motion, frame=3, camera=camera)
    shape = np.asarray(motion.betas)
    by_numbers = avatar.pose(np.asarray(motion.pose)[3], np.asarray(motion.transl)[3].tolist(),
                             expression=np.asarray(motion.expression)[3], betas=shape if len(shape) else None,
                             camera=camera)
    for name in ("means", "covariances", "opacities", "colors"):
        assert (np.asarray(getattr(by_motion, name)) == np.asarray(getattr(by_numbers, name))).all()
    assert np.abs(np.asarray(by_motion.means) - np.asarray(avatar.pose().means)).max() > 0.05


def test_strided_and_single_precision_arguments_mean_the_same(avatar, motion):
    pose = np.asarray(motion.pose)[2]
    single = pose.astype(np.float32)
    expected = np.asarray(avatar.pose(single.astype(np.float64)).means)
    for same in (single, np.repeat(single, 2, axis=0)[::2], np.asfortranarray(single), single.tolist()):
        assert (np.asarray(avatar.pose(same).means) == expected).all()


def test_out_uses_its_memory_again(avatar, motion):
    first = avatar.pose(motion, frame=0)
    address = np.asarray(first.means).__array_interface__["data"]
    assert avatar.pose(motion, frame=4, out=first) is first
    assert np.asarray(first.means).__array_interface__["data"] == address
    assert (np.asarray(first.means) == np.asarray(avatar.pose(motion, frame=4).means)).all()


def test_translation_moves_the_splats(avatar):
    moved = np.asarray(avatar.pose(transl=(1, 2, -3)).means) - np.asarray(avatar.pose().means)
    assert np.allclose(moved, [1, 2, -3], atol=1e-5)


def test_a_picture_shows_the_avatar_before_the_background(avatar, camera):
    picture = gsh.render(avatar.pose(camera=camera), camera, background=(0.25, 0.5, 1), depths=True)
    color, alpha, depth = (np.asarray(image) for image in picture[:3])
    assert color.shape == (camera.height, camera.width, 3) and color.dtype == np.float32
    assert alpha.shape == depth.shape == color.shape[:2]
    assert np.allclose(color[0, 0], [0.25, 0.5, 1]) and alpha[0, 0] == 0
    inside = alpha > 0.9
    assert inside.mean() > 0.02
    middle = np.asarray(picture.median_depth)[inside]
    assert np.abs((depth / np.maximum(alpha, 1e-6))[inside] - middle).max() < 0.5 and middle.min() > 1
    assert gsh.render(avatar.pose(camera=camera), camera).depth is None


def test_two_avatars_share_a_picture(avatar, camera):
    left, right = avatar.pose(transl=(-0.2, 0, 0), camera=camera), avatar.pose(transl=(0.2, 0, 0), camera=camera)
    alphas = [np.asarray(gsh.render(s, camera).alpha) for s in (left, right, [left, right])]
    assert (alphas[2] >= np.maximum(alphas[0], alphas[1]) - 1e-3).all()
    assert alphas[2].sum() < alphas[0].sum() + alphas[1].sum()


def test_colours_may_be_written(avatar, camera):
    splats = avatar.pose(camera=camera)
    np.asarray(splats.colors)[:] = (1, 0, 0)
    picture = np.asarray(gsh.render(splats, camera).color)
    assert picture[..., 0].max() > 0.9 and picture[..., 1:].max() == 0
    np.asarray(splats.means)[7] = np.nan
    with pytest.raises(ValueError, match="7"):
        gsh.render(splats, camera)


@pytest.mark.skipif(not has_programs(), reason="the package was built without programs")
def test_a_picture_is_that_of_gsh_render(avatar, motion, camera, example, tmp_path):
    from gsh import _programs

    subprocess.run([_programs.path_of("render"), example / "avatar.gsh", "--poses", example / "motion.npz", "--frame",
                    "5", "--camera", example / "camera.json", "--out", tmp_path / "p.png", "--npy", tmp_path / "p.npy",
                    "--background", "0.1,0.2,0.3"], check=True)
    picture = gsh.render(avatar.pose(motion, frame=5, camera=camera), camera, background=(0.1, 0.2, 0.3))
    assert (np.asarray(picture.color) == np.load(tmp_path / "p.npy")).all()


def test_arrays_pass_to_torch_without_a_copy(avatar):
    torch = pytest.importorskip("torch")
    splats = avatar.pose()
    means = torch.from_dlpack(splats.means)
    means[0, 0] = 42
    assert np.asarray(splats.means)[0, 0] == 42
    pose = torch.zeros((len(np.asarray(avatar.parents)), 3))
    assert (np.asarray(avatar.pose(pose).means) == np.asarray(avatar.pose().means)).all()
    with pytest.raises(TypeError, match="Avatar.pose: pose .*detach"):
        avatar.pose(pose.requires_grad_())


def test_several_python_threads_take_turns(avatar, motion, camera):
    expected = [np.asarray(gsh.render(avatar.pose(motion, frame=f, camera=camera), camera).color) for f in range(4)]
    wrong = []

    def draw(frame):
        for _ in range(5):
            picture = gsh.render(avatar.pose(motion, frame=frame, camera=camera), camera)
            if not (np.asarray(picture.color) == expected[frame]).all():
                wrong.append(frame)

    threads = [threading.Thread(target=draw, args=(frame,)) for frame in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_a_camera_is_what_its_file_states(camera, example):
    stored = json.loads((example / "camera.json").read_text())
    assert (camera.width, camera.height) == (stored["width"], stored["height"])
    same = gsh.Camera(camera.width, camera.height, camera.K, np.asarray(camera.R), camera.t)
    assert repr(same) == repr(camera)
    assert np.allclose(camera.K, stored["K"]) and np.allclose(camera.R, stored["R"])


def test_wrong_poses_are_refused_by_name(avatar, motion, camera):
    J = len(np.asarray(avatar.parents))
    good = np.zeros((J, 3))
    kept = avatar.pose(motion, frame=1)
    means = np.asarray(kept.means).copy()
    nan = good.copy()
    nan[4, 1] = np.nan
    for error, words, arguments in [
        (ValueError, rf"pose has the shape \[{J + 1}, 3\], expected \[{J}, 3\]", dict(pose=np.zeros((J + 1, 3)))),
        (ValueError, r"pose has the shape", dict(pose=np.zeros(3 * J))),
        (TypeError, "pose is an array of other numbers", dict(pose=np.zeros((J, 3), dtype=np.int64))),
        (TypeError, "pose is str", dict(pose="dance.npz")),
        (ValueError, r"pose\[4, 1\] is nan", dict(pose=nan)),
        (ValueError, r"pose\[0, 0\] is infinite", dict(pose=np.full((J, 3), np.inf))),
        (TypeError, "pose contains", dict(pose=[["a", 0, 0]] * J)),
        (ValueError, "pose has rows of different lengths", dict(pose=[[0, 0, 0]] * (J - 1) + [[0, 0]])),
        (ValueError, "transl has the shape", dict(pose=good, transl=(0, 0))),
        (ValueError, "betas has 500 numbers", dict(pose=good, betas=np.zeros(500))),
        (ValueError, "expression has 500 numbers", dict(pose=good, expression=np.zeros(500))),
        (ValueError, r"frame is 100, expected 0 to", dict(pose=motion, frame=100)),
        (ValueError, r"frame is -1", dict(pose=motion, frame=-1)),
        (TypeError, "frame is float", dict(pose=motion, frame=1.0)),
        (TypeError, "transl is given beside a motion", dict(pose=motion, transl=(0, 0, 0))),
        (TypeError, "camera is int", dict(camera=3)),
        (TypeError, "camera and center", dict(camera=camera, center=(0, 0, 0))),
        (ValueError, r"center\[2\] is nan", dict(center=(0, 0, float("nan")))),
    ]:
        with pytest.raises(error, match="Avatar.pose: " + words):
            avatar.pose(out=kept, **arguments)
        assert (np.asarray(kept.means) == means).all(), words
    with pytest.raises(TypeError, match="out is int"):
        avatar.pose(out=1)


def test_wrong_files_are_refused_by_name(avatar, example, tmp_path):
    with pytest.raises(OSError, match="nothing.gsh"):
        gsh.load_avatar(tmp_path / "nothing.gsh")
    (tmp_path / "text.gsh").write_text("not an avatar")
    with pytest.raises(OSError, match="text.gsh"):
        gsh.load_avatar(tmp_path / "text.gsh")
    with pytest.raises((OSError, ValueError), match="motion.npz"):
        gsh.load_avatar(example / "motion.npz")
    with pytest.raises(TypeError, match="path is int"):
        gsh.load_avatar(3)
    with pytest.raises(ValueError, match="threads is 5000"):
        gsh.load_avatar(example / "avatar.gsh", threads=5000)
    with pytest.raises(OSError, match="avatar.gsh"):
        avatar.load_motion(example / "avatar.gsh")
    with pytest.raises(ValueError, match="input_fps"):
        avatar.load_motion(example / "motion.npz", input_fps=-1)
    np.savez(tmp_path / "other.npz", poses=np.zeros((2, 9)), trans=np.zeros((2, 3)))
    with pytest.raises((OSError, ValueError), match="other.npz"):
        avatar.load_motion(tmp_path / "other.npz")


def test_wrong_pictures_are_refused_by_name(avatar, camera):
    splats = avatar.pose(camera=camera)
    for error, words, arguments in [
        (TypeError, "splats is int", (1, camera)),
        (TypeError, "splats is list", ([], camera)),
        (TypeError, r"splats\[1\] is int", ([splats, 1], camera)),
        (TypeError, "camera is NoneType", (splats, None)),
    ]:
        with pytest.raises(error, match="render: " + words):
            gsh.render(*arguments)
    with pytest.raises(ValueError, match="background has the shape"):
        gsh.render(splats, camera, background=(0, 0))
    for error, words, arguments in [
        (ValueError, "width is 0", (0, 5, np.eye(3), np.eye(3), np.zeros(3))),
        (TypeError, "height is float", (5, 5.0, np.eye(3), np.eye(3), np.zeros(3))),
        (ValueError, "K has the shape", (5, 5, np.eye(4), np.eye(3), np.zeros(3))),
        (ValueError, "singular", (5, 5, np.zeros((3, 3)), np.eye(3), np.zeros(3))),
        (ValueError, "not a rotation", (5, 5, np.eye(3), 2 * np.eye(3), np.zeros(3))),
        (ValueError, r"t\[1\] is nan", (5, 5, np.eye(3), np.eye(3), [0, float("nan"), 0])),
        (TypeError, "R is None", (5, 5, np.eye(3), None, [0, 0, 0])),
    ]:
        with pytest.raises(error, match=words):
            gsh.Camera(*arguments)
    with pytest.raises(ValueError, match="parallel to up"):
        gsh.Camera.look_at((0, 1, 0), (0, 0, 0), 10, 10)


def test_classes_are_not_made_by_hand():
    for make in (gsh.Avatar, gsh.Motion, gsh.Splats):
        with pytest.raises(TypeError, match="use "):
            make()
