# SPDX-License-Identifier: Apache-2.0
"""An avatar as a module: a pose and a camera in, an image out, with gradients."""

import os

import torch
from torch.autograd.function import once_differentiable

from .. import _gsh
from ._checks import check_finite, check_size, check_tensor
from ._projection import Project, ProjectionCall
from ._rasterization import Blend


class Pose(torch.autograd.Function):
    """(pose, coefficients, transl, center) -> (means, covars, opacities, colors) of the avatar's splats."""

    @staticmethod
    def forward(ctx, pose, coefficients, transl, center, avatar):
        ctx.sizes = avatar._sizes
        N = avatar.count
        splats = tuple(torch.empty(shape) for shape in ((N, 3), (N, 6), (N,), (N, 3)))
        ctx.posed = _gsh.pose_avatar(avatar._handle, *ctx.sizes, *(t.detach().contiguous() for t in
                                                                   (pose, coefficients, transl, center)), *splats)
        return splats

    @staticmethod
    @once_differentiable
    def backward(ctx, *gradients):
        joints, coefficients, _ = ctx.sizes
        out = tuple(torch.zeros(shape) for shape in ((joints, 3), (coefficients,), (3,), (3,)))
        _gsh.pose_avatar_backward(ctx.posed, *ctx.sizes, *(g.contiguous() for g in gradients), *out)
        return out + (None,)


class Avatar(torch.nn.Module):
    """An avatar of a file that gsh-reconstruct or gsh-export wrote (avatar.gsh).

    ``forward`` renders it; gradients flow to the pose, the shape and the camera, not to the avatar itself. Images are
    those of gsh-render: display-referred sRGB, with the avatar's own pixel filter. ``count`` is the number of
    Gaussians, ``joint_count`` that of joints; ``betas`` [S] is the avatar's own shape. The edges of shadows that a
    light casts pass no gradient (``is_lit``). float32.
    """

    def __init__(self, path):
        super().__init__()
        self.path = os.fspath(path)
        (self._handle, self.count, self.joint_count, self.beta_count, self.expression_count, dilation, compensate,
         self.is_lit, betas) = _gsh.open_avatar(self.path, torch.get_num_threads())
        self.register_buffer("betas", torch.tensor(betas, dtype=torch.float32), persistent=False)
        self._sizes = (self.joint_count, self.beta_count + self.expression_count, self.count)
        # As gsh::RasterParams: dilation, near plane; far plane, smallest radius; compensation and its floor; largest
        # alpha, least transmittance.
        self._settings = (dilation, 0.2, 1e10, 0.0, compensate, 0.000025, 0.99, 1e-4)

    def extra_repr(self):
        return f"{self.path!r}, {self.count} Gaussians, {self.joint_count} joints"

    def splats(self, pose, transl, center, betas=None, expression=None):
        """means [N, 3], covariances [N, 6] (xx xy xz yy yz zz), opacities [N], colors [N, 3] of a pose, in the world,
        as seen from ``center`` [3]. The other arguments are those of ``forward``."""
        where = "Avatar"
        check_tensor(where, "pose", pose, (self.joint_count, 3), torch.float32)
        check_tensor(where, "transl", transl, (3,), torch.float32)
        check_tensor(where, "center", center, (3,), torch.float32)
        betas = self.betas if betas is None else betas
        check_tensor(where, "betas", betas, (self.beta_count,), torch.float32)
        if expression is None:
            expression = torch.zeros(self.expression_count)
        check_tensor(where, "expression", expression, (self.expression_count,), torch.float32)
        check_finite(where, pose=pose, transl=transl, center=center, betas=betas, expression=expression)
        return Pose.apply(pose, torch.cat((betas, expression)), transl, center, self)

    def forward(self, pose, transl, viewmat, K, width, height, betas=None, expression=None, background=None):
        """The image [height, width, 3] and alpha [height, width, 1].

        ``pose`` [J, 3]: axis-angle of each joint against its parent, in the order of the body's joints; ``transl``
        [3] metres; ``viewmat`` [4, 4] camera from world, ``K`` [3, 3]; ``betas`` [S] (None: the avatar's own),
        ``expression`` [E] (None: neutral), ``background`` [3] (None: white).
        """
        where = "Avatar"
        check_tensor(where, "viewmat", viewmat, (4, 4), torch.float32)
        check_tensor(where, "K", K, (3, 3), torch.float32)
        check_size(where, width, height)
        check_finite(where, viewmat=viewmat, K=K)
        background = torch.ones(3) if background is None else background
        check_tensor(where, "background", background, (3,), torch.float32)
        center = -torch.linalg.solve(viewmat[:3, :3], viewmat[:3, 3])
        means, covars, opacities, colors = self.splats(pose, transl, center, betas, expression)
        viewmats, Ks = viewmat[None], K[None]
        call = ProjectionCall(where, means, None, None, covars, opacities, viewmats, Ks, width, height, self._settings)
        _, means2d, depths, conics, _, opacities = Project.apply(means, None, None, covars, opacities, viewmats, Ks,
                                                                 call, False)
        image, alpha = Blend.apply(means2d, depths, conics, opacities, colors, background[None], call, False, False)
        return image[0], alpha[0]
