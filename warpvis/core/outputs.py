# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Name the images that a renderer makes; nothing heavy is imported, so that the command line can list them."""

from __future__ import annotations

from typing import Literal, get_args

Output = Literal[
    "depth", "points", "normals", "labels", "segmentation", "faces", "color", "albedo", "reasons", "true_depth"
]
"""Names of images that a renderer makes; `OUTPUTS` says what they hold."""

SENSOR_NAMES = ("reasons", "true_depth")
"""Those that need the model of a depth camera."""

IMAGE_NAMES = tuple(name for name in get_args(Output) if name not in SENSOR_NAMES)
"""The others."""

VISIBILITY = "visibility"
"""The output of datasets that is no image: the results of `warpvis.object_visibility`."""
