# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the `packets` caster compiled for fewer instructions than this processor has, as for narrower lanes.

A process compiles its kernels for one target only, so every target is measured in separate processes, which take turns.
``targets.py TARGET SCENE...`` is one of them; it prints frames per second as JSON.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from collections.abc import Sequence

import numpy as np
import warp as wp

NATIVE = "native"

# Warp always adds AVX, for half floats: its generic x86-64 is not narrower than that.
FLAGS = {NATIVE: wp.config.cpu_compiler_flags, "AVX2": "-target-cpu haswell", "AVX": ""}
"""Warp's `cpu_compiler_flags` by target."""

_VIEWS = 32
_ROUNDS = 5
_TURNS = 3


def compare_targets(scenes: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return frames per second of all targets on the scenes, ``[target][scene]``: the median of three processes.

    Raises:
        RuntimeError: If the processor is of another kind, or a process failed.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise RuntimeError(f"the machine is {platform.machine()}, not x86-64")
    runs: dict[str, list[dict[str, float]]] = {target: [] for target in FLAGS}
    for round_ in range(_TURNS + 1):
        for target in FLAGS:
            found = _run(target, scenes)
            if round_ > 0:  # the first may have compiled, which leaves a processor hot
                runs[target].append(found)
    return {target: {s: float(np.median([run[s] for run in found])) for s in scenes} for target, found in runs.items()}


def _run(target: str, scenes: Sequence[str]) -> dict[str, float]:
    done = subprocess.run([sys.executable, __file__, target, *scenes], capture_output=True, text=True)
    if done.returncode != 0:
        reason = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
        raise RuntimeError(f"{target}: {reason}")
    return json.loads(done.stdout.splitlines()[-1])


def main(target: str, *scenes: str) -> int:
    """Measure one target in this process."""
    wp.config.log_level = wp.LOG_WARNING
    wp.config.cpu_compiler_flags = FLAGS[target]  # before importing warpvis, which may compile
    from timing import take_turns

    import warpvis as wv

    calls = []
    for name in scenes:
        preset = wv.scenes.PRESETS[name]
        renderer = wv.Renderer(preset.build(), preset.camera, outputs=("depth",), caster="packets")
        poses = preset.poses(_VIEWS)
        views = renderer.render(poses)
        calls.append(lambda renderer=renderer, poses=poses, views=views: renderer.render(poses, out=views))
    times = take_turns(calls, _ROUNDS)
    print(json.dumps({name: _VIEWS / float(np.median(found)) for name, found in zip(scenes, times, strict=True)}))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
