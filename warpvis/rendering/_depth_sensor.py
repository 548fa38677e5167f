# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What models of depth cameras derive from: they read clean images, and write what the device would have said."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import put_rows, take_rows
from warpvis.core.camera import Camera
from warpvis.core.ray_camera import LensedCamera
from warpvis.errors import ArrayError, CameraError
from warpvis.scene.worlds import part_of

if TYPE_CHECKING:
    from warpvis.kernels.pinhole import PinholeCamera
    from warpvis.kernels.worlds import Worlds
    from warpvis.scene import Scene

TakesLens: TypeAlias = Literal["no", "z", "any"]


@dataclass(frozen=True)
class Exposure:
    """The views of one call (or of a part of it, on a GPU): what a model reads, and what it writes."""

    scene: Scene
    """What is seen."""
    camera: Camera
    """The camera, with the depth range that it and the device have in common. Of models with `takes_lens` it may be a
    `LensCamera`, of which only `image_range` is to be asked for."""
    clip_near: float
    """What is nearer is not there [m]: the camera's near with ``near_plane="clip"``, else 0."""
    poses: wp.array
    """Camera to world, OpenCV's axes, ``(V,)`` transform."""
    worlds: Worlds
    """The world of each view."""
    draws: wp.array
    """What a view's random numbers follow from: its number and its frame, ``(V,)`` vec2ui."""
    numbers: NDArray[np.uint32]
    """The same in the host's memory, ``(V, 2)``."""
    seed: int
    """And the seed, below 2^32."""
    threads: int
    """CPU threads to use."""
    true_depth: wp.array
    """Planar depth of the first surface, however near or far it is, ``(V, H, W)``; +inf where there is none."""
    normals: wp.array | None
    """Its unit normals in the world frame, towards the camera, if the model needs them."""
    segmentation: wp.array | None
    """Its object, -1 where there is none, if the model needs that."""
    depth_out: wp.array
    """Where to write what the sensor says, ``(V, H, W)``."""
    reasons_out: wp.array | None
    """Where to write a `warpvis.sensors.Reason` for every pixel, ``(V, H, W)`` uint8; None if nobody asks."""
    room: Callable[[str, tuple[int, ...], type], wp.array]
    """Memory to work in: `room(name, shape, dtype)` returns an array, the same one in the next call of the kind."""
    cast: Callable[[Worlds, Camera, wp.array, wp.array, tuple[str, ...]], dict[str, wp.array]]
    """What `cast_images_at` calls, of any worlds."""

    @property
    def image_range(self) -> PinholeCamera:
        """The image's size and the range of depth as kernels take them, of a pinhole or a lens."""
        width, height = self.camera.width, self.camera.height
        range_ = {"near": self.camera.near, "far": self.camera.far}
        return Camera(width, height, 1.0, 1.0, width / 2, height / 2, **range_).device_struct()

    def cast_at(self, camera: Camera, poses: wp.array, points: wp.array) -> wp.array:
        """Cast through image points of another camera of the same worlds.

        Args:
            camera: The camera.
            poses: Where it is in each of V views, as `poses`.
            points: Its image points, ``(V, Y, X)`` vec2 [px], of which neighbours are best close together.

        Returns:
            The depth that is seen there, ``(V, Y, X)``; +inf where a point is NaN or outside of the image. The array is
            the model's until its `measure` returns, or casts again.
        """
        return self.cast_images_at(camera, poses, points, ("depth",))["depth"]

    def cast_images_at(
        self, camera: Camera, poses: wp.array, points: wp.array, names: tuple[str, ...]
    ) -> dict[str, wp.array]:
        """Do the same of several images, by their names: of ``"depth"``, ``"normals"`` and ``"segmentation"``."""
        return self.cast(self.worlds, camera, poses, points, names)

    def measure_some(self, views: NDArray[np.integer], sensor: DepthSensor) -> None:
        """Have a sensor measure some of the views, by their places among these, in ascending order."""
        first, last = int(views[0]), int(views[-1])
        if last - first == len(views) - 1:
            sensor.measure(self._part(slice(first, last + 1), sensor.needs))
            return
        part = self._part(views, sensor.needs)
        sensor.measure(part)
        for image, made in ((self.depth_out, part.depth_out), (self.reasons_out, part.reasons_out)):
            if image is not None:
                put_rows(image, views, made)

    def _part(self, views: slice | NDArray[np.integer], needs: Collection[str]) -> Exposure:
        """Return some of the views, of consecutive ones the same memory, and of images those that are needed."""

        def some(array: wp.array | None) -> wp.array | None:
            return None if array is None else take_rows(array, views)

        return replace(
            self,
            poses=some(self.poses),
            worlds=part_of(self.worlds, views),
            draws=some(self.draws),
            numbers=self.numbers[views],
            true_depth=some(self.true_depth),
            normals=some(self.normals) if "normals" in needs else None,
            segmentation=some(self.segmentation) if "segmentation" in needs else None,
            depth_out=some(self.depth_out),
            reasons_out=some(self.reasons_out),
        )


class DepthSensor(ABC):
    """A model of a depth camera: what ``sensor=`` takes, of `Renderer` and wherever else depth is rendered.

    A model of one's own is a frozen dataclass of numbers, whose `measure` launches kernels. Nothing else is asked of
    it: `needs` and `bytes_per_pixel` say what it reads and how much room it takes, and `check` refuses cameras and
    scenes that it is no model of.
    """

    native_camera: Camera | None = None
    """The camera that the device has: what `camera` returns. Depth keeps to its range through any other camera."""

    def camera(self) -> Camera:
        """Return the camera of the device: its image size, focal length and range.

        Raises:
            CameraError: The sensor was made without one.
        """
        if self.native_camera is None:
            raise CameraError("this sensor has no camera of its own: give native_camera, or take a profile of a device")
        return self.native_camera

    takes_lens: ClassVar[TakesLens] = "no"
    """Whether the model is one of cameras with lenses, too: where depth is along the axis, or of any. It must then look
    at depth alone, pixel by pixel, and at nothing of the camera but `Exposure.image_range`."""

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Which images of the first surface `measure` reads beside its depth."""
        return ()

    @property
    def bytes_per_pixel(self) -> int:
        """How much room `measure` takes for a pixel, beside the images that it reads and writes."""
        return 0

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera with the range of depth that it and the device have in common.

        Raises:
            WarpvisError: If the sensor is not a model of such a camera, or there is no such range.
        """
        if isinstance(camera, Camera):
            return self._in_range(camera)
        if isinstance(camera, LensedCamera) and self.takes_lens in ("any", camera.kind):
            return self._in_range(cast(Camera, camera))
        lens = {"no": "", "z": " or a lens's depth along the axis", "any": " or a lens"}[self.takes_lens]
        given = type(camera).__name__ + (f' of kind "{camera.kind}"' if isinstance(camera, LensedCamera) else "")
        raise CameraError(f"{type(self).__name__} is a model of a pinhole, warpvis.Camera,{lens} and not of a {given}")

    def _in_range(self, camera: Camera) -> Camera:
        device = self.native_camera
        if device is None or (camera.near >= device.near and camera.far <= device.far):
            return camera
        near, far = max(camera.near, device.near), min(camera.far, device.far)
        if near >= far:
            raise CameraError(
                f"camera must have depths within the device's range, {device.near:g} to {device.far:g} m, got near="
                f"{camera.near:g}, far={camera.far:g}; dataclasses.replace(sensor, native_camera=None) has no range"
            )
        return replace(camera, near=near, far=far)

    @abstractmethod
    def measure(self, exposure: Exposure) -> None:
        """Write the sensor's depth and reasons, by kernels on the scene's device.

        Depth is within the camera's range or, as in REP 117, +inf where nothing is or it is too far, -inf where it is
        too near; NaN where it was lost for another reason. Random numbers are those of
        `warpvis.kernels.random_numbers`, and nothing depends on how views are split.
        """


def require_sensor(sensor: object) -> DepthSensor:
    """Return `sensor` if it is a model of a depth camera.

    Raises:
        ArrayError: It is none.
    """
    if not isinstance(sensor, DepthSensor):
        raise ArrayError(f"sensor must be a model of warpvis.sensors, such as StereoDepth, got {sensor!r}")
    return sensor
