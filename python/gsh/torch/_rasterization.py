# SPDX-License-Identifier: Apache-2.0
"""Rasterization of Gaussians, with gsplat's names, shapes and conventions."""

import math

import torch
from torch.autograd.function import once_differentiable

from .. import _gsh
from ._checks import check_choice, check_tensor, refuse
from ._projection import Project, ProjectionCall, check_splats, gsplat_settings
from ._sh import spherical_harmonics


class Blend(torch.autograd.Function):
    """(means2d, depths, conics, opacities, colors, backgrounds) -> (render, alphas).

    Forward rasterizes the Gaussians of ``call``, which the first four come from, in one go. These four are the way of
    the gradient.
    """

    @staticmethod
    def forward(ctx, means2d, depths, conics, opacities, colors, backgrounds, call, with_depth, absgrad):
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(colors, backgrounds)
        ctx.call, ctx.with_depth = call, with_depth
        ctx.means2d = means2d if absgrad else None
        B, C, N = call.B, call.C, call.N
        ctx.channels, ctx.per_camera = 0, False
        flat_colors = None
        if colors is not None:
            ctx.channels, ctx.per_camera = colors.shape[-1], colors.dim() == len(call.batch) + 3
            dims = (B, C, N) if ctx.per_camera else (B, N)
            flat_colors = colors.detach().reshape(dims + (ctx.channels,)).contiguous()
        flat_backgrounds = None
        if backgrounds is not None:
            flat_backgrounds = backgrounds.detach().reshape(B, C, ctx.channels).contiguous()
        size = (B, C, call.height, call.width)
        render = torch.empty(size + (ctx.channels + with_depth,), dtype=call.means.dtype)
        alphas = torch.empty(size, dtype=call.means.dtype)
        try:
            ctx.rasterizer = _gsh.rasterize(
                call.means, call.factors, call.covars, call.opacities, call.viewmats, call.Ks, call.width, call.height,
                call.settings, torch.get_num_threads(), call.radii, flat_colors, flat_backgrounds, with_depth, render,
                alphas)
        except ValueError as error:
            call.explain(error, colors=colors, backgrounds=backgrounds)
        dims = call.batch + (C, call.height, call.width)
        return render.reshape(dims + render.shape[-1:]), alphas.reshape(dims + (1,))

    @staticmethod
    @once_differentiable
    def backward(ctx, dL_drender, dL_dalphas):
        call = ctx.call
        if dL_drender is None and dL_dalphas is None:
            return (None,) * 9
        colors, backgrounds = ctx.saved_tensors
        B, C, N = call.B, call.C, call.N
        needs = ctx.needs_input_grad

        def empty(needed, *shape):
            return torch.empty(shape, dtype=call.means.dtype) if needed else None

        dL_dmeans2d, dL_ddepths = empty(needs[0], B, C, N, 2), empty(needs[1] and ctx.with_depth, B, C, N)
        dL_dconics, dL_dopacities = empty(needs[2], B, C, N, 3), empty(needs[3], B, C, N)
        channels = ctx.channels
        dL_dcolors = empty(needs[4], *((B, C, N) if ctx.per_camera else (B, N)), channels)
        dL_dbackgrounds = empty(needs[5], B, C, channels)
        absolute = empty(ctx.means2d is not None, B, C, N, 2)
        image = (B * C, call.height, call.width)
        if dL_drender is not None:
            dL_drender = dL_drender.reshape(image + dL_drender.shape[-1:])
        if dL_dalphas is not None:
            dL_dalphas = dL_dalphas.reshape(image)
        _gsh.rasterize_backward(ctx.rasterizer, call.means, call.viewmats, call.width, call.height,
                                torch.get_num_threads(), channels, ctx.per_camera, ctx.with_depth, dL_drender,
                                dL_dalphas, dL_dmeans2d, dL_ddepths, dL_dconics, dL_dopacities, dL_dcolors,
                                dL_dbackgrounds, absolute)

        def result(gradient):
            return None if gradient is None else call.result(gradient)

        if absolute is not None:
            ctx.means2d.absgrad = result(absolute)
        return (result(dL_dmeans2d), result(dL_ddepths), result(dL_dconics), result(dL_dopacities),
                None if dL_dcolors is None else dL_dcolors.reshape(colors.shape),
                None if dL_dbackgrounds is None else dL_dbackgrounds.reshape(backgrounds.shape), None, None, None)


def _is_global_shutter(shutter):
    return shutter is None or getattr(shutter, "name", shutter) == "GLOBAL"


def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height, near_plane=0.01,
                  far_plane=1e10, radius_clip=0.0, eps2d=0.3, sh_degree=None, packed=True, tile_size=16,
                  backgrounds=None, render_mode="RGB", sparse_grad=False, absgrad=False, rasterize_mode="classic",
                  channel_chunk=32, distributed=False, camera_model="pinhole", segmented=False, covars=None,
                  with_ut=False, with_eval3d=False, radial_coeffs=None, tangential_coeffs=None,
                  thin_prism_coeffs=None, ftheta_coeffs=None, rolling_shutter=None, viewmats_rs=None):
    """Renders Gaussians on the CPU, as ``gsplat.rasterization``.

    ``means`` [..., N, 3], ``quats`` [..., N, 4] (w, x, y, z, of any length), ``scales`` [..., N, 3], ``opacities``
    [..., N], ``colors`` [..., (C,) N, D] or, with ``sh_degree``, [..., (C,) N, K, 3]; ``viewmats`` [..., C, 4, 4]
    (camera from world), ``Ks`` [..., C, 3, 3], ``backgrounds`` [..., C, D], ``covars`` [..., N, 3, 3] in place of quats
    and scales. All are float32, or all float64. The names, shapes and defaults are those of gsplat 1.5.3.

    Returns the images [..., C, height, width, D (+ 1)], alphas [..., C, height, width, 1], and a dictionary with
    ``means2d``, ``radii``, ``depths``, ``conics``, ``opacities`` and sizes. ``means2d.grad`` (after ``retain_grad()``)
    and, with ``absgrad``, ``means2d.absgrad`` serve density control.

    Gradients flow to every tensor, ``Ks`` included. What a CPU does not have (other camera models, lens distortion,
    rolling shutter, the unscented transform, sparse gradients, several ranks) raises NotImplementedError.
    """
    where = "rasterization"
    check_choice(where, "render_mode", render_mode, ("RGB", "D", "ED", "RGB+D", "RGB+ED"))
    check_choice(where, "rasterize_mode", rasterize_mode, ("classic", "antialiased"))
    check_choice(where, "camera_model", camera_model, ("pinhole", "ortho", "fisheye", "ftheta"))
    refuse(where, camera_model != "pinhole", f"camera_model {camera_model!r} is not available, only 'pinhole'")
    refuse(where, sparse_grad, "sparse_grad is not available; gradients are dense")
    refuse(where, distributed, "distributed is not available")
    refuse(where, with_ut or with_eval3d, "with_ut and with_eval3d are not available")
    for name, value in (("radial_coeffs", radial_coeffs), ("tangential_coeffs", tangential_coeffs),
                        ("thin_prism_coeffs", thin_prism_coeffs), ("ftheta_coeffs", ftheta_coeffs)):
        refuse(where, value is not None, f"{name}: lens distortion is not available; undistort the images")
    refuse(where, not _is_global_shutter(rolling_shutter) or viewmats_rs is not None,
           "rolling shutter is not available")
    check_splats(where, means, quats, scales, covars, opacities, viewmats, Ks, width, height)
    batch, N, C, dtype = tuple(means.shape[:-2]), means.shape[-2], viewmats.shape[-3], means.dtype
    if covars is not None:
        check_tensor(where, "covars", covars, batch + (N, 3, 3), dtype)
        covars = covars[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        quats = scales = None
    if not isinstance(colors, torch.Tensor):
        raise TypeError(f"{where}: colors is {type(colors).__name__}, expected a torch.Tensor")
    numbers = 1 if sh_degree is None else 2
    per_camera = colors.dim() == len(batch) + 2 + numbers
    check_tensor(where, "colors", colors, batch + ((C,) if per_camera else ()) + (N,)
                 + ((None,) if sh_degree is None else (None, 3)), dtype)
    channels = colors.shape[-1]
    if backgrounds is not None:
        check_tensor(where, "backgrounds", backgrounds, batch + (C, channels), dtype)

    settings = gsplat_settings(eps2d, near_plane, far_plane, radius_clip, rasterize_mode == "antialiased")
    call = ProjectionCall(where, means, quats, scales, covars, opacities, viewmats, Ks, width, height, settings)
    radii, means2d, depths, conics, _, on_image = Project.apply(means, quats, scales, covars, opacities, viewmats, Ks,
                                                                call, bool(packed))
    batch_ids, camera_ids, gaussian_ids = call.packed_ids or (None, None, None)
    if sh_degree is not None:
        centers = torch.inverse(viewmats)[..., :3, 3]
        directions = means[..., None, :, :] - centers[..., None, :]
        coefficients = colors if per_camera else colors[..., None, :, :, :].expand(batch + (C,) + colors.shape[-3:])
        visible = (call.radii > 0).all(dim=-1).reshape(batch + (C, N))
        colors = spherical_harmonics(sh_degree, directions, coefficients, masks=visible)
        colors = torch.clamp_min(colors + 0.5, 0.0)
    with_color, with_depth = render_mode.startswith("RGB"), render_mode != "RGB"
    render, alphas = Blend.apply(means2d, depths, conics, on_image, colors if with_color else None,
                                 backgrounds if with_color else None, call, with_depth, bool(absgrad))
    if render_mode.endswith("ED"):
        depth = render[..., -1:] / alphas.clamp(min=1e-10)
        render = torch.cat((render[..., :-1], depth), dim=-1) if with_color else depth
    tile_size = int(tile_size)
    meta = {
        "batch_ids": batch_ids, "camera_ids": camera_ids, "gaussian_ids": gaussian_ids, "radii": radii,
        "means2d": means2d, "depths": depths, "conics": conics, "opacities": on_image,
        "tile_width": math.ceil(call.width / tile_size), "tile_height": math.ceil(call.height / tile_size),
        "tile_size": tile_size, "width": width, "height": height, "n_batches": call.B, "n_cameras": C,
    }
    return render, alphas, meta
