# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the page answers when it is asked: where the robot should go, and what of the floor is seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.checks import format_percent
from warpvis.core.labels import Label
from warpvis.core.poses import check_up
from warpvis.maps import floor_map
from warpvis.planning import propose_view

if TYPE_CHECKING:
    from warpvis.planning import Proposal
    from warpvis.viewer._pictures import Seen
    from warpvis.viewer._state import Look, ViewerState

_MAP_CELLS = 160
"""Cells of a floor map's longer side."""


def propose(state: ViewerState, look: Look, *, max_distance: float, radius: float) -> Proposal | str:
    """Find where the first agent should go to see what only the second one sees; or say why nowhere.

    Args:
        state: The scene.
        look: The situation.
        max_distance: How far it may go [m].
        radius: Its radius [m].
    """
    if len(look.agents) < 2:
        return "There is nobody else who sees anything."
    robot, other = look.agents
    if not isinstance(robot.camera, Camera):
        return f"{robot.name} has no pinhole camera that could be placed."
    bodies = {*robot.body, *other.body}
    labels = None if all(item.label != Label.OBJECT for item in state.scene.objects) else [Label.OBJECT]
    found = look.seen.candidates(other.name, robot.name, labels=labels)
    found = [item for item in found if item.object not in bodies]
    if not found:
        return f"{other.name} sees no object."
    placed = look.object_poses if len(look.object_poses) else None
    floor = _floor(state)
    proposal = propose_view(
        state.scene, robot, found, max_distance=max_distance, radius=radius, floor=floor, object_poses=placed
    )
    if proposal is not None:
        return proposal
    if all(item.state is not None and item.state.name == "BOTH" for item in found):
        return f"{robot.name} sees all that {other.name} sees."
    return f"No place within {max_distance:g} m that has room for {robot.name} shows it any of that."


def in_words(proposal: Proposal) -> str:
    """Say what a proposal is."""
    shares = ", ".join(f"{name} {format_percent(share)}" for name, share in proposal.fractions.items())
    return f"{proposal.distance:.2f} m away it would see: {shares}."


def map_picture(state: ViewerState, seen: Seen) -> NDArray[np.uint8]:
    """Draw the floor as an agent's image shows it, from above, the second axis upwards, ``(h, w, 3)``: 2 x 2 a cell."""
    bounds = state.scene.bounds.astype(np.float64)
    sides = np.delete(bounds[1] - bounds[0], check_up(state.scene.up))
    found = floor_map(
        np.ascontiguousarray(seen.points)[None],
        np.ascontiguousarray(seen.labels)[None],
        bounds=bounds,
        cell_size=max(float(sides.max()) / _MAP_CELLS, 0.005),
        up=state.scene.up,
        label_names=state.scene.label_names,
        ground_labels=state.scene.ground_labels,
    )
    return found.rgb()[0, ::-1].repeat(2, axis=0).repeat(2, axis=1)


def _floor(state: ViewerState) -> float:
    """Return how high the ground is [m]: its top, or the bottom of all where there is none."""
    vertical = check_up(state.scene.up)
    tops = [item.bounds[1, vertical] for item in state.scene.objects if item.label in state.scene.ground_labels]
    return float(max(tops)) if tops else float(state.scene.bounds[0, vertical])
