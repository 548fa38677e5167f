# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A wrapper that renders frames of one environment, for videos."""

from __future__ import annotations

from typing import Any, Unpack

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import check_size
from warpvis.core.arrays import get_device
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.mujoco._batch_views import CameraChoice
from warpvis.mujoco._cameras import viewer_camera
from warpvis.mujoco._renderer import Renderer
from warpvis.mujoco._scene import shown_by
from warpvis.mujoco.gymnasium._environments import find_simulation
from warpvis.rendering import ColorOptions, check_colors


class RenderFrames(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Renders frames of a MuJoCo environment as ``render_mode="rgb_array"`` does, without OpenGL.

    The environment itself is made without a `render_mode`. Wrappers such as Gymnasium's `RecordVideo` and
    `AddRenderObservation` then use these frames.

    Example:
        >>> env = RenderFrames(gym.make("Ant-v5"), camera="track", width=320, height=240)
        >>> _ = env.reset(seed=0)
        >>> env.render().shape
        (240, 320, 3)
    """

    def __init__(
        self,
        env: gym.Env,
        *,
        camera: CameraChoice = -1,
        width: int = 480,
        height: int = 480,
        scene_option: mujoco.MjvOption | None = None,
        device: DeviceLike = "cpu",
        threads: int | None = None,
        **colors: Unpack[ColorOptions],
    ) -> None:
        """Wrap an environment.

        Args:
            env: A MuJoCo environment, as for `DepthObservation`.
            camera: A camera's name or id, -1 for the default free camera, or a `mujoco.MjvCamera`.
            width: Image width [px].
            height: Image height [px].
            scene_option: A `mujoco.MjvOption` that selects visible elements, by default those of `mujoco.Renderer`.
            device: Device for rendering.
            threads: Number of CPU threads; by default all cores available to the process.
            **colors: `shadows`, `reflections`, `ambient_occlusion` and `samples`, as for `warpvis.Renderer`.
        """
        model, _ = find_simulation(env)
        viewer_camera(model, camera)
        shown_by(scene_option)
        if device is not None and not isinstance(device, str):
            device = get_device(device).alias  # other types cannot be recorded
        chosen: dict[str, Any] = {"camera": camera, "width": check_size(width, "width")}
        chosen |= {"height": check_size(height, "height"), "scene_option": scene_option}
        self._options: dict[str, Any] = {"device": device, "threads": check_threads(threads), **check_colors(**colors)}
        chosen |= self._options
        gym.utils.RecordConstructorArgs.__init__(self, **chosen)
        super().__init__(env)
        self._camera, self._option, self._size = camera, scene_option, (height, width)
        self._renderer: Renderer | None = None

    @property
    def render_mode(self) -> str:  # type: ignore[override]
        """``"rgb_array"``."""
        return "rgb_array"

    def render(self) -> NDArray[np.uint8]:
        """Return a picture of the current state, shape ``(height, width, 3)``."""
        model, data = find_simulation(self.env)
        if self._renderer is None or self._renderer.model is not model:
            self._renderer = Renderer(model, *self._size, **self._options)
        self._renderer.update_scene(data, self._camera, self._option)
        return self._renderer.render()

    def close(self) -> None:
        """Close the environment, and release memory."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        super().close()

    def __getstate__(self) -> dict[str, Any]:
        """Return the picklable state without the renderer, since unpickled environments have other models."""
        return self.__dict__ | {"_renderer": None}
