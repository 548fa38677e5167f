# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays from sensors that move within a frame, on CUDA."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import BOX_WORDS, CUDA_LANES
from warpvis.rendering.casters.base import CastOptions, ImagesByName, Pool, ViewBatch, images_struct, needs_ids
from warpvis.rendering.casters.found_objects_cuda import nothing_found
from warpvis.rendering.casters.ray_bundles_cuda import packet_kernel
from warpvis.rendering.casters.rays import MAX_ORIGIN_EXTENT, extent_of
from warpvis.rendering.casters.sorted_rays_cuda import prepare_packets, z_buffer_order
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.images import Images
    from warpvis.kernels.casting.motions import TimedRays
    from warpvis.kernels.casting.moving_tables import MovingTerms, PacketRays
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.packets_cuda import RayPackets
    from warpvis.kernels.casting.rays import RayRange

# Maximum side of packets, which are whole images [px].
_MAX_SIDE = 32
# Size of a ray in the tables of a view.
_SLOT_BYTES = 32
# Minimum number of rays of all views: fewer are cast faster one by one in scenes of many small triangles. For each
# movable object that moves, rays count this many times more: packets of one view were faster among 20 of them.
_MIN_RAYS = 1 << 22
_OBJECT_COST = 7
# Maximum size of the tables of the views that are cast together [bytes].
_MAX_TABLE_BYTES = 1 << 29
# Minimum fraction of the rays that are in packets of neighbors; with fewer, all rays are cast one by one.
_MIN_PACKED = 0.5
# Maximum number of threads that cast remaining rays: more than a GPU runs at once.
_MAX_THREADS = 1 << 19
# Packets whose times span more than this many times the median are split if the widest gap is half of their span.
_LONG_SPAN = 4.0
# Arrays of `RayPackets`, except bounds of points.
_TABLES = {"frame": wp.float64, "eyes": wp.float64, "scale": wp.float32, "begins": wp.float32, "place": wp.int32}
_TABLES |= dict.fromkeys(("points", "rests", "asides"), wp.vec2)
# Rays of packets that take more legs of a motion are cast one by one.
_MAX_LEGS = 4
# Arrays of a `BvhScene` with elements of each object with its own frame: movable objects, then static instances.
_OF_DRAWN = {f"movable_{name}" for name in ("object", "root", "leaf", "first_id", "closed", "boxes", "solid", "size")}


@dataclass(frozen=True)
class TimedPackets:
    """Packets of neighbors for a sensor at rest, and their times, on a device."""

    side: int
    packets: RayPackets
    cells: wp.array
    """Column and row of each slot, vec2."""
    spans: wp.array
    """First and last time of each packet, after the start of the frame [s], shape ``(packets, 2)``."""
    times: wp.array
    """Time of each ray since the middle of its packet's times [s], shape ``(packets, slots)``."""
    paces: wp.array
    """Approximation of these times by columns and rows; see `place_moving_packets`."""

    @cached_property
    def rays(self) -> PacketRays:
        """The rays of the packets."""
        return _rays_of(self.packets)

    def __len__(self) -> int:
        """Return the number of packets."""
        return self.packets.place.shape[0]

    @property
    def table_bytes(self) -> int:
        """Size of the tables of a view, nearly."""
        return len(self) * _SLOT_BYTES * self.packets.place.shape[1]

    def make_tables(self, views: int, legs: int) -> Tables:
        """Return memory for the tables of several views whose packets take at most some legs each."""
        from warpvis.kernels.casting.moving_tables import LegTerms, MovingTerms, PacketTerms
        from warpvis.kernels.casting.packets_cuda import EYE_WORDS, FRAME_WORDS, RayPackets

        tables, device, rows = RayPackets(), self.packets.place.device, views * len(self)
        slots = rows, self.packets.place.shape[1]
        tables.frame = wp.empty((rows, FRAME_WORDS), dtype=wp.float64, device=device)
        tables.eyes = wp.empty((rows, EYE_WORDS), dtype=wp.float64, device=device)
        for name in ("points", "rests", "asides"):
            setattr(tables, name, wp.empty(slots, dtype=wp.vec2, device=device))
        for name in ("scale", "begins"):
            setattr(tables, name, wp.empty(slots, dtype=wp.float32, device=device))
        for name in ("windows", "place", "pixels"):
            setattr(tables, name, getattr(self.packets, name))
        tables.per_view = len(self)
        terms = MovingTerms()
        terms.legs = wp.empty((rows, legs), dtype=LegTerms, device=device)
        terms.packets = wp.empty(rows, dtype=PacketTerms, device=device)
        terms.remaining = wp.empty(rows, dtype=wp.int32, device=device)
        terms.count = wp.empty(1, dtype=wp.int32, device=device)
        return Tables(tables, terms, _rays_of(tables))


@dataclass(frozen=True)
class Tables:
    """Memory for the tables of several views."""

    packets: RayPackets
    terms: MovingTerms
    rays: PacketRays
    """The rays of the packets."""


class TableMemory:
    """Tables of all kinds of packets for as many views as a call had so far, and the poses of views."""

    def __init__(self) -> None:
        """Create without memory."""
        self.tables: list[Tables] = []
        self.poses: wp.array | None = None
        """Identities: tables are in world coordinates."""

    def reserve(self, kinds: list[TimedPackets], views: int, legs: int) -> None:
        """Allocate memory for some views whose packets take at most some legs each, unless there is enough."""
        if self.poses is None or self.poses.shape[0] < views:
            device = kinds[0].packets.place.device
            self.tables = [kind.make_tables(views, legs) for kind in kinds]
            self.poses = wp.full(views, wp.transform_identity(), dtype=wp.transform, device=device)


@dataclass(frozen=True)
class MovingRays:
    """The rays to cast in some views, the images to write, and the bits of objects that each ray may hit."""

    rays: TimedRays
    views: ViewBatch
    images: ImagesByName
    touched: wp.array | None

    @cached_property
    def images_struct(self) -> Images:
        """The images in the format of kernels."""
        return images_struct(self.images)

    def part(self, part: slice) -> MovingRays:
        """Return a slice of the views."""
        images = {name: image[part] for name, image in self.images.items()}
        return MovingRays(
            self.rays, self.views.part(part), images, None if self.touched is None else self.touched[part]
        )


class CudaMovingPackets:
    """Casts the rays of a packet together where the sensor moves little in the packet's time, and others one by one."""

    def __init__(self, scene: Scene, camera: AnyCamera, options: CastOptions) -> None:
        """Set up the caster."""
        self._scene = scene
        self._camera = camera
        self._options = options
        self._static: tuple[BvhScene, BvhScene] | None = None

    def __getstate__(self) -> dict[str, object]:
        """Return the state without device arrays, which copies create themselves."""
        cached = "_prepared", "_range", "_all_remaining"
        return {name: value for name, value in self.__dict__.items() if name not in cached} | {"_static": None}

    def takes(self, views: ViewBatch) -> bool:
        """Return whether packets can cast the rays of these views, and are faster than single rays.

        Packets are slower for few views, and where most rays are not in packets of neighbors, or their origins are far
        apart, as without motion. They cannot be used if each ray has an individual pose, if worlds scale objects, or
        near surfaces are cut away.
        """
        clips = self._options.clip_near and self._camera.near > 0
        if views.poses.sensor.poses or clips or views.worlds.object_sizes:
            return False
        rays, objects = self._camera.height * self._camera.width * views.count, views.poses.objects
        cost = 1 if objects is None else 1 + _OBJECT_COST * objects.legs.shape[2]
        return rays * cost >= _MIN_RAYS and self._suits

    def cast_motion(self, rays: TimedRays, views: ViewBatch, images: ImagesByName) -> wp.array | None:
        """Write images of all views, without movable objects if they have a motion.

        Returns:
            The bits of the objects that each ray may hit, by the object's index modulo 32, if they have a motion.
        """
        touched, (kinds, _) = None, self._prepared
        if views.poses.objects is not None:
            shape = views.count, self._camera.height, self._camera.width
            touched = wp.zeros(shape, dtype=wp.int32, device=self._scene.device)
        call, device, sensor = MovingRays(rays, views, images, touched), self._scene.device, views.poses.sensor
        parts = -(-views.count * sum(kind.table_bytes for kind in kinds) // _MAX_TABLE_BYTES)
        most = -(-views.count // min(parts, views.count))
        legs = 1 if sensor.is_screw else min(_MAX_LEGS, sensor.legs.shape[0])
        # A captured graph must not share its memory.
        pool = Pool() if device.is_cuda and device.is_capturing else self._options.pool
        kind = self, "moving tables", legs, device.is_cuda and device.stream
        for first in range(0, views.count, most):
            part = call if most == views.count else call.part(slice(first, min(first + most, views.count)))
            pool.use(kind, TableMemory, partial(self._cast, part, legs))
        return touched

    def _cast(self, call: MovingRays, legs: int, memory: TableMemory) -> None:
        kinds, points = self._prepared
        memory.reserve(kinds, call.views.count, legs)
        for kind, tables in zip(kinds, memory.tables, strict=True):
            self._fill(call, kind, tables)
            self._cast_packets(call, kind.side, tables.packets, memory.poses)
            self._cast_remaining(call, kind.packets.place, tables.terms)
            if call.touched is not None:
                self._mark_touched(call, kind, tables.packets)
        if points is not None:
            self._cast_remaining(call, points, self._all_remaining)

    def _fill(self, call: MovingRays, kind: TimedPackets, tables: Tables) -> None:
        from warpvis.kernels.casting.moving_tables import move_packet_rays, place_moving_packets

        views, device, made = call.views, self._scene.device, [tables.terms, tables.packets]
        inputs = [views.worlds, call.touched is not None, kind.packets, kind.spans, kind.paces]
        lanes, size = self._lanes, (views.count, len(kind))
        launch(place_moving_packets, size, [views.poses.sensor, *inputs, *made], device, block_dim=lanes)
        inputs = [kind.rays, kind.times, kind.cells, lanes]
        launch(move_packet_rays, (*size, lanes), [*inputs, *made, tables.rays], device, block_dim=lanes)

    def _cast_packets(self, call: MovingRays, side: int, tables: RayPackets, poses: wp.array) -> None:
        scene, views = self._scene.bvh(faces="faces" in call.images).struct, call.views
        if call.touched is not None:
            scene = self._without_movables(scene)
        cull, images = self._options.cull_backfaces, call.images_struct
        launch(
            packet_kernel(side, needs_ids(call.images), scene.drawn_count > 0, False, 0, True),
            (tables.per_view, views.count, 1, CUDA_LANES),
            [scene, self._range, poses, views.worlds, nothing_found(), tables, cull, images],
            self._scene.device,
            block_dim=CUDA_LANES,
        )

    def _cast_remaining(self, call: MovingRays, place: wp.array, terms: MovingTerms) -> None:
        from warpvis.kernels.casting.moving_packets_cuda import cast_remaining_at_objects, cast_remaining_rays

        views, poses, (packets, slots) = call.views, call.views.poses, place.shape
        triangles = self._scene.triangles(faces="faces" in call.images).struct
        objects = [] if poses.objects is None else [poses.objects]
        rows = views.count * packets
        blocks = max(1, min(rows, _MAX_THREADS // slots))
        rest = [call.rays, place, terms, wp.vec2i(rows, blocks), self._options.cull_backfaces]
        launch(
            cast_remaining_at_objects if objects else cast_remaining_rays,
            (blocks, slots),
            [triangles, self._range, poses.sensor, views.worlds, *objects, *rest, call.images_struct],
            self._scene.device,
            block_dim=256,
        )

    def _mark_touched(self, call: MovingRays, kind: TimedPackets, tables: RayPackets) -> None:
        from warpvis.kernels.casting.moving_packets_cuda import mark_touched_rays

        views, device, scene, lanes = call.views, self._scene.device, self._scene.bvh().struct, self._lanes
        sensor, objects = views.poses.sensor, views.poses.objects
        inputs = [scene, sensor, views.worlds, objects, tables, kind.spans, self._camera.width, lanes, call.touched]
        launch(mark_touched_rays, (views.count, len(kind), lanes), inputs, device, block_dim=lanes)

    @property
    def _lanes(self) -> int:
        return 1 if self._scene.device.is_cpu else CUDA_LANES

    @cached_property
    def _range(self) -> RayRange:
        return self._camera.ray_range()

    @cached_property
    def _all_remaining(self) -> MovingTerms:
        from warpvis.kernels.casting.moving_tables import MovingTerms

        return MovingTerms()

    def _without_movables(self, scene: BvhScene) -> BvhScene:
        """Return the trees of a scene without its movable objects."""
        if self._static is None or self._static[0] is not scene:
            self._static = scene, without_movables(scene)
        return self._static[1]

    @cached_property
    def _suits(self) -> bool:
        """Whether the origins of rays are close to each other, and most rays in packets of neighbors."""
        camera = self._camera
        if camera.origins is not None and extent_of(camera.rays, camera.origins) > MAX_ORIGIN_EXTENT:
            return False
        slots = sum(kind.packets.place.size for kind in self._prepared[0])
        return slots >= _MIN_PACKED * camera.height * camera.width

    @cached_property
    def _prepared(self) -> tuple[list[TimedPackets], wp.array | None]:
        camera, device = self._camera, self._scene.device
        return camera.prepared(("moving packets", device.alias), lambda: prepare_moving_packets(camera, device))


def prepare_moving_packets(camera: AnyCamera, device: wp.Device) -> tuple[list[TimedPackets], wp.array | None]:
    """Prepare packets of neighbors, whose times are 0 s if the camera has none, and other rays, if there are any."""
    shape, origins = (camera.height, camera.width, 3), camera.origins
    times = np.zeros(shape[:2]) if camera.times is None else camera.times
    has_ray = np.isfinite(camera.rays).all(axis=-1).ravel()
    prepared = prepare_packets(camera.rays.reshape(shape), device, None if origins is None else origins.reshape(shape))
    kinds = []
    for side, packets in prepared.packets(_MAX_SIDE):
        packets = _split_by_time(packets, times.ravel(), has_ray)
        place, order = packets.place.numpy(), z_buffer_order(side)
        is_ray, moments = (place >= 0) & has_ray[place], times.ravel()[place]
        spans = _spans(moments, is_ray)
        since = np.where(is_ray, moments - spans.mean(axis=1, keepdims=True), 0.0)
        cells = np.stack([order % side, order // side], axis=1).astype(np.float64)
        arrays = (
            wp.array(cells.astype(np.float32), dtype=wp.vec2, device=device),
            wp.array(spans, dtype=wp.float64, device=device),
            wp.array(since.astype(np.float32), dtype=wp.float32, device=device),
            wp.array(_fit_paces(since, is_ray, cells), dtype=wp.vec3d, device=device),
        )
        kinds.append(TimedPackets(side, packets, *arrays))
    return kinds, None if prepared.points is None else prepared.points.place


def _spans(times: NDArray[np.float64], is_ray: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the first and last time of each packet, shape ``(packets, 2)``; 0 without rays."""
    first, last = np.where(is_ray, times, np.inf).min(axis=1), np.where(is_ray, times, -np.inf).max(axis=1)
    return np.where(is_ray.any(axis=1, keepdims=True), np.stack([first, last], axis=1), 0.0)


def _split_by_time(packets: RayPackets, times: NDArray[np.float64], has_ray: NDArray[np.bool_]) -> RayPackets:
    """Split packets of which some rays are cast much later than others, as where a revolution ends and begins."""
    from warpvis.kernels.casting.packets_cuda import RayPackets

    place = packets.place.numpy()
    is_ray, moments = (place >= 0) & has_ray[place], times[place]
    spans = np.ptp(_spans(moments, is_ray), axis=1)
    ordered = np.sort(np.where(is_ray, moments, np.inf), axis=1)
    gaps = np.where(np.isfinite(ordered[:, 1:]), ordered[:, 1:], -np.inf) - ordered[:, :-1]
    widest = gaps.argmax(axis=1)[:, None]
    long = np.flatnonzero((gaps.max(axis=1) > spans / 2) & (spans > _LONG_SPAN * np.median(spans)))
    if not len(long):
        return packets
    is_late = moments > np.take_along_axis(ordered, widest, axis=1)
    rows = np.concatenate([np.arange(len(place)), long])
    is_kept = np.concatenate([np.ones_like(is_late), is_late[long]])
    is_kept[long] = ~is_late[long]
    split, device = RayPackets(), packets.place.device
    for name, dtype in _TABLES.items():
        values = getattr(packets, name)
        if values is not None:
            values = values.numpy()[rows]
            if name in ("scale", "place"):
                values = np.where(is_kept, values, -1 if name == "place" else 0)
            setattr(split, name, wp.array(values, dtype=dtype, device=device))
    windows = np.zeros((len(rows), 4), dtype=np.int32)
    windows[:, 0], windows[:, 3] = np.arange(len(rows)), (is_ray[rows] & is_kept).all(axis=1)
    split.windows = wp.array(windows, dtype=wp.int32, device=device)
    split.pixels = packets.pixels
    return split


def _rays_of(packets: RayPackets) -> PacketRays:
    """Return the rays of packets in the format of `move_packet_rays`."""
    from warpvis.kernels.casting.moving_tables import PacketRays

    rays: Any = PacketRays()
    for name in ("points", "rests", "scale", "asides", "begins"):
        values = getattr(packets, name)
        setattr(rays, name, None if values is None else values.flatten())
    return rays


def _fit_paces(times: NDArray[np.float64], is_ray: NDArray[np.bool_], cells: NDArray[np.float64]) -> NDArray:
    """Approximate the times of packets by ``x * column + y * row + z``, shape ``(packets, 3)``, by least squares."""
    terms = np.concatenate([cells, np.ones((len(cells), 1))], axis=1)
    normal = np.einsum("ps,sa,sb->pab", is_ray.astype(np.float64), terms, terms)
    return np.einsum("pab,sb,ps->pa", np.linalg.pinv(normal, hermitian=True), terms, times)


def without_movables(scene: BvhScene) -> BvhScene:
    """Return trees without the movable objects; those of static instances remain."""
    from warpvis.kernels.casting.packets import BvhScene

    kind: Any = BvhScene
    static, count = BvhScene(), scene.movable_count
    for name in kind.vars:
        value = getattr(scene, name)
        if name in _OF_DRAWN and scene.drawn_count > count:  # else they are not read
            value = value[(BOX_WORDS if name == "movable_boxes" else 1) * count :]
        setattr(static, name, value)
    static.movable_count, static.drawn_count = 0, scene.drawn_count - count
    return static
