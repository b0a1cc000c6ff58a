# SPDX-License-Identifier: Apache-2.0
"""Random Gaussians and cameras for tests."""

import torch


class Scene:
    """``count`` Gaussians in a box of two metres, and ``cameras`` cameras in front of it, for each of ``batch``."""

    def __init__(self, count, width, height, cameras=1, batch=(), dtype=torch.float64, size=0.05, seed=1):
        g = torch.Generator().manual_seed(seed)

        def random(*shape, normal=False):
            make = torch.randn if normal else torch.rand
            return make(batch + shape, generator=g, dtype=torch.float64)

        self.width, self.height = width, height
        means, quats = 2 * random(count, 3) - 1, random(count, 4, normal=True)
        scales = size * torch.exp(0.5 * random(count, 3, normal=True))
        opacities, colors, backgrounds = random(count), random(count, 3), random(cameras, 3)
        viewmats = torch.eye(4, dtype=torch.float64).expand(batch + (cameras, 4, 4)).clone()
        viewmats[..., 2, 3] = 3 + 0.2 * torch.arange(cameras)
        viewmats[..., 0, 3] = 0.1
        viewmats[..., :3, :3] += 0.05 * random(cameras, 3, 3, normal=True)  # any linear map will do
        Ks = torch.tensor([[width, 0, 0.47 * width], [0, 1.1 * width, 0.53 * height], [0, 0, 1]], dtype=torch.float64)
        self.inputs = dict(means=means, quats=quats, scales=scales, opacities=opacities, colors=colors,
                           viewmats=viewmats, Ks=Ks.expand(batch + (cameras, 3, 3)).clone(), backgrounds=backgrounds)
        self.inputs = {name: t.to(dtype).requires_grad_() for name, t in self.inputs.items()}

    def __getattr__(self, name):
        return self.inputs[name]

    def clone(self, dtype):
        return {name: t.detach().to(dtype).requires_grad_() for name, t in self.inputs.items()}


def weights_like(tensor, seed=2):
    """Weights of a linear loss."""
    g = torch.Generator().manual_seed(seed)
    return torch.randn(tensor.shape, generator=g, dtype=torch.float64).to(tensor.dtype)


def relative_error(found, expected):
    """The largest difference relative to the largest number of ``expected``."""
    found = torch.zeros_like(expected) if found is None else found.to(expected.dtype)
    return ((found - expected).abs().max() / expected.abs().max().clamp(min=1e-300)).item()
