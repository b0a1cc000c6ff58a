# SPDX-License-Identifier: Apache-2.0
"""Fits the pose of an avatar to photographs of one moment with Adam.

python fit_a_pose.py avatar.gsh capture frame       with the layout of docs/captures.md; needs numpy and pillow
"""

import json
import sys
from pathlib import Path

import numpy as np
import torch
from gsh.torch import Avatar, fused_ssim
from PIL import Image

avatar = Avatar(sys.argv[1])
capture, frame = Path(sys.argv[2]), int(sys.argv[3])
views = []
for camera in json.loads((capture / "cameras.json").read_text())["cameras"]:
    viewmat = torch.eye(4)
    viewmat[:3, :3], viewmat[:3, 3] = torch.tensor(camera["R"]).reshape(3, 3), torch.tensor(camera["t"]).reshape(3)
    pixels = np.asarray(Image.open(sorted((capture / "images" / camera["name"]).iterdir())[frame]), np.float32) / 255
    photo = torch.tensor(pixels[..., :3] * pixels[..., 3:] + 1 - pixels[..., 3:])  # over white
    views.append((viewmat, torch.tensor(camera["K"]).reshape(3, 3), photo))

poses = np.load(capture / "poses_noisy.npz")
parts = ("global_orient", "body_pose", "jaw_pose", "leye_pose", "reye_pose", "left_hand_pose", "right_hand_pose")
pose = torch.tensor(np.concatenate([poses[part][frame] for part in parts])).reshape(-1, 3).requires_grad_()
transl = torch.tensor(poses["transl"][frame]).requires_grad_()
optimizer = torch.optim.Adam([{"params": [pose], "lr": 5e-3}, {"params": [transl], "lr": 1e-3}])
for step in range(101):
    viewmat, K, photo = views[step % len(views)]
    image, _ = avatar(pose, transl, viewmat, K, photo.shape[1], photo.shape[0])
    ssim = fused_ssim(image.permute(2, 0, 1)[None], photo.permute(2, 0, 1)[None])
    loss = 0.8 * (image - photo).abs().mean() + 0.2 * (1 - ssim)
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    if step % 20 == 0:
        print(f"step {step}: loss {loss.item():.4f}")
true = np.load(capture / "poses.npz")
error = (transl.detach().numpy() - true["transl"][frame]) * 1000
print(f"translation: {np.linalg.norm(error):.1f} mm from the truth")
