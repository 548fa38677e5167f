# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: ``warpvis demo``, ``render``, ``batch``, ``verify``, ``warmup``, ``check`` and so on.

Heavy packages are imported only when a command runs, so that ``--help`` is fast.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

import warpvis
from warpvis.cli import _interrupts
from warpvis.cli._check import Check
from warpvis.cli._datasets import Batch, Verify, Warmup
from warpvis.cli._generate import Generate
from warpvis.cli._info import Info, SensorFit
from warpvis.cli._output import name_options, with_help
from warpvis.cli._perspective import Perspective, View
from warpvis.cli._render import Render
from warpvis.cli._watch import Watch
from warpvis.errors import WarpvisError


@with_help
@dataclass(frozen=True)
class Demo:
    """Run the four experiments of the paper: two pictures each (with viser, also a page), two tables, summary.json."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("demo")
    """Folder for the pictures and summary.json."""
    device: str = "cpu"
    """Device to compute on: cpu, cuda:0, ..."""

    def run(self) -> None:
        """Run the command."""
        from warpvis.cli.demo import run_demo

        run_demo(self.out, device=self.device)


def main() -> None:
    """Run the command line: invalid input ends with a message of one sentence and exit code 2, Ctrl-C with 130."""
    if sys.argv[1:] == ["--version"]:
        print(f"warpvis {warpvis.__version__}")
        return
    with _interrupts.exiting_on_interrupt(), _interrupts.exiting_on_closed_output():
        commands = (
            Demo | Render | Batch | Generate | Verify | Warmup | Check | Perspective | View | Watch | Info | SensorFit
        )
        run_command(tyro.cli(commands, prog="warpvis", description=_DESCRIPTION).run)


def run_command(run: Callable[[], None]) -> None:
    """Run a command: invalid input ends with a message of one sentence and exit code 2, Ctrl-C with 130."""
    command = getattr(run, "__self__", None)
    with _interrupts.exiting_on_interrupt(), _interrupts.exiting_on_closed_output():
        try:
            import warp as wp

            wp.config.log_level = wp.LOG_WARNING  # without a line for every kernel module
            with warnings.catch_warnings():
                warnings.simplefilter("default", UserWarning)
                warnings.showwarning = partial(_show_warning, command)
                run()
        except WarpvisError as error:
            print(f"warpvis: {name_options(str(error), command)}", file=sys.stderr)
            sys.exit(2)


_DESCRIPTION = """Depth images and 3D visibility from given camera poses, on CPU or CUDA.

warpvis COMMAND --help describes a command. Items of lists are separated by commas or spaces. warpvis --version prints
the version."""


def _show_warning(command: object, message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
    """Print a warning as one sentence, like errors."""
    print(f"warning: {name_options(str(message), command)}", file=sys.stderr)
