# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of the TUM RGB-D datasets."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import Layout, numbers, rows_of, write_lines
from warpvis.cameras.lenses import lens_to_tum
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

_SCALE = 5000.0


class Tum(Layout):
    """Writes ``depth/000012/000000.png``, ``depth.txt``, ``groundtruth.txt`` and ``calibration.txt``.

    Depth is 16-bit PNG with 5000 units per meter, up to 13.1068 m, 0 without depth. ``depth.txt`` has lines
    ``timestamp filename``; ``groundtruth.txt`` has lines ``timestamp tx ty tz qx qy qz qw`` at the same timestamps,
    poses from camera to world with OpenCV axes.

    TUM's format has no file for the camera. Its tools assume pixel centers at integers (``cx = 319.5`` in the middle of
    640 columns). ``calibration.txt`` contains ``fx fy cx cy`` in one line in this convention, as in the datasets of
    ETH3D's SLAM benchmark, which have the same layout. For a lens, five coefficients of OpenCV follow,
    ``k1 k2 p1 p2 k3``, in the order of TUM's list of cameras.

    Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
    """

    name: ClassVar[str] = "tum"
    library: ClassVar[str | None] = "zlib"
    outputs: ClassVar[frozenset[str]] = frozenset({"depth"})
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self._numbers = lens_as(plan, self.name, lens_to_tum)
        times = plan.frames.timestamps
        late = np.flatnonzero(np.diff(times) <= 0)
        if len(late):
            frame = int(late[0]) + 1
            raise FileFormatError(
                f"timestamps must increase for format 'tum', got {times[frame]} s in frame {frame} after "
                f"{times[frame - 1]} s"
            )

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        return [self.write_depth_pngs(shard, "depth", images["depth"], _SCALE, files)]

    def index(self, files: ShardFiles) -> list[str]:
        """Write ``depth.txt``, ``groundtruth.txt`` and ``calibration.txt``."""
        frames = self.plan.frames
        names = self.frame_names(".png")
        depths = (f"{time!r} depth/{name}" for time, name in zip(self._times(), names, strict=True))
        write_lines(files, "depth.txt", chain(["# timestamp filename"], depths))
        rows: Iterator[list[float]] = rows_of(frames.camera_to_world, np.ndarray.tolist)
        poses = (f"{time!r} {numbers(row)}" for time, row in zip(self._times(), rows, strict=True))
        write_lines(files, "groundtruth.txt", chain(["# timestamp tx ty tz qx qy qz qw"], poses))
        has_distortion = any(self._numbers[4:])
        values = numbers(self._numbers if has_distortion else self._numbers[:4])
        parameters = "fx fy cx cy k1 k2 p1 p2 k3" if has_distortion else "fx fy cx cy"
        files.write_text("calibration.txt", f"{values}\n# {parameters} [px], pixel centers at whole numbers\n")
        return ["depth.txt", "groundtruth.txt", "calibration.txt"]

    def _times(self) -> Iterator[float]:
        return rows_of(self.plan.frames.timestamps, np.ndarray.tolist)
