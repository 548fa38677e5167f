# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packed launches on CUDA: packing can take longer than a GPU takes to render an image.

CUDA reads the structs when a launch is submitted. A call only writes addresses into them, without keeping the arrays
alive.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import warp as wp

from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering.casters.base import ImagesByName, ImageSlots


class StructSlot:
    """A Warp struct to which others of its type can be assigned: ctypes assigns only to fields."""

    def __init__(self, struct: Any) -> None:
        """Wrap a struct, the argument of launches."""
        self.struct = struct
        memory = struct.__ctype__()
        holder: Any = type("Holder", (ctypes.Structure,), {"_fields_": [("struct", type(memory))]})
        self._memory = holder.from_address(ctypes.addressof(memory))

    def set(self, struct: Any) -> None:
        """Assign another struct."""
        self._memory.struct = struct.__ctype__()


class PosesSlot:
    """An array of poses, the argument of launches, whose address each call sets."""

    def __init__(self, views: int, device: wp.Device) -> None:
        """Create it with a placeholder address."""
        self.poses = wp.array(ptr=1, dtype=wp.transform, shape=(views,), device=device)
        self._memory = self.poses.__ctype__()

    def set(self, poses: wp.array) -> None:
        """Set the address."""
        self._memory.data = poses.ptr


class PackedPackets:
    """Packed launches of packets of a view each, by `warpvis.kernels.casting.packets_cuda`."""

    def __init__(
        self,
        groups: Sequence[tuple[wp.Kernel, Any, tuple[int, int]]],
        camera: Any,
        views: int,
        cull: bool,
        device: wp.Device,
    ) -> None:
        """Pack a launch for each group: its kernel, its rays, and the number of rows and columns of packets."""
        from warpvis.kernels.casting.packets import BvhScene
        from warpvis.kernels.casting.packets_cuda import FoundObjects
        from warpvis.kernels.casting.worlds import Worlds

        self._images, self._poses = ImageSlots(), PosesSlot(views, device)
        self._scene, self._worlds = StructSlot(BvhScene()), StructSlot(Worlds())
        self._found = StructSlot(FoundObjects())
        before = [self._scene.struct, camera, self._poses.poses, self._worlds.struct, self._found.struct]
        self._launches = [
            launch(
                kernel,
                (rows, views, columns, CUDA_LANES),
                [*before, rays, cull, self._images.struct],
                device,
                block_dim=CUDA_LANES,
                record_cmd=True,
            )
            for kernel, rays, (rows, columns) in groups
        ]

    def run(self, scene: Any, poses: wp.array, worlds: Any, found: Any, images: ImagesByName) -> None:
        """Launch on the device's current stream."""
        self._scene.set(scene)
        self._worlds.set(worlds)
        self._found.set(found)
        self._poses.set(poses)
        self._images.fill(images)
        for command in self._launches:
            command.launch()
