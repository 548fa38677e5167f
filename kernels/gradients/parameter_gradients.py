# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Gradients with respect to a camera's parameters, from those with respect to its rays."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def sum_parameter_gradients(
    # In:
    rays_in: wp.array3d[wp.vec3],
    origins_in: wp.array3d[wp.vec3],
    ray_jacobian: wp.array3d[wp.vec3d],
    origin_jacobian: wp.array3d[wp.vec3d],
    # Out:
    rows_out: wp.array2d[wp.float64],
):
    """Add, over the pixels of each row of all views, the gradients through rays and their origins.

    Jacobians are ``[parameter, y, x]``; `origins_in` and `origin_jacobian` are None if origins do not depend on the
    parameters. `rows_out` is ``[parameter, y]``.
    """
    parameter, y = wp.tid()
    total = wp.float64(0.0)
    for view in range(rays_in.shape[0]):
        for x in range(rays_in.shape[2]):
            total += wp.dot(wp.vec3d(rays_in[view, y, x]), ray_jacobian[parameter, y, x])
            if origin_jacobian:
                total += wp.dot(wp.vec3d(origins_in[view, y, x]), origin_jacobian[parameter, y, x])
    rows_out[parameter, y] = total


@wp.kernel
def sum_rows(
    # In:
    rows_in: wp.array2d[wp.float64],
    # Out:
    gradients_out: wp.array[wp.float64],
):
    """Add the rows of each parameter."""
    parameter = wp.tid()
    total = wp.float64(0.0)
    for y in range(rows_in.shape[1]):
        total += rows_in[parameter, y]
    gradients_out[parameter] = total
