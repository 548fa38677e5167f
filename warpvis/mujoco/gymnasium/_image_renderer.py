# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""All that an observation has of one view, of one call of the caster."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from warpvis.mujoco._geom_renderer import GeomRenderer
from warpvis.mujoco._renderer import Renderer
from warpvis.mujoco._shapes import GEOM, SITE
from warpvis.mujoco._stage import Stage
from warpvis.mujoco.gymnasium._fractions import VisibleFractions
from warpvis.mujoco.gymnasium._outputs import Outputs
from warpvis.rendering import AnyCamera

_MOST_CAMERAS = 16


class _Casters(NamedTuple):
    stage: Stage
    images: GeomRenderer
    fractions: VisibleFractions


class ImageRenderer(Renderer):
    """`warpvis.mujoco.Renderer` that makes depth, segmentation and visible fractions at once."""

    _casters: dict[AnyCamera, _Casters]

    def images(self, outputs: Outputs) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32]]:
        """Render what `update_scene` took over.

        Returns:
            Depth ``(H, W)``, the geom or site of every pixel or -1 ``(H, W)``, and visible fractions ``(objects,)``.
        """
        stage, camera = self._stage, self._camera
        assert camera is not None
        empty = np.float32(camera.far if np.isnan(outputs.fill) else outputs.fill)
        depth, shapes = np.full(self._size, empty), np.full(self._size, -1, dtype=np.int32)
        fractions = np.zeros(len(outputs.members), dtype=np.float32)
        if not len(stage.scene):
            return depth, shapes, fractions
        casters = self._casters_of(camera, outputs)
        places = stage.object_poses()
        views = casters.images.render(self._pose[None], object_poses=places, exclude=stage.hidden)
        if views.depth is not None:
            seen = views.depth.numpy()[0]
            np.copyto(depth, seen, where=seen < np.float32(np.inf))
        if views.segmentation is None:
            return depth, shapes, fractions
        of_object = self._shapes_of_objects()
        segmentation = views.segmentation.numpy()
        shapes[:] = of_object[segmentation[0]]
        if len(outputs.members):
            hidden = np.zeros((1, len(stage.scene)), dtype=bool)
            hidden[:, stage.hidden] = True
            members, eye = outputs.members_of(of_object[:-1]), self._pose[None]
            fractions = casters.fractions.count(segmentation, members, eye, places, hidden)[0]
        return depth, shapes, fractions

    def _shapes_of_objects(self) -> NDArray[np.int32]:
        """List the geom or site of every object, -1 of those that are none, and of none at last."""
        ids, kinds = self._stage.meanings().T
        sites = np.where(kinds == SITE, ids + self._model.ngeom, -1)
        return np.where(kinds == GEOM, ids, sites).astype(np.int32)

    def _casters_of(self, camera: AnyCamera, outputs: Outputs) -> _Casters:
        kept = self.__dict__.setdefault("_casters", {})
        if camera not in kept or kept[camera].stage is not self._stage:
            if len(kept) >= _MOST_CAMERAS:  # a field of view that changes all the time must not fill the memory
                kept.clear()
            options: dict[str, Any] = {"near_plane": "clip", "cull_backfaces": True, "threads": self._threads}
            seen = camera if self._near_plane == "clip" else replace(camera, near=0.0)
            stage = self._stage
            images = GeomRenderer(stage.scene, seen, stage.coinciding, outputs=outputs.images, **options)
            kept[camera] = _Casters(stage, images, VisibleFractions(stage.scene, seen, **options))
        return cast(_Casters, kept[camera])
