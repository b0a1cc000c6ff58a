# SPDX-License-Identifier: Apache-2.0
"""gsh.torch.Avatar. The file is that of the environment variable GSH_TEST_AVATAR, or gsh-reconstruct makes one of the
built-in actor; without either, the tests are skipped."""

import os
import subprocess
from pathlib import Path

import pytest
import torch
from gsh.torch import Avatar, rasterization
from scenes import weights_like

WIDTH, HEIGHT = 80, 100


@pytest.fixture(scope="module")
def avatar(tmp_path_factory):
    path = os.environ.get("GSH_TEST_AVATAR")
    if not path:
        folder = Path(os.environ.get("GSH_PROGRAM_DIR", Path(__file__).parents[2] / "build/joined-release/bin"))
        if not (folder / "gsh-reconstruct").exists():
            pytest.skip("no avatar: set GSH_TEST_AVATAR to a file, or GSH_PROGRAM_DIR to the folder of gsh-reconstruct")
        out = tmp_path_factory.mktemp("avatar")
        subprocess.run([folder / "gsh-reconstruct", "--synthetic", "--steps", "60", "--gaussians", "3000", "--out",
                        out], check=True, capture_output=True)
        path = out / "avatar.gsh"
    return Avatar(path)


def camera(avatar):
    """A camera in front of the avatar, which looks along -z; y is up."""
    pose, transl = rest(avatar)
    means, _, _, _ = avatar.splats(pose, transl, torch.zeros(3))
    middle = (means.amin(0) + means.amax(0)) / 2
    R = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    viewmat = torch.eye(4)
    viewmat[:3, :3], viewmat[:3, 3] = R, torch.tensor([0, 0, 3.0]) - R @ middle
    return viewmat, torch.tensor([[120.0, 0, 40], [0, 120, 50], [0, 0, 1]])


def rest(avatar):
    g = torch.Generator().manual_seed(1)
    return 0.05 * torch.randn(avatar.joint_count, 3, generator=g), torch.zeros(3)


def test_the_image_shows_the_splats(avatar):
    pose, transl = rest(avatar)
    viewmat, K = camera(avatar)
    image, alpha = avatar(pose, transl, viewmat, K, WIDTH, HEIGHT)
    assert image.shape == (HEIGHT, WIDTH, 3) and alpha.shape == (HEIGHT, WIDTH, 1)
    assert 0.02 < (alpha > 0.5).float().mean() < 0.9 and torch.isfinite(image).all()
    center = -viewmat[:3, :3].T @ viewmat[:3, 3]
    means, covars, opacities, colors = avatar.splats(pose, transl, center)
    full = torch.zeros(avatar.count, 9)
    full[:, [0, 1, 2, 4, 5, 8]] = covars
    full[:, [3, 6, 7]] = covars[:, [1, 2, 4]]
    dilation, *_, compensates = avatar._settings[:5]
    other, _, _ = rasterization(means, None, None, opacities, colors, viewmat[None], K[None], WIDTH, HEIGHT,
                                backgrounds=torch.ones(1, 3), covars=full.reshape(-1, 3, 3), eps2d=dilation,
                                rasterize_mode="antialiased" if compensates else "classic")
    # There, alpha is at most 0.999, here 0.99; the compensation has a floor here.
    assert (other[0] - image).abs().max() < 0.03
    assert torch.equal(image, avatar(pose, transl, viewmat, K, WIDTH, HEIGHT, betas=avatar.betas)[0])


def test_gradients_of_splats_are_those_of_differences(avatar):
    """Along the gradient, for a linear function of the splats. The image's share is that of ``rasterization``."""
    pose, transl = rest(avatar)
    inputs = dict(pose=pose, transl=transl, center=torch.tensor([0.3, 0.5, 3.0]), betas=avatar.betas.clone(),
                  expression=torch.zeros(avatar.expression_count))
    weights = None

    def loss(**changed):
        nonlocal weights
        splats = avatar.splats(**dict(inputs, **changed))
        if weights is None:
            weights = [weights_like(t, seed).double() for seed, t in enumerate(splats)]
            weights[1] *= 100  # square metres
            weights[3] *= 0 if avatar.is_lit else 1  # the edges of shadows pass no gradient
        return sum((t.double() * w).sum() for t, w in zip(splats, weights))

    leaves = {name: t.clone().requires_grad_() for name, t in inputs.items()}
    loss(**leaves).backward()
    for name, t in leaves.items():
        norm = t.grad.norm().item()
        if name in ("pose", "transl", "betas"):
            assert norm > 0
        if norm < 1e-3:  # views may not change colours, bodies may have no expression
            continue
        h = 1e-3
        above, below = (loss(**{name: inputs[name] + d * t.grad / norm}) for d in (h, -h))
        assert abs(((above - below) / (2 * h)).item() - norm) < 0.02 * norm, name


def test_gradients_of_the_camera_come_through_colours_and_image(avatar):
    pose, transl = rest(avatar)
    viewmat, K = (t.requires_grad_() for t in camera(avatar))
    image, alpha = avatar(pose, transl, viewmat, K, WIDTH, HEIGHT)
    (image.square().sum() + alpha.sum()).backward()
    assert (viewmat.grad[:3].abs() > 0).all() and (K.grad[[0, 0, 1, 1], [0, 2, 1, 2]].abs() > 0).all()


def test_a_pose_is_fitted(avatar):
    pose, transl = rest(avatar)
    viewmat, K = camera(avatar)
    with torch.no_grad():
        truth, _ = avatar(pose, transl + torch.tensor([0.03, -0.02, 0.0]), viewmat, K, WIDTH, HEIGHT)
    moved = transl.clone().requires_grad_()
    optimizer = torch.optim.Adam([moved], lr=0.003)
    for _ in range(60):
        image, _ = avatar(pose, moved, viewmat, K, WIDTH, HEIGHT)
        loss = (image - truth).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert (moved - torch.tensor([0.03, -0.02, 0.0]))[:2].abs().max() < 0.004


def test_bad_input_is_named(avatar, tmp_path):
    pose, transl = rest(avatar)
    viewmat, K = camera(avatar)
    run = lambda **o: avatar(**dict(dict(pose=pose, transl=transl, viewmat=viewmat, K=K, width=8, height=8), **o))
    for options, error, match in (
            (dict(pose=pose[1:]), ValueError, "pose has the shape"),
            (dict(pose=pose.double()), TypeError, "pose is torch"),
            (dict(transl=[0, 0, 0]), TypeError, "transl is list"),
            (dict(transl=torch.full((3,), float("nan"))), ValueError, r"transl\[0\] is nan"),
            (dict(viewmat=viewmat[:3]), ValueError, "viewmat has the shape"),
            (dict(betas=torch.zeros(1000)), ValueError, "betas has the shape"),
            (dict(background=torch.zeros(4)), ValueError, "background has the shape"),
            (dict(width=0), ValueError, "width is 0"), (dict(K=0 * K), ValueError, "focal lengths")):
        with pytest.raises(error, match=match):
            run(**options)
    with pytest.raises(RuntimeError, match="none.gsh"):
        Avatar(tmp_path / "none.gsh")
    (tmp_path / "bad.gsh").write_bytes(b"PK\x03\x04 not an archive")
    with pytest.raises((RuntimeError, ValueError), match="bad.gsh"):
        Avatar(tmp_path / "bad.gsh")
    del avatar


def test_poses_outlive_the_module(avatar):
    other = Avatar(avatar.path)
    pose, transl = rest(avatar)
    image, _ = other(pose.requires_grad_(), transl, *camera(avatar), WIDTH, HEIGHT)
    del other
    image.sum().backward()
    assert pose.grad.abs().max() > 0
