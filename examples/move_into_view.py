# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Move cameras until they see a hidden object, by gradients of masks.

    pip install 'warpvis[torch,viz]'
    python examples/move_into_view.py --out move_into_view.png

A mug is behind a low screen, between a lamp and a shelf. Of eight cameras on an arc, seven see nothing of it; each is
moved by gradient ascent, with a small cost of distance, while it looks at the mug. A mug that is entirely hidden has no
gradient itself: the mask of what hides it is blurred, so that each hidden pixel counts by its distance to the edge.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh

import warpvis as wv

MUG = (0.0, 0.0, 0.8)
STEPS = 80
BLUR = 4  # standard deviation [px]


def build_scene() -> wv.Scene:
    """Return a desk with a mug and what hides it."""
    scene, boxes = wv.Scene(), trimesh.creation.box
    scene.add(boxes(extents=(1.6, 1.6, 0.04)), name="desk", pose=(0, 0, 0.72, 0, 0, 0, 1), appearance=(0.6, 0.45, 0.3))
    mug = trimesh.creation.cylinder(radius=0.045, height=0.1, sections=24)
    scene.add(mug, name="mug", label="object", pose=(*MUG[:2], 0.79, 0, 0, 0, 1), appearance=(0.9, 0.3, 0.1))
    screen = boxes(extents=(0.03, 0.5, 0.12))
    scene.add(screen, name="screen", pose=(0.25, 0.05, 0.8, 0, 0, 0, 1), appearance=(0.15, 0.15, 0.18))
    scene.add(
        boxes(extents=(0.3, 0.03, 0.5)), name="shelf", pose=(-0.1, -0.3, 0.99, 0, 0, 0, 1), appearance=(0.8, 0.8, 0.7)
    )
    lamp = trimesh.creation.cylinder(radius=0.05, height=0.4, sections=16)
    scene.add(lamp, name="lamp", pose=(0.18, 0.38, 0.94, 0, 0, 0, 1), appearance=(0.2, 0.4, 0.7))
    return scene


def look_at(eyes, target, torch):
    """Return camera poses ``(V, 4, 4)`` with gradients; `eyes` and `target` are [m], and z is up."""
    forward = torch.nn.functional.normalize(target - eyes, dim=-1)
    right = torch.nn.functional.normalize(
        torch.linalg.cross(forward, forward.new_tensor([0.0, 0.0, 1.0]).expand_as(forward)), dim=-1
    )
    columns = torch.stack([right, torch.linalg.cross(forward, right), forward, eyes], dim=-1)
    last = columns.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(len(eyes), 1, 4)
    return torch.cat([columns, last], dim=1)


def blur(masks, torch):
    """Return masks ``(V, H, W)`` after a Gaussian filter."""
    offsets = torch.arange(-3 * BLUR, 3 * BLUR + 1)
    weights = torch.exp(-(offsets**2) / (2 * BLUR**2))
    weights = (weights / weights.sum()).reshape(1, 1, -1, 1)
    padded = torch.nn.functional.pad(masks[:, None], [3 * BLUR] * 4, mode="replicate")
    columns = torch.nn.functional.conv2d(padded, weights)
    return torch.nn.functional.conv2d(columns, weights.mT)[:, 0]


def main() -> None:
    """Print the visible fractions before and after, and draw one camera's pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="picture to write")
    arguments = parser.parse_args()
    try:
        import torch

        import warpvis.torch
    except ImportError:
        raise SystemExit("this example needs PyTorch: pip install 'warpvis[torch]'") from None

    def soften(poses):
        mug = warpvis.torch.soft_mask(scene, camera, poses, "mug", occluded=False)
        hidden = warpvis.torch.soft_mask(scene, camera, poses, ["screen", "shelf", "lamp"])
        return (mug * blur(1 - hidden, torch)).sum(dim=(1, 2)) / mug.sum(dim=(1, 2))

    scene, camera = build_scene(), wv.Camera.from_fov(160, 120, hfov=0.6, near=0.05, far=10.0)
    angles = np.linspace(-0.75, 0.55, 8)
    starts = np.stack([1.2 * np.cos(angles), 1.2 * np.sin(angles), np.full(8, 0.9)], axis=1)
    start, target = torch.tensor(starts, dtype=torch.float32), torch.tensor(MUG)
    eyes = start.clone().requires_grad_()
    optimizer = torch.optim.Adam([eyes], lr=0.02)
    fractions = []
    for _ in range(STEPS):
        poses = look_at(eyes, target, torch)
        loss = (-soften(poses) + 0.1 * (eyes - start).square().sum(dim=1)).sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        fractions.append(warpvis.torch.visible_fraction(scene, camera, poses.detach(), "mug").numpy())
    moved = (eyes.detach() - start).norm(dim=1).numpy()
    for first, last, distance in zip(fractions[0], fractions[-1], moved, strict=True):
        print(f"{first:4.0%} of the mug visible, {last:4.0%} after a move of {distance:.2f} m")
    if arguments.out:
        draw(
            scene, camera, [look_at(p, target, torch).detach().numpy() for p in (start, eyes)], fractions, arguments.out
        )


def draw(scene: wv.Scene, camera: wv.Camera, poses: list[np.ndarray], fractions: list[np.ndarray], path: Path) -> None:
    """Draw what four of the cameras see before and after."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    axes = figure.subplots(2, 4)
    for row, (name, matrices) in enumerate(zip(("before", "after"), poses, strict=True)):
        color = wv.render(scene, camera, matrices, outputs="color").color.numpy()
        for axis, view in zip(axes[row], range(0, 8, 2), strict=True):
            axis.imshow(color[view])
            axis.set_title(f"{name}: {fractions[-row][view]:.0%} of the mug", fontsize=9)
            axis.set_axis_off()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
