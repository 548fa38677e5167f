# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers and writers of meshes, cameras, points, poses and depth images, one module per format; and ROS messages.

`wv.Scene.load`, `wv.read_frames` and `wv.open_recording` choose the reader by the names of files.
"""

from __future__ import annotations

from warpvis.core.numpy_files import read_archive as read_archive
from warpvis.io._bag_files import BagFile as BagFile
from warpvis.io._cloud_messages import register_livox_types, to_laserscan, to_livox_msg
from warpvis.io._color_images import (
    COLOR_SUFFIXES as COLOR_SUFFIXES,
    ColorFile as ColorFile,
    encode_colors as encode_colors,
)
from warpvis.io._depth import (
    count_lost as count_lost,
    depth_to_units as depth_to_units,
    describe_lost as describe_lost,
    encode_png as encode_png,
    encode_pngs as encode_pngs,
    find_depth_images as find_depth_images,
    missing_units as missing_units,
    read_depth,
    save_depth_png,
)
from warpvis.io._figures import read_figure
from warpvis.io._image_messages import color_pixels as color_pixels
from warpvis.io._map_messages import to_occupancy_grid
from warpvis.io._messages import (
    from_color_msg,
    from_image_msg,
    to_color_msg,
    to_compressed_msg,
    to_image_msg,
    to_pointcloud2,
)
from warpvis.io._points import read_points, save_cloud, save_clouds
from warpvis.io._scene_cameras import SceneCamera, read_scene_cameras
from warpvis.io._scene_files import export_scene as export_scene, read_parts as read_parts
from warpvis.io.cameras._files import load_camera
from warpvis.io.datasets._bop import load_bop_scene
from warpvis.io.poses._frames import leaves_order_open as leaves_order_open, read_frames as read_frames
from warpvis.io.poses._tables import read_poses
from warpvis.io.poses._tracks import Track, read_tracks
from warpvis.io.recordings._open import open_recording as open_recording
from warpvis.io.recordings._recording import MeasuredFrame, Recording
from warpvis.io.sdf import SdfSensor, read_sensors

__all__ = [
    "MeasuredFrame",
    "Recording",
    "SceneCamera",
    "SdfSensor",
    "Track",
    "from_color_msg",
    "from_image_msg",
    "load_bop_scene",
    "load_camera",
    "read_depth",
    "read_figure",
    "read_points",
    "read_poses",
    "read_scene_cameras",
    "read_sensors",
    "read_tracks",
    "register_livox_types",
    "save_cloud",
    "save_clouds",
    "save_depth_png",
    "to_color_msg",
    "to_compressed_msg",
    "to_image_msg",
    "to_laserscan",
    "to_livox_msg",
    "to_occupancy_grid",
    "to_pointcloud2",
]
