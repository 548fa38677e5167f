# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision reference of skies and haze: `warpvis.kernels.shading.sky`."""

import numpy as np
import reference_shading
from reference_shading import to_screen

from warpvis.core.poses import poses_to_matrices
from warpvis.scene.lights import cube_coordinates
from warpvis.scene.materials import Texture

# Unit vectors to the right edge and the lower edge of the images of a cube map (OpenGL 4.6, table 8.19).
RIGHT = np.array([(0, 0, -1), (0, 0, 1), (1, 0, 0), (1, 0, 0), (1, 0, 0), (-1, 0, 0)], dtype=float)
DOWN = np.array([(0, -1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (0, -1, 0)], dtype=float)


def levels_of(image):
    """Return the mip levels of an image, from 0 to 1; floats are stored in half precision."""
    if image.dtype == np.uint8:
        return [level[..., :3] / 255 for level in reference_shading.levels_of(image)]
    return [level.astype(np.float16).astype(np.float64) for level in reference_shading.levels_of(image)]


def panorama_texel(level, column, row):
    return level[min(max(row, 0), len(level) - 1), column % level.shape[1]]


def cube_texel(images, side, column, row):
    """Return a texel of a side of a cube, at most one texel beyond its edges, where the cube is folded open.

    Beyond a corner, it is the mean of the three texels that meet there.
    """
    size = len(images[side])
    beyond = [not 0 <= index < size for index in (column, row)]
    inner = min(max(column, 0), size - 1), min(max(row, 0), size - 1)
    if all(beyond):
        three = ((side, *inner), (side, column, inner[1]), (side, inner[0], row))
        return np.mean([cube_texel(images, *at) for at in three], axis=0)
    forward = np.cross(DOWN[side], RIGHT[side])
    across, below = ((2 * index + 1) / size - 1 for index in (column, row))
    if not any(beyond):
        return images[side][row, column]
    # Behind the edge, a step away from the side goes back along its normal.
    across, below = np.clip(across, -1, 1), np.clip(below, -1, 1)
    point = (1 - 1 / size) * forward + across * RIGHT[side] + below * DOWN[side]
    other, place = cube_coordinates(point)
    column, row = np.floor(place * size).astype(int)
    return images[other][row, column]


def bilinear(size, place, texel):
    """Return the color at a place of an image of a size, from its upper left (0, 0) to its lower right (1, 1)."""
    height, width = size
    x, y = place[0] * width - 0.5, place[1] * height - 0.5
    column, row = int(np.floor(x)), int(np.floor(y))
    total = 0.0
    for dy, share_y in ((0, 1 - (y - row)), (1, y - row)):
        for dx, share_x in ((0, 1 - (x - column)), (1, x - column)):
            total = total + share_x * share_y * texel(column + dx, row + dy)
    return total


def filtered(levels, place, texels, texel):
    """Return the color of a footprint; `texel` returns one of a level, by its column and row."""
    level = min(max(np.log2(max(texels, 1e-30)), 0.0), len(levels) - 1.0)
    finer = int(level)

    def sample(number):
        return bilinear(levels[number].shape[:2], place, lambda *at: texel(number, *at))

    color = sample(finer)
    if level > finer:
        color = color + (level - finer) * (sample(finer + 1) - color)
    return color


def sky_color(background, levels, direction, across, below):
    """Return the sRGB color, 0 to 1, in a direction of the world; `across` and `below` are those of adjacent pixels."""
    turn = np.array(background.world_to_cube)
    ray, across, below = turn @ direction, turn @ across, turn @ below
    is_linear = background.color_space == "linear"
    from_up = np.arctan2(np.hypot(ray[0], ray[1]), ray[2]) / np.pi
    if background.gradient:
        colors = np.array(background.gradient)
        at = np.linspace(0, 1, len(colors))
        color = np.array([np.interp(from_up, at, channel) for channel in colors.T])
    elif background.panorama is not None:
        place = 0.5 - np.arctan2(ray[1], ray[0]) / (2 * np.pi), from_up
        step = max(np.linalg.norm(across - ray), np.linalg.norm(below - ray)) / np.linalg.norm(ray)
        texels = step * len(levels[0]) / np.pi
        color = filtered(levels, place, texels, lambda number, *at: panorama_texel(levels[number], *at))
        is_texture = isinstance(background.panorama, Texture)
        is_linear = not is_texture or background.panorama.color_space == "linear"
    else:
        side, place = cube_coordinates(ray)
        forward = np.cross(DOWN[side], RIGHT[side])

        def on_side(way):
            return (np.array([RIGHT[side] @ way, DOWN[side] @ way]) / (forward @ way) + 1) / 2

        size = len(levels[int(side)][0])
        texels = size * max(np.linalg.norm(on_side(way) - place) for way in (across, below))

        def texel(number, *at):
            return cube_texel([images[number] for images in levels], int(side), *at)

        color = filtered(levels[int(side)], place, texels, texel)
        is_linear = background.sky[0].color_space == "linear"
    color = np.clip(color, 0, 1)
    return to_screen(color) if is_linear else color


def haze_at(haze, eye, direction):
    """Return the opacity of haze in a direction, and its distance along the ground, by intersecting its two cones."""
    normal = np.array(haze.normal)
    elevation = normal @ (eye - np.array(haze.position))
    up = normal @ direction
    across = np.linalg.norm(direction - up * normal)
    if elevation <= 0:
        return 0.0, np.inf
    # The cone's radius is radius * (1 - width * (1 - h)) at the height h * elevation above the ground.
    matrix = np.array([[across, -haze.radius * haze.width], [up, -elevation]])
    try:
        distance, h = np.linalg.solve(matrix, [haze.radius * (1 - haze.width), -elevation])
    except np.linalg.LinAlgError:
        return 0.0, np.inf
    if distance <= 0 or not 0 <= h <= 1:
        return 0.0, np.inf
    alpha = np.interp(h, [0, haze.peak, 1], [0, 1, 0])
    return alpha, distance * across


def paint_sky(background, pose, rays, steps, segmentation, points, color):
    """Return the colors of a view, 0 to 255, with the sky where nothing is visible, and with haze.

    Args:
        background: The background, with a sky.
        pose: The camera's pose, ``x y z qx qy qz qw``.
        rays: Rays of the camera frame, (H, W, 3); NaN where there is none.
        steps: Rays of the adjacent pixels across and below, (2, H, W, 3).
        segmentation: (H, W).
        points: Points of surfaces, (H, W, 3).
        color: Colors of surfaces, (H, W, 3).
    """
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float64)[None])[0]
    turn, eye = matrix[:3, :3], matrix[:3, 3]
    if background.sky:
        levels = [levels_of(face.image) for face in background.sky]
    elif background.panorama is not None:
        panorama = background.panorama
        levels = levels_of(panorama.image if isinstance(panorama, Texture) else panorama * background.exposure)
    else:
        levels = None
    expected = color.astype(np.float64).copy()
    for y, x in np.argwhere(np.isfinite(rays[..., 0])):
        direction = turn @ rays[y, x]
        is_surface, haze = segmentation[y, x] >= 0, background.haze
        distance = np.inf
        if is_surface and haze is not None:
            offset, normal = points[y, x] - eye, np.array(haze.normal)
            distance = np.linalg.norm(offset - (normal @ offset) * normal)
            is_surface = distance <= haze.radius and abs(normal @ offset) < haze.radius
        if not is_surface:
            shown = sky_color(background, levels, direction, *(turn @ step[y, x] for step in steps))
            distance = np.inf
        else:
            shown = expected[y, x] / 255
        alpha, reach = (0.0, np.inf) if haze is None else haze_at(haze, eye, direction)
        if alpha > 0 and distance >= reach:
            shown = shown + alpha * (np.array(haze.color) - shown)
        expected[y, x] = np.floor(np.clip(shown, 0, 1) * 255 + 0.5)
    return expected


paint_sky_rows = paint_sky  # on CPU cores
