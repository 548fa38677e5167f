# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering: depth, world points, normals, labels, segmentation and faces of many views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.pinhole import require_camera
from warpvis.core.arrays import as_warp, count_axes
from warpvis.core.checks import check_choice, check_flag
from warpvis.core.motion import Motion
from warpvis.core.outputs import CAST, OUTPUTS
from warpvis.core.poses import Convention, QuaternionOrder, to_xyzw
from warpvis.core.threads import check_threads, launch_images
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, ObjectScales, PoseLike
from warpvis.errors import ArrayError, CameraError
from warpvis.rendering._antialiasing import EDGE_IMAGES, smooth_edges
from warpvis.rendering._choices import (
    DEFAULT_OUTPUTS,
    CasterName,
    Fill,
    Lighting,
    NearPlane,
    Output,
    check_device_bytes,
    check_output_names,
    choose_caster,
    fill_numbers,
)
from warpvis.rendering._color_options import check_colors
from warpvis.rendering._computed import Frame, compute_output, needs_of
from warpvis.rendering._depth_sensor import DepthSensor
from warpvis.rendering._layer_lists import blend_layers
from warpvis.rendering._layers import is_layered
from warpvis.rendering._mirrors import add_mirror, flipped_camera
from warpvis.rendering._sensing import Sensing, check_word, view_numbers
from warpvis.rendering._shadows import cast_occlusion, cast_shadows, count_shadows
from warpvis.rendering._views import CheckedImages, Views, pixel_bytes, pixel_type, views_for
from warpvis.rendering.casters import Caster, CastOptions, ViewBatch, make_caster
from warpvis.rendering.casters.base import ImagesByName, Scratch, as_image
from warpvis.rendering.casters.moving import MovingCaster, MovingPoses
from warpvis.scene import Scene, require_scene
from warpvis.scene.lights import AmbientOcclusion
from warpvis.scene.mirror_planes import Mirror
from warpvis.scene.world_appearances import WorldAppearances, parse_appearances
from warpvis.scene.worlds import parse_worlds

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds


class Renderer:
    """Render views of one scene through one camera repeatedly.

    Example:
        >>> renderer = Renderer(scene, Camera.kinect(), outputs=("depth", "labels"))
        >>> views = renderer.render(camera_to_world)
        >>> views = renderer.render(other_poses, out=views)  # into the same memory
    """

    frame: int = 0
    """The frame number that seeds a sensor's random numbers in the next call without `frame`."""

    def __init__(
        self,
        scene: Scene,
        camera: AnyCamera,
        *,
        outputs: Sequence[Output] = DEFAULT_OUTPUTS,
        caster: CasterName = "auto",
        cull_backfaces: bool = False,
        near_plane: NearPlane = "occlude",
        fill: Fill = "inf",
        shadows: bool = True,
        reflections: bool = True,
        lighting: Lighting = "pixel",
        ambient_occlusion: AmbientOcclusion | None = None,
        samples: int = 1,
        sensor: DepthSensor | None = None,
        seed: int = 0,
        threads: int | None = None,
        device_bytes: int | None = None,
    ) -> None:
        """Set up the renderer.

        Args:
            scene: The scene to render. Objects that are added to it later are rendered too.
            camera: Intrinsics, image size and depth range of all views; or a `warpvis.cameras.LensCamera`, a
                `warpvis.cameras.Rays` or a `warpvis.cameras.OrthographicCamera`. Rays with distinct origins are cast
                in packets of rays that pass near a common eye if the origins are within 0.1 m of each other, and ray by
                ray otherwise. An `OrthographicCamera` is always cast ray by ray.
            outputs: The images to render: ``"depth"``, ``"points"``, ``"normals"``, ``"labels"``, ``"segmentation"``,
                ``"faces"``, ``"color"``, ``"albedo"``; with a sensor, also ``"reasons"`` and ``"true_depth"``.
            caster: ``"packets"``, for speed; ``"rays"``, the reference; ``"auto"`` uses packets, which are faster in
                every measured case except small images of 50 million triangles on a GPU. Both give the same images.
            cull_backfaces: Whether to ignore triangles seen from behind (where ``(b - a) x (c - a)`` points away from
                the camera); by default surfaces are two-sided.
            near_plane: Treatment of surfaces nearer than the camera's `near`: with ``"occlude"``, they hide the
                surfaces behind them, and depth is -inf, as for a sensor (REP 117); with ``"clip"``, they are cut away,
                and the surfaces behind them are visible, as in OpenGL and MuJoCo.
            fill: Depth of pixels without a valid depth: ``"inf"``, +inf where there is no surface up to `far` and -inf
                where a surface is too near; ``"far"``, the camera's `far` and `near`; or a number for both, such as
                0.0. Pixels that a sensor lost for other reasons get the value of pixels without a surface.
            shadows: Whether surfaces block the light of each light with `Light.cast_shadow` in ``"color"``.
            reflections: Whether flat surfaces whose material has a `reflectance` show a mirror image in ``"color"``.
            lighting: Where light is computed in ``"color"``: ``"pixel"``, at each pixel; ``"vertex"``, at the vertices
                of triangles, clamped there, and interpolated, as in OpenGL's fixed-function pipeline. Shadows are those
                of pixels in both cases.
            ambient_occlusion: How far surfaces block ambient light of each other in ``"color"``; by default, they do
                not.
            samples: Rays through each pixel at an edge of a surface whose colors are averaged in ``"color"``: 1, 2, 4,
                8 or 16. Other pixels, and all other images, show what the ray through the pixel's center sees.
            sensor: A model of `warpvis.sensors`: depth and points are computed as such a device would measure them, and
                the other images are those of the exact rays. By default, depth and points are exact too.
            seed: Seed of the sensor's random numbers, combined with each view's number and frame; from 0 to 2^32 - 1.
                Renderers that simulate several devices need distinct seeds: with the same seed, their noise is the
                same.
            threads: CPU threads to use; all cores of this process by default.
            device_bytes: Maximum size in bytes of the images that one call of `render` holds on a GPU; half of its
                memory by default.

        Raises:
            WarpvisError: If an argument is invalid.
        """
        require_scene(scene)
        if not isinstance(camera, AnyCamera):
            require_camera(camera)
        self.scene = scene
        self.camera = camera
        self.sensor = sensor
        self.outputs = outputs
        self.threads = check_threads(threads)
        self.caster = choose_caster(caster, camera)
        self.device_bytes = check_device_bytes(device_bytes, scene.device)
        self.fill = fill
        self._fill = fill_numbers(fill, camera)
        colors = check_colors(
            camera, shadows=shadows, reflections=reflections, ambient_occlusion=ambient_occlusion, samples=samples
        )
        self.shadows, self.reflections = colors["shadows"], colors["reflections"]
        self.ambient_occlusion, self.samples = colors["ambient_occlusion"], colors["samples"]
        check_choice(lighting, "lighting", get_args(Lighting))
        self.lighting: Lighting = lighting
        if self.lighting == "vertex":
            scene.require_planes()
        self._shape = camera.shape
        self._checked = CheckedImages()
        self._options = CastOptions(
            check_flag(cull_backfaces, "cull_backfaces"),
            check_choice(near_plane, "near_plane", get_args(NearPlane)) == "clip",
            self.threads,
        )
        self.seed = check_word(seed, "seed")
        self._sensing: Sensing | None = None
        if sensor is not None:
            self._sensing = Sensing(sensor, scene, camera, self._make_caster, self._options, self.seed)
        self._exact_camera = camera if self._sensing is None else self._sensing.clean_camera
        self._caster = self._make_caster(self._exact_camera)
        self._only_packets = caster == "packets"
        self._moving: MovingCaster | None = None
        self._mirrored: tuple[AnyCamera, Caster] | None = None

    def _make_caster(self, camera: AnyCamera) -> Caster:
        return make_caster(self.caster, self.scene, camera, self._options)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The images that are rendered."""
        return self._outputs

    @outputs.setter
    def outputs(self, names: Sequence[str]) -> None:
        self._outputs = check_output_names(names, self.sensor)
        self._computed = []
        for name in self._outputs:
            if OUTPUTS[name].stage == "compute":
                self._computed.append(name)

    def render(
        self,
        camera_to_world: PoseLike | Motion,
        *,
        object_poses: ObjectPoses | Motion = None,
        object_scales: ObjectScales = None,
        world_index: ArrayInput | None = None,
        exclude: Excluded = None,
        appearances: WorldAppearances | None = None,
        convention: Convention | None = None,
        quaternion: QuaternionOrder = "xyzw",
        frame: int | ArrayInput | None = None,
        view_index: ArrayInput | None = None,
        out: Views | None = None,
    ) -> Views:
        """Render one image of each output for every pose.

        On CUDA the work is queued on the device's current stream, and the call does not wait for it. Images of more
        than `device_bytes` are rendered in parts, copied to host memory one part after the other, and returned there;
        the same applies if `out` is in host memory.

        Args:
            camera_to_world: Poses, rows ``x y z qx qy qz qw`` of shape ``(V, 7)`` or matrices of shape ``(V, 4, 4)``;
                one pose without the leading axis is one view. Or a `warpvis.sensors.Motion` for a sensor that moves
                within the frame: each ray is cast individually, from the sensor's pose at the ray's time.
            object_poses: Poses of the M movable objects (`Scene.movable`) in each of W worlds: object to world, rows
                ``x y z qx qy qz qw``, shape ``(W, M, 7)`` or ``(M, 7)``, or `wp.transform` of shape ``(W, M)``. By
                default there is one world with the poses at which they were added. Or a `warpvis.sensors.Motion` of the
                objects: each ray sees them at their poses at its time.
            object_scales: Scales of the movable objects in each of these worlds: factors along the object's local x, y
                and z axes, by which the object and everything attached to it are stretched, shape ``(W, M, 3)`` or
                ``(M, 3)``. By default 1. Round solids stay round: a sphere becomes an ellipsoid, and so do a capsule's
                ends.
            world_index: World index of every view, shape ``(V,)`` int32. By default all views show the one world, or if
                there are V worlds, view i shows world i.
            exclude: Objects to leave out: names or indices of objects, or flags per view, shape ``(V, objects)``. For
                example, a robot's camera excludes the robot's body.
            appearances: Colors, materials, lights and backgrounds of the worlds, which the outputs ``"color"`` and
                ``"albedo"`` show; by default all worlds have those of the scene.
            convention: Axes of the camera frame of the poses: ``"opencv"``, ``"opengl"``, ``"ros_body"`` or
                ``"ros_optical"``; by default the camera's axes, which are OpenCV's except for `warpvis.cameras.Rays`
                with other axes.
            quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``; a `Motion` already
                has its order.
            frame: Frame number that seeds a sensor's random numbers, from 0 up: one number, or one for each view, shape
                ``(V,)``. By default `Renderer.frame`, which starts at 0 and increases by 1 with each such call. A
                replayed CUDA graph uses the frame that it was recorded with.
            view_index: View numbers that seed the random numbers, shape ``(V,)``, by default 0 to V - 1: a view that is
                rendered alone or in another batch has the same image if its number and frame are the same.
            out: Images of an earlier call with the same number of views, to write into.

        Returns:
            The images, on the scene's device or, if they are too large for it, on the host; `out` if it was given.

        Raises:
            PoseError: If the poses are malformed; the message lists the first few offending views.
            ArrayError: If `out`, `world_index`, `exclude` or `object_scales` does not fit.
            SceneError: If the scene is empty, or contains no object of a name in `exclude`.
            CameraError: If a `Motion` is given and rays have no times, or the sensor is not a `LidarNoise`.
        """
        options = world_index, exclude, object_scales
        if not isinstance(quaternion, str) or quaternion != "xyzw":
            if not isinstance(camera_to_world, Motion):
                camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
            if not isinstance(object_poses, Motion):
                object_poses = to_xyzw(object_poses, quaternion, "object_poses")
        self.scene.require_objects()
        if isinstance(camera_to_world, Motion) or isinstance(object_poses, Motion):
            views = self._moving_caster().parse(camera_to_world, object_poses, convention, *options)
        else:
            poses = self._caster.parse_poses(camera_to_world, self.camera.axes if convention is None else convention)
            views = self._view_batch(poses, object_poses, options, appearances)
        if self._sensing is not None or frame is not None or view_index is not None:
            self._number(views, frame, view_index)
        return self._render(views, out)

    def _view_batch(
        self,
        poses: Any,
        object_poses: ObjectPoses,
        options: tuple[ArrayInput | None, Excluded, ObjectScales],
        appearances: WorldAppearances | None,
        pixels: wp.array | None = None,
    ) -> ViewBatch:
        """Return views of checked poses, with their worlds and appearances."""
        if appearances is None:
            worlds = parse_worlds(self.scene, len(poses), object_poses, *options)
            return ViewBatch(poses, worlds, pixels=pixels)
        found = parse_appearances(self.scene, appearances)
        worlds = parse_worlds(self.scene, len(poses), object_poses, *options, least=found.worlds)
        return ViewBatch(poses, worlds, pixels=pixels, appearances=found)

    def _number(self, views: ViewBatch, frame: int | ArrayInput | None, view_index: ArrayInput | None) -> None:
        """Set the number and frame of each view, which seed a sensor's random numbers."""
        if self._sensing is not None:
            views.numbers = view_numbers(views.count, self.frame if frame is None else frame, view_index)
            self.frame += frame is None
        elif frame is not None or view_index is not None:
            raise ArrayError("frame and view_index must be None without a sensor, since they seed its random numbers")

    def _render(self, views: ViewBatch, out: Views | None) -> Views:
        """Render checked views into new images, or into `out`."""
        shape, device = (views.count, *self._shape), self.scene.device
        images = None if out is None else self._checked.find(out, shape, self._outputs)
        if out is not None and images is not None:
            self._run(views, images)
            return out
        if self._on_host(shape, out):
            result = views_for(self._outputs, shape, wp.get_device("cpu"), out)
            self._run_in_parts(views, self._images_of(result))
            return result
        result = views_for(self._outputs, shape, device, out)
        images = self._images_of(result)
        if out is not None:
            self._checked.record(images, shape, self._outputs)
        self._run(views, images)
        return result

    def _images_of(self, views: Views) -> dict[str, wp.array]:
        """Return the requested images by name."""
        images = {}
        for name in self._outputs:
            images[name] = getattr(views, name)
        return images

    def _run(self, views: ViewBatch, images: ImagesByName) -> None:
        """Run the stages of a call: cast, compute, measure, fill. Take memory for images that they need."""
        device = self.scene.device
        to_upload = isinstance(views.poses, np.ndarray) and not device.is_cpu
        if not to_upload and not self._computed and self._sensing is None:
            self._cast(views, images)
            if self._fill is not None:
                self._fill_depth(images)
            return
        lacking = self._lacking()
        if device.is_cuda and device.is_capturing:  # a captured graph must not share its memory
            self._run_with(lacking, views, images, Scratch(device))
            return
        kind = (
            self._shape if views.pixels is None else views.pixels.shape,
            views.count,
            device.is_cuda and device.stream,
        )
        run = partial(self._run_with, lacking, views, images)
        self._options.pool.use(kind, lambda: Scratch(device), run)

    def _lacking(self) -> set[str]:
        """Return the images that the stages need and that were not requested; with a sensor, also exact points."""
        needed = set[str]().union(*(needs_of(name, self.scene) for name in self._computed))
        if self.samples > 1 and "color" in self._computed:
            needed.update(EDGE_IMAGES)
        if self._sensing is not None:
            exact = {"exact points"} if "points" in needed else set()
            needed = (needed - {"points"}) | exact | set(self._sensing.needs)
        return needed.difference(self._outputs)

    def _run_with(self, lacking: set[str], views: ViewBatch, images: ImagesByName, scratch: Scratch) -> None:
        """Run the stages with memory for images that were not requested."""
        device = self.scene.device
        if isinstance(views.poses, np.ndarray) and device.is_cuda and not device.is_capturing:
            views.upload(scratch)
        shape = (views.count, *self._shape) if views.pixels is None else next(iter(images.values())).shape
        memory = {name: scratch.array(name, shape, pixel_type(_output_of(name))) for name in lacking}
        self._run_stages({**images, **memory}, views, images, scratch)

    def _run_stages(self, every: ImagesByName, views: ViewBatch, images: ImagesByName, scratch: Scratch) -> None:
        """Cast, compute, measure and fill.

        Args:
            every: Images that the stages read or write, by name.
            views: The views.
            images: The requested images.
            scratch: Memory for further images.
        """
        exact = every
        if self._sensing is not None:  # casters write the exact depth, and exact points only if colors need them
            exact = {**every, "depth": every["true_depth"], "points": every.get("exact points")}
        cast_images = {name: exact[name] for name in CAST if exact.get(name) is not None}
        self._cast(views, cast_images)
        if self._computed:
            poses = views.poses_on(self.scene.device)
            for name in self._computed:
                inputs = {needed: as_image(exact[needed]) for needed in needs_of(name, self.scene)}
                frame = Frame(self.scene, self._exact_camera, poses, views.worlds, inputs, self.threads, views.pixels)
                if self.lighting == "vertex":
                    frame = replace(frame, lighting=self.lighting)
                if views.appearances is not None:
                    frame = replace(frame, appearances=views.appearances)
                if name == "color" and self.shadows and self.scene.lights:
                    frame = replace(frame, shadows=cast_shadows(frame, self.caster, scratch))
                if name == "color" and self.ambient_occlusion is not None and self.scene.lights:
                    occlusion = cast_occlusion(frame, self.ambient_occlusion, self.caster, scratch)
                    frame = replace(frame, occlusion=occlusion)
                compute_output(name, frame, as_image(images[name]), scratch)
                if name == "color" and self.reflections:
                    self._add_mirrors(frame, views, as_image(images[name]), scratch)
                if name == "color" and is_layered(frame):
                    blend_layers(frame, as_image(images[name]), self.caster, self._options, scratch)
                if name == "color" and self.samples > 1 and views.pixels is None:
                    smooth_edges(self.samples, views, exact, images[name], self._color_points, scratch)
        if self._sensing is not None:
            moving = self._moving if type(views.poses) is MovingPoses else None
            self._sensing.measure(views, every, scratch, moving)
        self._fill_depth(images)

    def _add_mirrors(self, frame: Frame, views: ViewBatch, color: wp.array, scratch: Scratch) -> None:
        """Add mirror images to colors."""
        mirrors = self.scene.mirrors()
        if mirrors is None:
            return
        if self._mirrored is None:
            camera = flipped_camera(self._exact_camera)
            self._mirrored = camera, self._make_caster(camera)
        for mirror in self._choose_mirrors(mirrors.planes):
            add_mirror(frame, views, mirror, mirrors, *self._mirrored, self._options, scratch, color)

    def _choose_mirrors(self, planes: Sequence[Mirror]) -> Sequence[Mirror]:
        """Return the planes that mirror."""
        return planes

    def _color_points(self, views: ViewBatch, color: wp.array) -> None:
        """Write the colors of image points."""
        inner = object.__new__(type(self))
        inner.__dict__.update(self.__dict__, sensor=None, _sensing=None)
        inner.outputs = ("color",)
        inner._run(views, {"color": color})

    def _cast(self, views: ViewBatch, images: ImagesByName) -> None:
        caster = self._moving_caster() if type(views.poses) is MovingPoses else self._caster
        caster.cast(views, images)

    def _moving_caster(self) -> MovingCaster:
        """Return the caster for motions, which is made at first use."""
        if self._sensing is not None and not self._sensing.sensor.takes_motion:
            raise CameraError(
                "sensor must be a LidarNoise or None for a Motion: other models do not support motion within a frame"
            )
        if self._computed:
            raise CameraError(
                f"outputs must not contain {', '.join(self._computed)} for a Motion: outputs that are computed from "
                "others do not support motion within a frame"
            )
        if self._only_packets:
            raise CameraError('caster must be "rays" or "auto" for a Motion, got "packets"')
        if self._moving is None:
            single_rays = self.caster == "rays"
            self._moving = MovingCaster(self.scene, self._exact_camera, self._options, single_rays=single_rays)
        return self._moving

    def render_at(
        self,
        camera_to_world: PoseLike,
        pixels: ArrayInput,
        *,
        object_poses: ObjectPoses = None,
        object_scales: ObjectScales = None,
        world_index: ArrayInput | None = None,
        exclude: Excluded = None,
        appearances: WorldAppearances | None = None,
        convention: Convention | None = None,
        quaternion: QuaternionOrder = "xyzw",
        out: Views | None = None,
    ) -> Views:
        """Render at arbitrary points of the image instead of at its pixel centers.

        Args:
            camera_to_world: Poses, as for `render`.
            pixels: Coordinates ``(x, y)`` [px] from the image's top left corner, N for every view, shape ``(V, N, 2)``;
                a pixel's center is its index + 0.5. Points outside the image and points with a NaN coordinate are
                empty. Or maps as for OpenCV's ``remap``, shape ``(V, Y, X, 2)``: neighbors that lie close together are
                cast together, which is several times as fast on CPU cores. On a GPU, long lists of points are cast
                together too (docs/rendering.md).
            object_poses: As for `render`.
            object_scales: As for `render`.
            world_index: As for `render`.
            exclude: As for `render`.
            appearances: As for `render`.
            convention: As for `render`.
            quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
            out: Results of an earlier call to write into, of the same shape.

        Returns:
            The outputs, of shape ``(V, N)`` or ``(V, Y, X)``, with the same meaning as in images.

        Raises:
            WarpvisError: As for `render`, or if `pixels` is malformed, or if there is a sensor.
        """
        if self._sensing is not None:
            raise CameraError(
                "render_at requires a Renderer without a sensor, since sensor models measure at pixel centers"
            )
        camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
        object_poses = to_xyzw(object_poses, quaternion, "object_poses")
        self.scene.require_objects()
        poses = self._caster.parse_poses(camera_to_world, self.camera.axes if convention is None else convention)
        axes = ("Y", "X") if count_axes(pixels, wp.vec2) == 3 else ("N",)
        points = as_warp(pixels, wp.vec2, (len(poses), *axes), name="pixels", device=self.scene.device)
        options = world_index, exclude, object_scales
        views = self._view_batch(poses, object_poses, options, appearances, as_image(points))
        result = views_for(self._outputs, points.shape, self.scene.device, out)
        self._run(views, self._images_of(result))
        return result

    def render_parsed(self, poses: wp.array, worlds: Worlds, *, out: Views | None = None) -> Views:
        """Render parsed poses and worlds, the results of `parse_poses` and `parse_worlds`: `render` for internal use.

        The images stay on the scene's device, whatever their size.
        """
        views = ViewBatch(self._caster.parse_poses(poses, "opencv"), worlds)
        self._number(views, None, None)
        result = views_for(self._outputs, (len(poses), *self._shape), self.scene.device, out)
        self._run(views, self._images_of(result))
        return result

    def _fill_depth(self, images: ImagesByName) -> None:
        """Replace depths that are not finite, if depth was requested, by the numbers of `fill`."""
        if self._fill is None or "depth" not in images:
            return
        from warpvis.kernels.casting.images import fill_depth

        (empty, too_near), depth = self._fill, as_image(images["depth"])
        launch_images(
            fill_depth,
            depth.shape,
            lambda window: [window, empty, too_near, depth],
            device=depth.device,
            threads=self.threads,
        )

    def _on_host(self, shape: tuple[int, ...], out: Views | None) -> bool:
        """Return whether the images rendered on a GPU go to host memory."""
        if self.scene.device.is_cpu:
            return False
        if out is None:
            return math.prod(shape) * self._bytes_per_pixel() > self.device_bytes
        images = [getattr(out, name, None) for name in self._outputs]
        return all(isinstance(image, wp.array) and image.device.is_cpu for image in images)

    def _bytes_per_pixel(self) -> int:
        lacking = [_output_of(name) for name in self._lacking()]
        extra = 0 if self.sensor is None else self.sensor.bytes_per_pixel
        if "color" in self._computed and self.shadows:
            extra += count_shadows(self.scene.lights)
        if "color" in self._computed and self.ambient_occlusion is not None:
            extra += 1
        if "color" in self._computed and self.reflections and self.scene.mirrors() is not None:
            extra += pixel_bytes(["color", *needs_of("color", self.scene)])
        return extra + pixel_bytes([*self._outputs, *lacking])

    def _run_in_parts(self, views: ViewBatch, images: ImagesByName) -> None:
        """Render as many views at a time as fit `device_bytes`, at least one, and copy them to the host's images."""
        count, pixels = views.count, math.prod(self._shape)
        step = min(count, max(1, self.device_bytes // (pixels * self._bytes_per_pixel())))
        buffers = self._images_of(views_for(self._outputs, (step, *self._shape), self.scene.device))
        for first in range(0, count, max(1, step)):
            part = slice(first, min(first + step, count))
            sources = {name: buffer[: part.stop - first] for name, buffer in buffers.items()}
            self._run(views.part(part), sources)
            for name, source in sources.items():
                wp.copy(images[name][part], source)
        wp.synchronize_stream(self.scene.device.stream)


def _output_of(image: str) -> str:
    """Return the output of the same type as an image of the stages, which may be the exact one before a sensor."""
    return image.removeprefix("exact ")
