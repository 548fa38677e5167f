# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Named scenes for demo, tests, benchmarks and pictures. The package is installed as ``warpvis.scenes``."""

from warpvis.scenes.benchmark import BENCHMARK_SCENES
from warpvis.scenes.crowd import CROWDS
from warpvis.scenes.experiments import EXPERIMENTS, Experiment
from warpvis.scenes.preset import ScenePreset
from warpvis.scenes.terrain import TERRAINS

PRESETS: dict[str, ScenePreset] = {
    preset.name: preset for preset in (*EXPERIMENTS, *BENCHMARK_SCENES, *TERRAINS, *CROWDS)
}
"""All presets by name."""

__all__ = ["BENCHMARK_SCENES", "CROWDS", "EXPERIMENTS", "PRESETS", "TERRAINS", "Experiment", "ScenePreset"]
