# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stackless traversal of a BVH of static instances with shared meshes."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class InstanceStep:
    """A node of a BVH of instance boxes in depth-first order; see `warpvis.scene.acceleration.instance_tree`."""

    low: wp.vec3  # of the box, in the world
    high: wp.vec3
    after: int  # next step if the box is missed
    instance: int  # the box's instance, -1 for an inner node
    pose: wp.transform  # object to world, of the instance with this step's index


@wp.func
def inverse_of(direction: float) -> float:
    """Return 1 / a direction's component; for a zero component a large finite number, so that 0 times it is 0."""
    return 1.0 / wp.where(wp.abs(direction) < 1.0e-18, 1.0e-18, direction)


@wp.func
def inverses_of(direction: wp.vec3d) -> wp.vec3:
    return wp.vec3(inverse_of(float(direction[0])), inverse_of(float(direction[1])), inverse_of(float(direction[2])))


@wp.func
def meets_box(low: wp.vec3, high: wp.vec3, eye: wp.vec3, inverse: wp.vec3, max_t: float) -> bool:
    """Return whether a ray may hit a box, enlarged by a tolerance, before `max_t`."""
    a, b = wp.cw_mul(low - eye, inverse), wp.cw_mul(high - eye, inverse)
    enter, leave = wp.min(a, b), wp.max(a, b)
    begin = wp.max(enter[0], wp.max(enter[1], enter[2]))
    end = wp.min(leave[0], wp.min(leave[1], leave[2]))
    reach = 1.0e-5 * wp.abs(end)
    return end >= 0.0 and begin <= end + reach and begin <= max_t + 1.0e-5 * wp.abs(max_t)


@wp.func
def next_instance(steps: wp.array[InstanceStep], step: int, eye: wp.vec3, inverse: wp.vec3, max_t: float) -> int:
    """Return the next step, from `step` on, at which a ray hits the box of an instance; -1 at the end."""
    current = int(step)
    found = int(-1)
    while found < 0 and current < steps.shape[0]:
        if meets_box(steps[current].low, steps[current].high, eye, inverse, max_t):
            if steps[current].instance >= 0:
                found = current
            current += 1
        else:
            current = steps[current].after
    return found
