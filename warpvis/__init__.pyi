# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
# The public names of warpvis and where each lives; `lazy_loader` reads this table.

from . import (
    batch as batch,
    cameras as cameras,
    core as core,
    errors as errors,
    io as io,
    maps as maps,
    mujoco as mujoco,
    planning as planning,
    pose_generators as pose_generators,
    rendering as rendering,
    scene as scene,
    scenes as scenes,
    sensors as sensors,
    situations as situations,
    viewer as viewer,
    visibility as visibility,
    viz as viz,
    webots as webots,
)
from .batch import open_dataset as open_dataset, render_batch as render_batch
from .cameras.frames import Frames as Frames
from .cameras.pinhole import Camera as Camera
from .core.labels import Label as Label, Visibility as Visibility
from .core.poses import look_at as look_at
from .errors import WarpvisError as WarpvisError
from .io import open_recording as open_recording, read_frames as read_frames
from .maps import (
    FloorMap as FloorMap,
    OccupancyMap as OccupancyMap,
    VoxelMap as VoxelMap,
    back_project as back_project,
    classify as classify,
    compare_depth as compare_depth,
    fit_floor as fit_floor,
    floor_map as floor_map,
    register as register,
    voxel_map as voxel_map,
    voxel_map_from_scene as voxel_map_from_scene,
)
from .rendering import Renderer as Renderer, Views as Views, render as render
from .scene import Scene as Scene, SceneObject as SceneObject
from .viewer._view import view as view
from .visibility import (
    Agent as Agent,
    FieldOfView as FieldOfView,
    Perspective as Perspective,
    object_visibility as object_visibility,
    perspective as perspective,
    point_visibility as point_visibility,
    point_visibility_from_depth as point_visibility_from_depth,
    visible_fractions as visible_fractions,
)

__version__: str
