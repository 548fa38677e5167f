# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Draw the chart of docs/figures.md from the tables of that page: ``python bench/speed_chart.py``."""

from __future__ import annotations

import re
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

DOCS = Path(__file__).parent.parent / "docs"

# Rows of the tables, and their names in the chart. Prefixes of rows are enough.
_CPU_ROWS = {
    "**warpvis** `packets`, depth |": "warpvis",
    "Mitsuba": "Mitsuba, Embree",
    "`mujoco.Renderer`": "mujoco.Renderer",
    "Open3D": "Open3D, Embree",
    "embreex": "embreex, 1 thread",
}
_GPU_ROWS = {
    "**warpvis**, depth |": "warpvis",
    "`wp.mesh_query_ray`": "wp.mesh_query_ray",
    "Newton `SensorCamera` |": "Newton",
    "mujoco-warp `render`": "MuJoCo Warp",
}
_OURS, _OTHERS = "#0b6e99", "#9aa7b1"


def read_rows(mark: str, rows: dict[str, str]) -> dict[str, float]:
    """Return frames per second in the first column of a generated table, by the names of the chart."""
    text = (DOCS / "figures.md").read_text(encoding="utf-8")
    table = text.partition(f"<!-- {mark}:begin -->")[2].partition(f"<!-- {mark}:end -->")[0]
    found = {}
    for prefix, name in rows.items():
        line = next(line for line in table.splitlines() if line.startswith(f"| {prefix}"))
        match = re.match(r"[\d,.]+", line.split("|")[2].strip())
        assert match is not None, line
        found[name] = float(match[0].replace(",", ""))
    return found


def draw_bars(axes: Axes, title: str, values: dict[str, float]) -> None:
    """Draw one bar per library, the fastest at the top."""
    names = sorted(values, key=lambda name: values[name])
    bars = axes.barh(
        names, [values[name] for name in names], color=[_OURS if n == "warpvis" else _OTHERS for n in names]
    )
    axes.bar_label(bars, [f"{values[name]:,.0f}" for name in names], padding=4)
    axes.set_title(title, fontsize=11, loc="left")
    axes.set_xlim(0, max(values.values()) * 1.2)
    axes.set_xticks([])
    axes.spines[["top", "right", "bottom"]].set_visible(False)


def main() -> None:
    """Write docs/pictures/speed.png."""
    figure = Figure(figsize=(10, 2.9), dpi=130, layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_bars(left, "2 CPU cores", read_rows("bench", _CPU_ROWS))
    draw_bars(right, "One NVIDIA H200", read_rows("gpu", _GPU_ROWS))
    figure.suptitle("Depth images per second: 320x240 pixels, a room of 5,000 triangles", fontsize=12)
    figure.savefig(DOCS / "pictures" / "speed.png")


if __name__ == "__main__":
    main()
