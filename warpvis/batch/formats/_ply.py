# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point clouds as PLY files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from warpvis.batch.formats._base import Images
from warpvis.batch.formats._layouts import Layout, Parts
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

# Of every output: its properties, their type in PLY's words and NumPy's, and what a pixel has that sees nothing.
_PROPERTIES: dict[str, tuple[tuple[str, ...], str, str, float]] = {
    "points": (("x", "y", "z"), "float", "<f4", np.nan),
    "normals": (("nx", "ny", "nz"), "float", "<f4", np.nan),
    "labels": (("label",), "uchar", "u1", 0),
    "segmentation": (("object",), "int", "<i4", -1),
}


class Ply(Layout):
    """Writes ``clouds/000012/000000.ply`` and ``clouds.json``.

    A cloud is binary, little-endian, and holds the points that one frame sees in the world frame [m], row by row of the
    image: ``x y z`` as float, and if they are among the outputs, ``nx ny nz`` as float, ``label`` as uchar (a `Label`)
    and ``object`` as int (an index into the scene's objects). ``clouds.json`` names labels and objects.

    Options:
        organised: ``true`` for one point a pixel, NaN where nothing is seen; the image's size is in the header's
            ``obj_info num_cols`` and ``num_rows``, where PCL looks for it.
    """

    name: ClassVar[str] = "ply"
    outputs: ClassVar[frozenset[str]] = frozenset(_PROPERTIES)
    default_outputs: ClassVar[tuple[str, ...]] = ("points",)
    options: ClassVar[Mapping[str, str]] = {"organised": "true or false"}

    def __init__(self, plan: Plan) -> None:
        """Check the plan.

        Raises:
            FileFormatError: An output or an option is not this format's, or points are not among the outputs.
        """
        super().__init__(plan)
        self._organised = self.flag_option("organised")
        if "points" not in plan.outputs:
            raise FileFormatError(f"format 'ply' needs points among its outputs, got {', '.join(plan.outputs)}")
        self._outputs = [output for output in _PROPERTIES if output in plan.outputs]
        columns = [(output, _PROPERTIES[output]) for output in self._outputs]
        self._dtype = np.dtype([(output, kind, (len(names),)) for output, (names, _, kind, _) in columns])
        self._header = "".join(f"property {kind} {name}\n" for _, (names, kind, _, _) in columns for name in names)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        """Write one shard; see `warpvis.batch.formats._base.Format`."""

        def make(frame: int) -> Parts:
            return self._cloud({output: images[output][frame] for output in self._outputs})

        count = len(images["points"])
        return [self.write_frames(shard, "clouds", ".ply", count, lambda frames: map(make, frames), files)]

    def index(self, files: ShardFiles) -> list[str]:
        """Write ``clouds.json``."""
        meaning = {"up": self.plan.up, "label": self.label_entries(), "object": self.object_entries()}
        files.write_text("clouds.json", json.dumps(meaning, indent=2) + "\n")
        return ["clouds.json"]

    def _cloud(self, images: Images) -> Parts:
        height, width = images["points"].shape[:2]
        seen = np.isfinite(images["points"].reshape(-1, 3)[:, 0])
        kept = np.flatnonzero(seen)
        cloud = np.empty(seen.size if self._organised else len(kept), dtype=self._dtype)
        for output in self._outputs:
            pixels = images[output].reshape(seen.size, -1)
            if self._organised:
                cloud[output] = pixels
                cloud[output][~seen] = _PROPERTIES[output][3]
            else:
                cloud[output] = pixels.take(kept, axis=0)
        size = f"obj_info num_cols {width}\nobj_info num_rows {height}\n" if self._organised else ""
        header = f"ply\nformat binary_little_endian 1.0\n{size}element vertex {len(cloud)}\n{self._header}end_header\n"
        return header.encode(), cloud
