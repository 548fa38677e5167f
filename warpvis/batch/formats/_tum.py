# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of TUM's RGB-D datasets."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import Layout, numbers, rows_of, write_lines
from warpvis.errors import FileFormatError
from warpvis.sensors.lenses import lens_to_tum

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

_SCALE = 5000.0


class Tum(Layout):
    """Writes ``depth/000012/000000.png``, ``depth.txt``, ``groundtruth.txt`` and ``calibration.txt``.

    Depth is 16-bit PNG of 5000 units a metre, to 13.1068 m, 0 where there is none. ``depth.txt`` has lines
    ``timestamp filename``, ``groundtruth.txt`` lines ``timestamp tx ty tz qx qy qz qw``, camera to world with OpenCV
    axes, at the same timestamps.

    TUM's format has no file for the camera. Its tools take pixel centres at whole numbers (``cx = 319.5`` in the middle
    of 640 columns); ``calibration.txt`` holds ``fx fy cx cy`` in one line in that convention, as in the datasets of
    ETH3D's SLAM benchmark, whose layout this is too. Of a lens five coefficients of OpenCV follow, ``k1 k2 p1 p2 k3``,
    in the order of TUM's own list of its cameras.

    Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
    """

    name: ClassVar[str] = "tum"
    library: ClassVar[str | None] = "zlib"
    outputs: ClassVar[frozenset[str]] = frozenset({"depth"})
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)

    def __init__(self, plan: Plan) -> None:
        """Check the plan.

        Raises:
            FileFormatError: An output, an option or a lens is not this format's, or timestamps do not increase, by
                which TUM's tools tell frames apart.
        """
        super().__init__(plan)
        self._numbers = lens_as(plan, self.name, lens_to_tum)
        times = plan.frames.timestamps
        late = np.flatnonzero(np.diff(times) <= 0)
        if len(late):
            frame = int(late[0]) + 1
            raise FileFormatError(
                "format 'tum' tells frames apart by timestamps, which must increase: "
                f"frame {frame} has {times[frame]} s, the one before {times[frame - 1]} s"
            )

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        """Write one shard; see `warpvis.batch.formats._base.Format`."""
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
        bent = any(self._numbers[4:])
        said = numbers(self._numbers if bent else self._numbers[:4])
        kinds = "fx fy cx cy k1 k2 p1 p2 k3" if bent else "fx fy cx cy"
        files.write_text("calibration.txt", f"{said}\n# {kinds} [px], pixel centres at whole numbers\n")
        return ["depth.txt", "groundtruth.txt", "calibration.txt"]

    def _times(self) -> Iterator[float]:
        return rows_of(self.plan.frames.timestamps, np.ndarray.tolist)
