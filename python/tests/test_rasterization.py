# SPDX-License-Identifier: Apache-2.0
"""gsh.torch.rasterization against the dense reference, against finite differences, and with bad input."""

import itertools

import pytest
import reference
import torch
from gsh.torch import rasterization, release_memory
from scenes import Scene, relative_error, weights_like

MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")


def in_mode(image, alpha, mode):
    """The reference's image, colours and depth, in a render mode."""
    color, depth = image[..., :-1], image[..., -1:]
    if "ED" in mode:
        depth = depth / alpha.clamp(min=1e-10)
    return {"RGB": color, "D": depth, "ED": depth}.get(mode, torch.cat([color, depth], -1))


@pytest.mark.parametrize("dtype", (torch.float32, torch.float64))
@pytest.mark.parametrize("packed", (False, True))
@pytest.mark.parametrize("rasterize_mode", ("classic", "antialiased"))
@pytest.mark.parametrize("mode", MODES)
def test_values_and_gradients_are_those_of_the_dense_reference(mode, rasterize_mode, packed, dtype):
    C, N = 2, 200
    scene = Scene(N, 61, 47, cameras=C, dtype=dtype)
    image, alphas, meta = rasterization(**scene.inputs, width=61, height=47, render_mode=mode,
                                        rasterize_mode=rasterize_mode, packed=packed)
    meta["means2d"].retain_grad()
    w, v = weights_like(image), weights_like(alphas, 3)
    ((image * w).sum() + (alphas * v).sum()).backward()

    inputs = scene.clone(torch.float64)
    offsets = torch.zeros(C, N, 2, dtype=torch.float64, requires_grad=True)
    loss = 0
    exact = dtype == torch.float64
    for c in range(C):
        expected, alpha = reference.rasterize(
            *(inputs[n] for n in ("means", "quats", "scales", "opacities", "colors")), inputs["viewmats"][c],
            inputs["Ks"][c], 61, 47, background=inputs["backgrounds"][c], depth=True, means2d_offset=offsets[c],
            antialiased=rasterize_mode == "antialiased")
        expected = in_mode(expected, alpha, mode)
        assert (expected - image[c]).abs().max() < (1e-12 if exact else 1e-4)
        assert (alpha - alphas[c]).abs().max() < (1e-12 if exact else 1e-5)
        loss = loss + (expected * w[c]).sum() + (alpha * v[c]).sum()
    loss.backward()
    for name, tensor in scene.inputs.items():
        expected = inputs[name].grad
        if tensor.grad is None:  # no colour in modes of depth alone
            assert name in ("colors", "backgrounds") and "RGB" not in mode and (expected == 0).all()
            continue
        assert expected.abs().max() > 0
        assert relative_error(tensor.grad, expected) < (1e-11 if exact else 1e-3), name
    expected = offsets.grad[meta["camera_ids"], meta["gaussian_ids"]] if packed else offsets.grad
    assert relative_error(meta["means2d"].grad, expected) < (1e-11 if exact else 1e-3)


def test_batches_are_single_calls():
    batch, C, N = (2, 3), 2, 40
    scene = Scene(N, 33, 21, cameras=C, batch=batch, dtype=torch.float32)
    image, alphas, meta = rasterization(**scene.inputs, width=33, height=21, packed=False)
    assert image.shape == (2, 3, 2, 21, 33, 3) and alphas.shape == (2, 3, 2, 21, 33, 1)
    assert image.is_contiguous() and meta["means2d"].shape == (2, 3, 2, N, 2) and meta["radii"].dtype == torch.int32
    assert meta["n_batches"] == 6 and meta["n_cameras"] == 2
    w = weights_like(image)
    (image * w).sum().backward()
    for i, j in itertools.product(range(2), range(3)):
        one = {name: t.detach()[i, j].clone().requires_grad_() for name, t in scene.inputs.items()}
        expected, _, _ = rasterization(**one, width=33, height=21, packed=False)
        assert torch.equal(expected, image[i, j])
        (expected * w[i, j]).sum().backward()
        for name, t in one.items():
            assert torch.equal(t.grad, scene.inputs[name].grad[i, j]), name


@pytest.mark.parametrize("channels", (1, 2, 3, 4, 7))
@pytest.mark.parametrize("per_camera", (False, True))
def test_any_number_of_channels(channels, per_camera):
    scene = Scene(50, 30, 20, cameras=2)
    g = torch.Generator().manual_seed(5)
    shape = (2, 50, channels) if per_camera else (50, channels)
    colors = torch.rand(shape, generator=g, dtype=torch.float64, requires_grad=True)
    backgrounds = torch.rand(2, channels, generator=g, dtype=torch.float64, requires_grad=True)
    inputs = dict(scene.inputs, colors=colors, backgrounds=backgrounds)
    image, alphas, _ = rasterization(**inputs, width=30, height=20, render_mode="RGB+D")
    w, v = weights_like(image), weights_like(alphas)
    found = torch.autograd.grad((image * w).sum() + (alphas * v).sum(), list(inputs.values()))
    loss = 0
    for c in range(2):
        expected, alpha = reference.rasterize(scene.means, scene.quats, scene.scales, scene.opacities,
                                              colors[c] if per_camera else colors, scene.viewmats[c], scene.Ks[c], 30,
                                              20, background=backgrounds[c], depth=True)
        assert (expected - image[c]).abs().max() < 1e-12
        loss = loss + (expected * w[c]).sum() + (alpha * v[c]).sum()
    for name, a, b in zip(inputs, found, torch.autograd.grad(loss, list(inputs.values()))):
        assert relative_error(a, b) < 1e-11, name


def test_spherical_harmonics_are_colors_of_the_view():
    scene = Scene(60, 30, 20, cameras=2)
    g = torch.Generator().manual_seed(5)
    coefficients = (0.5 * torch.randn(60, 16, 3, generator=g, dtype=torch.float64)).requires_grad_()
    inputs = dict(scene.inputs, colors=coefficients)
    image, _, _ = rasterization(**inputs, width=30, height=20, sh_degree=3)
    from gsh.torch import spherical_harmonics
    loss, w = 0, weights_like(image)
    for c in range(2):
        center = -torch.linalg.inv(scene.viewmats[c, :3, :3]) @ scene.viewmats[c, :3, 3]
        colors = torch.clamp_min(spherical_harmonics(3, scene.means - center, coefficients) + 0.5, 0)
        expected, _ = reference.rasterize(scene.means, scene.quats, scene.scales, scene.opacities, colors,
                                          scene.viewmats[c], scene.Ks[c], 30, 20, background=scene.backgrounds[c])
        assert (expected - image[c]).abs().max() < 1e-12
        loss = loss + (expected * w[c]).sum()
    found = torch.autograd.grad((image * w).sum(), list(inputs.values()))
    for name, a, b in zip(inputs, found, torch.autograd.grad(loss, list(inputs.values()))):
        if name == "viewmats":  # the last row counts in torch.inverse
            a, b = a[:, :3], b[:, :3]
        assert relative_error(a, b) < 1e-11, name


@pytest.mark.parametrize("rasterize_mode", ("classic", "antialiased"))
def test_gradcheck(rasterize_mode):
    scene = Scene(6, 14, 11, cameras=2, size=0.2, seed=4)
    scene.opacities.data.mul_(0.8).add_(0.1)

    def render(means, quats, scales, opacities, colors, viewmats, Ks, backgrounds):
        image, alphas, meta = rasterization(means, quats, scales, opacities, colors, viewmats, Ks, 14, 11,
                                            backgrounds=backgrounds, render_mode="RGB+ED", packed=False,
                                            rasterize_mode=rasterize_mode)
        return image, alphas, meta["means2d"], meta["depths"], meta["conics"], meta["opacities"]

    assert torch.autograd.gradcheck(render, tuple(scene.inputs.values()), eps=1e-7, atol=1e-5, rtol=1e-4)


def test_absolute_gradients_are_sums_over_pixels():
    scene = Scene(8, 9, 7, size=0.2)
    w = weights_like(torch.empty(1, 7, 9, 3, dtype=torch.float64))

    def run(weights):
        image, _, meta = rasterization(**scene.inputs, width=9, height=7, packed=False, absgrad=True)
        meta["means2d"].retain_grad()
        (image * weights).sum().backward()
        return meta["means2d"].grad, meta["means2d"].absgrad

    _, absolute = run(w)
    expected = torch.zeros_like(absolute)
    for y, x in itertools.product(range(7), range(9)):
        one = torch.zeros_like(w)
        one[:, y, x] = w[:, y, x]
        expected += run(one)[0].abs()
    assert relative_error(absolute, expected) < 1e-12 and absolute.max() > 0


def test_density_control_reads_what_it_expects():
    for packed in (False, True):
        scene = Scene(100, 40, 30, cameras=2, dtype=torch.float32)
        image, _, info = rasterization(**scene.inputs, width=40, height=30, packed=packed)
        info["means2d"].retain_grad()
        image.square().mean().backward()
        gradient = info["means2d"].grad.clone()
        assert {"width", "height", "n_cameras", "radii", "gaussian_ids"} <= info.keys()
        visible = (info["radii"] > 0).all(dim=-1)
        assert gradient.shape == info["radii"].shape and (packed == bool(visible.all()))
        if not packed:
            assert (gradient[~visible] == 0).all()


def test_limits_cull():
    scene = Scene(100, 40, 30)
    run = lambda **options: rasterization(**scene.inputs, width=40, height=30, packed=False, **options)[2]
    depths = run()["depths"]
    far = run(far_plane=3.0)
    assert ((far["radii"] > 0).all(-1) == ((run()["radii"] > 0).all(-1) & (depths <= 3))).all()
    assert far["radii"].count_nonzero() < run()["radii"].count_nonzero()
    clipped = run(radius_clip=4.0)["radii"]
    assert (clipped[clipped > 0].reshape(-1, 2).amax(-1) > 4).all() and (clipped == 0).any()


def test_covariances_in_place_of_quats_and_scales():
    scene = Scene(50, 30, 20)
    M = reference.rotations(scene.quats) * scene.scales[:, None, :]
    covars = (M @ M.transpose(1, 2)).detach().requires_grad_()
    inputs = dict(scene.inputs, quats=None, scales=None)
    image, _, _ = rasterization(**inputs, covars=covars, width=30, height=20)
    expected, _, _ = rasterization(**scene.inputs, width=30, height=20)
    assert (image - expected).abs().max() < 1e-12
    w = weights_like(image)
    gradient, = torch.autograd.grad((image * w).sum(), covars)
    direction = weights_like(covars)
    direction = direction + direction.transpose(1, 2)
    shifted = [rasterization(**inputs, covars=covars + h * direction, width=30, height=20)[0] for h in (1e-7, -1e-7)]
    difference = ((shifted[0] - shifted[1]) * w).sum() / 2e-7
    assert abs(difference - (gradient * direction).sum()) < 1e-5 * abs(difference)


def test_nothing_to_draw_and_no_gaussians():
    scene = Scene(5, 20, 10, dtype=torch.float32)
    behind = dict(scene.inputs, means=scene.means.detach() - torch.tensor([0, 0, 10.0]))
    for inputs in (behind, {n: t[:0] if n in ("means", "quats", "scales", "opacities", "colors") else t
                            for n, t in scene.inputs.items()}):
        for packed in (False, True):
            image, alphas, meta = rasterization(**inputs, width=20, height=10, packed=packed)
            assert torch.equal(image, scene.backgrounds.detach()[:, None, None].expand(1, 10, 20, 3))
            assert (alphas == 0).all() and (meta["radii"] == 0).all()
            image.sum().backward()
    assert (scene.quats.grad == 0).all()


def test_gradients_are_the_same_in_every_run_and_thread_count():
    scene = Scene(300, 64, 48, dtype=torch.float32)
    results, threads = [], torch.get_num_threads()
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            image, _, _ = rasterization(**scene.inputs, width=64, height=48)
            results.append((image,) + torch.autograd.grad(image.square().sum(), list(scene.inputs.values())))
    finally:
        torch.set_num_threads(threads)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other))


def test_strides_and_memory_do_not_matter():
    scene = Scene(50, 30, 20, dtype=torch.float32)
    expected, _, _ = rasterization(**scene.inputs, width=30, height=20)
    strided = {}
    for name, t in scene.inputs.items():
        wide = torch.zeros(t.shape[:-1] + (2 * t.shape[-1],))
        wide[..., ::2] = t.detach()
        strided[name] = wide[..., ::2].requires_grad_()
        assert not strided[name].is_contiguous()
    image, alphas, _ = rasterization(**strided, width=30, height=20)
    assert torch.equal(image, expected)
    image.permute(0, 3, 1, 2).square().sum().backward()  # a gradient in another layout
    expected.square().sum().backward()
    for name, t in scene.inputs.items():
        assert torch.allclose(t.grad, strided[name].grad, atol=0), name
    image, alphas, _ = rasterization(**scene.inputs, width=30, height=20)
    (image.sum() + alphas.sum()).backward()  # gradients with strides 0
    release_memory()


def test_a_second_backward_gives_the_same():
    scene = Scene(50, 30, 20)
    image, _, _ = rasterization(**scene.inputs, width=30, height=20)
    tensors = list(scene.inputs.values())
    first = torch.autograd.grad(image.square().sum(), tensors, retain_graph=True)
    rasterization(**Scene(80, 30, 20, seed=9).inputs, width=30, height=20)  # must not use the memory of the first
    second = torch.autograd.grad(image.square().sum(), tensors)
    assert all(torch.equal(a, b) for a, b in zip(first, second))


GOOD = Scene(6, 20, 10, dtype=torch.float32)


@pytest.mark.parametrize("name", ("means", "quats", "scales", "opacities", "colors", "viewmats", "Ks", "backgrounds"))
def test_bad_tensors_are_named(name):
    good = {n: t.detach() for n, t in GOOD.inputs.items()}
    run = lambda value: rasterization(**dict(good, **{name: value}), width=20, height=10)
    with pytest.raises(TypeError, match=rf"rasterization: {name} is list, expected a torch.Tensor"):
        run(good[name].tolist())
    with pytest.raises(TypeError, match=r"is torch.float(32|64), expected torch.float(32|64) as the other"):
        run(good[name].double())
    with pytest.raises(TypeError, match=rf"rasterization: {name} is torch.float16, expected"):
        run(good[name].half())
    with pytest.raises(ValueError, match=rf"rasterization: {name} is on meta, expected a tensor on the CPU"):
        run(good[name].to("meta"))
    with pytest.raises(ValueError, match=rf"{name} is torch.sparse_coo, expected a dense tensor"):
        run(good[name].to_sparse())
    with pytest.raises(ValueError, match=r"has the shape \[.*\], expected \["):
        run(good[name][..., :-1])
    for bad in (float("nan"), float("inf")):
        value = good[name].clone()
        value[(0,) * value.dim()] = bad
        with pytest.raises(ValueError, match=rf"rasterization: {name}\[0(, 0)*\] is (nan|inf), expected a finite"):
            run(value)


def test_bad_values_are_named():
    good = {n: t.detach() for n, t in GOOD.inputs.items()}
    run = lambda width=20, height=10, **options: rasterization(**dict(good, **options), width=width, height=height)
    quats = good["quats"].clone()
    quats[3] = 0
    with pytest.raises(ValueError, match=r"rasterization: quats\[3\] is zero"):
        run(quats=quats)
    Ks = good["Ks"].clone()
    Ks[0, 0, 1] = 5
    with pytest.raises(ValueError, match=r"Ks\[camera 0\]: has skew"):
        run(Ks=Ks)
    Ks[0, 0, :2] = 0
    with pytest.raises(ValueError, match=r"Ks\[camera 0\]: focal lengths must be above 0"):
        run(Ks=Ks)
    with pytest.raises(ValueError, match="near_plane.*above 0"):
        run(near_plane=0)
    with pytest.raises(ValueError, match="eps2d.*negative"):
        run(eps2d=-1)
    with pytest.raises(ValueError, match="width is 0, expected 1 to"):
        run(width=0)
    with pytest.raises(TypeError, match="height is float, expected a whole number"):
        run(height=10.5)
    with pytest.raises(ValueError, match="render_mode is 'rgb', expected one of"):
        run(render_mode="rgb")
    for options in (dict(camera_model="fisheye"), dict(camera_model="ortho"), dict(sparse_grad=True),
                    dict(distributed=True), dict(with_ut=True), dict(with_eval3d=True),
                    dict(radial_coeffs=torch.zeros(1, 4)), dict(viewmats_rs=good["viewmats"]),
                    dict(rolling_shutter="ROLLING_TOP_TO_BOTTOM")):
        with pytest.raises(NotImplementedError, match="is not available|are not available"):
            run(**options)
    run(segmented=True, channel_chunk=1, tile_size=8, rolling_shutter="GLOBAL")  # change nothing


def test_changes_in_place_are_seen_by_autograd():
    scene = Scene(6, 20, 10, dtype=torch.float32)
    image, _, _ = rasterization(**scene.inputs, width=20, height=10)
    with torch.no_grad():
        scene.means.add_(1)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        image.sum().backward()
