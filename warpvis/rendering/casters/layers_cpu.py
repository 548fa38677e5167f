# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The surfaces behind those of listed pixels, in packets on CPU cores."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from warpvis.core.threads import write_fields
from warpvis.kernels.constants import TILE_SIDE
from warpvis.rendering.casters.base import ImagesByName, ViewBatch
from warpvis.rendering.casters.packets_cpu import CpuPacketsCaster, Workspace

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene

FRONT_IMAGES = "points", "segmentation", "faces"
"""Images of the surfaces in front that are read."""


class _LayerWorkspace(Workspace):
    """A packed launch that reads the surfaces in front, ``"front ..."``, and also writes ``"is_back"`` etc."""

    def run(self, scene: Any, views: ViewBatch, images: ImagesByName) -> None:
        """Cast the rays of a call."""
        fields = {name: images[f"front {name}"] for name in FRONT_IMAGES}
        write_fields(self._call, **fields, **{name: images[name] for name in ("is_back", "is_left", "left")})
        super().run(scene, views, images)


class LayerCaster(CpuPacketsCaster):
    """Cast the rays of listed pixels on behind their surfaces, as packets of points; see `_layer_lists`."""

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write the surfaces behind those of ``"front ..."``, through the points `ViewBatch.pixels` that are not NaN.

        ``"is_back"`` becomes 1 where triangles are seen from behind, ``"is_left"`` 1 where rays are left to the
        reference, and ``"left"`` 1 if there are such rays.
        """
        assert views.pixels is not None
        points = views.pixels.size // views.count
        units = views.count * -(-self._camera.height // TILE_SIDE)
        make = partial(self._make_layers, views.count, points)
        self._run("layers", views, images, views.pixels.size, units, make)

    def _make_layers(self, views: int, points: int, scene: BvhScene, workers: int) -> Workspace:
        from warpvis.kernels.casting.layer_packets import LayerCall, cast_layer_packets
        from warpvis.kernels.casting.layers import GAP

        call = LayerCall()
        call.job, units = self._strips(views, points, workers)
        call.gap = float(GAP)
        return _LayerWorkspace(scene, cast_layer_packets, (call, LayerCall), views, min(workers, units))
