# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Commands of `warpvis` in this process, which has imported everything, or in one of their own."""

import contextlib
import io
import subprocess
import sys
from unittest import mock

from warpvis.cli import main


def run_inside(*arguments, cwd):
    """Run a command in this process: what a process of its own would have printed, and its exit code.

    An exception that would have ended that one with a traceback is raised here.
    """
    command = ["warpvis", *map(str, arguments)]
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with (
        contextlib.chdir(cwd),
        mock.patch.object(sys, "argv", command),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return subprocess.CompletedProcess(command, code, out.getvalue(), err.getvalue())


def run_apart(*arguments, cwd):
    """Run a command in a process of its own."""
    command = [sys.executable, "-m", "warpvis", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True)
