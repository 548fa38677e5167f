# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 twins of `warpvis.kernels.gradients.silhouette_masks` and `coverage`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from reference_gradients import rotation_matrix

SLOPE_TOLERANCE, DEPTH_TOLERANCE = 1e-3, 1e-5


def mark_silhouettes(camera, row, images) -> NDArray[np.bool_]:
    """Return the mask of pixels next to silhouettes of a view, by comparing the image with shifted copies."""
    depth, normals = images["depth"].astype(np.float64), images["normals"] @ rotation_matrix(row[3:])
    rays = np.asarray(camera.rays)
    origins = np.zeros(rays.shape) if camera.origins is None else np.asarray(camera.origins)
    height, width = depth.shape
    mask = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore", divide="ignore"):
        points = origins + depth[..., None] * rays
        for dy, dx in ((0, 1), (1, -1), (1, 0), (1, 1)):
            a = np.s_[: height - dy, max(-dx, 0) : width - max(dx, 0)]
            b = np.s_[dy:, max(dx, 0) : width + min(dx, 0)]
            there = ((points[a] - origins[b]) * normals[a]).sum(axis=-1) / (rays[b] * normals[a]).sum(axis=-1)
            here = ((points[b] - origins[a]) * normals[b]).sum(axis=-1) / (rays[a] * normals[b]).sum(axis=-1)
            bound = (np.abs(there - depth[a]) + np.abs(here - depth[b])) * (1 + SLOPE_TOLERANCE)
            connected = np.abs(depth[b] - depth[a]) <= bound + DEPTH_TOLERANCE * depth[a]
            connected &= (there > 0) & (here > 0) & (images["segmentation"][a] == images["segmentation"][b])
            connected |= ~np.isfinite(depth[a]) & ~np.isfinite(depth[b])
            mask[a] |= ~connected
            mask[b] |= ~connected
    return mask


def seen_vertices(scene, row, object_rows, vertices=None) -> list[NDArray[np.float64]]:
    """Return the vertices of all objects in the camera frame.

    Args:
        scene: A scene of meshes.
        row: Pose of the camera.
        object_rows: Poses of the movable objects.
        vertices: Vertices of movable objects, by name, instead of those of the scene.
    """
    seen = []
    for index, item in enumerate(scene.objects):
        points = item.frame_vertices.astype(np.float64)
        if index in scene.movable:
            pose = object_rows[scene.movable.index(index)]
            points = (vertices or {}).get(item.name, points) @ rotation_matrix(pose[3:]).T + pose[:3]
        seen.append((points - row[:3]) @ rotation_matrix(row[3:]))
    return seen


def _mesh_edges(vertices, faces):
    """Return the edges of two triangles, and these triangles, of a closed mesh."""
    places = {}
    triangles = {}
    for face, corners in enumerate(faces):
        for k in range(3):
            ends = tuple(sorted(places.setdefault(tuple(vertices[c]), c) for c in (corners[k], corners[(k + 1) % 3])))
            triangles.setdefault(ends, []).append(face)
    assert all(len(found) == 2 for found in triangles.values())
    return np.array(list(triangles)), np.array(list(triangles.values()))


def _sides(points, edges, rays, origins):
    """Return g of the edges for a ray."""
    return ((origins - points) * np.cross(edges, rays)).sum(axis=-1)


class Crossings:
    """The silhouette edges between pairs of pixel centers, by trying all silhouette edges of convex meshes."""

    def __init__(self, camera, scene, images, targets, seen):
        """Find the edges; `targets` are indices of objects, `seen` is the result of `seen_vertices`."""
        self.rays, self.segmentation = np.asarray(camera.rays), images["segmentation"]
        self.origins = np.zeros(self.rays.shape) if camera.origins is None else np.asarray(camera.origins)
        self.meshes = []
        for item, points in zip(scene.objects, seen, strict=True):
            edges, sides = _mesh_edges(item.frame_vertices, item.faces)
            a, b, c = points[item.faces].swapaxes(0, 1)
            self.meshes.append((edges, np.cross(b - a, c - a)[sides]))
        inside = np.isin(self.segmentation, targets)
        self.count, self.found = inside.sum(), []
        height, width = inside.shape
        for dy, dx in ((0, 1), (1, 0)):
            for y, x in zip(*np.nonzero(inside[: height - dy, : width - dx] != inside[dy:, dx:]), strict=True):
                pixels = ((y, x), (y + dy, x + dx))
                target, other = pixels if inside[y, x] else pixels[::-1]
                options = [self._nearest(target, other, seen), self._nearest(other, target, seen)]
                options = [option for option in options if option is not None]
                if options:
                    self.found.append((target, other, *min(options)[1:]))

    def _nearest(self, start, end, seen):
        """Return depth, object and edge of the crossing of an edge of the object that `start` sees."""
        index = self.segmentation[start]
        if index < 0 or not np.isfinite(self.rays[end]).all():
            return None
        edges, normals = self.meshes[index]
        points, ends = seen[index][edges].swapaxes(0, 1)
        vectors = ends - points
        a = _sides(points, vectors, self.rays[start], self.origins[start])
        b = _sides(points, vectors, self.rays[end], self.origins[end])
        with np.errstate(divide="ignore", invalid="ignore"):
            alpha = a / (a - b)
            rays = self.rays[start] + alpha[:, None] * (self.rays[end] - self.rays[start])
            origins = self.origins[start] + alpha[:, None] * (self.origins[end] - self.origins[start])
            facing = (normals * rays[:, None]).sum(axis=-1)
            # The point of the edge next to the ray, from two equations for the parameters of both lines.
            across = np.cross(vectors, rays)
            weight = (np.cross(origins - points, rays) * across).sum(axis=-1) / (across**2).sum(axis=-1)
            depth = ((points + weight[:, None] * vectors - origins) * rays).sum(axis=-1) / (rays**2).sum(axis=-1)
            hits = (alpha >= 0) & (alpha <= 1) & (weight >= 0) & (weight <= 1) & (depth > 0)
            hits &= facing[:, 0] * facing[:, 1] < 0
        if not hits.any():
            return None
        assert hits.sum() == 1
        k = int(np.argmax(hits))
        y, x = start
        height, width = self.segmentation.shape
        if y == end[0]:
            side = (y + 1 if y + 1 < height else y - 1, x)
        else:
            side = (y, x + 1 if x + 1 < width else x - 1)
        along, sideways = (
            abs(b[k] - a[k]),
            abs(_sides(points[k], vectors[k], self.rays[side], self.origins[side]) - a[k]),
        )
        if along < sideways or (along == sideways and y != end[0]):
            return None
        return depth[k], index, *edges[k]

    def area(self, seen):
        """Return the area with the edges of these vertices."""
        total = float(self.count)
        for target, other, index, i, j in self.found:
            point, edge = seen[index][i], seen[index][j] - seen[index][i]
            a = _sides(point, edge, self.rays[target], self.origins[target])
            b = _sides(point, edge, self.rays[other], self.origins[other])
            total += a / (a - b) - 0.5
        return total

    def masks(self, seen, targets):
        """Return the share of each pixel with the edges of these vertices, and the pixels of the edges."""
        masks, pixels = np.isin(self.segmentation, targets).astype(np.float64), []
        for target, other, index, i, j in self.found:
            point, edge = seen[index][i], seen[index][j] - seen[index][i]
            a = _sides(point, edge, self.rays[target], self.origins[target])
            b = _sides(point, edge, self.rays[other], self.origins[other])
            pixels.append(other if a / (a - b) > 0.5 else target)
            masks[pixels[-1]] += a / (a - b) - 0.5
        return masks, pixels


def write_masks(camera, scene, images, targets, row, object_rows) -> NDArray[np.float64]:
    """Return the share of each pixel that objects cover in a view."""
    seen = seen_vertices(scene, row, object_rows)
    return Crossings(camera, scene, images, targets, seen).masks(seen, targets)[0]


def sum_coverage(camera, scene, images, targets, row, object_rows) -> float:
    """Return the area of objects in a view [px]."""
    seen = seen_vertices(scene, row, object_rows)
    return Crossings(camera, scene, images, targets, seen).area(seen)


def sum_area_strips(strips) -> NDArray[np.float64]:
    """Return the sum of the areas of strips, (V, strips), of each view."""
    return np.asarray(strips, dtype=np.float64).sum(axis=1)


def sum_coverage_gradients(camera, scene, images, targets, row, object_rows, name, step=1e-6):
    """Return gradients with respect to the poses of camera and objects and the vertices of an object, by differences.

    The edges between pixels are those before the change. The result has shape ``((1 + M) * 7 + n * 3,)``.
    """
    base = np.concatenate([row, np.ravel(object_rows), np.ravel(scene.objects[scene.index(name)].mesh_vertices)])
    base = base.astype(np.float64)
    split = 7 + np.size(object_rows)
    crossings = Crossings(camera, scene, images, targets, seen_vertices(scene, row, object_rows))
    result = []
    for k in range(len(base)):
        values = []
        for sign in (1, -1):
            changed = base + sign * step * (np.arange(len(base)) == k)
            objects, corners = changed[7:split].reshape(-1, 7), changed[split:].reshape(-1, 3)
            values.append(crossings.area(seen_vertices(scene, changed[:7], objects, {name: corners})))
        result.append((values[0] - values[1]) / (2 * step))
    return np.array(result)
