# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The table of all outputs of a renderer. This module has no expensive imports, because the command line lists them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from warpvis.core.plugins import OUTPUT_MODULES, load_plugin

Output = Literal[
    "depth", "points", "normals", "labels", "segmentation", "faces", "color", "albedo", "reasons", "true_depth"
]
"""Names of images of a renderer; attributes of `warpvis.Views`, whose documentation describes them."""

Stage = Literal["cast", "compute", "measure"]
"""The stage of rendering that writes an image: a caster, a function of other images, or a sensor."""


@dataclass(frozen=True)
class OutputSpec:
    """An image that a renderer can write."""

    name: str
    """Its name in `outputs`, in `warpvis.Views` and in datasets."""
    dtype: Literal["float32", "int32", "uint8"]
    """NumPy dtype of a component."""
    stage: Stage = "cast"
    """The stage that writes it."""
    components: str = ""
    """Names of the components of a vector, one letter each; empty for a single number."""
    empty: float = 0
    """Value of pixels without a surface."""
    needs: tuple[str, ...] = ()
    """Images that it is computed from."""


OUTPUTS: dict[str, OutputSpec] = {
    spec.name: spec
    for spec in (
        OutputSpec("depth", "float32", empty=math.inf),
        OutputSpec("points", "float32", components="xyz", empty=math.nan),
        OutputSpec("normals", "float32", components="xyz", empty=math.nan),
        OutputSpec("labels", "uint8"),
        OutputSpec("segmentation", "int32", empty=-1),
        OutputSpec("faces", "int32", empty=-1),
        OutputSpec("color", "uint8", "compute", "rgb", needs=("points", "segmentation", "faces", "normals")),
        OutputSpec("albedo", "uint8", "compute", "rgb", needs=("points", "segmentation", "faces")),
        OutputSpec("reasons", "uint8", "measure", empty=1),
        OutputSpec("true_depth", "float32", "measure", empty=math.inf),
    )
}
"""All outputs, by name."""


def find_output(name: object) -> OutputSpec | None:
    """Return the output of a name, or None; import the installed module that registers it if it is unknown."""
    if isinstance(name, str) and name not in OUTPUTS:
        load_plugin(OUTPUT_MODULES, name)
    return OUTPUTS.get(name) if isinstance(name, str) else None


CAST = tuple(spec.name for spec in OUTPUTS.values() if spec.stage == "cast")
"""Images that casters write."""

SENSOR_NAMES = tuple(spec.name for spec in OUTPUTS.values() if spec.stage == "measure")
"""Images that require a depth-camera model."""

IMAGE_NAMES = tuple(name for name in get_args(Output) if name not in SENSOR_NAMES)
"""Images that do not require one."""

VISIBILITY = "visibility"
"""Output of datasets that is not an image: the results of `warpvis.object_visibility`."""
