# SPDX-License-Identifier: Apache-2.0
"""Spherical harmonics, covariances and projections against gsplat's torch reference; SSIM against its definition."""

import pytest
import torch
from gsh.torch import fully_fused_projection, fused_ssim, quat_scale_to_covar_preci, spherical_harmonics
from scenes import Scene, relative_error, weights_like

TYPES = (torch.float32, torch.float64)


def gsplat_reference():
    pytest.importorskip("gsplat")
    from gsplat.cuda import _torch_impl
    return _torch_impl


def random(*shape, seed=1, dtype=torch.float64):
    g = torch.Generator().manual_seed(seed)
    return torch.randn(shape, generator=g, dtype=torch.float64).to(dtype).requires_grad_()


def compare(found, expected, inputs):
    """Values to 1e-5 and gradients of a linear loss to 1e-4, relative to the largest number."""
    loss = [0, 0]
    for a, b in zip(found, expected):
        assert a.shape == b.shape and relative_error(a, b) < 1e-5
        w = weights_like(b)
        loss = [l + (t * w).sum() for l, t in zip(loss, (a, b))]
    gradients = [torch.autograd.grad(l, inputs) for l in loss]
    for a, b in zip(*gradients):
        assert b.abs().max() > 0 and relative_error(a, b) < 1e-4


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("degree", range(5))
def test_spherical_harmonics_are_gsplats(degree, dtype):
    reference = gsplat_reference()
    dirs, coeffs = random(3, 50, 3, dtype=dtype), random(3, 50, 25, 3, seed=2, dtype=dtype)
    expected = reference._spherical_harmonics(degree, dirs, coeffs)
    found = spherical_harmonics(degree, dirs, coeffs)
    compare([found], [expected], [coeffs] if degree == 0 else [dirs, coeffs])
    masks = torch.arange(150).reshape(3, 50) % 3 > 0
    masked = spherical_harmonics(degree, dirs, coeffs, masks=masks)
    assert torch.equal(masked, found * masks[..., None])
    gradient, = torch.autograd.grad(masked.sum(), coeffs)
    assert (gradient[~masks] == 0).all() and (gradient[:, :, (degree + 1) ** 2:] == 0).all()


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("triu", (False, True))
def test_covariances_are_gsplats(triu, dtype):
    reference = gsplat_reference()
    quats, scales = random(4, 20, 4, dtype=dtype), torch.exp(random(4, 20, 3, seed=2, dtype=dtype))
    compare(quat_scale_to_covar_preci(quats, scales, triu=triu),
            reference._quat_scale_to_covar_preci(quats, scales, triu=triu), [quats, scales])
    assert quat_scale_to_covar_preci(quats, scales, compute_covar=False)[0] is None
    assert quat_scale_to_covar_preci(quats, scales, compute_preci=False)[1] is None


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("compensations", (False, True))
def test_projections_are_gsplats(compensations, dtype):
    reference = gsplat_reference()
    scene = Scene(400, 60, 50, cameras=2, dtype=dtype, batch=(2,))
    scene.means.data.mul_(2)  # beyond the image, where the Jacobian is clamped, and behind the camera
    covars, _ = reference._quat_scale_to_covar_preci(scene.quats, scene.scales, True, False)
    expected = reference._fully_fused_projection(scene.means, covars, scene.viewmats, scene.Ks, 60, 50,
                                                 calc_compensations=compensations)
    found = fully_fused_projection(scene.means, None, scene.quats, scene.scales, scene.viewmats, scene.Ks, 60, 50,
                                   calc_compensations=compensations)
    assert found[0].dtype == torch.int32 and (found[0] - expected[0]).abs().max() <= 1  # rounded up
    visible = (found[0] > 0).all(-1) & (expected[0] > 0).all(-1)
    assert 0.1 < visible.double().mean() < 0.9 and (found[4] is None) != compensations
    assert ((found[0] > 0).all(-1) != (expected[0] > 0).all(-1)).sum() <= 2
    inputs = [scene.means, scene.quats, scene.scales, scene.viewmats]
    if dtype == torch.float64:
        inputs.append(scene.Ks)
        mask = torch.tensor([[1, 0, 1], [0, 1, 1], [0, 0, 0]], dtype=dtype)  # gsplat's reference has skew
        scene.Ks.register_hook(lambda gradient: gradient * mask)
    take = lambda results: [t[visible] for t in results[1:] if t is not None]
    compare(take(found), take(expected), inputs[:4])

    triangle = covars[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    of_covars = fully_fused_projection(scene.means, triangle, None, None, scene.viewmats, scene.Ks, 60, 50,
                                       calc_compensations=compensations)
    both = visible & (of_covars[0] > 0).all(-1)
    for a, b in zip(of_covars[1:], found[1:]):
        assert a is None or relative_error(a[both], b[both]) < (1e-10 if dtype == torch.float64 else 1e-3)
    packed = fully_fused_projection(scene.means, None, scene.quats, scene.scales, scene.viewmats, scene.Ks, 60, 50,
                                    calc_compensations=compensations, packed=True)
    for a, b in zip(packed[3:], found):
        assert a is None or torch.equal(a, b[packed[0], packed[1], packed[2]])


def plain_ssim(a, b, padding):
    """SSIM by five convolutions, as its authors define it."""
    x = torch.arange(11, dtype=a.dtype) - 5
    g = torch.exp(-x * x / 4.5)
    g = g / g.sum()
    channels = a.shape[1]
    window = (g[:, None] * g[None]).expand(channels, 1, 11, 11)
    blur = lambda t: torch.nn.functional.conv2d(t, window, padding=5 if padding == "same" else 0, groups=channels)
    ma, mb = blur(a), blur(b)
    va, vb, cov = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    return ((2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4))).mean()


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("padding", ("same", "valid"))
def test_ssim_is_what_its_definition_says(padding, dtype):
    g = torch.Generator().manual_seed(1)
    for shape in ((1, 3, 40, 75), (2, 1, 11, 12), (3, 3, 33, 64)):
        a, b = (torch.rand(shape, generator=g, dtype=torch.float64) for _ in range(2))
        b = (0.5 * a + 0.5 * b)
        a, b = a.to(dtype).requires_grad_(), b.to(dtype)
        exact = a.detach().double().requires_grad_()
        found, expected = fused_ssim(a, b, padding=padding), plain_ssim(exact, b.double(), padding)
        assert abs(found.item() - expected.item()) < 1e-5 and found.dtype == dtype
        found.backward()
        expected.backward()
        assert relative_error(a.grad, exact.grad) < 1e-4
        strided = b.permute(0, 2, 3, 1).contiguous().permute(0, 3, 1, 2)
        assert torch.equal(fused_ssim(a, strided, padding=padding), found)
    assert not fused_ssim(a, b, train=False).requires_grad
    assert fused_ssim(b, b).item() == 1


def test_gradcheck():
    dirs, coeffs = random(5, 3), random(5, 9, 3, seed=2)
    assert torch.autograd.gradcheck(lambda *t: spherical_harmonics(2, *t), (dirs, coeffs))
    g = torch.Generator().manual_seed(1)
    a, b = torch.rand(1, 2, 13, 12, generator=g, dtype=torch.float64), torch.rand(1, 2, 13, 12, dtype=torch.float64)
    for padding in ("same", "valid"):
        assert torch.autograd.gradcheck(lambda t: fused_ssim(t, b, padding=padding), (a.requires_grad_(),))
    scene = Scene(5, 20, 16, cameras=2, size=0.2)
    scene.means.data.mul_(0.3)

    def project(means, quats, scales, viewmats, Ks):
        return fully_fused_projection(means, None, quats, scales, viewmats, Ks, 20, 16, calc_compensations=True)[1:]

    inputs = tuple(scene.inputs[n] for n in ("means", "quats", "scales", "viewmats", "Ks"))
    assert torch.autograd.gradcheck(project, inputs, eps=1e-7, atol=1e-5, rtol=1e-4)


def test_bad_input_is_named():
    dirs, coeffs = random(5, 3), random(5, 9, 3)
    for call, error, match in (
            (lambda: spherical_harmonics(5, dirs, coeffs), ValueError, "the degree is 5, expected 0 to 4"),
            (lambda: spherical_harmonics(3, dirs, coeffs), ValueError, "9 coefficients are too few for degree 3"),
            (lambda: spherical_harmonics(1.0, dirs, coeffs), TypeError, "the degree is float"),
            (lambda: spherical_harmonics(1, dirs, coeffs.float()), TypeError, "coeffs is torch.float32"),
            (lambda: spherical_harmonics(1, dirs, coeffs, dirs[:, 0]), TypeError, "masks is torch.float64"),
            (lambda: spherical_harmonics(1, None, coeffs), TypeError, "dirs is NoneType"),
            (lambda: quat_scale_to_covar_preci(dirs, dirs), ValueError, r"quats has the shape \[5, 3\]"),
            (lambda: fused_ssim(dirs, dirs), ValueError, r"img1 has the shape \[5, 3\]"),
            (lambda: fused_ssim(torch.zeros(1, 3, 10, 20), torch.zeros(1, 3, 10, 20), "valid"), ValueError, "11 x 11"),
            (lambda: fused_ssim(torch.zeros(1, 3, 0, 20), torch.zeros(1, 3, 0, 20)), ValueError, "at least one pixel"),
            (lambda: fused_ssim(torch.zeros(1, 3, 9, 9), torch.zeros(1, 3, 9, 9), "full"), ValueError, "padding is"),
            (lambda: fused_ssim(torch.full((1, 1, 9, 9), float("nan")), torch.zeros(1, 1, 9, 9)), ValueError,
             r"img1\[0, 0, 0, 0\] is nan"),
            (lambda: fused_ssim(torch.zeros(1, 1, 9, 9), torch.zeros(1, 1, 9, 9, requires_grad=True)),
             NotImplementedError, "img2 requires a gradient")):
        with pytest.raises(error, match=match):
            call()
    scene = Scene(5, 20, 16)
    with pytest.raises(ValueError, match=r"means\[2, 1\] is nan"):
        means = scene.means.detach().clone()
        means[2, 1] = float("nan")
        fully_fused_projection(means, None, scene.quats, scene.scales, scene.viewmats, scene.Ks, 20, 16)
