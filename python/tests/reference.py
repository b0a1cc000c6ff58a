# SPDX-License-Identifier: Apache-2.0
"""A dense rasterizer in plain torch, after gsplat's published conventions: every Gaussian at every pixel.

It loops over Gaussians, front to back, and serves as the reference for values and, by autograd, for gradients.
"""

import torch

ALPHA_MIN, ALPHA_MAX, TRANSMITTANCE_MIN = 1 / 255, 0.999, 1e-4


def rotations(quats):
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    return torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1).reshape(-1, 3, 3)


def project(means, quats, scales, viewmat, K, width, height, near=0.01, far=1e10, eps2d=0.3, antialiased=False):
    """means2d, depths, covariances, factors of the opacity, and which Gaussians are in front, for one camera."""
    M = rotations(quats) * scales[:, None, :]
    R, t = viewmat[:3, :3], viewmat[:3, 3]
    p = means @ R.T + t
    depth = p[:, 2]
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    in_front = (depth >= near) & (depth <= far)
    z = torch.where(in_front, depth, torch.ones_like(depth))
    x, y = p[:, 0] / z, p[:, 1] / z
    means2d = torch.stack([fx * x + cx, fy * y + cy], -1)
    x = torch.minimum(torch.maximum(x, -(cx + 0.15 * width) / fx), (1.15 * width - cx) / fx)
    y = torch.minimum(torch.maximum(y, -(cy + 0.15 * height) / fy), (1.15 * height - cy) / fy)
    o = torch.zeros_like(z)
    J = torch.stack([fx / z, o, -fx * x / z, o, fy / z, -fy * y / z], -1).reshape(-1, 2, 3)
    A = J @ R @ M
    sharp = A @ A.transpose(1, 2)
    dilated = sharp + eps2d * torch.eye(2, dtype=means.dtype)
    factor = torch.ones_like(z)
    if antialiased:
        factor = torch.sqrt(torch.clamp_min(torch.linalg.det(sharp) / torch.linalg.det(dilated), 1e-30))
    return means2d, depth, dilated, factor, in_front


def rasterize(means, quats, scales, opacities, colors, viewmat, K, width, height, background=None, depth=False,
              means2d_offset=None, **settings):
    """The image [H, W, D (+ 1)] and alpha [H, W, 1] of one camera."""
    means2d, z, covariances, factor, in_front = project(means, quats, scales, viewmat, K, width, height, **settings)
    if means2d_offset is not None:
        means2d = means2d + means2d_offset
    if depth:
        colors = torch.cat([colors, z[:, None]], -1)
    conics = torch.linalg.inv(covariances)
    opacities = opacities * factor
    ys, xs = torch.meshgrid(torch.arange(height, dtype=means.dtype) + 0.5, torch.arange(width, dtype=means.dtype) + 0.5,
                            indexing="ij")
    pixels = torch.stack([xs, ys], -1)
    T = torch.ones(height, width, dtype=means.dtype)
    stopped = torch.zeros(height, width, dtype=torch.bool)
    image = torch.zeros(height, width, colors.shape[1], dtype=means.dtype)
    for i in torch.argsort(z.detach(), stable=True):
        if not in_front[i]:
            continue
        d = pixels - means2d[i]
        alpha = opacities[i] * torch.exp(-0.5 * torch.einsum("hwi,ij,hwj->hw", d, conics[i], d))
        alpha = torch.clamp_max(alpha, ALPHA_MAX)
        alpha = torch.where(alpha >= ALPHA_MIN, alpha, torch.zeros_like(alpha))
        after = T * (1 - alpha)
        stopped = stopped | (after.detach() <= TRANSMITTANCE_MIN)
        weight = torch.where(stopped, torch.zeros_like(T), alpha * T)
        image = image + weight[..., None] * colors[i]
        T = torch.where(stopped, T, after)
    if background is not None:
        if depth:
            background = torch.cat([background, background.new_zeros(1)])
        image = image + T[..., None] * background
    return image, 1 - T[..., None]
