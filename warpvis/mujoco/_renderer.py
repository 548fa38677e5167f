# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`mujoco.Renderer`'s depth and segmentation without OpenGL, under the same names."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, cast, get_args

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import check_size
from warpvis.core.checks import check_choice, check_flag, describe_exception, truncate
from warpvis.core.label_rules import LabelInput, LabelRules
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, SceneError, WarpvisError
from warpvis.mujoco._background import filled_depth
from warpvis.mujoco._cameras import camera_of_frustum, viewer_camera, viewer_frustum, viewer_pose
from warpvis.mujoco._geom_renderer import GeomRenderer
from warpvis.mujoco._geoms import DEFAULT_GROUPS, DEFAULT_TOLERANCE, check_groups
from warpvis.mujoco._lines import Eye
from warpvis.mujoco._options import shown_by
from warpvis.mujoco._poses import check_computed
from warpvis.mujoco._scene import check_patterns, select_geoms
from warpvis.mujoco._stage import Stage
from warpvis.mujoco._viewer_scene import RendererScene, ViewerScene
from warpvis.mujoco._visuals import Visuals
from warpvis.rendering import (
    AnyCamera,
    DepthSensor,
    Fill,
    NearPlane,
    Output,
    check_fill,
    check_word,
    require_sensor,
)
from warpvis.sensors import Reason

_MADE_ANEW = ("_stages", "_stage", "_viewer", "_fallback", "_visuals")
_OF_SENSOR: tuple[Output, ...] = ("reasons", "true_depth")
_MAX_RENDERERS = 64  # a camera whose field of view changes all the time must not fill the memory


class Renderer:
    """Depth and segmentation images of a MuJoCo model, as `mujoco.Renderer` makes them.

    Change ``mujoco.Renderer`` to ``warpvis.mujoco.Renderer`` and keep the rest. What differs:

    - Colours are `mujoco.Renderer`'s, which makes them for this one with ``fallback=True``.
    - All is seen that MuJoCo draws by the flags of `mujoco.MjvOption`, but for what plugins draw, and convex hulls.
    - `scene` is a `warpvis.Scene`: it has `flags` and `camera` of MuJoCo's, and no `geoms`; see `scene`.
    - Round shapes are exactly round, where MuJoCo draws 28 slices of them.
    - What the model says of geoms and sites is followed, meshes and height fields too, which MuJoCo uploads on demand.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        height: int = 240,
        width: int = 320,
        max_geom: int = 10000,
        font_scale: object = None,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
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
        """Prepare to render.

        Args:
            model: A `mujoco.MjModel`.
            height: Image height [px]; the model's ``offheight`` sets no limit.
            width: Image width [px].
            max_geom: Of no effect but on `fallback`: every geom is rendered.
            font_scale: Of no effect but on `fallback`: nothing is written in the images.
            tolerance: Most distance between round shapes and their triangles [m]; see `scene_from_mujoco`.
            labels: Labels for the objects of `scene`; see `scene_from_mujoco`.
            label_names: Names of classes of your own, as for `warpvis.Scene`.
            exclude: Names or patterns of geoms, sites, tendons, skins, flexes or bodies not to render.
            cull_backfaces: See through surfaces from behind, as in MuJoCo: out of a head that a camera is in.
            near_plane: ``"clip"``: what is nearer than MuJoCo's near plane is cut away, and what is behind is seen, as
                in MuJoCo; ``"occlude"``: it is seen where it is.
            fill: Depth of pixels without: ``"far"``, MuJoCo's far value, and the near plane's of what is too near to a
                sensor; ``"inf"``, +inf, -inf, and NaN of what a sensor lost; or a number [m].
            sensor: A model of a depth camera, as for `warpvis.Renderer`: depth is what such a device would say through
                MuJoCo's cameras, whose near plane is the model's; `reasons` says why a pixel has none, and `true_depth`
                what is there. Segmentation stays exact.
            seed: What its random numbers follow from, together with `frame`, which counts images of depth.
            fallback: Have colours made by a `mujoco.Renderer`, which needs OpenGL.
            device: Where to render: ``"cpu"``, ``"cuda:0"``, ...
            threads: CPU threads to use; all cores of this process by default.

        Raises:
            WarpvisError: An argument is not what it has to be.
        """
        if not isinstance(model, mujoco.MjModel):
            raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
        check_size(width, "width")
        check_size(height, "height")
        self._model, self._size = model, (int(height), int(width))
        rules = LabelRules.of(labels, label_names)
        self._options: dict[str, Any] = {"tolerance": tolerance, "labels": rules, "exclude": check_patterns(exclude)}
        self._device = device
        self._cull_backfaces = check_flag(cull_backfaces, "cull_backfaces")
        self._near_plane = check_choice(near_plane, "near_plane", get_args(NearPlane))
        self._fill = check_fill(fill)
        self._sensor = None if sensor is None else require_sensor(sensor)
        self._seed = check_word(seed, "seed")
        self.frame = 0
        """The frame that a sensor's random numbers are of in the next image of depth; each one adds 1."""
        self._sensed: dict[str, np.ndarray] = {}
        self._threads = check_threads(threads)
        self._viewer = ViewerScene(model)
        self._visuals = Visuals(model, tolerance=tolerance)
        self._warned: set[str] = set()
        self._stages: dict[tuple[tuple[int, ...], bool, tuple[int, ...]], Stage] = {}
        self._stage = self._stage_of(DEFAULT_GROUPS, static=True, sites=DEFAULT_GROUPS)
        self._mode = "color"
        self._camera: AnyCamera | None = None
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
        """The `mujoco.Renderer` that makes colours; None without."""
        return self._fallback

    @property
    def scene(self) -> RendererScene:
        """What the last `update_scene` chose to show: a `warpvis.Scene` with `flags` and `camera` of MuJoCo's.

        Of `flags`, mjRND_CULL_FACE has an effect; none of the others would have one on depth or segmentation, but for
        mjRND_WIREFRAME, of which a warning tells. What is written into `camera` is rendered until the next
        `update_scene`. Of `geoms`, there are none: add shapes by `add`.

        Objects may be added to it, which stay behind the model's own, and show while `update_scene` chooses the same
        groups of geoms and sites. Movable ones stay where they were added.
        """
        return self._stage.scene

    @property
    def reasons(self) -> NDArray[np.uint8]:
        """Why pixels of the last image of depth have none, `warpvis.sensors.Reason`, shape ``(height, width)`` uint8.

        Raises:
            WarpvisError: There is no sensor, or no depth was rendered.
        """
        return self._of_sensor("reasons")

    @property
    def true_depth(self) -> NDArray[np.float32]:
        """What the exact rays of the last image of depth met [m], shape ``(height, width)`` float32; +inf of nothing.

        Raises:
            WarpvisError: There is no sensor, or no depth was rendered.
        """
        return self._of_sensor("true_depth")

    def _of_sensor(self, name: str) -> np.ndarray:
        if not self._sensed:
            why = "give Renderer a sensor" if self._sensor is None else "render depth first"
            raise WarpvisError(f"{name} is of a sensor's depth: {why}")
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
        """Stop to render depth."""
        self._mode = "color" if self._mode == "depth" else self._mode

    def enable_segmentation_rendering(self) -> None:
        """Render segmentation from now on."""
        self._mode = "segmentation"

    def disable_segmentation_rendering(self) -> None:
        """Stop to render segmentation."""
        self._mode = "color" if self._mode == "segmentation" else self._mode

    def update_scene(
        self,
        data: mujoco.MjData,
        camera: int | str | mujoco.MjvCamera = -1,
        scene_option: mujoco.MjvOption | None = None,
    ) -> None:
        """Take over where everything is now.

        Args:
            data: A `mujoco.MjData` of the model, after `mj_forward` or a step.
            camera: A camera's name or id, -1 for the default free camera, or a `mujoco.MjvCamera`.
            scene_option: A `mujoco.MjvOption`: what is drawn. If MuJoCo draws what this renderer cannot, a warning
                names it, once.

        Raises:
            WarpvisError: There is no such camera, poses of the data were never computed, numbers of the model are not
                finite, or the options ask for convex hulls.
        """
        if self._closed:
            raise WarpvisError("update_scene cannot be called after close")
        if not isinstance(data, mujoco.MjData) or data.geom_xpos.shape != (self._model.ngeom, 3):
            raise ArrayError(f"data must be a mujoco.MjData of the renderer's model, got {type(data).__name__}")
        viewer = viewer_camera(self._model, camera)
        check_computed(data, ("geom", "cam") if viewer.type == mujoco.mjtCamera.mjCAMERA_FIXED else ("geom",))
        frustum, pose = viewer_frustum(self._model, viewer), viewer_pose(data, viewer)
        stage = self._chosen_stage(scene_option)
        stage.update(data)
        self._camera, self._pose = camera_of_frustum(frustum, self.width, self.height), pose
        self._draw(stage, data, viewer, scene_option)
        self._stage = stage
        self._viewer.update(frustum, pose)
        if self._fallback is not None:
            self._fallback.update_scene(data, camera, scene_option)

    def render(self, *, out: np.ndarray | None = None) -> np.ndarray:
        """Render what `update_scene` took over.

        Args:
            out: An array to write into, cast to its dtype.

        Returns:
            Depth: planar, in metres, shape ``(height, width)`` float32, with MuJoCo's far value where nothing is, or
            what `fill` says; of `sensor`, what that says.
            Colours, of `fallback` only: shape ``(height, width, 3)`` uint8.
            Segmentation: pairs of an id and its `mujoco.mjtObj` (mjOBJ_GEOM, mjOBJ_SITE, mjOBJ_SKIN, ...), as
            `mujoco.Renderer` has them; -1 and mjOBJ_UNKNOWN for objects that were added to `scene`, -1 and -1 for
            nothing, shape ``(height, width, 2)`` int32.

        Raises:
            WarpvisError: Neither is enabled, `update_scene` was not called, or `out` has another shape.
        """
        if self._closed:
            raise WarpvisError("render cannot be called after close")
        if self._mode == "color":
            if self._fallback is not None:
                return cast("np.ndarray", self._fallback.render(out=out))
            raise WarpvisError(
                "warpvis renders depth and segmentation: call enable_depth_rendering() or "
                "enable_segmentation_rendering(), and take mujoco.Renderer for colours, or fallback=True"
            )
        if self._camera is None:
            raise WarpvisError("call update_scene() before render()")
        shape = self._size if self._mode == "depth" else (*self._size, 2)
        if out is not None and getattr(out, "shape", None) != shape:
            raise ArrayError(f"out must have shape {shape}, got {getattr(out, 'shape', type(out).__name__)}")
        image = self._depth() if self._mode == "depth" else self._segmentation()
        if out is None:
            return image
        np.copyto(out, image, casting="unsafe")
        return out

    def close(self) -> None:
        """Let go of the memory."""
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
        """Return what another process makes the same of: what was added to scenes, and no memory to work with."""
        kept = {name: value for name, value in self.__dict__.items() if name not in _MADE_ANEW}
        current = [key for key, stage in self._stages.items() if stage is self._stage]
        return kept | {
            "_fallback": self._fallback is not None,
            "_current": current[0] if current else None,
            "_states": {key: stage.state() for key, stage in self._stages.items()},
            "_flags": self._viewer.flags(),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the scenes, as the model is now."""
        states, current, fallback = state.pop("_states"), state.pop("_current"), state.pop("_fallback")
        flags = state.pop("_flags")
        self.__dict__ |= state
        self._viewer, self._stages = ViewerScene(self._model), {}
        self._visuals = Visuals(self._model, tolerance=self._options["tolerance"])
        self._viewer.set_flags(flags)
        for (groups, static, sites), kept in states.items():
            self._stage_of(groups, static=static, sites=sites).restore(kept)
        if current is not None:
            self._stage = self._stages[current]
        self._fallback = self._make_fallback() if fallback and not self._closed else None

    def _make_fallback(self) -> mujoco.Renderer:
        try:
            return mujoco.Renderer(self._model, *self._size, **self._fallback_options)
        except mujoco.FatalError as error:
            raise WarpvisError(
                f"fallback=True needs OpenGL, and there is none ({error}); MUJOCO_GL=egl finds that of a GPU or of Mesa"
            ) from None
        except (AttributeError, OverflowError, TypeError) as error:
            given = ", ".join(f"{name}={truncate(repr(value))}" for name, value in self._fallback_options.items())
            raise ArrayError(
                f"mujoco.Renderer, which fallback=True makes, refuses {given}: {describe_exception(error)}"
            ) from None

    def _draw(
        self, stage: Stage, data: mujoco.MjData, viewer: mujoco.MjvCamera, option: mujoco.MjvOption | None
    ) -> None:
        """Take over what MuJoCo draws beside geoms and sites, and name what cannot be, each once."""
        if not self._visuals.may_draw(option):
            if len(stage.visuals):
                stage.draw({})
            return
        assert self._camera is not None
        stage.draw(self._visuals.read(data, viewer, option, Eye(self._camera, self._pose)))
        new = [name for name in self._visuals.undrawn if name not in self._warned]
        if new:
            self._warned.update(new)
            warnings.warn(f"not rendered, which mujoco.Renderer draws: {', '.join(new)}", stacklevel=3)

    def _depth(self) -> NDArray[np.float32]:
        assert self._camera is not None
        images = self._cast("depth", *(() if self._sensor is None else _OF_SENSOR))
        if self._sensor is not None:
            self._sensed = self._nothing_sensed() if images is None else {name: images[name] for name in _OF_SENSOR}
            self.frame += 1
        return filled_depth(None if images is None else images["depth"], self._camera, self._fill)

    def _nothing_sensed(self) -> dict[str, np.ndarray]:
        reasons = np.full(self._size, Reason.EMPTY, dtype=np.uint8)
        return {"reasons": reasons, "true_depth": np.full(self._size, np.inf, dtype=np.float32)}

    def _segmentation(self) -> NDArray[np.int32]:
        images = self._cast("segmentation")
        if images is None:
            return np.full((*self._size, 2), -1, dtype=np.int32)
        # A pair as one number: to gather pairs takes longer than to render a small image.
        pairs = self._stage.meanings().view(np.int64)[:, 0]
        return pairs[images["segmentation"]].view(np.int32).reshape(*self._size, 2)

    def _cast(self, *outputs: Output) -> dict[str, np.ndarray] | None:
        """Cast images of one view, by the sensor if reasons are one of them; None if there are no geoms."""
        stage = self._stage
        assert self._camera is not None
        camera, pose = self._viewer.seen(self._camera, self._pose)
        culls = self._viewer.culls() and self._cull_backfaces
        if not len(stage.scene):
            return None
        key = (outputs, camera, culls)
        sensor = self._sensor if "reasons" in outputs else None
        if key not in stage.renderers:
            # What is not cut away is seen where it is: depth is always a number.
            seen = camera if self._near_plane == "clip" else replace(camera, near=0.0)
            renderer = GeomRenderer(
                stage.scene,
                seen,
                stage.coinciding,
                outputs=outputs,
                near_plane="clip",
                cull_backfaces=culls,
                sensor=sensor,
                seed=self._seed,
                threads=self._threads,
            )
            if len(stage.renderers) >= _MAX_RENDERERS:
                stage.renderers.clear()
            stage.renderers[key] = renderer
        options: dict[str, Any] = {"object_poses": stage.object_poses(), "exclude": stage.hidden}
        if sensor is not None:
            options["frame"] = self.frame
        views = stage.renderers[key].render(pose[None], **options)
        return {output: getattr(views, output).numpy()[0] for output in outputs}

    def _chosen_stage(self, option: mujoco.MjvOption | None) -> Stage:
        groups, static, sites = shown_by(option)
        return self._stage_of(groups, static=static, sites=sites)

    def _stage_of(self, groups: Iterable[int], *, static: bool, sites: Iterable[int]) -> Stage:
        """Return the stage of some groups, made when first needed."""
        key = (check_groups(groups), static, check_groups(sites) if self._model.nsite else ())
        if key not in self._stages:
            selection = select_geoms(
                self._model, geom_groups=key[0], site_groups=key[2], static=static, **self._options
            )
            scene = RendererScene(self._viewer, device=self._device)
            scene.use_labels(selection.rules)
            self._stages[key] = Stage(self._model, selection, scene)
        return self._stages[key]
