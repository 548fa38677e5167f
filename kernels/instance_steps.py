# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stackless traversal of a BVH of static instances with shared meshes."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class InstanceStep:
    """A node of a BVH of instance boxes in depth-first order; see `warpvis.scene._instance_tree`."""

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
def meets_box(low: wp.vec3, high: wp.vec3, eye: wp.vec3, inverse: wp.vec3, most_t: float) -> bool:
    """Return whether a ray may hit a box, enlarged by a tolerance, before `most_t`."""
    a, b = wp.cw_mul(low - eye, inverse), wp.cw_mul(high - eye, inverse)
    least, most = wp.min(a, b), wp.max(a, b)
    begin = wp.max(least[0], wp.max(least[1], least[2]))
    end = wp.min(most[0], wp.min(most[1], most[2]))
    reach = 1.0e-5 * wp.abs(end)
    return end >= 0.0 and begin <= end + reach and begin <= most_t + 1.0e-5 * wp.abs(most_t)


@wp.func
def next_instance(steps: wp.array[InstanceStep], step: int, eye: wp.vec3, inverse: wp.vec3, most_t: float) -> int:
    """Return the next step, from `step` on, at which a ray hits the box of an instance; -1 at the end."""
    at = int(step)
    found = int(-1)
    while found < 0 and at < steps.shape[0]:
        if meets_box(steps[at].low, steps[at].high, eye, inverse, most_t):
            if steps[at].instance >= 0:
                found = at
            at += 1
        else:
            at = steps[at].after
    return found
