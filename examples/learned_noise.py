# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Train a small network to imitate a RealSense D435, use it as a sensor, and compare errors by depth.

An optional argument is the file of a picture.
"""

import itertools
import sys

import numpy as np

try:
    import torch
except ImportError:
    sys.exit("this example needs PyTorch: pip install torch")
import matplotlib.pyplot as plt  # noqa: TID253
import trimesh
import warp as wp
from torch import nn  # noqa: TID253
from torch.nn import functional  # noqa: TID253

import warpvis as wv

wp.config.log_level = wp.LOG_WARNING
VIEWS, STEPS = 64, 240
device = "cuda:0" if torch.cuda.is_available() and wp.is_cuda_available() else "cpu"
d435 = wv.sensors.realsense_d435(160, 120)
camera = d435.camera()


def make_room(seed):
    """Return a closed room of 6x6x3 m with boxes on its floor, and poses of a camera in it."""
    rng = np.random.default_rng(seed)
    scene = wv.Scene(device=device)
    room = trimesh.creation.box((6, 6, 3))
    room.invert()
    scene.add(room, name="room", pose=(0, 0, 1.5, 0, 0, 0, 1))
    for number in range(24):
        x, y, z = rng.uniform(0.15, 0.8, 3)
        pose = (*rng.uniform(-2.5, 2.5, 2), z / 2, 0, 0, 0, 1)
        scene.add(trimesh.creation.box((x, y, z)), name=f"box {number}", pose=pose)
    eyes, targets = rng.uniform(-2.5, 2.5, (2, VIEWS, 3))
    eyes[:, 2], targets[:, 2] = rng.uniform(0.9, 1.6, VIEWS), rng.uniform(0, 0.8, VIEWS)
    return scene, np.stack([wv.look_at(eye, target) for eye, target in zip(eyes, targets, strict=True)])


class Imitation(nn.Module):
    """Adds the errors and the holes of a stereo camera, whose errors of inverse depth are similar at all distances."""

    def __init__(self):
        """Create the layers, which work at half the resolution."""
        super().__init__()
        self.layers = nn.Sequential(
            nn.PixelUnshuffle(2),
            nn.Conv2d(20, 32, 3, padding=1), nn.ReLU(),
            nn.Conv2d(32, 32, 3, padding=1), nn.ReLU(),
            nn.Conv2d(32, 32, 3, padding=1), nn.ReLU(),
            nn.Conv2d(32, 12, 3, padding=1),
            nn.PixelShuffle(2),
        )  # fmt: skip

    def predict(self, depth, normals):
        """Return mean and deviation of inverse depth [1/m], and the logit that a pixel is lost."""
        inverse = 1 / depth
        nearest = functional.max_pool2d(inverse, 7, stride=1, padding=3)  # a matching window spreads near surfaces
        shift, spread, lost = self.layers(torch.cat([inverse, nearest, normals], dim=1)).split(1, dim=1)
        return inverse + 0.1 * shift, 0.01 * functional.softplus(spread) + 1e-4, lost

    def forward(self, depth, normals, noise):
        """Return measured depth [m]; NaN is a hole."""
        mean, sigma, lost = self.predict(depth, normals)
        return torch.where(lost > 0, torch.nan, 1 / (mean + sigma * smooth(noise)))


def smooth(noise, sigma=1.7):
    """Return noise that neighbors share, with the same variance, as a camera that matches windows of pixels has."""
    steps = torch.arange(-5, 6, device=noise.device) / sigma
    weights = torch.exp(-(steps**2) / 2)
    weights = (weights / weights.norm())[None, None, None]
    noise = functional.conv2d(functional.pad(noise, (5, 5, 5, 5), "reflect"), weights)
    return functional.conv2d(noise, weights.transpose(2, 3))


pairs = []


def record(exact, normals, measured):
    """Keep the images that a network learns from. A function is a sensor, too."""
    pairs.append([image.clone() for image in (exact, normals, measured)])
    return measured


recorder = wv.sensors.LearnedDepth(record, ("true_depth", "camera_normals", "depth"), of=d435)
for seed in (1, 2):
    scene, poses = make_room(seed)
    wv.render(scene, camera, poses, sensor=recorder, seed=seed)
exact, normals, measured = (torch.cat(images) for images in zip(*pairs, strict=True))

torch.manual_seed(0)
network = Imitation().to(exact.device)
print(f"{sum(weights.numel() for weights in network.parameters())} weights learn from {len(exact)} images")
optimizer = torch.optim.Adam(network.parameters(), lr=5e-3)
schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 5e-3, STEPS)
for step in range(STEPS):
    some = torch.randint(len(exact), (2,), device=exact.device)
    mean, sigma, lost = network.predict(exact[some], normals[some])
    found = measured[some].isfinite()
    error = (torch.where(found, 1 / measured[some], mean) - mean) / sigma
    loss = torch.where(found, 1.25 * error.abs() + sigma.log(), 0).mean()  # sqrt(pi / 2): sigma is that of a normal
    loss = loss + 5 * functional.binary_cross_entropy_with_logits(lost, (~found).float())
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    schedule.step()
    if step % 50 == 0 or step == STEPS - 1:
        print(f"step {step:3}: loss {loss.item():.2f}")
network.eval()

# Another room, rendered with the D435 and with the network that imitates it.
learned = wv.sensors.LearnedDepth(network, ("depth", "camera_normals", "noise"), batch=16)
scene, poses = make_room(3)
sensors = {"D435": d435, "imitation": learned}
error = {}
for name, sensor in sensors.items():
    views = wv.render(scene, camera, poses, outputs=("depth", "true_depth"), sensor=sensor, seed=3)
    depth, true_depth = views.depth.numpy(), views.true_depth.numpy()
    error[name] = 1000 * np.where(np.isfinite(depth), depth - true_depth, np.nan)

edges = np.array([0.5, 1, 1.5, 2, 2.5, 3, 4, 5])
typical = {name: [] for name in sensors}
print("depth [m]    " + "".join(f"{name:>10}: lost, error" for name in sensors))
for low, high in itertools.pairwise(edges):
    inside = (low <= true_depth) & (true_depth < high)
    line = f"{low:.1f} to {high:.1f}: "
    for name in sensors:
        values = error[name][inside]
        typical[name].append(1.4826 * np.nanmedian(np.abs(values)))
        line += f"{np.isnan(values).mean():15.1%} {typical[name][-1]:5.1f} mm"
    print(line)
holes, imitated = (np.isnan(image) for image in error.values())
print(f"{(holes & imitated).sum() / holes.sum():.0%} of the holes are imitated")

if len(sys.argv) > 1:
    view = int(np.argmax(holes.mean(axis=(1, 2))))
    figure, axes = plt.subplots(1, 4, figsize=(11.2, 2.3), layout="constrained", width_ratios=(1, 1, 1, 0.9))
    axes[0].imshow(true_depth[view], cmap="viridis_r")
    axes[0].set_title("exact depth", fontsize=9)
    for place, name in zip(axes[1:], sensors, strict=False):
        place.set_facecolor("black")
        place.imshow(error[name][view], cmap="RdBu_r", vmin=-100, vmax=100, interpolation="nearest")
        place.set_title(f"{name}: error, -10 to 10 cm", fontsize=9)
    for place in axes[:3]:
        place.set(xticks=[], yticks=[])
    for (name, values), marker in zip(typical.items(), "ox", strict=True):
        axes[3].plot((edges[1:] + edges[:-1]) / 2, values, f"{marker}-", label=name)
    axes[3].set_xlabel("depth [m]", fontsize=8)
    axes[3].set_title("typical error [mm]", fontsize=9)
    axes[3].tick_params(labelsize=8)
    axes[3].legend(fontsize=8)
    figure.savefig(sys.argv[1], dpi=77)
