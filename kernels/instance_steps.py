# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The walk of a ray through a tree of boxes: of the instances that stay and share their meshes."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class InstanceStep:
    """A step of a walk through a tree of instances' boxes; see `warpvis.scene._instance_tree`."""

    low: wp.vec3  # of the box, in the world
    high: wp.vec3
    after: int  # the step to go on at if the box is missed
    instance: int  # which one the box is of, -1 for that of several
    pose: wp.transform  # object to world, of the instance that has this step's number


@wp.func
def inverse_of(direction: float) -> float:
    """1 / a ray's direction along an axis; a large number where it has none, of which 0 times is 0."""
    return 1.0 / wp.where(wp.abs(direction) < 1.0e-18, 1.0e-18, direction)


@wp.func
def inverses_of(direction: wp.vec3d) -> wp.vec3:
    return wp.vec3(inverse_of(float(direction[0])), inverse_of(float(direction[1])), inverse_of(float(direction[2])))


@wp.func
def meets_box(low: wp.vec3, high: wp.vec3, eye: wp.vec3, inverse: wp.vec3, most_t: float) -> bool:
    """Whether a ray may meet a box that is a little wider than what is in it, before it has gone so far."""
    a, b = wp.cw_mul(low - eye, inverse), wp.cw_mul(high - eye, inverse)
    least, most = wp.min(a, b), wp.max(a, b)
    begin = wp.max(least[0], wp.max(least[1], least[2]))
    end = wp.min(most[0], wp.min(most[1], most[2]))
    reach = 1.0e-5 * wp.abs(end)
    return end >= 0.0 and begin <= end + reach and begin <= most_t + 1.0e-5 * wp.abs(most_t)


@wp.func
def next_instance(steps: wp.array[InstanceStep], step: int, eye: wp.vec3, inverse: wp.vec3, most_t: float) -> int:
    """The next step, from one on, at which a ray meets the box of an instance; -1 if there is none."""
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
