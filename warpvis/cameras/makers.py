# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Create cameras from the calibrations of other systems, which may include lens distortion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Self

from numpy.typing import ArrayLike

from warpvis.cameras.base import DepthKind, ProjectingCamera, intrinsics
from warpvis.cameras.lenses import (
    Lens,
    check_coefficients,
    lens_from_colmap,
    lens_from_kalibr,
    lens_from_nerfstudio,
    lens_from_opencv,
    lens_from_ros,
)
from warpvis.core.checks import check_choice, check_mapping
from warpvis.core.messages import Message, read_raw_camera_info
from warpvis.errors import CameraError

if TYPE_CHECKING:
    from warpvis.cameras.lens_camera import LensCamera


class CameraMakers(ProjectingCamera):
    """Base class with constructors of `Camera` (without distortion) or `warpvis.cameras.LensCamera`.

    The cameras are those of the raw images, with the distortion of the calibration. All constructors accept `near` and
    `far` [m], and `kind`, the definition of depth for a lens: ``"z"`` or ``"range"``, see `LensCamera`.
    """

    @classmethod
    def from_opencv(
        cls,
        K: ArrayLike,  # noqa: N803 - the field's names
        D: ArrayLike | None,  # noqa: N803
        width: int,
        height: int,
        *,
        model: Literal["pinhole", "fisheye"] = "pinhole",
        near: float = 0.0,
        far: float = math.inf,
        kind: DepthKind | None = None,
    ) -> Self | LensCamera:
        """Create a camera from an OpenCV calibration, whose pixel centers are at integer coordinates.

        Args:
            K: Intrinsics [px], shape ``(3, 3)``.
            D: Distortion coefficients: 4, 5, 8, 12 or 14 of ``cv2.calibrateCamera``, 4 of ``cv2.fisheye``; None for no
                distortion.
            width: Image width [px].
            height: Image height [px].
            model: One of the two camera models of OpenCV.
            near: Minimum depth [m].
            far: Maximum depth [m].
            kind: Definition of depth for a lens.
        """
        fisheye = check_choice(model, "model", ("pinhole", "fisheye"), CameraError) == "fisheye"
        return cls.from_lens(lens_from_opencv(K, D, fisheye=fisheye), width, height, near=near, far=far, kind=kind)

    @classmethod
    def from_raw_camera_info(
        cls, message: Message, *, near: float = 0.0, far: float = math.inf, kind: DepthKind | None = None
    ) -> Self | LensCamera:
        """Create a camera for the raw image of a ``sensor_msgs/CameraInfo``: `K`, `D` and `distortion_model`.

        For the rectified image, use `Camera.from_camera_info`. Binning and region of interest are applied.

        Args:
            message: The message, or any object with these fields, `width` and `height`.
            near: Minimum depth [m].
            far: Maximum depth [m].
            kind: Definition of depth for a lens.

        Raises:
            CameraError: If the model is not ``plumb_bob``, ``rational_polynomial`` or ``equidistant``, the number of
                coefficients does not match the model, or the camera is not calibrated.
            MessageError: If `message` is not a CameraInfo.
        """
        info, coefficients, model = read_raw_camera_info(message)
        lens = lens_from_ros(info.K, coefficients, model)
        return cls.from_lens(lens, info.width, info.height, near=near, far=far, kind=kind)

    @classmethod
    def from_colmap(
        cls,
        model: str,
        params: Sequence[float],
        width: int,
        height: int,
        *,
        near: float = 0.0,
        far: float = math.inf,
        kind: DepthKind | None = None,
    ) -> Self | LensCamera:
        """Create a camera from a COLMAP camera model, whose pixel centers are at +0.5.

        Args:
            model: Its name, such as ``"OPENCV"``; for a ``pycolmap.Camera``, ``camera.model.name``.
            params: Its parameters, in COLMAP's order.
            width: Image width [px].
            height: Image height [px].
            near: Minimum depth [m].
            far: Maximum depth [m].
            kind: Definition of depth for a lens.
        """
        return cls.from_lens(lens_from_colmap(model, params), width, height, near=near, far=far, kind=kind)

    @classmethod
    def from_kalibr(
        cls, camera: Mapping[str, Any], *, near: float = 0.0, far: float = math.inf, kind: DepthKind | None = None
    ) -> Self | LensCamera:
        """Create a camera from a Kalibr calibration, whose pixel centers are at integer coordinates.

        Args:
            camera: Its entry in ``camchain.yaml``: ``camera_model`` (pinhole, omni, eucm, ds), ``intrinsics``,
                ``distortion_model`` (none, radtan, equidistant, fov), ``distortion_coeffs``, ``resolution``.
            near: Minimum depth [m].
            far: Maximum depth [m].
            kind: Definition of depth for a lens.
        """
        entry = check_mapping(camera, "camera", CameraError)
        width, height = check_coefficients(entry.get("resolution", ()), "resolution", (2,), "numbers")
        return cls.from_lens(lens_from_kalibr(entry), width, height, near=near, far=far, kind=kind)  # type: ignore[arg-type]  # it checks

    @classmethod
    def from_nerfstudio(
        cls, fields: Mapping[str, Any], *, near: float = 0.0, far: float = math.inf, kind: DepthKind | None = None
    ) -> Self | LensCamera:
        """Create a camera from nerfstudio's ``transforms.json``, whose pixel centers are at +0.5.

        Args:
            fields: ``fl_x fl_y cx cy w h``, ``camera_model``, and ``k1 k2 k3 k4 p1 p2`` or ``distortion_params``; or,
                instead of ``camera_model``, instant-ngp's ``is_fisheye``, ``latlong`` or ``ftheta_p0`` to
                ``ftheta_p4``. If a frame has separate intrinsics, pass ``{**transforms, **frame}``.
            near: Minimum depth [m].
            far: Maximum depth [m].
            kind: Definition of depth for a lens.
        """
        entry = check_mapping(fields, "fields", CameraError)
        missing = [name for name in ("fl_x", "fl_y", "cx", "cy", "w", "h") if entry.get(name) is None]
        if missing:
            raise CameraError(f"fields must contain fl_x, fl_y, cx, cy, w and h, missing {missing[0]}")
        lens = lens_from_nerfstudio(entry, (entry["w"], entry["h"]), [entry[n] for n in ("fl_x", "fl_y", "cx", "cy")])
        return cls.from_lens(lens, entry["w"], entry["h"], near=near, far=far, kind=kind)

    @classmethod
    def from_lens(
        cls,
        lens: Lens,
        width: int,
        height: int,
        *,
        near: float = 0.0,
        far: float = math.inf,
        kind: DepthKind | None = None,
    ) -> Self | LensCamera:
        """Create a pinhole camera if the lens has no distortion and depth is along the axis, else a `LensCamera`."""
        from warpvis.cameras.lens_camera import LensCamera

        if kind is not None:
            check_choice(kind, "kind", ("z", "range"), CameraError)
        if getattr(lens, "is_pinhole", False) and kind != "range":
            pinhole: Any = cls
            return pinhole(width, height, *intrinsics(lens), near, far)
        return LensCamera(lens, width, height, near, far, kind)
