# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of dense COLMAP workspaces, with a text model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import COLOR_OPTIONS, SPARSE_POINTS, Layout, Parts, numbers, rows_of, write_lines
from warpvis.cameras.lenses import lens_to_colmap
from warpvis.core.poses import poses_to_matrices

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.formats._sparse_points import SparsePoints
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.scene import Scene

_CAMERA = 1

Observations: TypeAlias = dict[int, tuple[NDArray[np.int64], NDArray[np.float64]]]
"""Indices of the points that a frame shows, and their coordinates [px], by the number of the frame."""


class Colmap(Layout):
    """Writes ``images``, ``sparse/{cameras,images,points3D}.txt`` and depth and normal maps in ``stereo``.

    The camera model is ``PINHOLE``, or the model of the lens, with pixel centers at +0.5. Images are numbered from 1
    and named ``000012/000000.png``; their poses are from world to camera with OpenCV axes. With color, there are sparse
    3D points with the images that show them, and ``sparse/0`` has the same files as ``sparse``: COLMAP expects the
    model of a dense workspace in the latter, and tools for Gaussian splatting in the former.

    Depth maps, ``stereo/depth_maps/000012/000000.png.geometric.bin``, are float32 [m], 0 without depth. Normal maps, in
    ``stereo/normal_maps``, are in the camera frame, 0 without a surface.

    COLMAP's ``stereo_fusion`` places pixels of depth maps at integer coordinates, half a pixel from the centers defined
    in its documentation and used here.

    Source: https://colmap.github.io/format.html
    """

    name: ClassVar[str] = "colmap"
    outputs: ClassVar[frozenset[str]] = frozenset({"color", "depth", "normals"})
    default_outputs: ClassVar[tuple[str, ...]] = ("color", "depth")
    options: ClassVar[Mapping[str, str]] = {**COLOR_OPTIONS, **SPARSE_POINTS}

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self._sparse_points = self.parse_sparse_points()
        self._model, self._parameters = lens_as(plan, self.name, lens_to_colmap)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        units = []
        if "color" in self.plan.outputs:
            units.append(self.write_colors(shard, "images", images["color"], files))
        if "depth" in self.plan.outputs:
            depth = images["depth"]

            def make_depth(frame: int) -> Parts:
                return _map_parts(np.where(np.isfinite(depth[frame]), depth[frame], 0)[None])

            units.append(self._write_maps(shard, "depth_maps", len(depth), make_depth, files))
        if "normals" in self.plan.outputs:
            normals = images["normals"]
            frames = self.plan.frames[self.plan.shard_slice(shard)]
            rotations = poses_to_matrices(frames.camera_to_world)[:, :3, :3].astype(np.float32)

            def make_normals(frame: int) -> Parts:
                rotated = normals[frame] @ rotations[frame]  # row vectors: this is the inverse rotation
                return _map_parts(np.where(np.isnan(rotated), 0, rotated).transpose(2, 0, 1))

            units.append(self._write_maps(shard, "normal_maps", len(normals), make_normals, files))
        return units

    def index(self, files: ShardFiles) -> list[str]:
        """Write the model, unless it has points."""
        return [] if self._sparse_points else self._write_model(files, None, {})

    def write_models(self, files: ShardFiles, scene: Scene) -> list[str]:
        """Write the model with points of the scene."""
        if not self._sparse_points:
            return []
        from warpvis.batch.formats._sparse_points import observations, sample_points

        sparse = sample_points(scene, self.plan, self._sparse_points)
        observed = {frame: (points, pixels) for frame, points, pixels in observations(scene, self.plan, sparse)}
        return self._write_model(files, sparse, observed)

    def _write_model(self, files: ShardFiles, sparse: SparsePoints | None, observed: Observations) -> list[str]:
        """Write ``cameras.txt``, ``images.txt`` and ``points3D.txt``."""
        camera = self.plan.camera
        for folder in ("sparse", "sparse/0") if "color" in self.plan.outputs else ("sparse",):
            files.write_text(
                f"{folder}/cameras.txt",
                "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
                f"{_CAMERA} {self._model} {camera.width} {camera.height} {numbers(self._parameters)}\n",
            )
            write_lines(files, f"{folder}/images.txt", self._image_lines(observed))
            write_lines(files, f"{folder}/points3D.txt", _point_lines(sparse, observed))
        return ["sparse"]

    def _write_maps(self, shard: int, kind: str, count: int, make: Callable[[int], Parts], files: ShardFiles) -> str:
        suffix = f"{self.color_suffix}.geometric.bin"
        return self.write_frames(shard, f"stereo/{kind}", suffix, count, lambda frames: map(make, frames), files)

    def _image_lines(self, observed: Observations) -> Iterator[str]:
        count = len(self.plan.frames)
        mean = sum(len(points) for points, _ in observed.values()) / count
        yield "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
        yield "# POINTS2D[] as (X, Y, POINT3D_ID)"
        yield f"# Number of images: {count}, mean observations per image: {mean:g}"
        poses = rows_of(self.plan.frames.camera_to_world, _world_to_camera)
        for frame, (name, pose) in enumerate(zip(self.frame_names(self.color_suffix), poses, strict=True)):
            yield f"{frame + 1} {numbers(pose)} {_CAMERA} {name}"
            points, pixels = observed.get(frame, ((), ()))
            yield " ".join(f"{x:.4f} {y:.4f} {point + 1}" for point, (x, y) in zip(points, pixels, strict=True))


def _point_lines(sparse: SparsePoints | None, observed: Observations) -> Iterator[str]:
    """Yield the lines of ``points3D.txt``; points are numbered from 1."""
    count = 0 if sparse is None else len(sparse.points)
    tracks: list[list[str]] = [[] for _ in range(count)]
    for frame, (points, _) in observed.items():
        for place, point in enumerate(points.tolist()):
            tracks[point].append(f"{frame + 1} {place}")
    mean = sum(map(len, tracks)) / max(1, count)
    yield "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"
    yield f"# Number of points: {count}, mean track length: {mean:g}"
    if sparse is not None:
        for point, track in enumerate(tracks):
            position, (red, green, blue) = numbers(sparse.points[point].tolist()), sparse.colors[point].tolist()
            yield f"{point + 1} {position} {red} {green} {blue} 0 {' '.join(track)}"


def _world_to_camera(camera_to_world: NDArray[np.float64]) -> list[list[float]]:
    """Invert poses, as rows ``qw qx qy qz tx ty tz``."""
    rotations = poses_to_matrices(camera_to_world)[:, :3, :3]
    translations = -np.einsum("nji,nj->ni", rotations, camera_to_world[:, :3])
    x, y, z, w = camera_to_world[:, 3:].T
    return np.column_stack([w, -x, -y, -z, translations]).tolist()


def _map_parts(channels: NDArray[np.float32]) -> Parts:
    """Return the file of a depth or normal map with channels of shape ``(C, H, W)``."""
    count, height, width = channels.shape
    return f"{width}&{height}&{count}&".encode(), channels.astype("<f4", copy=False)
