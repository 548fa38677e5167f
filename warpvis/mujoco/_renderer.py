# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`mujoco.Renderer`'s depth and segmentation without OpenGL, under the same names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, get_args

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.checks import check_choice
from warpvis.core.labels import Label
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, SceneError, WarpvisError
from warpvis.mujoco._cameras import camera_from_mujoco, viewer_camera, viewer_pose
from warpvis.mujoco._geom_renderer import GeomRenderer
from warpvis.mujoco._geoms import DEFAULT_GROUPS, DEFAULT_TOLERANCE, check_groups
from warpvis.mujoco._options import shown_by
from warpvis.mujoco._scene import check_patterns, select_geoms
from warpvis.mujoco._stage import Stage
from warpvis.rendering import NearPlane, Output
from warpvis.scene import Scene

_MOST_RENDERERS = 64  # a camera whose field of view changes all the time must not fill the memory


class Renderer:
    """Depth and segmentation images of a MuJoCo model, as `mujoco.Renderer` makes them.

    Change ``mujoco.Renderer`` to ``warpvis.mujoco.Renderer`` and keep the rest. What differs:

    - Colours are `mujoco.Renderer`'s: this makes depth and segmentation only.
    - Geoms are seen; sites, tendons, skins, flexes and decorations are not.
    - Round shapes are exactly round, where MuJoCo draws 28 slices of them.
    - What the model says of geoms is followed, meshes and height fields too, which MuJoCo uploads on demand.
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
        labels: Mapping[str, Label | int | str] | None = None,
        exclude: Iterable[str] = (),
        cull_backfaces: bool = True,
        near_plane: NearPlane = "clip",
        device: DeviceLike = "cpu",
        threads: int | None = None,
    ) -> None:
        """Prepare to render.

        Args:
            model: A `mujoco.MjModel`.
            height: Image height [px]; the model's ``offheight`` sets no limit.
            width: Image width [px].
            max_geom: Of no effect: every geom is rendered.
            font_scale: Of no effect: nothing is written in the images.
            tolerance: Most distance between round shapes and their triangles [m]; see `scene_from_mujoco`.
            labels: Labels for the objects of `scene`; see `scene_from_mujoco`.
            exclude: Names or patterns of geoms or bodies not to render.
            cull_backfaces: See through surfaces from behind, as in MuJoCo: out of a head that a camera is in.
            near_plane: What becomes of surfaces nearer than MuJoCo's near plane: ``"clip"``, they are cut away, as in
                MuJoCo, and what is behind them is seen; ``"occlude"``, they are seen where they are.
            device: Where to render: ``"cpu"``, ``"cuda:0"``, ...
            threads: CPU threads to use; all cores of this process by default.

        Raises:
            WarpvisError: An argument is not what it has to be.
        """
        if not isinstance(model, mujoco.MjModel):
            raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
        Camera(width, height, 1, 1, 0, 0)  # checks the size
        self._model, self._size = model, (int(height), int(width))
        self._options: dict[str, Any] = {"tolerance": tolerance, "labels": labels, "exclude": check_patterns(exclude)}
        self._device = device
        self._render_options: dict[str, Any] = {"cull_backfaces": cull_backfaces, "threads": threads}
        self._near_plane = check_choice(near_plane, "near_plane", get_args(NearPlane))
        self._stages: dict[tuple[tuple[int, ...], bool], Stage] = {}
        self._stage = self._stage_of(DEFAULT_GROUPS, static=True)
        self._mode = "color"
        self._camera: Camera | None = None
        self._pose: NDArray[np.float32] = np.zeros(7, dtype=np.float32)
        self._closed = False

    @property
    def model(self) -> mujoco.MjModel:
        """The `mujoco.MjModel`."""
        return self._model

    @property
    def scene(self) -> Scene:
        """What the last `update_scene` chose to show: a `warpvis.Scene`, not a `mujoco.MjvScene`.

        Objects may be added to it, and show while `update_scene` chooses the same groups of geoms. Movable ones stay
        where they were added.
        """
        return self._stage.scene

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
            scene_option: A `mujoco.MjvOption`: its geom groups, and whether fixed geoms show.

        Raises:
            WarpvisError: There is no such camera, or the options ask for convex hulls.
        """
        if not isinstance(data, mujoco.MjData) or data.geom_xpos.shape != (self._model.ngeom, 3):
            raise ArrayError(f"data must be a mujoco.MjData of the renderer's model, got {type(data).__name__}")
        viewer = viewer_camera(self._model, camera)
        self._camera = camera_from_mujoco(self._model, viewer, self.width, self.height)
        self._pose = viewer_pose(data, viewer)
        self._stage = self._chosen_stage(scene_option)
        self._stage.update(data)

    def render(self, *, out: np.ndarray | None = None) -> np.ndarray:
        """Render what `update_scene` took over.

        Args:
            out: An array to write into, cast to its dtype.

        Returns:
            Depth: planar, in metres, shape ``(height, width)`` float32, with MuJoCo's far value where nothing is.
            Segmentation: pairs of a geom's id and mjOBJ_GEOM, -1 and mjOBJ_UNKNOWN for objects that were added to
            `scene`, -1 and -1 for nothing, shape ``(height, width, 2)`` int32.

        Raises:
            WarpvisError: Neither is enabled, `update_scene` was not called, or `out` has another shape.
        """
        if self._closed:
            raise WarpvisError("render cannot be called after close")
        if self._mode == "color":
            raise WarpvisError(
                "warpvis renders depth and segmentation: call enable_depth_rendering() or "
                "enable_segmentation_rendering(), and take mujoco.Renderer for colours"
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

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _depth(self) -> NDArray[np.float32]:
        assert self._camera is not None
        background = _background(self._camera.near, self._camera.far)
        image = self._cast("depth")
        return np.full(self._size, background) if image is None else np.minimum(image, background)

    def _segmentation(self) -> NDArray[np.int32]:
        image = self._cast("segmentation")
        return np.full((*self._size, 2), -1, dtype=np.int32) if image is None else self._stage.meanings()[image]

    def _cast(self, output: Output) -> np.ndarray | None:
        """Cast one image of one view; None if there are no geoms."""
        camera, stage = self._camera, self._stage
        assert camera is not None
        if not len(stage.scene):
            return None
        if (output, camera) not in stage.renderers:
            # What is not cut away is seen where it is: depth is always a number.
            seen = camera if self._near_plane == "clip" else replace(camera, near=0.0)
            renderer = GeomRenderer(
                stage.scene, seen, stage.coinciding, outputs=(output,), near_plane="clip", **self._render_options
            )
            if len(stage.renderers) >= _MOST_RENDERERS:
                stage.renderers.clear()
            stage.renderers[output, camera] = renderer
        views = stage.renderers[output, camera].render(
            self._pose[None], object_poses=stage.object_poses(), exclude=stage.hidden
        )
        return getattr(views, output).numpy()[0]

    def _chosen_stage(self, option: mujoco.MjvOption | None) -> Stage:
        groups, static = shown_by(option)
        return self._stage_of(groups, static=static)

    def _stage_of(self, groups: Iterable[int], *, static: bool) -> Stage:
        """Return the stage of some groups, made when first needed."""
        key = (check_groups(groups), static)
        if key not in self._stages:
            selection = select_geoms(self._model, geom_groups=key[0], static=static, **self._options)
            self._stages[key] = Stage(self._model, selection, Scene(device=self._device))
        return self._stages[key]


def _background(near: float, far: float) -> np.float32:
    """Compute the depth that `mujoco.Renderer` has where nothing is: its far plane, by its own rounding.

    As `render` in mujoco/rendering/classic/renderer.py computes it from a depth buffer of 0.
    """
    z_near, z_far = np.float32(near), np.float32(far)
    c = np.float32(-0.5) * (-(z_far + z_near) / (z_far - z_near)) - np.float32(0.5)
    d = np.float32(-0.5) * (-(np.float32(2) * z_far * z_near) / (z_far - z_near))
    return np.float32(np.float64(d) / np.float64(c))
