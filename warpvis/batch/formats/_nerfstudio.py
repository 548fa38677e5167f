# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of nerfstudio datasets."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import COLOR_OPTIONS, SPARSE_POINTS, Layout, rows_of, write_lines
from warpvis.cameras.lenses import lens_to_nerfstudio
from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import Json
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.scene import Scene

# Right factor that converts camera-to-world matrices from OpenCV axes to OpenGL axes (x right, y up, z backward).
_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])

# Rotation from a world with y up to nerfstudio's world with z up: (x, y, z) to (x, -z, y).
_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


_POINTS = "sparse_pc.ply"
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4")


class Nerfstudio(Layout):
    """Writes ``transforms.json``, ``images/000012/000000.png``, and ``depth`` and ``labels`` in the same way.

    The conventions are nerfstudio's defaults: pixel centers are at +0.5, lenses have its models ``OPENCV`` or
    ``OPENCV_FISHEYE``, ``transform_matrix`` is from camera to world with OpenGL axes, and depth is 16-bit PNG in
    millimeters, 0 without depth.

    Its world has z up. A scene with y up is rotated, ``(x, y, z)`` to ``(x, -z, y)``, and the rotation is stored in
    ``applied_transform``, nerfstudio's field for the transform from the original world to the saved one.
    ``orientation_override`` prevents its loader from rotating the world again to align the mean camera.

    ``file_path`` of a frame is its color image, ``depth_file_path`` its depth image. Nerfstudio has no field for
    labels. ``sparse_pc.ply`` has points of the scene's surfaces in the saved world, from which splatfacto starts.

    Source: https://docs.nerf.studio/quickstart/data_conventions.html, and its ``nerfstudio_dataparser.py`` for the two
    fields of the world.
    """

    name: ClassVar[str] = "nerfstudio"
    library: str | None = "zlib"
    outputs: ClassVar[frozenset[str]] = frozenset({"color", "depth", "labels"})
    default_outputs: ClassVar[tuple[str, ...]] = ("color", "depth")
    options: ClassVar[Mapping[str, str]] = {**COLOR_OPTIONS, **SPARSE_POINTS}

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        if "color" not in plan.outputs:
            raise FileFormatError(
                f"outputs must include color for format 'nerfstudio', which trains on color images, got "
                f"{', '.join(plan.outputs)}. Use format 'png' for images without color."
            )
        self._sparse_points = self.parse_sparse_points()
        self._camera = lens_as(plan, self.name, lens_to_nerfstudio)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        units = [self.write_colors(shard, "images", images["color"], files)]
        if "depth" in self.plan.outputs:
            units.append(self.write_depth_pngs(shard, "depth", images["depth"], 1000.0, files))
        if "labels" in self.plan.outputs:
            units.append(self.write_byte_pngs(shard, "labels", images["labels"], files))
        return units

    def index(self, files: ShardFiles) -> list[str]:
        """Write ``transforms.json``."""
        write_lines(files, "transforms.json", self._lines())
        return ["transforms.json"]

    def write_models(self, files: ShardFiles, scene: Scene) -> list[str]:
        """Write ``sparse_pc.ply``."""
        if not self._sparse_points:
            return []
        from warpvis.batch.formats._sparse_points import sample_points

        sparse = sample_points(scene, self.plan, self._sparse_points)
        vertices = np.empty(len(sparse.points), dtype=[("position", "<f4", 3), ("color", "u1", 3)])
        vertices["position"] = sparse.points @ _Z_UP[:3, :3].T if self.plan.up == "y" else sparse.points
        vertices["color"] = sparse.colors
        properties = [f"property float {axis}\n" for axis in "xyz"]
        properties += [f"property uchar {channel}\n" for channel in ("red", "green", "blue")]
        header = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{''.join(properties)}end_header\n"
        )
        files.write(_POINTS, header.encode(), vertices)
        return [_POINTS]

    def _lines(self) -> Iterator[str]:
        camera, poses = self.plan.camera, self.plan.frames.camera_to_world
        head: dict[str, Json] = {
            **{name: value for name, value in self._camera.items() if name not in _COEFFICIENTS},
            "w": camera.width,
            "h": camera.height,
            **{name: value for name, value in self._camera.items() if name in _COEFFICIENTS},
            "orientation_override": "none",
        }
        if self._sparse_points:
            head["ply_file_path"] = _POINTS
        if self.plan.up == "y":
            head["applied_transform"] = _Z_UP[:3].tolist()
        yield "{"
        for key, value in head.items():
            yield f"  {json.dumps(key)}: {json.dumps(value)},"
        yield '  "frames": ['
        frames = zip(self.frame_names(""), rows_of(poses, self._to_nerfstudio), strict=True)
        for number, (name, matrix) in enumerate(frames, start=1):
            yield f"    {json.dumps(self._frame(name, matrix))}{',' if number < len(poses) else ''}"
        yield "  ]"
        yield "}"

    def _to_nerfstudio(self, poses: NDArray[np.float64]) -> list[list[list[float]]]:
        matrices = poses_to_matrices(poses) @ _OPENGL
        return (_Z_UP @ matrices if self.plan.up == "y" else matrices).tolist()

    def _frame(self, name: str, matrix: list[list[float]]) -> dict[str, Json]:
        """Return the entry of a frame; `name` is the name of its files without suffix."""
        depth = {"depth_file_path": f"depth/{name}.png"} if "depth" in self.plan.outputs else {}
        return {"file_path": f"images/{name}{self.color_suffix}", **depth, "transform_matrix": matrix}
