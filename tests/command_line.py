# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`warpvis` commands, run in this process or in a subprocess."""

import contextlib
import io
import subprocess
import sys
from unittest import mock

from warpvis.cli import main


def run_inside(*arguments, cwd):
    """Run a command in this process and return its output and exit code.

    An exception that would end a subprocess with a traceback is raised here.
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
    """Run a command in a subprocess."""
    command = [sys.executable, "-m", "warpvis", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True)
