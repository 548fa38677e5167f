# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings for the Rerun viewer of one situation or of all frames of a state."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from warpvis.core.checks import as_path
from warpvis.core.file_content import writing
from warpvis.errors import WarpvisError
from warpvis.viewer._state import Snapshot, ViewerState

if TYPE_CHECKING:
    from rerun import RecordingStream

_FRUSTUM_SIZE = 0.28
_RADIUS = 0.16
"""Radius of a point, relative to the spacing of points."""


def save_rerun(state: ViewerState, path: str | os.PathLike[str]) -> None:
    """Write a recording for Rerun (``.rrd``) with all frames of a state, or its current situation if it has none.

    The recording contains meshes, the point cloud, agents with their images and the table. If the state has frames, it
    shows the same frame afterwards as before.

    Raises:
        WarpvisError: If rerun-sdk is missing, or the file cannot be written.
    """
    try:
        import rerun
    except ImportError:
        raise WarpvisError("recordings need rerun-sdk, which is missing: pip install 'warpvis[rerun]'") from None
    if not isinstance(state, ViewerState):
        raise WarpvisError(f"state must be a warpvis.viewer.ViewerState, got {type(state).__name__}")
    file = as_path(path)
    with writing(file), open(file, "wb"):
        pass
    recording = rerun.RecordingStream("warpvis")
    recording.save(file)
    up = rerun.ViewCoordinates.RIGHT_HAND_Z_UP if state.scene.up == "z" else rerun.ViewCoordinates.RIGHT_HAND_Y_UP
    recording.log("world", up, static=True)
    _log_meshes(recording, state)
    before = state.frame
    if state.frames is None:
        _log_snapshot(recording, state, state.snapshot())
    else:
        for number, seconds in enumerate(state.frames.timestamps.tolist()):
            recording.set_time("frame", sequence=number)
            recording.set_time("time", duration=seconds)
            state.show_frame(number)
            _log_snapshot(recording, state, state.snapshot())
        state.show_frame(before)
    recording.flush()
    recording.disconnect()


def _log_meshes(recording: RecordingStream, state: ViewerState) -> None:
    import rerun

    colors = state.colors({})
    for index, item in enumerate(state.scene.objects):
        vertices, faces = state.stage.mesh(item.name)
        mesh = rerun.Mesh3D(vertex_positions=vertices, triangle_indices=faces, albedo_factor=colors[index])
        recording.log(_entity(index), mesh, static=True)


def _log_snapshot(recording: RecordingStream, state: ViewerState, snapshot: Snapshot) -> None:
    import rerun

    for index in np.flatnonzero(state.stage.columns >= 0).tolist():
        recording.log(_entity(index), _transform(snapshot.object_poses[state.stage.columns[index]]))
    size = _RADIUS * state.cloud.spacing
    recording.log("world/cloud", rerun.Points3D(snapshot.points, colors=snapshot.point_colors, radii=size))
    for number, (agent, picture) in enumerate(zip(snapshot.agents, snapshot.pictures, strict=True)):
        entity = f"world/agents/{number}"
        recording.log(entity, _transform(agent.poses[0]))
        recording.log(f"images/{agent.name}", rerun.Image(picture))
        if (camera := agent.pinhole) is not None:
            pinhole = rerun.Pinhole(
                image_from_camera=camera.to_K(),
                resolution=[camera.width, camera.height],
                image_plane_distance=_FRUSTUM_SIZE,
            )
            recording.log(f"{entity}/view", pinhole)
    recording.log("table", rerun.TextDocument(snapshot.seen.table()))


def _transform(pose: Any) -> Any:
    import rerun

    return rerun.Transform3D(translation=pose[:3], quaternion=rerun.Quaternion(xyzw=pose[3:]))


def _entity(index: int) -> str:
    return f"world/objects/{index}"
