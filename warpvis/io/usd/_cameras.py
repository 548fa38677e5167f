# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras of UsdGeom, as cameras and poses in the scene that `Scene.load` makes of the same stage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, UsdGeom

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import describe_exception, truncate
from warpvis.core.poses import poses_to_opencv
from warpvis.errors import CameraError, FileFormatError, WarpvisError
from warpvis.io.usd._open import first_error, open_stage, quiet, stage_time
from warpvis.io.usd._walk import StageWalk
from warpvis.scene import Y_UP_TO_Z_UP, Axis

_APERTURE_UNIT = 0.1
"""Apertures of orthographic cameras are in tenths of the stage's unit (`GfCamera::APERTURE_UNIT`)."""

_HUGE = 1e30
"""Far planes beyond this distance are infinite."""


def read_cameras(
    path: Path, width: int | None, height: int | None, up: Axis, search_path: Sequence[Path]
) -> dict[str, tuple[PlanarCamera, NDArray[np.float64]]]:
    """Read the visible cameras of a stage; see `warpvis.io.read_scene_cameras`."""
    with quiet():
        try:
            stage = open_stage(path, search_path)
            time = stage_time(stage)
            walk = StageWalk(stage, time)
            sizes = _render_sizes(stage)
            z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
        except FileFormatError:
            raise
        except Tf.ErrorException as error:
            raise FileFormatError(f"{path}: cannot be read as USD: {truncate(first_error(error), 300)}") from None
        except Exception as error:  # damaged files may raise any exception
            raise FileFormatError(f"{path}: {truncate(describe_exception(error), 400)}") from None
        upright = np.eye(4) if z_up == (up == "z") else Y_UP_TO_Z_UP if up == "z" else Y_UP_TO_Z_UP.T
        found = {}
        for prim, matrix in walk.cameras:
            name = str(prim.GetPath())
            size = _size(name, sizes.get(name), width, height, prim, time)
            try:
                camera = _camera(prim, *size, walk.meters, time)
                found[name] = camera, poses_to_opencv(upright @ _frame(matrix), "opengl")[0]
            except (WarpvisError, TypeError, ValueError, ZeroDivisionError) as error:
                raise FileFormatError(f"{path}: camera <{name}>: {describe_exception(error)}") from None
    return found


def _render_sizes(stage: Any) -> dict[str, tuple[int, int]]:
    """Return the resolutions of render products, by the paths of their cameras."""
    sizes = {}
    for prim in stage.Traverse():
        if prim.GetTypeName() == "RenderProduct":
            resolution = prim.GetAttribute("resolution").Get()
            for target in prim.GetRelationship("camera").GetForwardedTargets():
                if resolution is not None:
                    sizes[str(target)] = int(resolution[0]), int(resolution[1])
    return sizes


def _size(
    name: str, known: tuple[int, int] | None, width: int | None, height: int | None, prim: Any, time: Any
) -> tuple[int, int]:
    """Return the size of a camera's image: the given one, that of its render product, or with its aspect ratio."""
    if width is None:
        if known is None:
            raise CameraError(f"width must be given for the camera {name!r}, which has no RenderProduct")
        return known
    if height is not None:
        return width, height
    apertures = [float(prim.GetAttribute(f"{axis}Aperture").Get(time)) for axis in ("horizontal", "vertical")]
    ratio = apertures[1] / apertures[0] if all(0 < value < np.inf for value in apertures) else 1.0
    return width, max(1, round(width * ratio))


def _camera(prim: Any, width: int, height: int, meters: float, time: Any) -> PlanarCamera:
    """Return a camera whose image shows the horizontal aperture with square pixels."""
    camera = UsdGeom.Camera(prim)
    aperture = float(camera.GetHorizontalApertureAttr().Get(time))
    focal = float(camera.GetFocalLengthAttr().Get(time))
    shift_x = float(camera.GetHorizontalApertureOffsetAttr().Get(time)) * width / aperture
    shift_y = float(camera.GetVerticalApertureOffsetAttr().Get(time)) * width / aperture
    near, far = (meters * float(value) for value in camera.GetClippingRangeAttr().Get(time))
    parallel = camera.GetProjectionAttr().Get(time) == UsdGeom.Tokens.orthographic
    pixels = width / (aperture * _APERTURE_UNIT * meters) if parallel else width * focal / aperture
    kind = OrthographicCamera if parallel else Camera
    return kind(
        width,
        height,
        fx=pixels,
        fy=pixels,
        cx=width / 2 - shift_x,
        cy=height / 2 + shift_y,
        near=near,
        far=far if far < _HUGE else np.inf,
    )


def _frame(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a placement without scale."""
    frame = matrix.copy()
    frame[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
    return frame
