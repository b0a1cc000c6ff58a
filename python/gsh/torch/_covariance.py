# SPDX-License-Identifier: Apache-2.0
"""Covariance and precision matrices of Gaussians, with gsplat's names and shapes."""

import torch

from ._checks import check_tensor

_UPPER, _LOWER = [0, 1, 2, 4, 5, 8], [0, 3, 6, 4, 7, 8]


def _rotations(quats):
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    rows = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    return torch.stack(rows, dim=-1).reshape(quats.shape[:-1] + (3, 3))


def quat_scale_to_covar_preci(quats, scales, compute_covar=True, compute_preci=True, triu=False):
    """Covariance and precision matrices, as ``gsplat.quat_scale_to_covar_preci``.

    ``quats`` [..., 4] (w, x, y, z, of any length but zero), ``scales`` [..., 3]. Returns two tensors [..., 3, 3], or
    their upper triangles by rows [..., 6] with ``triu``; None for what is not asked for.
    """
    where = "quat_scale_to_covar_preci"
    if not isinstance(quats, torch.Tensor):
        raise TypeError(f"{where}: quats is {type(quats).__name__}, expected a torch.Tensor")
    check_tensor(where, "quats", quats, (None,) * max(quats.dim() - 1, 0) + (4,))
    check_tensor(where, "scales", scales, tuple(quats.shape[:-1]) + (3,), quats.dtype)
    R = _rotations(quats)

    def product(factors):
        M = R * factors[..., None, :]
        matrices = M @ M.transpose(-1, -2)
        if not triu:
            return matrices
        flat = matrices.reshape(quats.shape[:-1] + (9,))
        return (flat[..., _UPPER] + flat[..., _LOWER]) / 2

    return product(scales) if compute_covar else None, product(1 / scales) if compute_preci else None
