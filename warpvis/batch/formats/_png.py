# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images as PNG files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from warpvis.batch.formats._base import Images
from warpvis.batch.formats._layouts import COLOR_OPTIONS, Layout, Parts
from warpvis.cameras import as_pinhole
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io import encode_pngs
from warpvis.sensors import Reason

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

_MAX_OBJECTS = 65_535


class Png(Layout):
    """Writes files such as ``depth/000012/000000.png`` for images, ``camera.json``, ``images.json``.

    - Depth: 16 bits, in units of 1 / `scale` m, rounded; 0 for missing depth, and for depth that does not fit. It is
      planar, or along the ray for a lens with ``kind="range"``.
    - With a sensor, ``true_depth`` in the same units, and ``reasons`` with 8 bits.
    - Labels: 8 bits.
    - Objects: 16 bits, 0 for none, else the index of the object in the scene + 1.
    - ``color`` and ``albedo``: sRGB, 8 bits per channel; with the option `color`, files of another kind.

    ``camera.json`` is a camera file for the command line, with the lens; ``images.json`` defines the values of images.

    Options:
        scale: Units per meter, 1000 (millimeters) by default: depth up to 65.534 m, because some readers treat 65535
            as missing depth.
    """

    name: ClassVar[str] = "png"
    library: str | None = "zlib"
    outputs: ClassVar[frozenset[str]] = frozenset(
        {"depth", "labels", "segmentation", "color", "albedo", "reasons", "true_depth"}
    )
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)
    options: ClassVar[Mapping[str, str]] = {"scale": "units per meter, 1000", **COLOR_OPTIONS}

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self._scale = self.positive_option("scale", 1000.0)
        if "segmentation" in plan.outputs and len(plan.object_names) > _MAX_OBJECTS:
            count = len(plan.object_names)
            raise FileFormatError(
                f"format 'png' supports at most {_MAX_OBJECTS} objects, got {count}. Use format 'npz'."
            )

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        units = []
        for name in ("depth", "true_depth"):
            if name in self.plan.outputs:
                units.append(self.write_depth_pngs(shard, name, images[name], self._scale, files))
        for name in ("labels", "reasons"):
            if name in self.plan.outputs:
                units.append(self.write_byte_pngs(shard, name, images[name], files))
        for name in ("color", "albedo"):
            if name in self.plan.outputs:
                units.append(self.write_colors(shard, name, images[name], files))
        if "segmentation" in self.plan.outputs:
            objects = images["segmentation"]

            def make(frames: range) -> Iterable[Parts]:
                return zip(encode_pngs((objects[frames.start : frames.stop] + 1).astype(np.uint16)))

            units.append(self.write_frames(shard, "segmentation", ".png", len(objects), make, files))
        return units

    def index(self, files: ShardFiles) -> list[str]:
        """Write ``camera.json`` and ``images.json``."""
        camera, fields = as_pinhole(self.plan.camera), self.plan.camera.to_dict()
        if camera is not None:
            fields = {"width": camera.width, "height": camera.height, "K": camera.to_K().tolist(), "near": camera.near}
            if math.isfinite(camera.far):
                fields["far"] = camera.far
        files.write_text("camera.json", json.dumps(fields, indent=2) + "\n")
        files.write_text("images.json", json.dumps(self._meaning(), indent=2) + "\n")
        return ["camera.json", "images.json"]

    def _meaning(self) -> dict[str, Json]:
        depth: dict[str, Json] = {
            "kind": "planar" if self.plan.camera.kind == "z" else "range",
            "units_per_meter": self._scale,
            "no_depth": 0,
        }
        meaning: dict[str, Json] = {
            "depth": depth,
            "true_depth": depth,
            "reasons": {"values": {str(reason.value): reason.name for reason in Reason}},
            "labels": {"values": self.label_entries()},
            "color": {"color_space": "sRGB"},
            "albedo": {"color_space": "sRGB"},
            "segmentation": {"none": 0, "first": 1, "objects": self.object_entries()},
        }
        return {
            "frames": len(self.plan.frames),
            "frames_per_folder": self.plan.shard_frames,
            **{name: meaning[name] for name in meaning if name in self.plan.outputs},
        }
