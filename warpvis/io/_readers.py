# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of scene formats other than meshes."""

from __future__ import annotations

RASTERS = (".tif", ".tiff")
_USD = ("warpvis.io.usd:read_usd", "a USD stage")

_SDF = "warpvis.io.sdf:read_sdf"
MODEL_CONFIG = "model.config"
"""Name of the file that lists the SDF files of the folder of one of Gazebo's models."""

SCENE_READERS = {
    ".wbt": ("warpvis.webots:read_world", "a Webots world"),
    ".xml": ("warpvis.io._models:read_model_file", "a model"),
    ".urdf": ("warpvis.io._models:read_model_file", "a model"),
    ".xacro": ("warpvis.io.urdf:read_urdf", "a model"),
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _USD),
    **dict.fromkeys(RASTERS, ("warpvis.io.datasets._terrain:read_terrain", "a raster of elevations")),
    ".json": ("warpvis.io.datasets._habitat:read_habitat", "a scene of a Habitat dataset"),
    ".sdf": (_SDF, "an SDF file"),
    ".world": (_SDF, "an SDF file"),
    ".config": (_SDF, "a model.config"),
}
"""Readers by file extension, and what such a file contains.

A reader takes the path and the keyword arguments `search_path` and `strict`, and returns `FileParts`. It is imported
when it is first used.
"""
