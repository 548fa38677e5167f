# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Run the command line: ``warpvis demo``, ``render``, ``batch``, ``verify``, ``warmup``, ``check`` and so on.

Nothing heavy is imported until a command runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import tyro

from warpvis.cli import _interrupts
from warpvis.cli._check import Check
from warpvis.cli._datasets import Batch, Render, Verify, Warmup
from warpvis.cli._inputs import MaybeSceneFile, SceneOptions, parse_labels, refuse_options, scene_options
from warpvis.cli._output import format_rows
from warpvis.cli._perspective import Perspective
from warpvis.errors import WarpvisError


@dataclass(frozen=True)
class Demo:
    """Run the paper's four experiments: two pictures each, two tables, and summary.json."""

    out: Path = Path("demo")
    """Folder for the pictures and summary.json."""
    device: str = "cpu"
    """Where to compute: cpu, cuda:0, ..."""

    def run(self) -> None:
        """Run the command."""
        from warpvis.cli.demo import run_demo

        run_demo(self.out, device=self.device)


@dataclass(frozen=True, kw_only=True)
class Info(SceneOptions):
    """Print versions, devices and cores; or what a scene's file holds."""

    file: MaybeSceneFile = None

    def run(self) -> None:
        """Run the command."""
        from warpvis.cli._webots import is_world, print_world

        if self.file is None:
            refuse_options(self, scene_options, "info of this machine takes")
            _print_versions()
        elif is_world(self.file):
            own = [name for name in scene_options if name not in ("search_path", "strict", "labels")]
            refuse_options(self, own, "info of a Webots world takes")
            labels = parse_labels(self.labels)
            print_world(self.file, search_path=self.search_path, strict=self.strict, labels=labels)
        else:
            self._print_objects(self.file)

    def _print_objects(self, file: Path) -> None:
        scene = self.load_scene(file)
        print(f"{file}: {scene.up} up, {len(scene)} objects, {scene.triangle_count} triangles")
        rows = []
        for item in scene:
            corners = [" ".join(f"{value:.4g}" for value in corner) for corner in item.bounds]
            rows.append([item.name, item.label.name.lower(), str(len(item.faces)), *corners])
        print(format_rows(["object", "label", "triangles", "least corner [m]", "greatest corner [m]"], rows))


def _print_versions() -> None:
    import platform
    from importlib.metadata import version

    import warp as wp

    import warpvis
    from warpvis.core.threads import core_count

    print(f"warpvis {warpvis.__version__}")
    print(f"python  {platform.python_version()} on {platform.platform()}")
    for package in ("warp-lang", "numpy", "trimesh", "mujoco"):
        print(f"{package} {version(package)}")
    print(f"cores   {core_count()}")
    for device in wp.get_devices():
        print(f"device  {device.alias}: {device.name}")


def main() -> None:
    """Run the command of the command line: bad input ends with one sentence and exit code 2, Ctrl-C with 130."""
    with _interrupts.ending_the_process():
        commands = Demo | Render | Batch | Verify | Warmup | Check | Perspective | Info
        command = tyro.cli(commands, prog="warpvis", description=_DESCRIPTION)
        try:
            _quiet_warp()
            with warnings.catch_warnings():
                warnings.simplefilter("default", UserWarning)
                warnings.showwarning = _show_warning
                command.run()
        except WarpvisError as error:
            print(f"warpvis: {error}", file=sys.stderr)
            sys.exit(2)
        except BrokenPipeError:
            sys.exit(1)


_DESCRIPTION = "What a camera at a pose sees: depth images and 3D visibility, on CPU or CUDA."


def _show_warning(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
    """Print a warning as one sentence, as errors are."""
    print(f"warning: {message}", file=sys.stderr)


def _quiet_warp() -> None:
    """Print no start-up banner and no line for every kernel module loaded."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
