# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Results behind the page's buttons: a better pose for the robot, and a map of the visible floor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import format_percent
from warpvis.core.labels import Label
from warpvis.core.poses import check_up
from warpvis.maps import floor_map
from warpvis.planning import propose_view

if TYPE_CHECKING:
    from warpvis.planning import Proposal
    from warpvis.viewer._pictures import Seen
    from warpvis.viewer._state import Snapshot, ViewerState

_MAP_CELLS = 160
"""Number of cells along a floor map's longer side."""


def propose(state: ViewerState, snapshot: Snapshot, *, max_distance: float, radius: float) -> Proposal | str:
    """Propose a pose of the first agent from which it sees objects that only the second one sees.

    Args:
        state: State with the scene.
        snapshot: The current situation.
        max_distance: Maximum distance to the pose [m].
        radius: Radius of the first agent [m].

    Returns:
        The proposal, or the reason why there is none.
    """
    if len(snapshot.agents) < 2:
        return "There is no second agent."
    robot, other = snapshot.agents
    if not isinstance(robot.camera, Camera):
        return f"{robot.name} has no pinhole camera."
    bodies = {*robot.body, *other.body}
    labels = None if all(item.label != Label.OBJECT for item in state.scene.objects) else [Label.OBJECT]
    found = snapshot.seen.candidates(other.name, robot.name, labels=labels)
    found = [item for item in found if item.object not in bodies]
    if not found:
        return f"{other.name} sees no object."
    object_poses = snapshot.object_poses if len(snapshot.object_poses) else None
    floor = _floor(state)
    proposal = propose_view(
        state.scene, robot, found, max_distance=max_distance, radius=radius, floor=floor, object_poses=object_poses
    )
    if proposal is not None:
        return proposal
    if all(item.state is not None and item.state.name == "BOTH" for item in found):
        return f"{robot.name} sees every object that {other.name} sees."
    return f"No free place within {max_distance:g} m shows {robot.name} any of these objects."


def describe_proposal(proposal: Proposal) -> str:
    """Describe a proposal in a sentence."""
    fractions = ", ".join(f"{name} {format_percent(share)}" for name, share in proposal.fractions.items())
    return f"{proposal.distance:.2f} m away it would see: {fractions}."


def map_picture(state: ViewerState, seen: Seen) -> NDArray[np.uint8]:
    """Return a floor map of an agent's image, from above, second axis upwards, 2 x 2 pixels per cell, ``(h, w, 3)``."""
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
    """Return the height of the ground [m]: its highest point, or the scene's lowest one without a ground."""
    vertical = check_up(state.scene.up)
    tops = [item.bounds[1, vertical] for item in state.scene.objects if item.label in state.scene.ground_labels]
    return float(max(tops)) if tops else float(state.scene.bounds[0, vertical])
