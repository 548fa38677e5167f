# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering of all images of an observation in one call."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.mujoco._geom_renderer import GeomRenderer
from warpvis.mujoco._renderer import Renderer
from warpvis.mujoco._shapes import GEOM, SITE
from warpvis.mujoco._stage import Stage
from warpvis.mujoco.gymnasium._fractions import VisibleFractions
from warpvis.mujoco.gymnasium._outputs import DEPTH, FRACTION, REASONS, SEGMENTATION, TRUE_DEPTH, Outputs
from warpvis.sensors import Reason

_MAX_CAMERAS = 16


class _Casters(NamedTuple):
    stage: Stage
    images: GeomRenderer
    fractions: VisibleFractions


class ImageRenderer(Renderer):
    """A `warpvis.mujoco.Renderer` that computes depth, segmentation and visible fractions at once."""

    _casters: dict[PlanarCamera, _Casters]

    def images(self, outputs: Outputs, draws: NDArray[np.uint32]) -> dict[str, np.ndarray]:
        """Render the scene of the last `update_scene`.

        Args:
            outputs: The requested outputs.
            draws: Number and frame of the view, for a sensor's random numbers.

        Returns:
            Images ``(H, W)`` by name, with segmentation as the geom or site of every pixel, or -1; and visible
            fractions ``(objects,)``.
        """
        stage, camera = self._stage, self._camera
        assert camera is not None
        if not len(stage.scene):
            return self._nothing(outputs, camera)
        casters = self._casters_of(camera, outputs)
        places = stage.object_poses()
        view_index, frame = (None, None) if outputs.sensor is None else (draws[:1], draws[1:])
        options: dict[str, Any] = {"object_poses": places, "exclude": stage.hidden}
        views = casters.images.render(self._pose[None], view_index=view_index, frame=frame, **options)
        entries: dict[str, np.ndarray] = {name: getattr(views, name).numpy()[0] for name in outputs.images}
        if SEGMENTATION in entries:
            segmentation, of_object = entries[SEGMENTATION], self._shapes_of_objects()
            entries[SEGMENTATION] = of_object[segmentation]
        if len(outputs.members):
            hidden = np.zeros((1, len(stage.scene)), dtype=bool)
            hidden[:, stage.hidden] = True
            members, eye = outputs.members_of(of_object[:-1]), self._pose[None]
            entries[FRACTION] = casters.fractions.count(segmentation[None], members, eye, places, hidden)[0]
        return entries

    def _nothing(self, outputs: Outputs, camera: PlanarCamera) -> dict[str, np.ndarray]:
        """Return the images of a scene without geoms."""
        far = {"far": camera.far, "inf": np.inf}
        fill = far[outputs.fill] if isinstance(outputs.fill, str) else outputs.fill
        return {
            DEPTH: np.full(self._size, fill, dtype=np.float32),
            SEGMENTATION: np.full(self._size, -1, dtype=np.int32),
            REASONS: np.full(self._size, Reason.EMPTY, dtype=np.uint8),
            TRUE_DEPTH: np.full(self._size, np.inf, dtype=np.float32),
            FRACTION: np.zeros(len(outputs.members), dtype=np.float32),
        }

    def _shapes_of_objects(self) -> NDArray[np.int32]:
        """List the geom or site of every object, -1 for other objects, with a last -1 for no object."""
        ids, kinds = self._stage.meanings().T
        sites = np.where(kinds == SITE, ids + self._model.ngeom, -1)
        return np.where(kinds == GEOM, ids, sites).astype(np.int32)

    def _casters_of(self, camera: PlanarCamera, outputs: Outputs) -> _Casters:
        cached = self.__dict__.setdefault("_casters", {})
        if camera not in cached or cached[camera].stage is not self._stage:
            if len(cached) >= _MAX_CAMERAS:  # bounds the memory if the field of view keeps changing
                cached.clear()
            options: dict[str, Any] = {"near_plane": "clip", "cull_backfaces": True, "threads": self._threads}
            seen = camera if self._near_plane == "clip" else replace(camera, near=0.0)
            stage = self._stage
            sensing = {"outputs": outputs.images, "fill": outputs.fill, "sensor": outputs.sensor}
            images = GeomRenderer(stage.scene, seen, stage.coinciding, **sensing, **options)
            cached[camera] = _Casters(stage, images, VisibleFractions(stage.scene, seen, **options))
        return cast(_Casters, cached[camera])
