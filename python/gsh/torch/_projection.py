# SPDX-License-Identifier: Apache-2.0
"""Projection of Gaussians onto images, with gsplat's names and shapes."""

import math

import torch
from torch.autograd.function import once_differentiable

from .. import _gsh
from ._checks import check_choice, check_size, check_tensor, explain, refuse


def gsplat_settings(eps2d, near_plane, far_plane, radius_clip, antialiased):
    """The settings of a projection and of a blend with the constants of gsplat 1.5: no lower limit of the
    compensation, alpha at most 0.999, and a transmittance that does not fall to 1e-4."""
    return (float(eps2d), float(near_plane), float(far_plane), float(radius_clip), bool(antialiased), 1e-30, 0.999,
            1e-4)


class ProjectionCall:
    """The sizes, the settings and the flat arrays of one call. Arrays are [B, N, ...] and [B, C, ...]."""

    def __init__(self, where, means, quats, scales, covars, opacities, viewmats, Ks, width, height, settings):
        self.where = where
        batch = means.shape[:-2]
        B, N, C = math.prod(batch), means.shape[-2], viewmats.shape[-3]
        self.batch, self.B, self.N, self.C = batch, B, N, C
        self.width, self.height, self.settings = int(width), int(height), settings

        def flat(tensor, *shape):
            return None if tensor is None else tensor.detach().reshape(shape).contiguous()

        self.means = flat(means, B, N, 3)
        self.quats, self.scales = flat(quats, B, N, 4), flat(scales, B, N, 3)
        self.covars = flat(covars, B, N, 6)
        self.opacities = flat(opacities, B, N)
        self.viewmats, self.Ks = flat(viewmats, B, C, 4, 4), flat(Ks, B, C, 3, 3)
        self.radii = self.ids = self.packed_ids = self.factors = None

    @property
    def compensates(self):
        return self.settings[4]

    def shapes(self):
        return self.quats, self.scales, self.covars

    def empty(self, *numbers):
        return torch.empty((self.B, self.C, self.N) + numbers, dtype=self.means.dtype)

    def project(self):
        """radii, means2d, depths, conics, compensations, opacities as [B, C, N, ...]; the last two may be None."""
        self.radii = torch.empty((self.B, self.C, self.N, 2), dtype=torch.int32)
        means2d, depths, conics = self.empty(2), self.empty(), self.empty(3)
        compensations = self.empty() if self.compensates else None
        opacities = None if self.opacities is None else self.empty()
        if self.quats is not None:
            self.factors = torch.empty((self.B, self.N, 9), dtype=self.means.dtype)
        try:
            _gsh.project(self.means, *self.shapes(), self.opacities, self.viewmats, self.Ks, self.width, self.height,
                         self.settings, torch.get_num_threads(), self.radii, means2d, depths, conics, compensations,
                         opacities, self.factors)
        except ValueError as error:
            self.explain(error)
        return self.radii, means2d, depths, conics, compensations, opacities

    def find_packed(self):
        """Makes the results packed: rows of the Gaussians that are not culled."""
        ids = torch.empty((4, self.B * self.C * self.N), dtype=torch.int64)
        count = _gsh.find_visible(self.radii, ids)
        self.ids, *self.packed_ids = ids[:, :count]  # in [B * C * N]; batch_ids, camera_ids, gaussian_ids

    def result(self, numbers):
        """An array [B, C, N, ...] in the shape that users see: [..., C, N, ...], or packed."""
        if self.ids is None:
            return numbers.reshape(self.batch + numbers.shape[1:])
        packed = torch.empty(self.ids.shape + numbers.shape[3:], dtype=numbers.dtype)
        rows = (-1, math.prod(numbers.shape[3:]))
        if len(packed):
            _gsh.gather_rows(numbers.view(rows), self.ids, torch.get_num_threads(), packed.view(rows))
        return packed

    def unpacked(self, gradient):
        """The gradient of a result as a contiguous array [B, C, N, ...]; None stays None."""
        if gradient is None:
            return None
        dims = (self.B, self.C, self.N)
        if self.ids is None:
            return gradient.reshape(dims + gradient.shape[len(self.batch) + 2:]).contiguous()
        numbers = gradient.shape[1:]
        if not len(gradient):
            return torch.zeros(dims + numbers, dtype=gradient.dtype)
        full = torch.empty(dims + numbers, dtype=gradient.dtype)
        rows = (-1, math.prod(numbers))
        _gsh.scatter_rows(gradient.contiguous().view(rows), self.ids, torch.get_num_threads(), full.view(rows))
        return full

    def explain(self, error, **others):
        batch, cameras = self.batch, self.batch + (self.C,)

        def shaped(tensor, dims):
            return None if tensor is None else tensor.reshape(dims + tensor.shape[2:])

        explain(self.where, error, quats=shaped(self.quats, batch + (self.N,)),
                means=shaped(self.means, batch + (self.N,)), scales=shaped(self.scales, batch + (self.N,)),
                covars=shaped(self.covars, batch + (self.N,)), opacities=shaped(self.opacities, batch + (self.N,)),
                viewmats=shaped(self.viewmats, cameras), Ks=shaped(self.Ks, cameras), **others)


class Project(torch.autograd.Function):
    """(means, quats, scales, covars, opacities, viewmats, Ks) ->
    (radii, means2d, depths, conics, compensations, opacities), as ``call.result`` shapes them."""

    @staticmethod
    def forward(ctx, means, quats, scales, covars, opacities, viewmats, Ks, call, packed):
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(means, quats, scales, covars, opacities, viewmats, Ks) # torch then sees changes in place
        ctx.call = call
        numbers = call.project()
        if packed:
            call.find_packed()
        results = tuple(None if t is None else call.result(t) for t in numbers)
        ctx.mark_non_differentiable(results[0])
        return results

    @staticmethod
    @once_differentiable
    def backward(ctx, _, *gradients):
        call = ctx.call
        inputs = ctx.saved_tensors
        if all(g is None for g in gradients):
            return (None,) * 9
        flat = (call.means, call.quats, call.scales, call.covars, call.opacities, call.viewmats, call.Ks)
        out = [torch.empty_like(t) if t is not None and needed else None
               for t, needed in zip(flat, ctx.needs_input_grad)]
        _gsh.project_backward(*flat, call.width, call.height, call.settings, torch.get_num_threads(), call.radii,
                              *(call.unpacked(g) for g in gradients), *out)
        return tuple(None if g is None else g.reshape(t.shape) for g, t in zip(out, inputs)) + (None, None)


def check_splats(where, means, quats, scales, covars, opacities, viewmats, Ks, width, height):
    check_tensor(where, "means", means, (None,) * (means.dim() - 2 if isinstance(means, torch.Tensor) else 0)
                 + (None, 3))
    batch, N, dtype = tuple(means.shape[:-2]), means.shape[-2], means.dtype
    if covars is None:
        check_tensor(where, "quats", quats, batch + (N, 4), dtype)
        check_tensor(where, "scales", scales, batch + (N, 3), dtype)
    if opacities is not None:
        check_tensor(where, "opacities", opacities, batch + (N,), dtype)
    check_tensor(where, "viewmats", viewmats, batch + (None, 4, 4), dtype)
    check_tensor(where, "Ks", Ks, batch + (viewmats.shape[-3], 3, 3), dtype)
    check_size(where, width, height)


def fully_fused_projection(means, covars, quats, scales, viewmats, Ks, width, height, eps2d=0.3, near_plane=0.01,
                           far_plane=1e10, radius_clip=0.0, packed=False, sparse_grad=False, calc_compensations=False,
                           camera_model="pinhole", opacities=None):
    """Projects Gaussians onto the images of cameras, as ``gsplat.fully_fused_projection``.

    ``covars`` is [..., N, 6], the upper triangle by rows, or None: then ``quats`` [..., N, 4] (w, x, y, z) and
    ``scales`` [..., N, 3] give the shape. Returns radii [..., C, N, 2] (0: culled), means2d [..., C, N, 2], depths
    [..., C, N], conics [..., C, N, 3], compensations [..., C, N] or None. With ``packed``, batch_ids, camera_ids and
    gaussian_ids of the Gaussians that are not culled come first, and the others are [nnz, ...]. Everything but the
    radii is differentiable, with respect to ``viewmats`` and ``Ks``, too.
    """
    where = "fully_fused_projection"
    check_choice(where, "camera_model", camera_model, ("pinhole", "ortho", "fisheye", "ftheta"))
    refuse(where, camera_model != "pinhole", f"camera_model {camera_model!r} is not available, only 'pinhole'")
    refuse(where, sparse_grad, "sparse_grad is not available; gradients are dense")
    check_splats(where, means, quats, scales, covars, opacities, viewmats, Ks, width, height)
    if covars is not None:
        check_tensor(where, "covars", covars, tuple(means.shape[:-1]) + (6,), means.dtype)
        quats = scales = None
    settings = gsplat_settings(eps2d, near_plane, far_plane, radius_clip, calc_compensations)
    call = ProjectionCall(where, means, quats, scales, covars, opacities, viewmats, Ks, width, height, settings)
    results = Project.apply(means, quats, scales, covars, opacities, viewmats, Ks, call, bool(packed))[:5]
    return tuple(call.packed_ids) + results if packed else results
