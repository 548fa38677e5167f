# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras of scene files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import check_size
from warpvis.core.checks import as_items, as_path
from warpvis.core.file_content import require_content, require_package
from warpvis.core.poses import check_up
from warpvis.errors import CameraError, FileFormatError
from warpvis.scene import Axis

_USD = (".usd", ".usda", ".usdc", ".usdz")


class SceneCamera(NamedTuple):
    """A camera of a scene file, and its pose in the scene."""

    camera: PlanarCamera
    """A `warpvis.Camera`, or a `warpvis.cameras.OrthographicCamera`."""
    pose: NDArray[np.float64]
    """Camera to world, ``x y z qx qy qz qw`` of the OpenCV camera frame [m], shape ``(7,)``."""


def read_scene_cameras(
    path: str | os.PathLike[str],
    *,
    width: int | None = None,
    height: int | None = None,
    up: Axis = "z",
    search_path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
) -> dict[str, SceneCamera]:
    """Read the visible cameras of a USD stage, at the stage's first frame.

    The image shows the horizontal aperture, ``fx = width * focalLength / horizontalAperture``, and pixels are square:
    the vertical aperture only determines the default height. Clipping ranges are converted to meters; other effects of
    lenses are not read. Needs ``pip install 'warpvis[usd]'``. For cameras of MuJoCo, see
    `warpvis.mujoco.camera_from_mujoco`; for those of Webots, the devices of `warpvis.webots.load_webots`.

    Args:
        path: The stage.
        width: Image width [px]; by default that of the ``RenderProduct`` of each camera.
        height: Image height [px]; by default by the camera's aperture.
        up: The scene's vertical axis, as for `warpvis.Scene.load`.
        search_path: Folders to search for files that the stage references.

    Returns:
        The cameras by their paths in the stage.

    Raises:
        FileFormatError: If the stage cannot be read, or a camera is invalid.
        CameraError: If no width is given and a camera has none.
    """
    path = as_path(path)
    check_up(up)
    if width is None and height is not None:
        raise CameraError("width must be given with height")
    width = None if width is None else check_size(width, "width")
    height = None if height is None else check_size(height, "height")
    items = [search_path] if isinstance(search_path, os.PathLike) else as_items(search_path, "search_path")
    folders = [as_path(folder, "search_path") for folder in items]
    if path.suffix.lower() not in _USD:
        raise FileFormatError(f"{path}: cameras are read from USD stages, whose names end in {', '.join(_USD)}")
    if not path.is_file():
        raise FileFormatError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    require_content(path, "a USD stage")
    require_package("pxr", f"{path}: reading USD needs usd-core", "usd")
    from warpvis.io.usd._cameras import read_cameras

    found = read_cameras(path, width, height, up, folders)
    return {name: SceneCamera(*item) for name, item in found.items()}
