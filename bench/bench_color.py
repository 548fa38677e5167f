# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure color images of `warpvis.mujoco.Renderer` against those of `mujoco.Renderer` on CPU cores.

    MUJOCO_GL=egl python bench/bench_color.py [NAME ...] [--sizes 84x84 320x240] [--rounds 15] [--threads N]

Models are aloha_pot of mujoco_warp, Humanoid and Ant of Gymnasium, Fetch and the kitchen of gymnasium_robotics, and
robosuite's Lift, as far as they are installed. A call is `update_scene` and `render` of the default free camera,
without multisampling: as a user gets it, with shadows, reflections, haze and the sky, and plain, without these. Prints
a Markdown table with medians of calls in turns [ms], their ratios, and the mean difference of the pictures, of 255.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp
from machine import describe
from mujoco_colors import robosuite_task
from timing import take_turns

from warpvis.mujoco import Renderer

_FILES = {
    "aloha_pot": ("mujoco_warp", "test_data/aloha_pot/scene.xml"),
    "Humanoid": ("gymnasium", "envs/mujoco/assets/humanoid.xml"),
    "Ant": ("gymnasium", "envs/mujoco/assets/ant.xml"),
    "Fetch": ("gymnasium_robotics", "envs/assets/fetch/pick_and_place.xml"),
    "kitchen": ("gymnasium_robotics", "envs/assets/kitchen_franka/kitchen_assets/kitchen_env_model.xml"),
}
_EXTRAS = "SHADOW", "REFLECTION", "HAZE", "SKYBOX"


def models() -> Iterator[tuple[str, Callable[[], mujoco.MjModel]]]:
    """Yield the name of each installed model, and a function that loads it."""
    for name, (package, path) in _FILES.items():
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.origin is not None:
            yield name, partial(mujoco.MjModel.from_xml_path, str(Path(spec.origin).parent / path))
    if importlib.util.find_spec("robosuite") is not None:
        yield "Lift", lambda: robosuite_task("Lift")[0]


def compare(model: mujoco.MjModel, size: tuple[int, int], rounds: int, threads: int | None) -> list[str]:
    """Return the cells of a row: for default and plain pictures, times [ms], their ratio and the difference."""
    data, cells = mujoco.MjData(model), []
    mujoco.mj_forward(model, data)
    width, height = size
    model.vis.quality.offsamples = 0
    model.vis.global_.offwidth, model.vis.global_.offheight = max(width, 640), max(height, 480)
    for is_plain in (False, True):
        with mujoco.Renderer(model, height, width) as peer, Renderer(model, height, width, threads=threads) as ours:

            def call(renderer: Any) -> np.ndarray:
                renderer.update_scene(data)
                return np.asarray(renderer.render())

            for renderer in (peer, ours):
                renderer.update_scene(data)
                for name in _EXTRAS if is_plain else ():
                    renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name}")] = 0
            pictures = [call(renderer).astype(np.int64) for renderer in (peer, ours)]
            times = take_turns([partial(call, peer), partial(call, ours)], rounds)
        theirs, own = (1e3 * float(np.median(found)) for found in times)
        cells += [
            f"{theirs:.2f}",
            f"{own:.2f}",
            f"{theirs / own:.2f}",
            f"{np.abs(pictures[0] - pictures[1]).mean():.2f}",
        ]
    return cells


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--sizes", nargs="+", default=["84x84", "320x240"])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--threads", type=int)
    arguments = parser.parse_args()
    wp.config.quiet = True
    print(describe(("mujoco", "warp-lang")))
    columns = "mujoco.Renderer | warpvis | ratio | difference"
    print(f"\n| model | size | {columns} | plain: {columns} |")
    print("|---|---|" + "---:|" * 8)
    for name, load in models():
        if arguments.names and name not in arguments.names:
            continue
        try:
            model = load()
        except Exception as error:  # third-party models may not compile with the installed MuJoCo
            print(f"| {name} | not loaded: {type(error).__name__} {error} |")
            continue
        for size in arguments.sizes:
            width, height = map(int, size.split("x"))
            row = compare(model, (width, height), arguments.rounds, arguments.threads)
            print(f"| {name} | {size} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
