# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Names of the images of a renderer. This module has no expensive imports, because the command line lists them."""

from __future__ import annotations

from typing import Literal, get_args

Output = Literal[
    "depth", "points", "normals", "labels", "segmentation", "faces", "color", "albedo", "reasons", "true_depth"
]
"""Names of images of a renderer; `OUTPUTS` defines their contents."""

SENSOR_NAMES = ("reasons", "true_depth")
"""Images that require a depth-camera model."""

IMAGE_NAMES = tuple(name for name in get_args(Output) if name not in SENSOR_NAMES)
"""Images that do not require one."""

VISIBILITY = "visibility"
"""Output of datasets that is not an image: the results of `warpvis.object_visibility`."""
