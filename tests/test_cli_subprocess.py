# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Commands that end early: in a subprocess, which Ray may end, or because their output is closed."""

import os
import subprocess
import sys
from functools import partial

import pytest

import warpvis as wv
from warpvis.cli import Batch, run_command
from warpvis.cli._interrupts import run_in_subprocess


@pytest.mark.slow
def test_ended_process_raises_one_sentence(capsys):
    with pytest.raises(wv.WarpvisError, match=r"^the node was lost \(exit code 1\)$"):
        run_in_subprocess(partial(os._exit, 1), "the node was lost")
    with pytest.raises(SystemExit) as end:
        run_command(partial(run_in_subprocess, partial(os._exit, 0), "the node was lost"))
    assert end.value.code == 2
    assert capsys.readouterr().err == "warpvis: the node was lost (exit code 0)\n"


@pytest.mark.slow
def test_exit_codes_are_forwarded(tmp_path):
    with pytest.raises(SystemExit) as end:
        run_in_subprocess(partial(sys.exit, 3), "the node was lost")
    assert end.value.code == 3
    with pytest.raises(SystemExit) as end:  # invalid input, reported by the subprocess
        Batch(file=tmp_path / "nowhere.glb", poses="nowhere.txt", out=str(tmp_path / "out"), engine="ray").run()
    assert end.value.code == 2
    run_in_subprocess(partial(print, "well"), "the node was lost")


@pytest.mark.parametrize("command", [["--help"], ["info"]])
def test_closed_output_ends_a_command_quietly(command):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        program = [sys.executable, "-m", "warpvis", *command]
        result = subprocess.run(program, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=300)
    finally:
        os.close(writer)
    assert result.returncode == 1
    assert "BrokenPipe" not in result.stderr and "Traceback" not in result.stderr
