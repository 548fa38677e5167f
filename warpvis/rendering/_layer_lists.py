# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Transparent surfaces on CPU cores: layers of those pixels only that show what is behind their surfaces."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.cameras.rays import RayCamera
from warpvis.core.threads import write_fields
from warpvis.kernels.constants import BLOCK_SIDE
from warpvis.rendering._computed import Frame, compute_output, make_footprint
from warpvis.rendering._layers import LAYER_IMAGES, blend_layer_images, materials_of, ray_arguments
from warpvis.rendering._shadows import cast_shadows
from warpvis.rendering.casters.base import CastOptions, ImagesByName, Scratch, ViewBatch, images_struct
from warpvis.rendering.casters.layers_cpu import FRONT_IMAGES, LayerCaster
from warpvis.rendering.casters.packed_rows import PackedRows
from warpvis.rendering.casters.rays import rays_through

_MAX_COLUMNS = 512
"""Maximum width of a list as an image."""
_MIN_PACKETS = 512
"""Number of listed pixels from which on packets are faster than rays, however large the scene is."""


def blend_layers(frame: Frame, out: wp.array, caster: str, options: CastOptions, scratch: Scratch) -> None:
    """Blend the colors of transparent surfaces with those behind them, for up to `MAX_LAYERS` surfaces along a ray.

    On CPU cores, the pixels that show what is behind their surfaces are listed, and layers are cast and shaded for the
    list, until all of it is finished. Lists do not depend on the number of threads. See `blend_layer_images` for the
    arguments, and for GPUs.
    """
    from warpvis.kernels.shading.layers import MAX_LAYERS

    if not frame.scene.device.is_cpu:
        blend_layer_images(frame, out, caster, options, scratch)
        return
    if 0 in out.shape:
        return
    # Lists differ in size from images: in separate memory, both are reused.
    memory = scratch.item("layers", lambda: Scratch(frame.scene.device))
    layers = _LayerLists(frame, memory)
    if not layers.find(out):
        return
    for number in range(1, MAX_LAYERS):
        behind = layers.cast_behind(caster, options)
        shadows = None if frame.shadows is None else cast_shadows(behind, caster, memory)
        compute_output("color", replace(behind, shadows=shadows), layers.color, memory)
        if not layers.blend(number, out):
            return


class _LayerLists:
    """The lists of a call, and the launches that process them."""

    def __init__(self, frame: Frame, memory: Scratch) -> None:
        self._frame, self._memory = frame, memory
        self._seen = {
            "appearance": materials_of(frame),
            "footprint": make_footprint(frame.camera),
            "camera_to_world": frame.poses,
            "worlds": frame.worlds,
        }

    def _launch(self, module: Any, kernel: str, call: str, images: str) -> PackedRows:
        make = partial(PackedRows, getattr(module, kernel), getattr(module, call), getattr(module, images))
        return self._memory.item(kernel, lambda: make(self._frame.threads))

    def find(self, out: wp.array) -> bool:
        """List the pixels that show what is behind their surfaces, and return whether there are any."""
        from warpvis.kernels.shading import layer_rows

        frame, memory, array = self._frame, self._memory, self._memory.array
        views, height, width = out.shape
        bands = views, -(-height // BLOCK_SIDE), BLOCK_SIDE * width
        found = {
            "count": array("counts", bands[:2], wp.int32),
            "pixels": array("found", bands, wp.int32),
            "opacity": array("found opacity", bands, wp.vec2),
        }
        front = {name: frame.images[name] for name in FRONT_IMAGES}
        finder = self._launch(layer_rows, "find_transparent_rows", "FindCall", "FoundPixels")
        finder.run(bands, found, **self._seen, **front)
        first = array("first", (views, bands[1] + 1), wp.int32)
        numbers = first.numpy()
        numbers[:, 0] = 0
        np.cumsum(found["count"].numpy(), axis=1, out=numbers[:, 1:])
        longest, self._count = int(numbers[:, -1].max()), int(numbers[:, -1].sum())
        if not longest:
            return False
        rays = self._sky_rays()
        self._make_list(_list_shape(views, longest), has_rays=rays is not None)
        struct = memory.item("found", layer_rows.FoundPixels)
        write_fields(struct, **found)
        self._launch(layer_rows, "list_transparent_rows", "ListCall", "PixelList").run(
            bands,
            self._fields,
            found=struct,
            first=first,
            width=width,
            color=out,
            places=frame.pixels,
            rays=rays,
            **front,
        )
        return True

    def _sky_rays(self) -> wp.array | None:
        """Return the rays of all pixels if the color of the background differs between them."""
        frame = self._frame
        if frame.skies() is None or not isinstance(frame.camera, RayCamera):
            return None
        return rays_through(frame.camera, frame.pixels, frame.scene.device)

    def _make_list(self, shape: tuple[int, int, int], *, has_rays: bool) -> None:
        """Take memory for a list of pixels."""
        from warpvis.kernels.shading.layer_rows import PixelList
        from warpvis.kernels.shading.layers import Layers

        array = partial(self._memory.array, shape=shape)
        self._images = [
            {name: array(f"{name} {k}", dtype=dtype) for name, dtype in LAYER_IMAGES.items()} for k in (0, 1)
        ]
        self.images = self._images[0]
        self.color = array("color", dtype=wp.vec3ub)
        self.pixels, self.places = array("pixels", dtype=wp.int32), array("places", dtype=wp.vec2)
        self._rays = array("rays", dtype=wp.vec3d) if has_rays else None
        self._clear = array("clear", dtype=wp.vec2)
        layers, self._list = self._memory.item("blended", Layers), self._memory.item("list", PixelList)
        write_fields(layers, over=array("over", dtype=wp.vec3), under=array("under", dtype=wp.vec3), clear=self._clear)
        self._fields = {"layers": layers, "pixels": self.pixels, "places": self.places, "rays": self._rays}
        self._fields |= {name: self.images[name] for name in FRONT_IMAGES}
        write_fields(self._list, **self._fields)

    def cast_behind(self, caster: str, options: CastOptions) -> Frame:
        """Cast the rays of listed pixels on behind their surfaces, and return the frame of those that they meet."""
        front, self.images = self.images, self._images[self.images is self._images[0]]
        frame, left = self._frame, None
        if caster == "packets" and isinstance(frame.camera, Camera) and self._count >= _MIN_PACKETS:
            left = self._cast_packets(front, options)
        if left is None or left:
            self._cast_rays(front, options, None if left is None else self._array("is_left", wp.uint8))
        return replace(frame, images=self.images, pixels=self.places, rays=self._rays, shadows=None, occlusion=None)

    def _cast_packets(self, front: ImagesByName, options: CastOptions) -> bool:
        """Cast rays in packets, and return whether some are left."""
        frame, memory = self._frame, self._memory
        made = memory.item("caster", lambda: LayerCaster(frame.scene, frame.camera, options))
        left = memory.array("left", (1,), wp.int32)
        left.numpy()[0] = 0
        images = {f"front {name}": front[name] for name in FRONT_IMAGES} | self.images
        images |= {"is_back": self._array("is_back", wp.uint8), "is_left": self._array("is_left", wp.uint8)}
        made.cast(ViewBatch(frame.poses.numpy(), frame.worlds, pixels=self.places), images | {"left": left})
        return bool(left.numpy()[0])

    def _cast_rays(self, front: ImagesByName, options: CastOptions, is_left: wp.array | None) -> None:
        """Cast rays one by one: all, or those that are left."""
        from warpvis.kernels.casting import layer_rows

        rays = ray_arguments(self._frame)
        self._launch(layer_rows, "cast_layer_rows", "BehindCall", "BehindImages").run(
            self.color.shape,
            {"images": images_struct(self.images), "is_back": self._array("is_back", wp.uint8)},
            **rays | {"is_parallel": int(rays["is_parallel"])},
            **{name: front[name] for name in FRONT_IMAGES},
            cull_backfaces=int(options.cull_backfaces),
            camera_to_world=self._frame.poses,
            worlds=self._frame.worlds,
            pixels=self.pixels,
            clear=self._clear,
            is_left=is_left,
        )

    def blend(self, number: int, out: wp.array) -> bool:
        """Blend a layer, write colors of finished pixels, and return whether pixels may show more."""
        from warpvis.kernels.shading import layer_rows

        unfinished = self._memory.array("unfinished", (1,), wp.int32)
        unfinished.numpy()[0] = 0
        self._launch(layer_rows, "blend_layer_rows", "BlendCall", "BlendedImages").run(
            self.color.shape,
            {"color": out, "unfinished": unfinished},
            **self._seen,
            listed=self._list,
            **{name: self.images[name] for name in FRONT_IMAGES},
            is_back=self._array("is_back", wp.uint8),
            color=self.color,
            opacity=self._array("opacity", wp.vec2),
            number=number,
        )
        return bool(unfinished.numpy()[0])

    def _array(self, name: str, dtype: type) -> wp.array:
        return self._memory.array(name, self.color.shape, dtype)


def _list_shape(views: int, pixels: int) -> tuple[int, int, int]:
    """Return the shape of lists of at least this many pixels; few sizes differ, so that memory is reused."""
    blocks = -(-pixels // BLOCK_SIDE**2)
    blocks = 1 << (blocks - 1).bit_length()
    columns = min(blocks, _MAX_COLUMNS // BLOCK_SIDE)
    return views, BLOCK_SIDE * -(-blocks // columns), BLOCK_SIDE * columns
