# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of nerfstudio datasets."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import Layout, rows_of, write_lines
from warpvis.cameras.lenses import lens_to_nerfstudio
from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import Json

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

# Right factor that converts camera-to-world matrices from OpenCV axes to OpenGL axes (x right, y up, z backward).
_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])

# Rotation from a world with y up to nerfstudio's world with z up: (x, y, z) to (x, -z, y).
_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4")


class Nerfstudio(Layout):
    """Writes ``transforms.json``, ``depth/000012/000000.png`` and ``labels/000012/000000.png``.

    The conventions are nerfstudio's defaults: pixel centers are at +0.5, lenses have its models ``OPENCV`` or
    ``OPENCV_FISHEYE``, ``transform_matrix`` is from camera to world with OpenGL axes, and depth is 16-bit PNG in
    millimeters, 0 without depth.

    Its world has z up. A scene with y up is rotated, ``(x, y, z)`` to ``(x, -z, y)``, and the rotation is stored in
    ``applied_transform``, nerfstudio's field for the transform from the original world to the saved one.
    ``orientation_override`` prevents its loader from rotating the world again to align the mean camera.

    ``file_path`` of a frame is its label image, an 8-bit image as nerfstudio requires, because there is no color image.
    Without labels it is the depth image, which nerfstudio cannot use for training.

    Source: https://docs.nerf.studio/quickstart/data_conventions.html, and its ``nerfstudio_dataparser.py`` for the two
    fields of the world.
    """

    name: ClassVar[str] = "nerfstudio"
    library: ClassVar[str | None] = "zlib"
    outputs: ClassVar[frozenset[str]] = frozenset({"depth", "labels"})
    default_outputs: ClassVar[tuple[str, ...]] = ("depth", "labels")

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self._camera = lens_as(plan, self.name, lens_to_nerfstudio)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        units = []
        if "depth" in self.plan.outputs:
            units.append(self.write_depth_pngs(shard, "depth", images["depth"], 1000.0, files))
        if "labels" in self.plan.outputs:
            units.append(self.write_byte_pngs(shard, "labels", images["labels"], files))
        return units

    def index(self, files: ShardFiles) -> list[str]:
        """Write ``transforms.json``."""
        write_lines(files, "transforms.json", self._lines())
        return ["transforms.json"]

    def _lines(self) -> Iterator[str]:
        camera, poses = self.plan.camera, self.plan.frames.camera_to_world
        head: dict[str, Json] = {
            **{name: value for name, value in self._camera.items() if name not in _COEFFICIENTS},
            "w": camera.width,
            "h": camera.height,
            **{name: value for name, value in self._camera.items() if name in _COEFFICIENTS},
            "orientation_override": "none",
        }
        if self.plan.up == "y":
            head["applied_transform"] = _Z_UP[:3].tolist()
        yield "{"
        for key, value in head.items():
            yield f"  {json.dumps(key)}: {json.dumps(value)},"
        yield '  "frames": ['
        frames = zip(self.frame_names(".png"), rows_of(poses, self._to_nerfstudio), strict=True)
        for number, (name, matrix) in enumerate(frames, start=1):
            yield f"    {json.dumps(self._frame(name, matrix))}{',' if number < len(poses) else ''}"
        yield "  ]"
        yield "}"

    def _to_nerfstudio(self, poses: NDArray[np.float64]) -> list[list[list[float]]]:
        matrices = poses_to_matrices(poses) @ _OPENGL
        return (_Z_UP @ matrices if self.plan.up == "y" else matrices).tolist()

    def _frame(self, name: str, matrix: list[list[float]]) -> dict[str, Json]:
        folder = "labels" if "labels" in self.plan.outputs else "depth"
        depth = {"depth_file_path": f"depth/{name}"} if "depth" in self.plan.outputs else {}
        return {"file_path": f"{folder}/{name}", **depth, "transform_matrix": matrix}
