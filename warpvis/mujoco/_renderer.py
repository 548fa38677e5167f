# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A drop-in replacement of `mujoco.Renderer` without OpenGL."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Unpack, get_args

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import check_size
from warpvis.core.checks import check_choice, check_flag, check_whole
from warpvis.core.labels import LabelInput, LabelRules
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, SceneError, WarpvisError
from warpvis.mujoco._appearances import Style
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
from warpvis.mujoco._stage_colors import StageLights, style_of
from warpvis.mujoco._tessellation import Eye
from warpvis.mujoco._visuals import MAX_GEOMS, Visuals
from warpvis.rendering import (
    ColorOptions,
    DepthSensor,
    Fill,
    Lighting,
    NearPlane,
    Output,
    check_colors,
    check_fill,
    check_word,
    require_sensor,
)
from warpvis.sensors import Reason

_REBUILT = ("_stages", "_stage", "_viewer", "_visuals")
_OF_SENSOR: tuple[Output, ...] = ("reasons", "true_depth")
_NOTHING: dict[str, tuple[float, type]] = {"depth": (np.inf, np.float32), "segmentation": (-1, np.int32)}
_CHANNELS: dict[str, tuple[int, ...]] = {"color": (3,), "depth": (), "segmentation": (2,)}
_NOTHING |= {"reasons": (Reason.EMPTY, np.uint8), "true_depth": (np.inf, np.float32)}
_MAX_MAX_GEOM = 10**7  # about 2 GB of MuJoCo's geoms
_MAX_RENDERERS = 64  # bounds the memory if the camera's field of view keeps changing


class Renderer:
    """Color, depth and segmentation images of a MuJoCo model, with the interface of `mujoco.Renderer`, without OpenGL.

    Replace ``mujoco.Renderer`` by ``warpvis.mujoco.Renderer``; other code is unchanged. Differences:

    - Colors have exact shadows, where MuJoCo has shadow maps. Light is computed at the vertices of MuJoCo's triangles,
      or at pixels (`lighting`).
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
        max_geom: int = MAX_GEOMS,
        font_scale: object = None,
        *,
        mesh_tolerance: float = DEFAULT_MESH_TOLERANCE,
        labels: LabelInput | None = None,
        label_names: Mapping[int, str] | None = None,
        exclude: Iterable[str] = (),
        cull_backfaces: bool = True,
        near_plane: NearPlane = "clip",
        lighting: Lighting = "vertex",
        fill: Fill = "far",
        sensor: DepthSensor | None = None,
        seed: int = 0,
        device: DeviceLike = "cpu",
        threads: int | None = None,
        **colors: Unpack[ColorOptions],
    ) -> None:
        """Initialize a renderer.

        Args:
            model: A `mujoco.MjModel`.
            height: Image height [px], not limited by the model's ``offheight``.
            width: Image width [px].
            max_geom: Maximum number of tendon segments, contacts, frames and other elements that are neither geoms nor
                sites; all geoms and sites are rendered.
            font_scale: Unused, since images contain no text.
            mesh_tolerance: Maximum distance between round shapes and their triangles [m]; see `scene_from_mujoco`.
            labels: Labels for the objects of `scene`; see `scene_from_mujoco`.
            label_names: Names of user-defined classes, as for `warpvis.Scene`.
            exclude: Names or patterns of geoms, sites, tendons, skins, flexes or bodies not to render.
            cull_backfaces: Whether back faces are invisible, as in MuJoCo, for example from inside a robot's head.
            near_plane: ``"clip"`` to clip geometry nearer than MuJoCo's near plane, as MuJoCo does; ``"occlude"`` to
                render it.
            lighting: Where light is computed: ``"vertex"``, at the vertices of MuJoCo's triangles, as MuJoCo does;
                ``"pixel"``, at each pixel, which shows highlights and spots that MuJoCo's triangles miss.
            fill: Depth of pixels without depth: ``"far"`` for MuJoCo's far value (for a sensor, the near plane where a
                surface is too near); ``"inf"`` for +inf (-inf where too near, and NaN where a sensor lost depth); or a
                number [m].
            sensor: A depth camera model, as for `warpvis.Renderer`, which computes depth for MuJoCo's cameras with the
                model's near plane. `reasons` has the reasons for missing depth, and `true_depth` the exact depth.
                Segmentation remains exact.
            seed: Seed of the sensor's random numbers, which also depend on `frame`, the number of depth images.
            device: Device for rendering: ``"cpu"``, ``"cuda:0"``, ...
            threads: Number of CPU threads; by default all cores available to the process.
            **colors: `shadows`, `reflections`, `ambient_occlusion` and `samples`, as for `warpvis.Renderer`. The flags
                mjRND_SHADOW and mjRND_REFLECTION of `scene` also turn off shadows and reflections. MuJoCo has no
                ambient occlusion, and ``model.vis.quality.offsamples`` instead of `samples`.
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
        self._lighting = check_choice(lighting, "lighting", get_args(Lighting))
        self._fill, self._colors = check_fill(fill), check_colors(**colors)
        self._sensor = None if sensor is None else require_sensor(sensor)
        self._seed = check_word(seed, "seed")
        self.frame = 0
        """Frame number for a sensor's random numbers in the next depth image; incremented with every depth image."""
        self._sensed: dict[str, np.ndarray] = {}
        self._threads = check_threads(threads)
        self._viewer = ViewerScene(model)
        self._max_geom = check_whole(max_geom, "max_geom")
        if self._max_geom > _MAX_MAX_GEOM:
            raise ArrayError(f"max_geom must be at most {_MAX_MAX_GEOM}, got {max_geom}")
        self._visuals = Visuals(model, mesh_tolerance=mesh_tolerance, max_geoms=self._max_geom)
        self._lights = StageLights(model)
        self._style = Style()
        self._has_colors = self._renders_colors = False
        self._warned: set[str] = set()
        self._stages: dict[tuple[tuple[int, ...], bool, tuple[int, ...]], Stage] = {}
        self._mode = "color"
        self._stage = self._stage_of(shown_by(None))
        self._camera: PlanarCamera | None = None
        self._pose: NDArray[np.float32] = np.zeros(7, dtype=np.float32)
        self._closed = False

    @property
    def model(self) -> mujoco.MjModel:
        """The `mujoco.MjModel`."""
        return self._model

    @property
    def scene(self) -> RendererScene:
        """The scene of the last `update_scene`: a `warpvis.Scene` with the `flags` and `camera` of MuJoCo's scene.

        The flag mjRND_CULL_FACE has an effect on all images, and mjRND_SHADOW, mjRND_REFLECTION, mjRND_SKYBOX and
        mjRND_HAZE on colors. Others that are set are ignored with a warning. Changes of `camera`,
        `lights` and `background` apply until the next `update_scene`. There are no `geoms`: use `add` for additional
        shapes.

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
        self._stage, self._has_colors = stage, False
        self._viewer.update(frustum, pose)
        self._style = Style() if scene_option is None else style_of(scene_option)
        self._lights.read(data)
        if self._follows_colors:
            self._color_stage()

    def render(self, *, out: np.ndarray | None = None) -> np.ndarray:
        """Render the scene of the last `update_scene`.

        Args:
            out: Output array; the image is cast to its dtype.

        Returns:
            Depth: planar depth [m], or the depth of `sensor`, shape ``(height, width)`` float32, with MuJoCo's far
            value or `fill` where there is none.
            Color: sRGB, shape ``(height, width, 3)`` uint8.
            Segmentation: pairs of an id and its `mujoco.mjtObj` (mjOBJ_GEOM, mjOBJ_SITE, mjOBJ_SKIN, ...), as from
            `mujoco.Renderer`; -1 and mjOBJ_UNKNOWN for objects added to `scene`, -1 and -1 for no object, shape
            ``(height, width, 2)`` int32.
        """
        if self._closed:
            raise WarpvisError("render cannot be called after close")
        if self._camera is None:
            raise WarpvisError("update_scene() must be called before render()")
        shape = (*self._size, *_CHANNELS[self._mode])
        if out is not None and getattr(out, "shape", None) != shape:
            raise ArrayError(f"out must have shape {shape}, got {getattr(out, 'shape', type(out).__name__)}")
        makers: dict[str, Callable[[], np.ndarray]]
        makers = {"color": self._color, "depth": self._depth, "segmentation": self._segmentation}
        image = makers[self._mode]()
        if out is None:
            return image
        np.copyto(out, image, casting="unsafe")
        return out

    def close(self) -> None:
        """Release memory."""
        self._closed = True
        self._stages.clear()
        self._stage.renderers.clear()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getstate__(self) -> dict[str, Any]:
        """Return the picklable state, which includes objects added to scenes but no caches."""
        copied = {name: value for name, value in self.__dict__.items() if name not in _REBUILT}
        current = [key for key, stage in self._stages.items() if stage is self._stage]
        return copied | {
            "_current": current[0] if current else None,
            "_states": {key: stage.state() for key, stage in self._stages.items()},
            "_flags": self._viewer.flags(),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Rebuild the scenes from the model's current values."""
        states, current = state.pop("_states"), state.pop("_current")
        flags = state.pop("_flags")
        self.__dict__ |= state
        self._viewer, self._stages = ViewerScene(self._model, flags), {}
        tolerance = self._options["mesh_tolerance"]
        self._visuals = Visuals(self._model, mesh_tolerance=tolerance, max_geoms=self._max_geom)
        for shown, stage_state in states.items():
            self._stage_of(shown).restore(stage_state)
        if current is not None:
            self._stage = self._stages[current]

    def _draw(
        self, stage: Stage, data: mujoco.MjData, viewer: mujoco.MjvCamera, option: mujoco.MjvOption | None
    ) -> None:
        """Update visual elements other than geoms and sites; warn once of each that cannot be rendered."""
        if not self._visuals.may_draw(option):
            self._visuals.clear()
            if len(stage.visuals):
                stage.draw({})
            return
        assert self._camera is not None
        eye = Eye(self._camera, poses_to_matrices(self._pose.astype(np.float64)))
        drawn = self._visuals.read(data, viewer, option, eye)
        stage.draw(drawn, self._visuals.paints() if self._follows_colors else None)
        new = [name for name in self._visuals.undrawn if name not in self._warned]
        if new:
            self._warned.update(new)
            warnings.warn(f"elements of mujoco.Renderer that are not rendered: {', '.join(new)}", stacklevel=3)

    @property
    def _follows_colors(self) -> bool:
        """Whether `update_scene` updates colors, too: otherwise, the first color image does."""
        return self._mode == "color" or self._renders_colors

    def _color_stage(self) -> None:
        """Update colors, lights and the background of the current stage to those of the last `update_scene`."""
        self._lights.light(self._stage.scene)
        self._stage.color(self._style)
        self._has_colors = True

    def _color(self) -> NDArray[np.uint8]:
        self._renders_colors = True
        if not self._has_colors:
            self._color_stage()
            self._stage.draw(self._stage.visuals.state(), self._visuals.paints())
        with self._lights.with_flags(self._stage.scene, self._viewer.flags()):
            return self._cast("color")["color"]

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
        renderer.reflections = self._viewer.reflects() and self._colors["reflections"]
        options: dict[str, Any] = {"object_poses": stage.object_poses(), "exclude": stage.hidden}
        if sensor is not None:
            options["frame"] = self.frame
        views = renderer.render(pose[None], **options)
        return {output: getattr(views, output).numpy()[0] for output in outputs}

    def _nothing(self, outputs: Iterable[str]) -> dict[str, np.ndarray]:
        """Return the outputs of a view without surfaces."""
        images: dict[str, np.ndarray] = {
            name: np.full(self._size, value, dtype) for name, (value, dtype) in _NOTHING.items() if name in outputs
        }
        if "color" in outputs:
            images["color"] = np.zeros((*self._size, 3), dtype=np.uint8)
        return images

    def _renderer_of(
        self, outputs: tuple[Output, ...], camera: PlanarCamera, *, culls: bool = True, **options: Any
    ) -> GeomRenderer:
        """Return the renderer of the current stage for some outputs and a camera."""
        stage, key = self._stage, (outputs, camera, culls)
        if key not in stage.renderers:
            # Near geometry is clipped, or rendered at its depth: depth is always a number.
            seen = camera if self._near_plane == "clip" else replace(camera, near=0.0)
            options |= {"near_plane": "clip", "cull_backfaces": culls, "threads": self._threads}
            if "color" in outputs:
                options |= {**self._colors, "lighting": self._lighting}
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
