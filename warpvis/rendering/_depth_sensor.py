# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Base class of depth camera models, which compute a device's measurements from exact images."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import ProjectingCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import put_rows, take_rows
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.errors import ArrayError, CameraError
from warpvis.scene.worlds import part_of

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.pinhole import PinholeCamera
    from warpvis.scene import Scene

TakesLens: TypeAlias = Literal["no", "z", "any"]


@dataclass(frozen=True)
class Exposure:
    """Inputs and outputs of a model for the views of one call, or of a part of it on a GPU."""

    scene: Scene
    """The scene."""
    camera: Camera
    """The camera, with the depth range shared by it and the device. For models with `takes_lens`, it may be a
    `LensCamera`, of which only `image_range` may be used; for models whose `check` accepts them, it is `Rays`."""
    clip_near: float
    """Distance within which surfaces are cut away [m]: the camera's near with ``near_plane="clip"``, otherwise 0."""
    poses: wp.array
    """Camera to world, OpenCV axes or those of rays, ``(V,)`` transform; empty if `incidence` is given."""
    worlds: Worlds
    """The world of each view."""
    draws: wp.array
    """Keys of each view's random numbers: its number and its frame, ``(V,)`` vec2ui."""
    numbers: NDArray[np.uint32]
    """The same keys in host memory, ``(V, 2)``."""
    seed: int
    """Seed of the random numbers, below 2^32."""
    threads: int
    """CPU threads to use."""
    true_depth: wp.array
    """Depth of the first surface at any distance, ``(V, H, W)``: planar, or that of the camera's `kind`; +inf without a
    surface. Lists of rays are images of one row."""
    normals: wp.array | None
    """Unit normals of the first surface in the world frame, toward the camera, if the model needs them."""
    segmentation: wp.array | None
    """Objects of the first surface, -1 without one, if the model needs them."""
    incidence: wp.array | None
    """For a `Motion`, the cosine of incidence of each ray times the length of the ray of depth 1, ``(V, H, W)``, if the
    model needs normals; otherwise None."""
    depth_out: wp.array
    """Output for the measured depth, ``(V, H, W)``."""
    reasons_out: wp.array | None
    """Output for a `warpvis.sensors.Reason` per pixel, ``(V, H, W)`` uint8; None if not requested."""
    scratch: Callable[[str, tuple[int, ...], type], wp.array]
    """Scratch memory: `scratch(name, shape, dtype)` returns an array, which later calls of the same kind reuse."""
    cast: Callable[..., dict[str, wp.array]]
    """Implementation of `cast_images_at` for given worlds, which are its first argument."""

    @property
    def image_range(self) -> PinholeCamera:
        """Image size and depth range of a pinhole or a lens in the format of kernels."""
        width, height = self.camera.width, self.camera.height
        range_ = {"near": self.camera.near, "far": self.camera.far}
        return Camera(width, height, 1.0, 1.0, width / 2, height / 2, **range_).device_struct()

    def launch(
        self,
        kernel: wp.Kernel,
        *inputs: object,
        cameras: Sequence[object] = (),
        shape: tuple[int, int, int] | None = None,
        rows: int = 0,
    ) -> None:
        """Launch a kernel over all pixels of ``(V, Y, X)``, by default those of `depth_out`, on the scene's device.

        Its arguments are `cameras`, the window of `warpvis.core.threads.launch_images`, and `inputs`. If `rows` is not
        0, each of its threads processes a row of pixels on a CPU, and `rows` pixels of a row on a GPU.
        """
        launch_images(
            kernel,
            shape or self.depth_out.shape,
            lambda window: [*cameras, window, *inputs],
            device=self.scene.device,
            threads=self.threads,
            span=WHOLE_ROW if rows and self.scene.device.is_cpu else max(rows, 1),
        )

    def cast_at(self, camera: Camera, poses: wp.array, points: wp.array, limits: wp.array | None = None) -> wp.array:
        """Cast through image points of another camera in the same worlds.

        Args:
            camera: The camera.
            poses: Its pose in each of V views, in the format of `Exposure.poses`.
            points: Its image points [px], ``(V, Y, X)`` vec2; faster if neighbors in the array are close in the image.
            limits: Inverse depths beyond which surfaces are not needed [1/m], ``(V, Y, X)``, if `clip_near` is 0: where
                the first surface is farther, depth may be that of the limit, which is faster.

        Returns:
            Depth at the points, ``(V, Y, X)``; +inf where a point is NaN or outside the image. The array is valid until
            `measure` returns or casts again.
        """
        return self.cast(self.worlds, camera, poses, points, ("depth",), limits)["depth"]

    def cast_images_at(
        self, camera: Camera, poses: wp.array, points: wp.array, names: tuple[str, ...], used: wp.array | None = None
    ) -> dict[str, wp.array]:
        """Cast as `cast_at` does and return several images by name: ``"depth"``, ``"normals"``, ``"segmentation"``.

        `used` are numbers of points of each view, ``(V,)`` int32 on the device: images of later points are not needed.
        """
        return self.cast(self.worlds, camera, poses, points, names, None, used)

    def measure_some(self, views: NDArray[np.integer], sensor: DepthSensor) -> None:
        """Let a sensor measure a subset of the views, given by ascending indices."""
        first, last = int(views[0]), int(views[-1])
        if last - first == len(views) - 1:
            sensor.measure(self._part(slice(first, last + 1), sensor.needs))
            return
        batch = self._part(views, sensor.needs)
        sensor.measure(batch)
        for image, measured in ((self.depth_out, batch.depth_out), (self.reasons_out, batch.reasons_out)):
            if image is not None:
                put_rows(image, views, measured)

    def _part(self, views: slice | NDArray[np.integer], needs: Collection[str]) -> Exposure:
        """Return a subset of the views with the images in `needs`; a slice shares memory, indices are copied."""

        def select(array: wp.array | None) -> wp.array | None:
            return None if array is None else take_rows(array, views)

        return replace(
            self,
            poses=select(self.poses),
            worlds=part_of(self.worlds, views),
            draws=select(self.draws),
            numbers=self.numbers[views],
            true_depth=select(self.true_depth),
            normals=select(self.normals) if "normals" in needs else None,
            segmentation=select(self.segmentation) if "segmentation" in needs else None,
            incidence=select(self.incidence),
            depth_out=select(self.depth_out),
            reasons_out=select(self.reasons_out),
        )


class DepthSensor(ABC):
    """Base class of depth camera models, for the argument `sensor` of `Renderer` and other functions that render depth.

    A custom model is a frozen dataclass of numbers that implements `measure` by launching kernels. It may override
    `needs` and `bytes_per_pixel` to request additional images and declare its memory use, and `check` to reject cameras
    and scenes that it does not support.
    """

    native_camera: Camera | None = None
    """The device's own camera, returned by `camera`. Its depth range also limits depth through other cameras."""

    def camera(self) -> Camera:
        """Return the device's camera: its image size, focal length and range.

        Raises:
            CameraError: If the sensor has no `native_camera`.
        """
        if self.native_camera is None:
            raise CameraError("the sensor has no native_camera. Set native_camera, or use a profile of a device")
        return self.native_camera

    takes_lens: ClassVar[TakesLens] = "no"
    """Supported lenses: ``"no"``, ``"z"`` for lenses with depth along the axis, or ``"any"``. Models that support
    lenses must process depth pixel by pixel, and read only `Exposure.image_range` of the camera."""

    takes_motion: ClassVar[bool] = False
    """Whether the model supports motion within a frame: it reads `Exposure.incidence` instead of poses and normals."""

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Images of the first surface that `measure` reads in addition to its depth."""
        return ()

    @property
    def bytes_per_pixel(self) -> int:
        """Memory that `measure` uses per pixel, in addition to the images that it reads and writes [bytes]."""
        return 0

    @property
    def edge_shift(self) -> int:
        """Maximum distance by which edges of surfaces are displaced in measured depth [px]."""
        return 0

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera, with its depth range restricted to the device's.

        Raises:
            WarpvisError: If the sensor does not support the camera, or the ranges do not overlap.
        """
        lens = {"no": "", "z": ' or a LensCamera of kind "z"', "any": " or a LensCamera"}[self.takes_lens]
        expected = f"camera of {type(self).__name__} must be a warpvis.Camera{lens}"
        if not isinstance(camera, ProjectingCamera):
            raise CameraError(f"{expected}, got {type(camera).__name__}")
        if camera.ray_model != "pinhole" and self.takes_lens not in ("any", camera.kind):
            raise CameraError(f'{expected}, got {type(camera).__name__} of kind "{camera.kind}"')
        return self._in_range(cast(Camera, camera))

    def _in_range(self, camera: Camera) -> Camera:
        device = self.native_camera
        if device is None or (camera.near >= device.near and camera.far <= device.far):
            return camera
        near, far = max(camera.near, device.near), min(camera.far, device.far)
        if near >= far:
            raise CameraError(
                f"camera must have depths within the device's range, {device.near:g} to {device.far:g} m, got near="
                f"{camera.near:g}, far={camera.far:g}. Remove the device's range with "
                "dataclasses.replace(sensor, native_camera=None)"
            )
        return replace(camera, near=near, far=far)

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return the standard deviation of measured depth, for a surface at normal incidence.

        It includes rounding and systematic errors, as their root mean square, but no errors at edges. Models that do
        not override this method have none.

        Args:
            depth: Exact depth [m], any shape.
            camera: The camera, which defines the focal length of some models.

        Returns:
            Standard deviation [m], the shape of `depth`.

        Raises:
            ArrayError: If the model does not define it.
        """
        raise ArrayError(
            f"sensor must define the standard deviation of its depth, got {type(self).__name__}, which does not; "
            "override depth_sigma, or pass a number of meters or a function of depth"
        )

    @abstractmethod
    def measure(self, exposure: Exposure) -> None:
        """Write the sensor's depth and reasons with kernels on the scene's device.

        Depth must be within the camera's range or, as in REP 117, +inf where there is no surface or it is too far, and
        -inf where it is too near; NaN where it was lost for another reason. Random numbers must come from
        `warpvis.kernels.sensors.random_numbers`, whose docstring describes the options of modules with such kernels,
        and results must not depend on how views are split into calls.
        """


def require_sensor(sensor: object) -> DepthSensor:
    """Return `sensor` if it is a model of a depth camera.

    Raises:
        ArrayError: If `sensor` is not a `DepthSensor`.
    """
    if not isinstance(sensor, DepthSensor):
        raise ArrayError(f"sensor must be a model of warpvis.sensors, such as StereoDepth, got {sensor!r}")
    return sensor
