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

# Output: names of its properties, their type in PLY and in NumPy, and the value of pixels without a surface.
_PROPERTIES: dict[str, tuple[tuple[str, ...], str, str, float]] = {
    "points": (("x", "y", "z"), "float", "<f4", np.nan),
    "normals": (("nx", "ny", "nz"), "float", "<f4", np.nan),
    "color": (("red", "green", "blue"), "uchar", "u1", 0),
    "labels": (("label",), "uchar", "u1", 0),
    "segmentation": (("object",), "int", "<i4", -1),
}


class Ply(Layout):
    """Writes ``clouds/000012/000000.ply`` and ``clouds.json``.

    A cloud is a binary little-endian file with the points of one frame in the world frame [m], in the order of image
    rows: ``x y z`` as float, and, if they are among the outputs, ``nx ny nz`` as float, ``red green blue`` as uchar,
    ``label`` as uchar (a `Label`) and ``object`` as int (index into the objects of the scene). ``clouds.json`` contains
    names of labels and objects.

    Options:
        organized: ``true`` for one point per pixel, NaN without a surface; the header then has the size of the image,
            ``obj_info num_cols`` and ``num_rows``, as expected by PCL.
    """

    name: ClassVar[str] = "ply"
    outputs: ClassVar[frozenset[str]] = frozenset(_PROPERTIES)
    default_outputs: ClassVar[tuple[str, ...]] = ("points",)
    options: ClassVar[Mapping[str, str]] = {"organized": "true or false"}

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self._organized = self.flag_option("organized")
        if "points" not in plan.outputs:
            raise FileFormatError(f"outputs must include points for format 'ply', got {', '.join(plan.outputs)}")
        self._outputs = [output for output in _PROPERTIES if output in plan.outputs]
        columns = [(output, _PROPERTIES[output]) for output in self._outputs]
        self._dtype = np.dtype([(output, kind, (len(names),)) for output, (names, _, kind, _) in columns])
        self._header = "".join(f"property {kind} {name}\n" for _, (names, kind, _, _) in columns for name in names)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:

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
        valid = np.flatnonzero(seen)
        cloud = np.empty(seen.size if self._organized else len(valid), dtype=self._dtype)
        for output in self._outputs:
            pixels = images[output].reshape(seen.size, -1)
            if self._organized:
                cloud[output] = pixels
                cloud[output][~seen] = _PROPERTIES[output][3]
            else:
                cloud[output] = pixels.take(valid, axis=0)
        size = f"obj_info num_cols {width}\nobj_info num_rows {height}\n" if self._organized else ""
        header = f"ply\nformat binary_little_endian 1.0\n{size}element vertex {len(cloud)}\n{self._header}end_header\n"
        return header.encode(), cloud
