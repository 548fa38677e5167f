# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of depth that ``warpvis render`` writes in addition to datasets."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpvis.core.checks import pluralize

if TYPE_CHECKING:
    from warpvis.batch import FrameDataset

PREVIEWS, SHEET = "preview", "contact_sheet.png"
"""Names of the folder and the file of pictures."""

_MAX_PREVIEWS, _MAX_ON_SHEET = 100, 24


def write_pictures(dataset: FrameDataset, out: Path) -> str:
    """Write a picture of the first hundred frames' depth, and a contact sheet of two dozen evenly spaced frames.

    All share one color scale, from the minimum to the maximum of the depth they show; if there is no depth, the
    camera's range.

    Returns:
        A text that lists the written files.
    """
    from warpvis.viz import save_contact_sheet, save_preview

    count = len(dataset)
    first = range(min(count, _MAX_PREVIEWS))
    spread = sorted({round(place) for place in np.linspace(0, count - 1, min(count, _MAX_ON_SHEET))})
    min_depth, max_depth = np.inf, -np.inf
    for index in {*first, *spread}:
        seen = dataset.read("depth", index)
        seen = seen[np.isfinite(seen)]
        if seen.size:
            min_depth, max_depth = min(min_depth, float(seen.min())), max(max_depth, float(seen.max()))
    near, far = dataset.camera.near, dataset.camera.far
    camera_range = (near, far if np.isfinite(far) else near + 1)
    depth_range = (min_depth, max_depth) if min_depth <= max_depth else camera_range
    (out / PREVIEWS).mkdir()
    for index in first:
        save_preview(dataset.read("depth", index), out / PREVIEWS / f"{index:06d}.png", depth_range)
    names = [f"{index:06d}" for index in spread]
    save_contact_sheet([dataset.read("depth", index) for index in spread], names, out / SHEET, depth_range)
    extent = "" if count == len(first) else f" of the first {pluralize(len(first), 'frame')}"
    return f"{out / PREVIEWS}{extent}, {out / SHEET}"
