# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of packets of rays on a GPU, each rotated toward its rays and scaled to their spacing.

Computed in double precision, once per ray table. Rays that are neighbors in rows and columns each pass near the center
of one pixel (`fit_grid`); other rays have arbitrary positions in the image (`fit_points`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.kernels.constants import CUDA_LANES

POINTS_SIDE = 32
"""Pixels of an image of points, along each axis."""

# Minimum cosine of the angle between a ray and its image's axis.
_MIN_COSINE = 0.3
_MARGIN = 1e-3  # of bounds [px]
# Maximum aspect ratio of pixels; beyond it, rays are collinear in the image, and pixels are square. The focal length is
# used for single rays [px].
_MAX_ASPECT = 1e5
_PLAIN_FOCAL = 256.0
# Maximum aspect ratio of pixels in images of points: slopes lose digits in stretched images.
_MAX_POINTS_ASPECT = 16.0
# Number of rotations tried for an image of points, to find the one with the smallest bounds.
_NUM_ROTATIONS = 8
# Maximum distance of a point from the center of its pixel, with a margin for rounding [px].
_POINT_SPREAD = 0.501


@dataclass(frozen=True)
class PacketImages:
    """Images of packets: arrays with a row per packet."""

    place: NDArray[np.int64]
    """Index of each slot's ray in the table, -1 for none, shape (packets, slots)."""
    occupied: NDArray[np.bool_]
    """Whether a slot has a ray, shape (packets, slots). Slots without one refer to a pixel without a ray, or to -1."""
    forward: NDArray[np.float64]
    """Component of rays of depth 1 along the image's axis, shape (packets, slots); 1 without a ray."""
    positions: NDArray[np.float64]
    """Positions of rays in the image, from the principal point [px], shape (packets, slots, 2)."""
    first: NDArray[np.float64]
    """Position of the center of each image's first pixel [px], shape (packets, 2)."""
    axis_spread: NDArray[np.float64]
    """Maximum distances of rays from pixel centers along each axis [px], shape (packets, 2); infinite if a ray is too
    far off the axis."""
    matrix: NDArray[np.float64]
    """Transformations from the table's camera frame to the images, shape (packets, 3, 3)."""

    @property
    def rounded(self) -> NDArray[np.float32]:
        """Positions of rays in single precision."""
        return self.positions.astype(np.float32)

    @property
    def spread(self) -> NDArray[np.float64]:
        """Maximum distance along either axis, shape (packets)."""
        return self.axis_spread.max(axis=-1)

    def frames(self, side: int) -> NDArray[np.float64]:
        """Return the words of a ``TableFrame`` (``native/cuda/table.h``) in each row, for images of a side [px]."""
        from warpvis.kernels.casting.packets_cuda import FRAME_WORDS

        rows = [
            self.matrix.reshape(-1, 9),
            np.linalg.inv(self.matrix).transpose(0, 2, 1).reshape(-1, 9),
            self.first,
            self.axis_spread,
            np.linalg.norm(self.matrix[:, :2], axis=-1),
            np.where(self.occupied, self.forward, 0.0).max(axis=1)[:, None],
            np.full((len(self.place), 1), side),
        ]
        table = np.concatenate(rows, axis=1)
        assert table.shape[1] == FRAME_WORDS
        return table

    def block_bounds(self) -> NDArray[np.float32]:
        """Return bounds of the rays of each block: left, right, top and bottom [px]; left > right for empty blocks."""
        rounded, occupied = self.rounded.reshape(len(self.place), -1, CUDA_LANES, 2), self.occupied[..., None]
        occupied = occupied.reshape(*rounded.shape[:3], 1)
        low = np.where(occupied, rounded, np.float32(np.inf)).min(axis=2)
        high = np.where(occupied, rounded, np.float32(-np.inf)).max(axis=2)
        return np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]], axis=-1)


def fit_grid(place: NDArray[np.int64], rays: NDArray[np.float64], side: int) -> PacketImages:
    """Rotate, scale and shear images so that rays, zeros for none, pass near the centers of their slots' pixels.

    Args:
        place: Index of each pixel's ray, row by row, -1 for none, shape (packets, side * side).
        rays: Rays of the camera frame at depth 1, shape (N, 3).
        side: Number of pixels of an image along each axis.
    """
    packet_rays, pixels = _rays_of(place, rays), _grid(side)
    directions = mean_directions(packet_rays)
    # Most packets fit best in an image that faces their rays; rays that were sorted by their position in the image of a
    # pinhole along an axis fit best in that image.
    bases = np.stack([_basis(directions), _basis(_nearest_axes(directions))])
    fits = [_fit(packet_rays, basis, pixels) for basis in bases]
    best = np.argmin([fit.axis_spread.max(axis=-1) for fit in fits], axis=0)
    index = np.arange(len(place))
    basis, mirrored = bases[best, index], np.array([np.linalg.det(fit.linear) < 0 for fit in fits])[best, index]
    # Mirror the packet back: in a mirrored image, triangles would be seen from behind.
    place = np.where(mirrored[:, None], place.reshape(-1, side, side)[..., ::-1].reshape(place.shape), place)
    fit = _fit(_rays_of(place, rays), basis, pixels)
    positions = np.where(fit.occupied[..., None], fit.positions @ fit.linear.transpose(0, 2, 1), fit.centers)
    matrix = basis.copy()
    matrix[:, :2] = fit.linear @ basis[:, :2]
    return PacketImages(place, fit.occupied, fit.forward, positions, fit.first, fit.axis_spread + _MARGIN, matrix)


def fit_points(place: NDArray[np.int64], rays: NDArray[np.float64]) -> PacketImages:
    """Rotate and scale images so that rays, zeros for none, just fill them; the arguments are those of `fit_grid`."""
    packet_rays = _rays_of(place, rays)
    occupied, basis = (packet_rays != 0).any(axis=-1), _basis(mean_directions(packet_rays))
    flat = np.einsum("prk,pik->pir", basis, packet_rays)
    forward = np.where(occupied, flat[..., 2], 1.0)
    positions = flat[..., :2] / forward[..., None]
    rotation, low, size = _tightest_rotation(positions, occupied)
    size = np.maximum(size, size.max(axis=1, keepdims=True) / _MAX_POINTS_ASPECT)
    usable = POINTS_SIDE - 1 - 2 * _MARGIN
    with np.errstate(divide="ignore"):
        scale = np.where(size > usable / _PLAIN_FOCAL / _MAX_ASPECT, usable / size, _PLAIN_FOCAL)
    linear = scale[..., None] * rotation
    matrix = basis.copy()
    matrix[:, :2] = linear @ basis[:, :2]
    first = low * scale - _MARGIN
    image_positions = np.where(occupied[..., None], positions @ linear.transpose(0, 2, 1), first[:, None] + _MARGIN)
    spread = np.full((len(place), 2), _POINT_SPREAD)
    return PacketImages(place, occupied, forward, image_positions, first, spread, matrix)


def _tightest_rotation(positions: NDArray, occupied: NDArray[np.bool_]) -> tuple[NDArray, NDArray, NDArray]:
    """Find rotations that minimize the bounds of images.

    Returns:
        The rotations, shape (packets, 2, 2), and the first corner and the size of the bounds, shape (packets, 2) each.
    """
    count = len(positions)
    rotations, corner, size = np.tile(np.eye(2), (count, 1, 1)), np.zeros((count, 2)), np.full((count, 2), np.inf)
    for angle in np.arange(_NUM_ROTATIONS) * (np.pi / 2 / _NUM_ROTATIONS):
        rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        rotated = positions @ rotation.T
        low = np.where(occupied[..., None], rotated, np.inf).min(axis=1)
        high = np.where(occupied[..., None], rotated, -np.inf).max(axis=1)
        better = (high - low).prod(axis=1) < size.prod(axis=1)
        rotations[better], corner[better], size[better] = rotation, low[better], (high - low)[better]
    empty = ~occupied.any(axis=1)
    corner[empty], size[empty] = 0.0, 0.0
    return rotations, corner, size


def middle_cosines(images: PacketImages, rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the minimum cosine of the angle between a packet's rays and its image's axis, shape (packets)."""
    length = np.linalg.norm(_rays_of(images.place, rays), axis=-1)
    return np.where(images.occupied, images.forward / np.where(images.occupied, length, 1.0), 1.0).min(axis=1)


def _grid(side: int) -> NDArray[np.float64]:
    """Return the column and row of each pixel of a packet, row by row."""
    y, x = np.divmod(np.arange(side * side), side)
    return np.stack([x, y], axis=-1).astype(np.float64)


def mean_directions(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean directions of packets as unit vectors, ignoring zeros."""
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    total = (rays / np.where(length > 0, length, 1)).sum(axis=1)
    size = np.linalg.norm(total, axis=-1, keepdims=True)
    return np.where(size > 0, total / np.where(size > 0, size, 1), [0.0, 0.0, 1.0])


def _basis(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes right, down and forward of cameras that face given directions, shape (packets, 3, 3)."""
    right = np.cross(directions, np.where(np.abs(directions[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(directions, right), directions], axis=1)


def _rays_of(place: NDArray[np.int64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rays of each packet's pixels, shape (packets, pixels, 3); zeros without a ray."""
    return np.where((place >= 0)[..., None], rays[place], 0.0)


def _nearest_axes(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positive or negative camera axis nearest to each direction."""
    axis = np.abs(directions).argmax(axis=-1)[:, None]
    sign = np.sign(np.take_along_axis(directions, axis, axis=-1))
    nearest = np.zeros_like(directions)
    np.put_along_axis(nearest, axis, sign, axis=-1)
    return nearest


@dataclass(frozen=True)
class _Fit:
    """Images in which rays pass near the centers of pixels."""

    occupied: NDArray[np.bool_]
    """Whether a pixel has a ray, shape (packets, pixels)."""
    forward: NDArray[np.float64]
    """Component of rays of depth 1 along the image's axis, shape (packets, pixels); 1 without a ray."""
    positions: NDArray[np.float64]
    """Positions of rays at focal length 1, shape (packets, pixels, 2)."""
    linear: NDArray[np.float64]
    """Matrices from these positions to positions in the packets' images, shape (packets, 2, 2)."""
    first: NDArray[np.float64]
    """Position of the center of each packet's first pixel, shape (packets, 2)."""
    centers: NDArray[np.float64]
    """Positions of the centers of all pixels, shape (packets, pixels, 2)."""
    axis_spread: NDArray[np.float64]
    """Maximum distances of rays from pixel centers, shape (packets, 2); infinite if a ray is too far off the axis."""


def _fit(rays: NDArray, basis: NDArray, pixels: NDArray) -> _Fit:
    """Fit images to rays: columns and rows are linear functions of the positions of rays, by least squares."""
    occupied = (rays != 0).any(axis=-1)
    flat = np.einsum("prk,pik->pir", basis, rays)
    off_axis = (occupied & (flat[..., 2] < _MIN_COSINE * np.linalg.norm(rays, axis=-1))).any(axis=1)
    forward = np.where(occupied & ~off_axis[:, None], flat[..., 2], 1.0)
    positions = flat[..., :2] / forward[..., None]
    count = np.maximum(occupied.sum(axis=1), 1)[:, None]
    mean = (positions * occupied[..., None]).sum(axis=1) / count
    grid = pixels * occupied[..., None]
    grid_mean = grid.sum(axis=1) / count
    offsets = (positions - mean[:, None]) * occupied[..., None]
    normal = np.einsum("pia,pib->pab", offsets, offsets)
    target = np.einsum("pia,pib->pab", offsets, grid - grid_mean[:, None])
    linear = np.linalg.pinv(normal, rcond=1e-12, hermitian=True) @ target
    # The fit is underdetermined for too few or collinear rays: choose the scale along the free directions.
    left_vectors, size, right_vectors = np.linalg.svd(linear.transpose(0, 2, 1))
    size[size[:, 0] < 1e-6] = _PLAIN_FOCAL
    narrow = size[:, 1] < size[:, 0] / _MAX_ASPECT
    size[narrow, 1] = size[narrow, 0]
    left_vectors[narrow, :, 1] *= np.sign(np.linalg.det(left_vectors @ right_vectors))[narrow, None]
    linear = (left_vectors * size[:, None]) @ right_vectors
    first = np.einsum("pab,pb->pa", linear, mean) - grid_mean
    centers = first[:, None] + pixels
    error = np.abs(positions @ linear.transpose(0, 2, 1) - centers) * occupied[..., None]
    axis_spread = np.where(off_axis[:, None], np.inf, error.max(axis=1, initial=0))
    return _Fit(occupied, forward, positions, linear, first, centers, axis_spread)
