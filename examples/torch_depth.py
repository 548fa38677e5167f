# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Train a small PyTorch network on rendered depth without a copy, on a GPU if available."""

import sys

import numpy as np

try:
    import torch
except ImportError:
    sys.exit("this example needs PyTorch: pip install torch")
import trimesh
import warp as wp

import warpvis as wv

wp.config.log_level = wp.LOG_WARNING
VIEWS, SIZE, FAR = 32, 64, 4.0

device = "cuda:0" if torch.cuda.is_available() and wp.is_cuda_available() else "cpu"
scene = wv.Scene(device=device)
scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
scene.add(trimesh.creation.icosphere(radius=0.4), name="ball", label="object", pose=(0, 0, 0.4, 0, 0, 0, 1))
angles = np.linspace(0, 2 * np.pi, VIEWS, endpoint=False)
eyes = np.stack([2 * np.cos(angles), 2 * np.sin(angles), np.linspace(0.5, 2, VIEWS)], axis=1)
poses = np.stack([wv.look_at(eye, (0, 0, 0.4)) for eye in eyes])

# Empty pixels get the depth of the far plane, since the network needs finite numbers.
camera = wv.Camera.from_fov(SIZE, SIZE, hfov=1.0, near=0.1, far=FAR)
renderer = wv.Renderer(scene, camera, outputs=("depth", "labels"), fill="far")
views = renderer.render(poses)
depth = torch.from_dlpack(views.depth)
same = depth.data_ptr() == views.depth.ptr
print(f"depth is a tensor {tuple(depth.shape)} on {depth.device}, of {'the same' if same else 'other'} memory")

torch.manual_seed(0)
network = torch.nn.Sequential(
    torch.nn.Conv2d(1, 8, 5, stride=2), torch.nn.ReLU(),
    torch.nn.Conv2d(8, 16, 5, stride=2), torch.nn.ReLU(),
    torch.nn.Flatten(), torch.nn.Linear(16 * 13 * 13, 1),
).to(depth.device)  # fmt: skip
images = depth[:, None] / FAR  # (views, 1, height, width)

# The network learns the fraction of the image that the ball covers, which is known from the labels.
is_ball = torch.from_dlpack(views.labels) == int(wv.Label.OBJECT)
share = is_ball.float().mean(dim=(1, 2))
optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
losses = []
for _ in range(60):
    loss = torch.nn.functional.mse_loss(network(images)[:, 0], share)
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    losses.append(loss.item())
print(f"the error fell from {losses[0] ** 0.5:.3f} to {losses[-1] ** 0.5:.3f}, of shares of {share.mean():.3f}")

# The next images are rendered into the same memory: the tensor is updated without another call of from_dlpack.
renderer.render(poses[::-1], out=views)
with torch.no_grad():
    turned = network(images.copy_(depth[:, None] / FAR))[:, 0]
print(f"the first view is the last now: {turned[0]:.3f} for {share[-1]:.3f}")
