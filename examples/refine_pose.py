# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find the pose of a depth camera from 5 degrees and 5 cm off: by gradients in PyTorch, and by registration.

Prints the errors of the pose before and after; writes refine_pose.png, or the file given as argument.
"""

import sys

import numpy as np
import warp as wp
from matplotlib.figure import Figure  # noqa: TID253

import warpvis as wv

STEPS = 150
TWIST = [0.0504, -0.0504, 0.0504, 0.03, -0.03, 0.0265]  # 5.0 degrees and 5.0 cm
SENSOR = wv.sensors.realsense_d435(320, 200)


def errors(pose, truth):
    """Return how far a pose is from the true one, in degrees and mm."""
    cosine = min(abs(pose[3:] @ truth[3:]), 1.0)
    return np.degrees(2 * np.arccos(cosine)), 1000 * np.linalg.norm(pose[:3] - truth[:3])


def refine(scene, camera, measured, start):
    """Return the pose at which rendered depth agrees with measured depth."""
    import torch

    import warpvis.torch as wt

    depth = torch.tensor(measured)
    twist = torch.zeros(1, 6, requires_grad=True)
    optimizer = torch.optim.Adam([twist], lr=0.01)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    for _ in range(STEPS):
        optimizer.zero_grad()
        rendered = wt.render(scene, camera, wt.apply_twists(start, twist)).depth[0]
        valid = rendered.isfinite() & depth.isfinite()
        torch.nn.functional.huber_loss(rendered[valid], depth[valid], delta=0.02).backward()
        optimizer.step()
        schedule.step()
    return wt.apply_twists(start, twist).detach()


def main():
    """Compare gradients and registration."""
    try:
        import torch
    except ImportError:
        sys.exit("this example needs PyTorch: pip install torch")
    import warpvis.torch as wt

    wp.config.log_level = wp.LOG_WARNING
    scene, camera = wv.scenes.PRESETS["room"].build(), SENSOR.camera()
    truth = wv.look_at((2.2, -1.3, 1.0), (0.4, 0.3, 0.4))
    start = wt.apply_twists(torch.tensor(truth), torch.tensor(TWIST, dtype=torch.float64)).float()[None]
    measured = wv.render(scene, camera, truth, outputs="depth", sensor=SENSOR, seed=1, frame=0).depth.numpy()[0]
    measured[~(measured > 0)] = np.inf

    found, start = refine(scene, camera, measured, start).numpy()[0], start.numpy()[0]
    registered = wv.register(scene, camera, measured, start, sigma=0.01, max_distance=0.5).poses.numpy()[0]
    for name, pose in (("before", start), ("Adam", found), ("wv.register", registered)):
        print("{:12} {:5.2f} degrees {:5.1f} mm".format(name, *errors(pose, truth)))

    before, after = wv.render(scene, camera, np.stack([start, found]), outputs="depth").depth.numpy()
    figure = Figure(figsize=(10, 4.4), layout="constrained")
    axes = figure.subplots(2, 3)
    shown = {"measured": measured, "rendered before": before, "rendered after": after}
    for axis, (title, image) in zip(axes[0], shown.items(), strict=True):
        drawn = axis.imshow(np.where(np.isfinite(image), image, np.nan), cmap="turbo", vmin=0.5, vmax=4.5)
        axis.set_title(title)
    figure.colorbar(drawn, ax=axes[0], label="depth [m]")
    for axis, (title, image) in zip(axes[1, 1:], (("before", before), ("after", after)), strict=True):
        with np.errstate(invalid="ignore"):
            error = 1000 * (image - measured)
        drawn = axis.imshow(np.where(np.isfinite(error), error, np.nan), cmap="RdBu", vmin=-100, vmax=100)
        axis.set_title(f"difference {title}")
    figure.colorbar(drawn, ax=axes[1], label="difference [mm]")
    for axis in axes.flat:
        axis.set_axis_off()
    figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "refine_pose.png", dpi=100)


if __name__ == "__main__":
    main()
