# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A drop-in replacement of `mujoco.Renderer` for depth and segmentation, without OpenGL."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, cast, get_args

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import check_size
from warpvis.core.checks import check_choice, check_flag, describe_exception, truncate
from warpvis.core.labels import LabelInput, LabelRules
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, SceneError, WarpvisError
from warpvis.mujoco._cameras import (
    RendererScene,
    ViewerScene,
    camera_of_frustum,
    filled_depth,
    viewer_camera,
    viewer_frustum,
    viewer_pose,
)
from warpvis.mujoco._geom_renderer import GeomRenderer
from warpvis.mujoco._geoms import DEFAULT_MESH_TOLERANCE
from warpvis.mujoco._poses import check_computed
from warpvis.mujoco._scene import check_patterns, select_geoms, shown_by
from warpvis.mujoco._stage import Stage
from warpvis.mujoco._tessellation import Eye
from warpvis.mujoco._visuals import Visuals
from warpvis.rendering import DepthSensor, Fill, NearPlane, Output, check_fill, check_word, require_sensor
from warpvis.sensors import Reason

_REBUILT = ("_stages", "_stage", "_viewer", "_fallback", "_visuals")
_OF_SENSOR: tuple[Output, ...] = ("reasons", "true_depth")
_NOTHING: dict[str, tuple[float, type]] = {"depth": (np.inf, np.float32), "segmentation": (-1, np.int32)}
_NOTHING |= {"reasons": (Reason.EMPTY, np.uint8), "true_depth": (np.inf, np.float32)}
_MAX_RENDERERS = 64  # bounds the memory if the camera's field of view keeps changing


class Renderer:
    """Depth and segmentation images of a MuJoCo model, with the interface of `mujoco.Renderer`.

    Replace ``mujoco.Renderer`` by ``warpvis.mujoco.Renderer``; other code is unchanged. Differences:

    - Colors are rendered by a `mujoco.Renderer`, if ``fallback=True``.
    - Everything is rendered that MuJoCo draws with the flags of `mujoco.MjvOption`, except plugins and convex hulls.
    - `scene` is a `warpvis.Scene` with the `flags` and `camera` of MuJoCo's scene, but without `geoms`; see `scene`.
    - Round shapes are exact; MuJoCo draws them with 28 slices.
    - Changes of the model's geoms and sites are followed, including meshes and height fields, which MuJoCo uploads only
      on request.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        height: int = 240,
        width: int = 320,
        max_geom: int = 10000,
        font_scale: object = None,
        *,
        mesh_tolerance: float = DEFAULT_MESH_TOLERANCE,
        labels: LabelInput | None = None,
        label_names: Mapping[int, str] | None = None,
        exclude: Iterable[str] = (),
        cull_backfaces: bool = True,
        near_plane: NearPlane = "clip",
        fill: Fill = "far",
        sensor: DepthSensor | None = None,
        seed: int = 0,
        fallback: bool = False,
        device: DeviceLike = "cpu",
        threads: int | None = None,
    ) -> None:
        """Initialize a renderer.

        Args:
            model: A `mujoco.MjModel`.
            height: Image height [px], not limited by the model's ``offheight``.
            width: Image width [px].
            max_geom: Used by `fallback` only; all geoms are rendered.
            font_scale: Used by `fallback` only; images contain no text.
            mesh_tolerance: Maximum distance between round shapes and their triangles [m]; see `scene_from_mujoco`.
            labels: Labels for the objects of `scene`; see `scene_from_mujoco`.
            label_names: Names of user-defined classes, as for `warpvis.Scene`.
            exclude: Names or patterns of geoms, sites, tendons, skins, flexes or bodies not to render.
            cull_backfaces: Whether back faces are invisible, as in MuJoCo, for example from inside a robot's head.
            near_plane: ``"clip"`` to clip geometry nearer than MuJoCo's near plane, as MuJoCo does; ``"occlude"`` to
                render it.
            fill: Depth of pixels without depth: ``"far"`` for MuJoCo's far value (for a sensor, the near plane where a
                surface is too near); ``"inf"`` for +inf (-inf where too near, and NaN where a sensor lost depth); or a
                number [m].
            sensor: A depth camera model, as for `warpvis.Renderer`, which computes depth for MuJoCo's cameras with the
                model's near plane. `reasons` has the reasons for missing depth, and `true_depth` the exact depth.
                Segmentation remains exact.
            seed: Seed of the sensor's random numbers, which also depend on `frame`, the number of depth images.
            fallback: Whether to render colors with a `mujoco.Renderer`, which needs OpenGL.
            device: Device for rendering: ``"cpu"``, ``"cuda:0"``, ...
            threads: Number of CPU threads; by default all cores available to the process.
        """
        if not isinstance(model, mujoco.MjModel):
            raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
        check_size(width, "width")
        check_size(height, "height")
        self._model, self._size = model, (int(height), int(width))
        rules = LabelRules.of(labels, label_names)
        self._options: dict[str, Any] = {"mesh_tolerance": mesh_tolerance, "labels": rules}
        self._options["exclude"] = check_patterns(exclude)
        self._device = device
        self._cull_backfaces = check_flag(cull_backfaces, "cull_backfaces")
        self._near_plane = check_choice(near_plane, "near_plane", get_args(NearPlane))
        self._fill = check_fill(fill)
        self._sensor = None if sensor is None else require_sensor(sensor)
        self._seed = check_word(seed, "seed")
        self.frame = 0
        """Frame number for a sensor's random numbers in the next depth image; incremented with every depth image."""
        self._sensed: dict[str, np.ndarray] = {}
        self._threads = check_threads(threads)
        self._viewer = ViewerScene(model)
        self._visuals = Visuals(model, mesh_tolerance=mesh_tolerance)
        self._warned: set[str] = set()
        self._stages: dict[tuple[tuple[int, ...], bool, tuple[int, ...]], Stage] = {}
        self._stage = self._stage_of(shown_by(None))
        self._mode = "color"
        self._camera: PlanarCamera | None = None
        self._pose: NDArray[np.float32] = np.zeros(7, dtype=np.float32)
        self._closed = False
        self._fallback_options = {"max_geom": max_geom} | ({} if font_scale is None else {"font_scale": font_scale})
        self._fallback = self._make_fallback() if check_flag(fallback, "fallback") else None

    @property
    def model(self) -> mujoco.MjModel:
        """The `mujoco.MjModel`."""
        return self._model

    @property
    def fallback(self) -> mujoco.Renderer | None:
        """The `mujoco.Renderer` for colors, or None."""
        return self._fallback

    @property
    def scene(self) -> RendererScene:
        """The scene of the last `update_scene`: a `warpvis.Scene` with the `flags` and `camera` of MuJoCo's scene.

        Among `flags`, only mjRND_CULL_FACE has an effect. mjRND_WIREFRAME is ignored with a warning; the others do not
        affect depth or segmentation. Changes of `camera` apply until the next `update_scene`. There are no `geoms`: use
        `add` for additional shapes.

        Added objects follow the model's objects, and are visible while `update_scene` selects the same groups of geoms
        and sites. Movable ones keep their initial poses.
        """
        return self._stage.scene

    @property
    def reasons(self) -> NDArray[np.uint8]:
        """Reasons for missing depth in the last depth image, `warpvis.sensors.Reason`, ``(height, width)`` uint8."""
        return self._of_sensor("reasons")

    @property
    def true_depth(self) -> NDArray[np.float32]:
        """Exact depth of the last depth image [m], shape ``(height, width)`` float32; +inf for no hit."""
        return self._of_sensor("true_depth")

    def _of_sensor(self, name: str) -> np.ndarray:
        if not self._sensed:
            remedy = "pass sensor= to Renderer" if self._sensor is None else "render depth first"
            raise WarpvisError(f"{name} requires depth of a sensor: {remedy}")
        return self._sensed[name]

    @property
    def height(self) -> int:
        """Image height [px]."""
        return self._size[0]

    @property
    def width(self) -> int:
        """Image width [px]."""
        return self._size[1]

    def enable_depth_rendering(self) -> None:
        """Render depth from now on."""
        self._mode = "depth"

    def disable_depth_rendering(self) -> None:
        """Stop rendering depth."""
        self._mode = "color" if self._mode == "depth" else self._mode

    def enable_segmentation_rendering(self) -> None:
        """Render segmentation from now on."""
        self._mode = "segmentation"

    def disable_segmentation_rendering(self) -> None:
        """Stop rendering segmentation."""
        self._mode = "color" if self._mode == "segmentation" else self._mode

    def update_scene(
        self,
        data: mujoco.MjData,
        camera: int | str | mujoco.MjvCamera = -1,
        scene_option: mujoco.MjvOption | None = None,
    ) -> None:
        """Update the scene and the camera from simulation data.

        Args:
            data: A `mujoco.MjData` of the model, after `mj_forward` or a step.
            camera: A camera's name or id, -1 for the default free camera, or a `mujoco.MjvCamera`.
            scene_option: A `mujoco.MjvOption` that selects visible elements. Elements that this renderer cannot draw
                are listed in a warning, once.

        Raises:
            WarpvisError: If there is no such camera, poses of the data were never computed, values of the model are not
                finite, or the options enable convex hulls.
        """
        if self._closed:
            raise WarpvisError("update_scene cannot be called after close")
        if not isinstance(data, mujoco.MjData) or data.geom_xpos.shape != (self._model.ngeom, 3):
            raise ArrayError(f"data must be a mujoco.MjData of the renderer's model, got {type(data).__name__}")
        viewer = viewer_camera(self._model, camera)
        check_computed(data, ("geom", "cam") if viewer.type == mujoco.mjtCamera.mjCAMERA_FIXED else ("geom",))
        frustum, pose = viewer_frustum(self._model, viewer), viewer_pose(data, viewer)
        stage = self._stage_of(shown_by(scene_option))
        stage.update(data)
        self._camera, self._pose = camera_of_frustum(frustum, self.width, self.height), pose
        self._draw(stage, data, viewer, scene_option)
        self._stage = stage
        self._viewer.update(frustum, pose)
        if self._fallback is not None:
            self._fallback.update_scene(data, camera, scene_option)

    def render(self, *, out: np.ndarray | None = None) -> np.ndarray:
        """Render the scene of the last `update_scene`.

        Args:
            out: Output array; the image is cast to its dtype.

        Returns:
            Depth: planar depth [m], or the depth of `sensor`, shape ``(height, width)`` float32, with MuJoCo's far
            value or `fill` where there is none.
            Color, with `fallback` only: shape ``(height, width, 3)`` uint8.
            Segmentation: pairs of an id and its `mujoco.mjtObj` (mjOBJ_GEOM, mjOBJ_SITE, mjOBJ_SKIN, ...), as from
            `mujoco.Renderer`; -1 and mjOBJ_UNKNOWN for objects added to `scene`, -1 and -1 for no object, shape
            ``(height, width, 2)`` int32.
        """
        if self._closed:
            raise WarpvisError("render cannot be called after close")
        if self._mode == "color":
            if self._fallback is not None:
                return cast("np.ndarray", self._fallback.render(out=out))
            raise WarpvisError(
                "render requires enable_depth_rendering() or enable_segmentation_rendering(); "
                "for colors, use mujoco.Renderer or fallback=True"
            )
        if self._camera is None:
            raise WarpvisError("update_scene() must be called before render()")
        shape = self._size if self._mode == "depth" else (*self._size, 2)
        if out is not None and getattr(out, "shape", None) != shape:
            raise ArrayError(f"out must have shape {shape}, got {getattr(out, 'shape', type(out).__name__)}")
        image = self._depth() if self._mode == "depth" else self._segmentation()
        if out is None:
            return image
        np.copyto(out, image, casting="unsafe")
        return out

    def close(self) -> None:
        """Release memory."""
        self._closed = True
        self._stages.clear()
        self._stage.renderers.clear()
        if self._fallback is not None:
            self._fallback.close()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getstate__(self) -> dict[str, Any]:
        """Return the picklable state, which includes objects added to scenes but no caches."""
        copied = {name: value for name, value in self.__dict__.items() if name not in _REBUILT}
        current = [key for key, stage in self._stages.items() if stage is self._stage]
        return copied | {
            "_fallback": self._fallback is not None,
            "_current": current[0] if current else None,
            "_states": {key: stage.state() for key, stage in self._stages.items()},
            "_flags": self._viewer.flags(),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Rebuild the scenes from the model's current values."""
        states, current, fallback = state.pop("_states"), state.pop("_current"), state.pop("_fallback")
        flags = state.pop("_flags")
        self.__dict__ |= state
        self._viewer, self._stages = ViewerScene(self._model, flags), {}
        self._visuals = Visuals(self._model, mesh_tolerance=self._options["mesh_tolerance"])
        for shown, stage_state in states.items():
            self._stage_of(shown).restore(stage_state)
        if current is not None:
            self._stage = self._stages[current]
        self._fallback = self._make_fallback() if fallback and not self._closed else None

    def _make_fallback(self) -> mujoco.Renderer:
        try:
            return mujoco.Renderer(self._model, *self._size, **self._fallback_options)
        except mujoco.FatalError as error:
            raise WarpvisError(
                f"fallback=True needs OpenGL, which is not available ({error}); "
                "MUJOCO_GL=egl uses that of a GPU or of Mesa"
            ) from None
        except (AttributeError, OverflowError, TypeError) as error:
            options = ", ".join(f"{name}={truncate(repr(value))}" for name, value in self._fallback_options.items())
            raise ArrayError(
                f"{options} must be valid for mujoco.Renderer, which fallback=True uses: {describe_exception(error)}"
            ) from None

    def _draw(
        self, stage: Stage, data: mujoco.MjData, viewer: mujoco.MjvCamera, option: mujoco.MjvOption | None
    ) -> None:
        """Update visual elements other than geoms and sites; warn once of each that cannot be rendered."""
        if not self._visuals.may_draw(option):
            if len(stage.visuals):
                stage.draw({})
            return
        assert self._camera is not None
        eye = Eye(self._camera, poses_to_matrices(self._pose.astype(np.float64)))
        stage.draw(self._visuals.read(data, viewer, option, eye))
        new = [name for name in self._visuals.undrawn if name not in self._warned]
        if new:
            self._warned.update(new)
            warnings.warn(f"elements of mujoco.Renderer that are not rendered: {', '.join(new)}", stacklevel=3)

    def _depth(self) -> NDArray[np.float32]:
        assert self._camera is not None
        images = self._cast("depth", *(() if self._sensor is None else _OF_SENSOR))
        if self._sensor is not None:
            self._sensed = {name: images[name] for name in _OF_SENSOR}
            self.frame += 1
        return filled_depth(images["depth"], self._camera, self._fill)

    def _segmentation(self) -> NDArray[np.int32]:
        images = self._cast("segmentation")
        # Pairs as int64, since gathering pairs takes longer than rendering a small image.
        pairs = self._stage.meanings().view(np.int64)[:, 0]
        return pairs[images["segmentation"]].view(np.int32).reshape(*self._size, 2)

    def _cast(self, *outputs: Output) -> dict[str, np.ndarray]:
        """Render outputs of one view, with the sensor if they include reasons."""
        stage = self._stage
        assert self._camera is not None
        camera, pose = self._viewer.seen(self._camera, self._pose)
        culls = self._viewer.culls() and self._cull_backfaces
        if not len(stage.scene):
            return self._nothing(outputs)
        sensor = self._sensor if "reasons" in outputs else None
        renderer = self._renderer_of(outputs, camera, culls=culls, sensor=sensor, seed=self._seed)
        options: dict[str, Any] = {"object_poses": stage.object_poses(), "exclude": stage.hidden}
        if sensor is not None:
            options["frame"] = self.frame
        views = renderer.render(pose[None], **options)
        return {output: getattr(views, output).numpy()[0] for output in outputs}

    def _nothing(self, outputs: Iterable[str]) -> dict[str, np.ndarray]:
        """Return the outputs of a view without surfaces."""
        return {name: np.full(self._size, value, dtype) for name, (value, dtype) in _NOTHING.items() if name in outputs}

    def _renderer_of(
        self, outputs: tuple[Output, ...], camera: PlanarCamera, *, culls: bool = True, **options: Any
    ) -> GeomRenderer:
        """Return the renderer of the current stage for some outputs and a camera."""
        stage, key = self._stage, (outputs, camera, culls)
        if key not in stage.renderers:
            # Near geometry is clipped, or rendered at its depth: depth is always a number.
            seen = camera if self._near_plane == "clip" else replace(camera, near=0.0)
            options |= {"near_plane": "clip", "cull_backfaces": culls, "threads": self._threads}
            if len(stage.renderers) >= _MAX_RENDERERS:
                stage.renderers.clear()
            stage.renderers[key] = GeomRenderer(stage.scene, seen, stage.coinciding, outputs=outputs, **options)
        return stage.renderers[key]

    def _stage_of(self, shown: tuple[tuple[int, ...], bool, tuple[int, ...]]) -> Stage:
        """Return the cached stage of the result of `shown_by`."""
        groups, static, sites = shown
        key = groups, static, sites if self._model.nsite else ()
        if key not in self._stages:
            options = self._options | {"geom_groups": groups, "site_groups": key[2], "static": static}
            selection = select_geoms(self._model, **options)
            scene = RendererScene(self._viewer, device=self._device)
            scene.use_labels(selection.rules)
            self._stages[key] = Stage(self._model, selection, scene)
        return self._stages[key]
