# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt steps of poses, one thread per view, in double precision."""

import warp as wp

from warpvis.kernels.pinhole import pose_origin, pose_rotation

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

RUNNING = wp.constant(0)
CONVERGED = wp.constant(1)
STOPPED = wp.constant(2)

# Columns of sums: see `kernels.gradients.normal_equations.sum_terms`.
SIDE = wp.constant(36)
COST = wp.constant(42)
INLIERS = wp.constant(43)
MEASURED = wp.constant(44)

MIN_INLIERS = wp.constant(wp.float64(6.0))

# Damping is a multiple of the mean diagonal of the block of rotations or translations of H.
FIRST_DAMPING = wp.constant(wp.float64(1e-4))
MIN_DAMPING = wp.constant(wp.float64(1e-7))
MAX_DAMPING = wp.constant(wp.float64(1e4))
DAMPING_FACTOR = wp.constant(wp.float64(10.0))

# Relative increase of the cost that is accepted: pixels at silhouettes change sides in every step,
# and the cost of each of them jumps.
COST_TOLERANCE = wp.constant(wp.float64(0.01))

# Squared length of a step, in standard deviations of the pose, that is not significant.
INSIGNIFICANT = wp.constant(wp.float64(1e-2))

# Squared length of steps that end iterations if they are not shorter than the step before: pixels at silhouettes change
# sides, and move the pose to and fro.
REPEATED = wp.constant(wp.float64(1.0))

# Squared length of steps that are accepted at any cost: pixels that change sides would reject them by chance.
SHORT = wp.constant(wp.float64(100.0))

# Pivots that are smaller fractions of the diagonal are rounding errors: H is singular.
PIVOT_TOLERANCE = wp.constant(wp.float64(1e-12))

TINY = wp.constant(wp.float64(1e-30))
ONE = wp.constant(wp.float64(1.0))
HALF = wp.constant(wp.float64(0.5))
THIRD = wp.constant(wp.float64(1.0 / 3.0))


@wp.struct
class StepLimits:
    """Largest steps, and those at which iterations end."""

    max_rotation: wp.float64  # [rad]
    max_translation: wp.float64  # [m]
    tolerance: wp.float64  # [rad] and [m]


@wp.struct
class SolverState:
    """State of every view."""

    status: wp.array[int]
    iterations: wp.array[int]
    damping: wp.array[wp.float64]
    lengths: wp.array[wp.float64]
    """Squared lengths of the last steps, in standard deviations."""
    best: wp.array[wp.transform]
    """Accepted poses."""
    sums: wp.array2d[wp.float64]
    """Sums at the accepted poses."""


@wp.func
def factorize(matrix: wp.spatial_matrixd) -> tuple[wp.spatial_matrixd, bool]:
    """Return the Cholesky factor of a matrix, and whether the matrix is positive definite."""
    lower = wp.spatial_matrixd()
    size = int(6)
    for i in range(size):
        for k in range(i + 1):
            total = matrix[i, k]
            for m in range(k):
                total -= lower[i, m] * lower[k, m]
            if k < i:
                lower[i, k] = total / lower[k, k]
            elif total > PIVOT_TOLERANCE * matrix[i, i]:
                lower[i, i] = wp.sqrt(total)
            else:
                return lower, False
    return lower, True


@wp.func
def solve_factorized(lower: wp.spatial_matrixd, side: wp.spatial_vectord) -> wp.spatial_vectord:
    """Solve a linear system by its Cholesky factor."""
    x = side
    size = int(6)
    for i in range(size):
        total = x[i]
        for m in range(i):
            total -= lower[i, m] * x[m]
        x[i] = total / lower[i, i]
    for backward in range(size):
        i = 5 - backward
        total = x[i]
        for m in range(i + 1, size):
            total -= lower[m, i] * x[m]
        x[i] = total / lower[i, i]
    return x


@wp.func
def read_matrix(sums: wp.array2d[wp.float64], view: int) -> wp.spatial_matrixd:
    matrix = wp.spatial_matrixd()
    size = int(6)
    for i in range(size):
        for k in range(size):
            matrix[i, k] = sums[view, 6 * i + k]
    return matrix


@wp.func
def rounded_pose(origin: wp.vec3d, rotation: wp.quatd) -> wp.transform:
    """Return a pose in single precision."""
    q = wp.normalize(rotation)
    rounded = wp.quat(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]), wp.float32(q[3]))
    return wp.transform(wp.vec3(origin), rounded)


@wp.func
def moved_pose(pose: wp.transform, rotation: wp.vec3d, translation: wp.vec3d) -> wp.transform:
    """Return a pose after a twist about its origin, by the exponential map."""
    angle = wp.length(rotation)
    scale = HALF
    if angle > wp.float64(1e-8):
        scale = wp.sin(HALF * angle) / angle
    turn = wp.quatd(scale * rotation[0], scale * rotation[1], scale * rotation[2], wp.cos(HALF * angle))
    return rounded_pose(pose_origin(pose) + translation, turn * pose_rotation(pose))


@wp.kernel
def step_poses(
    # In:
    limits: StepLimits,
    column: int,
    is_last: bool,
    sums_in: wp.array2d[wp.float64],
    # Out:
    state_out: SolverState,
    poses_out: wp.array2d[wp.transform],
):
    """Accept or reject the poses (view, column) at which sums were computed, and write the next poses.

    A pose is accepted if its cost is not larger, up to `COST_TOLERANCE`; damping then decreases, and increases
    otherwise. Views that are not running keep their accepted poses.
    """
    view = wp.tid()
    if state_out.status[view] != RUNNING:
        return
    cost, inliers = sums_in[view, COST], sums_in[view, INLIERS]
    is_first = state_out.iterations[view] == 0
    damping = state_out.damping[view]
    is_cheap = cost <= (ONE + COST_TOLERANCE) * state_out.sums[view, COST] or state_out.lengths[view] <= SHORT
    accepted = is_first or (inliers >= MIN_INLIERS and is_cheap)
    if accepted:
        state_out.best[view] = poses_out[view, column]
        for k in range(sums_in.shape[1]):
            state_out.sums[view, k] = sums_in[view, k]
        damping = wp.where(is_first, FIRST_DAMPING, wp.max(damping / DAMPING_FACTOR, MIN_DAMPING))
    else:
        damping *= DAMPING_FACTOR
    state_out.damping[view] = damping
    best = state_out.best[view]
    poses_out[view, column] = best
    if (is_first and not inliers >= MIN_INLIERS) or damping > MAX_DAMPING:
        state_out.status[view] = STOPPED
        return

    matrix = read_matrix(state_out.sums, view)
    damped = matrix
    rotations = THIRD * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2])
    translations = THIRD * (matrix[3, 3] + matrix[4, 4] + matrix[5, 5])
    side = wp.spatial_vectord()
    size = int(6)
    for k in range(size):
        damped[k, k] += damping * wp.where(k < 3, rotations, translations)
        side[k] = -state_out.sums[view, SIDE + k]
    lower, is_definite = factorize(damped)
    if not is_definite:
        state_out.status[view] = STOPPED
        return
    step = solve_factorized(lower, side)
    rotation = wp.vec3d(step[0], step[1], step[2])
    translation = wp.vec3d(step[3], step[4], step[5])
    length = wp.dot(step, matrix * step)
    is_repeated = not is_first and length <= REPEATED and length >= state_out.lengths[view]
    state_out.lengths[view] = length
    largest = wp.max(wp.length(rotation), wp.length(translation))
    is_small = largest <= limits.tolerance or length <= INSIGNIFICANT or is_repeated
    scale = wp.min(
        ONE,
        wp.min(
            limits.max_rotation / wp.max(wp.length(rotation), TINY),
            limits.max_translation / wp.max(wp.length(translation), TINY),
        ),
    )
    moved = moved_pose(best, scale * rotation, scale * translation)
    if is_small and damping <= ONE:
        state_out.status[view] = CONVERGED
        state_out.best[view] = moved
    if not is_last or state_out.status[view] == CONVERGED:
        poses_out[view, column] = moved
        state_out.iterations[view] += 1


@wp.kernel
def write_results(
    # In:
    state: SolverState,
    # Out:
    matrices_out: wp.array3d[wp.float64],
    sides_out: wp.array2d[wp.float64],
    costs_out: wp.array[wp.float64],
    covariance_out: wp.array3d[wp.float64],
    inliers_out: wp.array[int],
    measured_out: wp.array[int],
    converged_out: wp.array[wp.uint8],
):
    """Write H, b, e and the counts of accepted poses, and the covariance, inf if H is singular."""
    view = wp.tid()
    matrix = read_matrix(state.sums, view)
    lower, is_definite = factorize(matrix)
    size = int(6)
    for i in range(size):
        unit = wp.spatial_vectord()
        unit[i] = ONE
        row = wp.spatial_vectord()
        if is_definite:
            row = solve_factorized(lower, unit)
        for k in range(size):
            matrices_out[view, i, k] = matrix[i, k]
            covariance_out[view, i, k] = wp.where(is_definite, row[k], wp.float64(wp.inf))
        sides_out[view, i] = state.sums[view, SIDE + i]
    costs_out[view] = state.sums[view, COST]
    inliers_out[view] = int(state.sums[view, INLIERS])
    measured_out[view] = int(state.sums[view, MEASURED])
    converged_out[view] = wp.where(state.status[view] == CONVERGED, wp.uint8(1), wp.uint8(0))
