# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Run the command line in this process."""

import sys

from warpvis.cli import main


def run_here(monkeypatch, capsys, folder, *arguments):
    """Return the exit code and output of a command that runs in this process."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["warpvis", *map(str, arguments)])
    code = 0
    try:
        main()
    except SystemExit as stop:
        code = stop.code
    printed = capsys.readouterr()
    return code, printed.out, printed.err
