# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of dense COLMAP workspaces, with a text model."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import Layout, Parts, numbers, rows_of, write_lines
from warpvis.cameras.lenses import lens_to_colmap
from warpvis.core.poses import poses_to_matrices

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

_CAMERA = 1


class Colmap(Layout):
    """Writes ``sparse/{cameras,images,points3D}.txt`` and ``stereo/depth_maps/000012/000000.png.geometric.bin``.

    The camera model is ``PINHOLE``, or the model of the lens, with pixel centers at +0.5. Images are numbered from 1
    and named ``000012/000000.png``; their poses are from world to camera with OpenCV axes. There are no keypoints and
    no 3D points. Depth maps are float32 [m], 0 without depth. Normal maps, in ``stereo/normal_maps``, are in the camera
    frame, 0 without a surface.

    COLMAP's ``stereo_fusion`` places pixels of depth maps at integer coordinates, half a pixel from the centers defined
    in its documentation and used here.

    Source: https://colmap.github.io/format.html
    """

    name: ClassVar[str] = "colmap"
    outputs: ClassVar[frozenset[str]] = frozenset({"depth", "normals"})
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self._model, self._parameters = lens_as(plan, self.name, lens_to_colmap)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        units = []
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
        """Write ``cameras.txt``, ``images.txt`` and ``points3D.txt``."""
        camera, count = self.plan.camera, len(self.plan.frames)
        files.write_text(
            "sparse/cameras.txt",
            "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
            f"{_CAMERA} {self._model} {camera.width} {camera.height} {numbers(self._parameters)}\n",
        )
        write_lines(files, "sparse/images.txt", self._image_lines(count))
        files.write_text("sparse/points3D.txt", "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] (none)\n")
        return ["sparse"]

    def _write_maps(self, shard: int, kind: str, count: int, make: Callable[[int], Parts], files: ShardFiles) -> str:
        return self.write_frames(
            shard, f"stereo/{kind}", ".png.geometric.bin", count, lambda frames: map(make, frames), files
        )

    def _image_lines(self, count: int) -> Iterator[str]:
        yield "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
        yield "# POINTS2D[] as (X, Y, POINT3D_ID)"
        yield f"# Number of images: {count}, mean observations per image: 0"
        poses = rows_of(self.plan.frames.camera_to_world, _world_to_camera)
        for image, (name, pose) in enumerate(zip(self.frame_names(".png"), poses, strict=True), start=1):
            yield f"{image} {numbers(pose)} {_CAMERA} {name}"
            yield ""


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
