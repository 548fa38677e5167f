# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's rangefinder sensors on CPU cores: `rangefinders.read_rangefinders` in a launch packed once.

Bounding spheres of 16 geoms at a time are tested with SIMD lanes.
"""

import warp as wp

from warpvis.kernels.constants import CPU_LANES
from warpvis.kernels.mujoco.rangefinders import (
    Ray,
    RayGeoms,
    SensorRays,
    farthest_hit,
    nearer_hit,
    sensor_frame,
    sensor_ray,
    write_reading,
)
from warpvis.kernels.native_source import include_native
from warpvis.kernels.rows import RowJob, finish_rows, rows_of, take_rows

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/spheres.h")}
)


@wp.struct
class RangefinderCall:
    """The arguments of a launch, as of `rangefinders.read_rangefinders`, in one struct modified between launches."""

    geoms: RayGeoms
    geom_xpos: wp.array2d[wp.vec3]
    geom_xmat: wp.array2d[wp.mat33]
    rays: SensorRays
    site_xpos: wp.array2d[wp.vec3]
    site_xmat: wp.array2d[wp.mat33]
    cam_xpos: wp.array2d[wp.vec3]
    cam_xmat: wp.array2d[wp.mat33]
    columns: int  # numbers of a world's readings
    job: RowJob  # views are worlds, and rows are rays
    spheres: wp.array2d[wp.float32]  # a row of scratch memory for each worker


@wp.struct
class RangefinderReadings:
    """The readings of all worlds, one after the other; the strides and the shape are ignored."""

    readings: wp.array[wp.float32]


@wp.func_native("return warpvis::Workers::enter(job.counter.data);")
def enter_job(job: RowJob) -> int: ...


@wp.func_native("warpvis::Spheres::of(spheres, worker).place(geoms, geom_xpos, world);")
def place_spheres(
    geoms: RayGeoms, geom_xpos: wp.array2d[wp.vec3], world: int, spheres: wp.array2d[wp.float32], worker: int
): ...


@wp.func_native("return warpvis::Spheres::of(spheres, worker).met(block, count, ray, nearest, body);")
def spheres_met(
    spheres: wp.array2d[wp.float32], worker: int, block: int, count: int, ray: Ray, nearest: wp.float64, body: int
) -> wp.uint32: ...


@wp.func_native("return __builtin_ctz(bits);")
def lowest_bit(bits: wp.uint32) -> int: ...


@wp.func
def read_rays(
    geoms: RayGeoms,
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    rays: SensorRays,
    site_xpos: wp.array2d[wp.vec3],
    site_xmat: wp.array2d[wp.mat33],
    cam_xpos: wp.array2d[wp.vec3],
    cam_xmat: wp.array2d[wp.mat33],
    rows: wp.vec3i,
    spheres: wp.array2d[wp.float32],
    worker: int,
    readings: wp.array[wp.float32],
    columns: int,
):
    """Write the readings of some rays of a world.

    The parameters are not one struct, because Warp copies the structs in it at every access.
    """
    world, count = rows[0], geoms.geom.shape[0]
    place_spheres(geoms, geom_xpos, world, spheres, worker)
    for index in range(rows[1], rows[2]):
        frame = sensor_frame(rays, index, site_xpos, site_xmat, cam_xpos, cam_xmat, world)
        ray = sensor_ray(rays, index, frame)
        nearest = farthest_hit()
        for block in range((count + CPU_LANES - 1) // CPU_LANES):
            remaining = count - CPU_LANES * block
            met = spheres_met(spheres, worker, block, remaining, ray, nearest.distance, rays.body[index])
            while met != wp.uint32(0):
                geom = CPU_LANES * block + lowest_bit(met)
                nearest = nearer_hit(geoms, geom_xpos, geom_xmat, world, geom, ray, nearest)
                met = met & (met - wp.uint32(1))
        write_reading(rays, index, frame, ray, nearest, readings, wp.int64(world) * wp.int64(columns))


@wp.kernel
def read_rangefinder_rows(
    # In:
    calls: wp.array[RangefinderCall],
    # Out:
    readings_out: wp.array[RangefinderReadings],
):
    """Write the readings of one call; each array contains one element. Every worker launches this kernel."""
    _ = wp.tid()
    call = calls[0]
    worker = enter_job(call.job)
    unit = take_rows(call.job)
    while unit >= 0:
        read_rays(
            call.geoms,
            call.geom_xpos,
            call.geom_xmat,
            call.rays,
            call.site_xpos,
            call.site_xmat,
            call.cam_xpos,
            call.cam_xmat,
            rows_of(call.job, unit),
            call.spheres,
            worker,
            readings_out[0].readings,
            call.columns,
        )
        unit = take_rows(call.job)
    finish_rows(call.job)
