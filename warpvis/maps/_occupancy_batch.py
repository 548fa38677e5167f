# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The kernels that integrate the depth images of a call into an occupancy map; see `warpvis.kernels.maps.occupancy`."""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import empty
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.kernels.pinhole import Window
from warpvis.maps._occupancy_blocks import BlockStorage

# Listed blocks that a CUDA launch processes at a time, and threads for each: about as many as run at a time. The host
# does not know how many blocks are listed.
_CUDA_ROWS, _CUDA_PARTS = 4096, 64

_CUDA_BLOCK = 64  # threads

# Images after which the host looks whether there were enough slots on a GPU.
_CUDA_IMAGES = 16

# Blocks that the list has room for at first.
_MIN_LISTED = 2**15

# Minimum number of pixels or blocks that a CPU thread processes at a time.
_MIN_PIXELS, _MIN_BLOCKS = 4096, 64


class _Argument(Enum):
    """What changes among the arguments of a kernel: the index of the image, and all images."""

    IMAGE = 0
    IMAGES = 1


_IMAGE, _IMAGES = _Argument


class Table:
    """Rows of a kernel's struct, which the host writes and sends to the device."""

    def __init__(self, shape: tuple[int, ...], dtype: type, device: wp.Device) -> None:
        """Allocate uninitialized rows."""
        self._host = empty(shape, dtype, name="the images", device=wp.get_device("cpu"))
        self.rows: NDArray[Any] = self._host.numpy()
        self.array = self._host if device.is_cpu else empty(shape, dtype, name="the images", device=device)

    def send(self) -> None:
        """Copy the rows to the device."""
        if self.array is not self._host:
            wp.copy(self.array, self._host)

    def receive(self) -> None:
        """Copy the rows to the host, after all kernels."""
        if self.array is not self._host:
            wp.copy(self._host, self.array)
            wp.synchronize_stream(self.array.device)


class Batch:
    """The depth images of a call, and the kernels that integrate them.

    Memory and recorded launches are kept for the next call with images of this size.
    """

    def __init__(self, blocks: BlockStorage) -> None:
        """Allocate nothing."""
        self._blocks, self._device = blocks, blocks.device
        self.by_rows = blocks.device.is_cpu
        """Whether kernels of `warpvis.kernels.maps.occupancy_rows` are used."""
        self._rows, self._parts = (1, 1) if self._device.is_cpu else (_CUDA_ROWS, _CUDA_PARTS)
        self._span = WHOLE_ROW if self._device.is_cpu else 1
        self._image_size: tuple[int, int] | None = None
        self._largest = np.zeros(3, dtype=np.int64)
        self._capacity = self._version = 0
        self._list_length = _MIN_LISTED

    def integrate(
        self, images: wp.array, views: NDArray[np.void], boxes: NDArray[np.void], threads: int | None
    ) -> None:
        """Integrate images one after the other.

        Args:
            images: Depth [m], ``(V, H, W)``.
            views: Fields of `DepthView`, ``(V,)``.
            boxes: Fields of `BlockBox`, ``(V,)``; the blocks are in the grid of the map.
            threads: Number of CPU threads.
        """
        self._allocate(images.shape[1:], len(images), boxes["size"].max(axis=0))
        self._images, self._threads, self._sizes = images, threads, boxes["size"].tolist()
        count = len(images)
        self._views.rows[:count], self._boxes.rows[:count] = views, boxes
        self._counts.rows[:] = -1, 0, 0
        self._counts.rows[0, 0] = self._blocks.free_count
        for table in (self._views, self._boxes, self._counts):
            table.send()
        step = 1 if self._device.is_cpu else _CUDA_IMAGES
        for first in range(0, count, step):
            self._integrate(first, min(first + step, count))

    def _allocate(self, image_size: tuple[int, int], count: int, largest: NDArray[np.int64]) -> None:
        """Make sure that arrays suffice for images of a size, and boxes of blocks."""
        from warpvis.kernels.maps.occupancy_blocks import BlockBox
        from warpvis.kernels.maps.occupancy_images import TILE, DepthView

        if count > self._capacity:
            self._capacity, self._version = count, 0
            self._views, self._boxes = (Table((count,), struct, self._device) for struct in (DepthView, BlockBox))
            self._counts = Table((count + 1, 3), wp.int32, self._device)
        if image_size != self._image_size:
            self._image_size, self._version = image_size, 0
            height, width = image_size
            self._bounds = self._array((1, height, width), wp.vec2)
            self._tiles = self._array((1, -(-height // TILE), -(-width // TILE)), wp.vec3)
            self._large_tiles = self._array((1, -(-height // TILE**2), -(-width // TILE**2)), wp.vec3)
        if (largest > self._largest).any():
            self._largest, self._version = np.maximum(largest, self._largest), 0
            self._updates = self._array(tuple(self._largest.tolist()), wp.uint8)
        if self._version != self._blocks.version:
            self._prepare()

    def _array(self, shape: tuple[int, ...], dtype: type) -> wp.array:
        return empty(shape, dtype, name="the map", device=self._device)

    def _prepare(self) -> None:
        """Collect the arguments of the kernels."""
        from warpvis.kernels.maps.occupancy_blocks import BlockList
        from warpvis.kernels.maps.occupancy_images import Tiles

        tiles, listed = Tiles(), BlockList()
        tiles.small, tiles.large = self._tiles, self._large_tiles
        listed.counts, listed.free_slots = self._counts.array, self._blocks.free_slots
        listed.blocks = self._array((self._list_length,), wp.vec4i)
        listed.ranges = self._array((self._list_length, 2), wp.int32)
        blocks, marks = self._blocks.struct(), self._blocks.marks
        view, boxes = (_IMAGE, self._views.array), self._boxes.array
        self._arguments: dict[str, tuple[object, ...]] = {
            "bound_surface": (*view, _IMAGES, self._bounds),
            "bound_tiles": (self._bounds, self._tiles),
            "merge_tiles": (self._tiles, self._large_tiles),
            "judge_blocks": (*view, boxes, self._span, tiles, listed, blocks, self._updates),
            "list_blocks": (_IMAGE, boxes, blocks, self._updates, listed),
            "fill_blocks": (_IMAGE, self._rows, self._parts, listed, blocks),
            "mark_points": (*view, listed, blocks, _IMAGES, marks),
            "update_voxels": (*view, _CUDA_ROWS, self._bounds, listed, blocks, marks),
            "release_blocks": (_IMAGE, self._rows * self._parts, listed, blocks),
        }
        if self.by_rows:
            by_rows = marks, self._blocks.marked_slots
            self._arguments["mark_points"] = (*view, blocks, _IMAGES, *by_rows)
            self._arguments["update_voxels"] = (*view, self._bounds, self._tiles, listed, blocks, *by_rows)
        self._recorded: dict[str, _Recorded] = {}
        self._version = self._blocks.version

    def _integrate(self, first: int, end: int) -> None:
        """Integrate some of the images; `first` must be the first one that is not integrated yet."""
        is_judged = False
        while first < end:
            for image in range(first, end):
                self._bound(image)
                self._list(image, is_judged=is_judged and image == first)
                self._update(image)
            first, is_judged = self._make_room(first, end), True

    def _bound(self, image: int) -> None:
        """Write the intervals that contain surfaces."""
        self._run("bound_surface", image, self._bounds.shape)
        self._run("bound_tiles", image, self._tiles.shape)
        self._run("merge_tiles", image, self._large_tiles.shape)

    def _list(self, image: int, *, is_judged: bool) -> None:
        """Update uniform blocks, and list those that need an update."""
        size = self._sizes[image]
        if 0 in size:
            return
        if not is_judged:
            self._run("judge_blocks", image, size)
        self._run_once("list_blocks", image, size)

    def _update(self, image: int) -> None:
        """Update the listed blocks, unless the image waits for slots."""
        from warpvis.kernels.maps.occupancy_blocks import SIDE

        self._run_once("fill_blocks", image, (self._rows, self._parts))
        shape = (_CUDA_ROWS, SIDE, SIDE)
        if self._device.is_cpu:
            counts = self._counts.rows
            if counts[image + 1, 0] < 0 or counts[image, 1] == 0:
                return
            if self.by_rows:
                shape = (int(counts[image, 1]), 1, 1)
        self._run("mark_points", image, self._bounds.shape)
        self._run("update_voxels", image, shape)
        self._run_once("release_blocks", image, (self._rows * self._parts,))

    def _make_room(self, first: int, end: int) -> int:
        """Add slots and length of the list if an image waits for them. Return that image, or `end` if none does."""
        self._counts.receive()
        counts = self._counts.rows
        stop = int((counts[first : end + 1, 0] >= 0).sum()) - 1 + first
        free, listed, new = (int(count) for count in counts[stop])
        self._blocks.free_count = free
        if stop == end:
            return end
        if new > free:
            self._blocks.make_room(new)
        self._list_length = max(self._list_length, listed + listed // 2)
        counts[stop] = self._blocks.free_count, 0, 0
        self._counts.send()
        self._prepare()
        return stop

    def _run(self, name: str, image: int, shape: tuple[int, int, int]) -> None:
        """Launch a kernel over pixels, voxels or blocks; on CPU cores that of a whole row, if there is one."""
        if not self._device.is_cpu:
            self._run_recorded(name, image, shape)
            return
        inputs = self._inputs(name, image)
        by_rows = self.by_rows and name in _BY_ROWS
        launch_images(
            _kernel(name, by_rows),
            shape,
            lambda window: [window, *inputs],
            device=self._device,
            threads=self._threads,
            split_views=name != "update_voxels",
            span=WHOLE_ROW if by_rows or name == "judge_blocks" else 1,
            min_pixels=_MIN_BLOCKS if by_rows and name == "update_voxels" else _MIN_PIXELS,
        )

    def _run_once(self, name: str, image: int, shape: tuple[int, ...]) -> None:
        """Launch a kernel over a list: on a CPU on this thread."""
        if self._device.is_cpu:
            launch(_kernel(name), shape, self._inputs(name, image), self._device)
        else:
            self._run_recorded(name, image, shape)

    def _run_recorded(self, name: str, image: int, shape: tuple[int, ...]) -> None:
        """Launch a CUDA kernel again for another image; packing all arguments would take longer than many kernels."""
        recorded = self._recorded.get(name)
        if recorded is None:
            kernel, inputs = _kernel(name), self._inputs(name, image)
            if kernel.adj.args[0].label == "window":
                inputs = [Window(), *inputs]
            packed = launch(kernel, shape, inputs, self._device, block_dim=_CUDA_BLOCK, record_cmd=True)
            recorded = self._recorded[name] = _Recorded(packed, shape, image, self._images)
        recorded.launch(shape, image, self._images)

    def _inputs(self, name: str, image: int) -> list[Any]:
        given = {_IMAGE: image, _IMAGES: self._images}
        return [given[value] if isinstance(value, _Argument) else value for value in self._arguments[name]]


class _Recorded:
    """A recorded launch, whose shape, image and images change. Each change takes as long as some kernels."""

    def __init__(self, packed: wp.Launch, shape: tuple[int, ...], image: int, images: wp.array) -> None:
        self._packed, self._shape, self._image, self._images = packed, shape, image, images
        places = {argument.label: place for place, argument in enumerate(packed.kernel.adj.args)}
        self._image_place, self._images_place = places.get("image"), places.get("depth_in")

    def launch(self, shape: tuple[int, ...], image: int, images: wp.array) -> None:
        """Launch the kernel."""
        if shape != self._shape:
            self._packed.set_dim(shape)
            self._shape = shape
        if self._image_place is not None and image != self._image:
            self._packed.set_param_at_index(self._image_place, image)
            self._image = image
        if self._images_place is not None and images is not self._images:
            self._packed.set_param_at_index(self._images_place, images)
            self._images = images
        self._packed.launch()


# Kernels of which `occupancy_rows` has counterparts for CPU cores.
_BY_ROWS = {"bound_surface", "mark_points", "update_voxels"}


def _kernel(name: str, by_rows: bool = False) -> wp.Kernel:
    from warpvis.kernels.maps import occupancy, occupancy_blocks, occupancy_images, occupancy_rows

    modules = (occupancy_rows,) if by_rows else (occupancy_images, occupancy_blocks, occupancy)
    kernel: wp.Kernel = next(getattr(module, name) for module in modules if hasattr(module, name))
    return kernel
