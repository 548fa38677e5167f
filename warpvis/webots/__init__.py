# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots worlds, from V6.0 to R2025a: scenes, and the images of their range finders, lidars and cameras."""

from __future__ import annotations

from warpvis.webots._agents import robot_agent
from warpvis.webots._color_images import render_color
from warpvis.webots._controller import DepthEye
from warpvis.webots._devices import Device, Lens
from warpvis.webots._lidars import Lidar
from warpvis.webots._nodes import Node, Version
from warpvis.webots._range_images import find_device, find_lidar, render_lidar, render_range
from warpvis.webots._ranges import add_noise, distort_pixels, quantize, range_values
from warpvis.webots._recognition import Recognized, recognize, segmentation_image
from warpvis.webots._world import WebotsWorld, load_webots, read_world as read_world

__all__ = [
    "DepthEye",
    "Device",
    "Lens",
    "Lidar",
    "Node",
    "Recognized",
    "Version",
    "WebotsWorld",
    "add_noise",
    "distort_pixels",
    "find_device",
    "find_lidar",
    "load_webots",
    "quantize",
    "range_values",
    "recognize",
    "render_color",
    "render_lidar",
    "render_range",
    "robot_agent",
    "segmentation_image",
]
