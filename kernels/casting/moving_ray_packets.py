# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rays of sensors that move during a measurement, as in `kernels.casting.moving_rays`, by packets on CPU cores.

See ``native/cpu/moving_rays.h``.
"""

import warp as wp

from warpvis.kernels.casting.motions import Motion
from warpvis.kernels.casting.packets import BvhScene, WorkerMemory, make_packet_kernel
from warpvis.kernels.casting.ray_bundle_packets import RayBundles, RayOrigins, TableJob
from warpvis.kernels.casting.worlds import Worlds


@wp.struct
class MovingRays:
    """Rays of a sensor in its frame, in the order of `RayBundles`."""

    directions: wp.array2d[wp.float64]  # (3, rays), of depth 1
    origins: wp.array2d[float]  # (3, rays) [m]; None if all are 0
    times: wp.array[wp.float64]  # after the start of the frame [s]
    spans: wp.array2d[wp.float64]  # (bundles, 2): their first and last times [s]
    left: wp.array[wp.int32]  # (views), Out: 1 for views that packets cannot cast
    touched: wp.array[
        wp.int32
    ]  # (views, pixels), Out: bits of the objects that a ray may hit, by their index modulo 32


@wp.struct
class MovingCall:
    """The arguments of a launch, as in `kernels.casting.packets.PacketCall`."""

    scene: BvhScene
    job: TableJob
    workers: WorkerMemory
    rays: RayBundles
    origins: RayOrigins  # None: each view has its own
    moving: MovingRays
    sensor: Motion
    objects: Motion  # of movable objects, on the same clock; None if they do not move
    poses: wp.array[wp.transform]  # not read
    worlds: Worlds


cast_moving_ray_packets = make_packet_kernel("cpu/moving_rays.h", "MovingBundles", MovingCall)
