# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Named scenes, used alike by the demo, the tests, the benchmarks and the pictures. Installed as ``warpvis.scenes``."""

from warpvis.scenes.benchmark import BENCHMARK_SCENES
from warpvis.scenes.experiments import EXPERIMENTS, Experiment
from warpvis.scenes.preset import ScenePreset

PRESETS: dict[str, ScenePreset] = {preset.name: preset for preset in (*EXPERIMENTS, *BENCHMARK_SCENES)}
"""Every preset by its name."""

__all__ = ["BENCHMARK_SCENES", "EXPERIMENTS", "PRESETS", "Experiment", "ScenePreset"]
