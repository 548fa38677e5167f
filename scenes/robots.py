# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A hall with obstacles and moving robots of four parts, with different positions in every world.

The first robot has a lidar, the site ``lidar`` on its mast. The hall is a MuJoCo model, so that lidars of other
libraries can use the same scene.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_HALL = 10.0  # half of its length and width [m]
_FREE = 8.0  # maximum coordinate of robots and obstacles [m]
_WALL = 1.5  # half of a wall's height [m]


def moving_robots_xml(robots: int = 8, obstacles: int = 16) -> str:
    """Return the model as MJCF; every robot has three joints, along x, along y and about z.

    Args:
        robots: Number of robots.
        obstacles: Number of boxes and pillars, with deterministic positions.
    """
    rng = np.random.default_rng(0)
    parts = [f'<geom name="floor" type="plane" size="{_HALL} {_HALL} 1"/>']
    for name, where, size in (
        ("north", f"0 {_HALL} {_WALL}", f"{_HALL} 0.1 {_WALL}"),
        ("south", f"0 -{_HALL} {_WALL}", f"{_HALL} 0.1 {_WALL}"),
        ("east", f"{_HALL} 0 {_WALL}", f"0.1 {_HALL} {_WALL}"),
        ("west", f"-{_HALL} 0 {_WALL}", f"0.1 {_HALL} {_WALL}"),
    ):
        parts.append(f'<geom name="{name}" type="box" pos="{where}" size="{size}"/>')
    for number in range(obstacles):
        x, y = rng.uniform(-_FREE, _FREE, 2)
        a, b, height = rng.uniform((0.1, 0.1, 0.2), (0.6, 0.6, 1.2))
        kind, size = ("box", f"{a:.3f} {b:.3f} {height:.3f}") if number % 2 else ("cylinder", f"{a:.3f} {height:.3f}")
        parts.append(f'<geom name="obstacle_{number}" type="{kind}" pos="{x:.3f} {y:.3f} {height:.3f}" size="{size}"/>')
    parts += [_robot(number) for number in range(robots)]
    return f"<mujoco><worldbody>{''.join(parts)}</worldbody></mujoco>"


def _robot(number: int) -> str:
    joints = "".join(
        f'<joint name="robot_{number}_{name}" type="{kind}" axis="{axis}"/>'
        for name, kind, axis in (("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("turn", "hinge", "0 0 1"))
    )
    site = '<site name="lidar" pos="0 0 1"/>' if number == 0 else ""
    return (
        f'<body name="robot_{number}">{joints}'
        '<geom type="box" pos="0 0 0.25" size="0.35 0.25 0.15" mass="1"/>'
        '<geom type="cylinder" pos="0.2 0 0.1" size="0.1 0.3" euler="90 0 0" mass="1"/>'
        '<geom type="capsule" pos="0 0 0.6" size="0.05 0.2" mass="1"/>'
        f'<geom type="sphere" pos="0 0 0.85" size="0.08" mass="1"/>{site}</body>'
    )


def robot_joints(worlds: int, robots: int = 8) -> NDArray[np.float64]:
    """Return random joint positions in worlds, shape ``(worlds, 3 * robots)``."""
    rng = np.random.default_rng(1)
    reach = np.array([_FREE, _FREE, np.pi])
    return rng.uniform(-reach, reach, (worlds, robots, 3)).reshape(worlds, -1)
