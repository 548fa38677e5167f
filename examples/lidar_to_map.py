# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find the pose of a VLP-16 in a map: from a start that is 0.5 m and 5 degrees off, and from starts all over the room.

Prints the errors of both poses; writes lidar_to_map.png: points of the scan on the map, before and after, and the
inlier ratio of every start.
"""

import sys

import numpy as np
import trimesh
from matplotlib.figure import Figure  # noqa: TID253
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.core.poses import poses_to_matrices


def build_map():
    """Return a room of 8 by 6 m with walls, shelves, a table and a column."""
    scene = wv.Scene()
    parts = {"floor": ((8, 6, 0.1), (0, 0, -0.05)), "ceiling": ((8, 6, 0.1), (0, 0, 2.85))}
    parts |= {"left": ((0.1, 6, 2.8), (-4, 0, 1.4)), "right": ((0.1, 6, 2.8), (4, 0, 1.4))}
    parts |= {"front": ((8, 0.1, 2.8), (0, -3, 1.4)), "back": ((8, 0.1, 2.8), (0, 3, 1.4))}
    parts |= {"shelf": ((0.4, 2.4, 2.0), (-3.7, 1.2, 1.0)), "table": ((1.6, 0.8, 0.75), (1.8, -1.6, 0.375))}
    parts |= {"column": ((0.5, 0.5, 2.8), (1.4, 1.5, 1.4)), "closet": ((1.2, 0.6, 2.2), (-1.5, -2.6, 1.1))}
    for name, (size, center) in parts.items():
        scene.add(trimesh.creation.box(size), name=name, pose=(*center, 0, 0, 0, 1))
    return scene


def errors(poses, truth):
    """Return errors of position [m] and of rotation [degrees] of poses ``(N, 7)``."""
    turns = Rotation.from_quat(poses[:, 3:]) * Rotation.from_quat(truth[3:]).inv()
    return np.linalg.norm(poses[:, :3] - truth[:3], axis=1), np.degrees(turns.magnitude())


scene, rng = build_map(), np.random.default_rng(0)
lidar = wv.sensors.lidars.vlp16()
truth = np.array([-0.6, 0.4, 0.9, *Rotation.from_euler("zyx", (40, 2, -1), degrees=True).as_quat()])
noise = wv.sensors.LidarNoise(sigma=0.03, dropout=0.02)
scan = wv.render(scene, lidar, truth, outputs="depth", sensor=noise, seed=1).depth.numpy()[0]

# A start from odometry.
axis = Rotation.from_rotvec(np.radians(5) * np.array([0.48, 0.6, 0.64]))
start = np.array([*(truth[:3] + (0.4, -0.3, 0.0)), *(axis * Rotation.from_quat(truth[3:])).as_quat()])
near = wv.register(scene, lidar, scan, start, sigma=noise.sigma, max_distance=1.0)
pose = near.poses.numpy()[0]
for name, row in (("start", start), ("registered", pose)):
    meters, degrees = errors(row[None], truth)
    print(f"{name}: {1000 * meters[0]:.1f} mm, {degrees[0]:.3f} degrees")

# No start: a grid of positions, eight headings each, every 32nd column of the scan first.
grid = np.stack(np.meshgrid(np.arange(-3.5, 4), np.arange(-2.5, 3), np.arange(0, 360, 45)), axis=-1).reshape(-1, 3)
headings = Rotation.from_euler("z", grid[:, 2:], degrees=True).as_quat()
starts = np.column_stack([grid[:, :2], np.full(len(grid), truth[2]), headings])
columns = np.arange(0, lidar.width, 32)
coarse = wv.cameras.Rays(
    lidar.rays[:, columns], near=lidar.near, far=lidar.far, axes=lidar.axes, origins=lidar.origins[:, columns]
)
found = wv.register(scene, coarse, scan[:, columns], starts, sigma=noise.sigma, max_distance=1.0, iterations=40)
best = wv.register(scene, lidar, scan, found.poses.numpy()[found.best()], sigma=noise.sigma, max_distance=0.2)
meters, degrees = errors(found.poses.numpy(), truth)
is_right = (meters < 0.05) & (degrees < 1)
print(f"{len(starts)} starts: {is_right.sum()} end within 50 mm and 1 degree")
meters, degrees = errors(best.poses.numpy(), truth)
print(f"best: {1000 * meters[0]:.1f} mm, {degrees[0]:.3f} degrees, {best.inlier_ratio[0]:.1%} inliers")

figure = Figure(figsize=(12, 3.6), layout="constrained")
axes = figure.subplots(1, 3)
hits = np.isfinite(scan)
points = (lidar.origins + lidar.rays * np.where(hits, scan, 0)[..., None])[hits]
for axis, title, row in zip(axes, ("start: 0.5 m, 5 degrees", "registered"), (start, pose), strict=False):
    matrix = poses_to_matrices(row[None])[0]
    x, y, z = (points @ matrix[:3, :3].T + matrix[:3, 3]).T
    level = (z > 0.3) & (z < 2.5)
    axis.scatter(x[level], y[level], s=0.3, c="tab:red", linewidths=0, rasterized=True, zorder=2)
    axis.plot(*row[:2], "r+", zorder=3)
    axis.set_title(title)
axes[2].set_title(f"inlier ratio of {len(starts)} starts")
turned = np.radians(grid[:, 2])
arrows = axes[2].quiver(*grid[:, :2].T, np.cos(turned), np.sin(turned), found.inlier_ratio, cmap="viridis", scale=26)
axes[2].plot(*truth[:2], "r+", zorder=3)
figure.colorbar(arrows, ax=axes[2])
for axis in axes:
    for item in scene:
        if item.name not in ("floor", "ceiling"):
            low, high = item.vertices[:, :2].min(0), item.vertices[:, :2].max(0)
            axis.fill(*np.array([low, (high[0], low[1]), high, (low[0], high[1])]).T, color="0.75", zorder=1)
    axis.set_aspect("equal")
    axis.set_axis_off()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "lidar_to_map.png", dpi=90)
