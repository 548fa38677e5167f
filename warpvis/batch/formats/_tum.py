# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of the TUM RGB-D datasets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import COLOR_OPTIONS, Layout, numbers, rows_of, write_lines
from warpvis.cameras.lenses import lens_to_tum
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

_SCALE = 5000.0


class Tum(Layout):
    """Writes ``rgb/000012/000000.png``, ``depth/000012/000000.png``, lists of them, and the trajectory.

    Depth is 16-bit PNG with 5000 units per meter, up to 13.1068 m, 0 without depth. ``rgb.txt`` and ``depth.txt`` have
    lines ``timestamp filename``; ``groundtruth.txt`` has lines ``timestamp tx ty tz qx qy qz qw`` at the same
    timestamps, poses from camera to world with OpenCV axes. ``associations.txt`` has the lines of ``rgb.txt`` and
    ``depth.txt`` side by side, as made by TUM's ``associate.py rgb.txt depth.txt`` and read by ORB-SLAM.

    TUM's format has no file for the camera. Its tools assume pixel centers at integers (``cx = 319.5`` in the middle of
    640 columns). ``calibration.txt`` contains ``fx fy cx cy`` in one line in this convention, as in the datasets of
    ETH3D's SLAM benchmark, which have the same layout. For a lens, five coefficients of OpenCV follow,
    ``k1 k2 p1 p2 k3``, in the order of TUM's list of cameras.

    Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
    """

    name: ClassVar[str] = "tum"
    library: str | None = "zlib"
    outputs: ClassVar[frozenset[str]] = frozenset({"color", "depth"})
    default_outputs: ClassVar[tuple[str, ...]] = ("color", "depth")
    options: ClassVar[Mapping[str, str]] = COLOR_OPTIONS

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
        units = []
        if "color" in self.plan.outputs:
            units.append(self.write_colors(shard, "rgb", images["color"], files))
        if "depth" in self.plan.outputs:
            units.append(self.write_depth_pngs(shard, "depth", images["depth"], _SCALE, files))
        return units

    def index(self, files: ShardFiles) -> list[str]:
        """Write the lists, ``groundtruth.txt`` and ``calibration.txt``."""
        frames, units = self.plan.frames, ["groundtruth.txt", "calibration.txt"]
        lists = {name: folder for name, folder in (("color", "rgb"), ("depth", "depth")) if name in self.plan.outputs}
        for name, folder in lists.items():
            write_lines(files, f"{folder}.txt", chain(["# timestamp filename"], self._list(name, folder)))
            units.append(f"{folder}.txt")
        if len(lists) == 2:
            pairs = zip(*(self._list(name, folder) for name, folder in lists.items()), strict=True)
            write_lines(files, "associations.txt", map(" ".join, pairs))
            units.append("associations.txt")
        rows: Iterator[list[float]] = rows_of(frames.camera_to_world, np.ndarray.tolist)
        poses = (f"{time!r} {numbers(row)}" for time, row in zip(self._times(), rows, strict=True))
        write_lines(files, "groundtruth.txt", chain(["# timestamp tx ty tz qx qy qz qw"], poses))
        has_distortion = any(self._numbers[4:])
        values = numbers(self._numbers if has_distortion else self._numbers[:4])
        parameters = "fx fy cx cy k1 k2 p1 p2 k3" if has_distortion else "fx fy cx cy"
        files.write_text("calibration.txt", f"{values}\n# {parameters} [px], pixel centers at whole numbers\n")
        return units

    def _list(self, output: str, folder: str) -> Iterator[str]:
        """Yield lines ``timestamp filename``."""
        names = self.frame_names(self.color_suffix if output == "color" else ".png")
        return (f"{time!r} {folder}/{name}" for time, name in zip(self._times(), names, strict=True))

    def _times(self) -> Iterator[float]:
        return rows_of(self.plan.frames.timestamps, np.ndarray.tolist)
