# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras of ``calibration.txt``, next to TUM trajectories: ``fx fy cx cy``, and ``k1 k2 p1 p2 k3`` of a lens.

Format: https://www.eth3d.net/slam_documentation, and for the coefficients the table of
https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from warpvis.cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import truncate
from warpvis.errors import FileFormatError
from warpvis.io._files import read_lines
from warpvis.io.cameras._pinhole import image_size, make_calibrated, make_pinhole

TUM_FILE = "calibration.txt"

_IMAGES = ("depth.txt", "rgb.txt", "associated.txt")
"""Lists of images, from which the image size is read."""


def tum_camera(path: Path, *, distortion: bool) -> ImageCamera:
    """Read the camera, whose pixel centers are at whole numbers; the image size is that of an image next to it."""
    expected = "fx fy cx cy, or those and k1 k2 p1 p2 k3"
    for number, line in enumerate(read_lines(path, expected), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) not in (4, 9):
            raise FileFormatError(f"{path}:{number}: expected {expected}, got {truncate(line, 60)!r}")
        size, (fx, fy, cx, cy, *lens) = _size(path), values
        if not distortion:
            return make_pinhole(str(path), size, (fx, fy, cx, cy), pixel_center=0.0, distortion=lens)
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        return make_calibrated(str(path), partial(Camera.from_opencv, matrix, lens, *size))
    raise FileFormatError(f"{path}: expected {expected}, and holds no numbers")


def _size(path: Path) -> tuple[int, int]:
    for name in _IMAGES:
        if not (path.parent / name).is_file():
            continue
        rows = (line.split() for line in read_lines(path.parent / name, "timestamp filename"))
        images = [row[1] for row in rows if len(row) > 1 and not row[0].startswith("#")]
        size = image_size(path.parent, images[:1])
        if size is not None:
            return size
    raise FileFormatError(
        f"{path}: does not define the image size, and there is no image next to it that {_IMAGES[0]} lists"
    )
