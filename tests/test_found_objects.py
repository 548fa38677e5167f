# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects found in images before packets are cast, and sorted into tiles."""

import numpy as np
import trimesh
import warp as wp

import warpvis as wv
from warpvis.kernels.casting.packets_cuda import FoundObjects, sort_into_tiles
from warpvis.rendering.casters.found_objects_cuda import find_objects
from warpvis.scene.worlds import parse_worlds

import reference
from support.worlds import random_poses


def test_objects_are_sorted_into_tiles():
    rng, (views, count, tiles_y, tiles_x) = np.random.default_rng(0), (3, 50, 4, 5)
    counts = np.array([[50, 0], [0, 7], [31, 2]], dtype=np.int32)
    first = rng.integers(0, [[tiles_x - 1, tiles_y - 1]], (views, count, 2)) * 32 + rng.integers(
        0, 32, (views, count, 2)
    )
    entries = np.zeros((views, count, 4), dtype=np.int32)
    entries[..., 1:3] = first | (first + rng.integers(0, 33, (views, count, 2))) << 16
    lists = reference.sort_into_tiles(entries[..., 1:3], counts[:, 0], tiles_y, tiles_x)
    found = FoundObjects()
    found.tiles_y, found.tiles_x = tiles_y, tiles_x
    found.entries = wp.array(entries, dtype=wp.vec4i, device="cpu")
    found.counts = wp.array(counts, dtype=wp.int32, device="cpu")
    found.tile_counts = wp.array([len(tile) for tile in lists], dtype=wp.int32, device="cpu")
    found.tile_ends = wp.array(np.cumsum([len(tile) for tile in lists]), dtype=wp.int32, device="cpu")
    found.order = wp.full(4 * views * count, -1, dtype=wp.int32, device="cpu")
    wp.launch(sort_into_tiles, dim=(views, count), outputs=[found], device="cpu")
    order, ends = found.order.numpy(), found.tile_ends.numpy()
    for tile, end, start in zip(lists, ends, [0, *ends], strict=False):
        assert sorted(order[start:end]) == tile
    assert (order[ends[-1] :] == -1).all() and (found.tile_counts.numpy() == 0).all()


def test_found_objects_have_tight_image_bounds(cuda):
    """No visible object is missed, and bounds of objects in front of the camera are tight."""
    rng, count, views = np.random.default_rng(0), 600, 3
    scene, camera = wv.Scene(device=cuda), wv.Camera.from_fov(133, 77, hfov=1.2, near=0.05, far=15.0)
    box = trimesh.creation.box((0.2, 0.3, 0.4))
    places = random_poses(rng, count, spread=8.0).astype(np.float32)
    scene.add_instances(box, places, movable=True)
    poses = random_poses(rng, views, spread=2.0).astype(np.float32)
    worlds = parse_worlds(scene, views, None, None, None)
    where = wp.array(poses, dtype=wp.transform, device=cuda)
    found = find_objects(scene.bvh().struct, camera, False, where, worlds, wp.get_device(cuda))
    boxes = np.tile(np.r_[box.bounds[0], box.bounds[1]], (count, 1))
    last = np.array([camera.width, camera.height]) - 1
    for view, (entries, (few, many)) in enumerate(zip(found.entries.numpy(), found.counts.numpy(), strict=True)):
        entries = np.concatenate([entries[:few], entries[count - many :]])
        where_in = {int(m): (c & 0xFFFF, c >> 16, r & 0xFFFF, r >> 16) for _, c, r, m in entries}
        assert len(where_in) == few + many
        rects, in_front = reference.find_objects_cuda(boxes, places, camera, poses[view])
        pixels = np.stack(
            [np.ceil(rects[:, 0]), np.floor(rects[:, 1]), np.ceil(rects[:, 2]), np.floor(rects[:, 3])], -1
        )
        least, most = np.maximum(pixels[:, ::2], 0), np.minimum(pixels[:, 1::2], last)
        near = np.linalg.norm(places[:, :3] - poses[view, :3], axis=1)
        seen = in_front & (least <= most).all(axis=1) & (near < camera.far - 1)
        assert seen.sum() > 5
        for m in np.flatnonzero(seen):
            x0, x1, y0, y1 = where_in[m]
            assert x0 <= least[m, 0] and x1 >= most[m, 0] and y0 <= least[m, 1] and y1 >= most[m, 1]
        for m, rect in where_in.items():
            if in_front[m] and near[m] > 1.0:
                assert rect[0] >= least[m, 0] - 2 and rect[1] <= most[m, 0] + 2
                assert rect[2] >= least[m, 1] - 2 and rect[3] <= most[m, 1] + 2
