# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`fuzz_files` detects crashes, hangs, memory use, unexpected exceptions and writes elsewhere."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fuzz_mutations import mutate

FUZZ = Path(__file__).with_name("fuzz_files.py")

BAD_SEEDS = """
import os, time
from pathlib import Path
from fuzz_seeds import Seed
from warpvis.errors import FileFormatError

ACTIONS = {
    "a crash": os.abort,
    "a hang": lambda: time.sleep(100),
    "a name of no place": lambda: Path("left.txt").write_text("x"),
    "an exception": lambda: {}["name"],
    "lines": lambda: refuse("one\\ntwo"),
    "memory": lambda: bytearray(3 << 30),
    "nothing said": lambda: refuse(""),
    "one sentence": lambda: refuse("a.txt: is damaged"),
    "read": lambda: None,
    "removed": lambda: os.remove("/no/such/folder/x"),
    "the network": lambda: __import__("socket").create_connection(("127.0.0.1", 9), timeout=0.1),
}
begun = []

def refuse(text):
    raise FileFormatError(text)

def read(action):
    if action in begun:  # as it is, each file is read once
        ACTIONS[action]()
    begun.append(action)

def make_seeds(root):
    (root / "in").mkdir()
    (root / "in" / "a.txt").write_text("0 1 2\\n")
    return [Seed(name, root / "in", ("a.txt",), lambda folder, name=name: read(name)) for name in ACTIONS]
"""


def run(*options, **environment):
    """Return the output and exit status of ``make fuzz-files``."""
    import os

    command = [sys.executable, str(FUZZ), *options]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, check=False)
    assert not done.stderr, done.stderr
    return done.stdout, done.returncode


@pytest.mark.slow
def test_failures_are_found_and_named(tmp_path):
    (tmp_path / "bad_seeds.py").write_text(BAD_SEEDS)
    options = ("--seeds", "bad_seeds", "--count", "11", "--seconds", "2", "--gigabytes", "2")
    said, status = run(*options, PYTHONPATH=str(tmp_path))
    found = dict(re.findall(r"^\d+: ([^,]+), [^:]*: (.*)", said, re.MULTILINE))
    for name, wanted in {
        "a crash": "ends the process with status -6",
        "a hang": "takes longer than 2 s",
        "a name of no place": "writes elsewhere: open ",
        "an exception": "KeyError: 'name' (",
        "lines": "an error of 7 characters and 2 lines: ",
        "memory": "asks for too much memory",
        "nothing said": "an error that says nothing",
        "removed": "FileNotFoundError: ",
        "the network": "ConnectionRefusedError: ",
    }.items():
        assert found.pop(name).startswith(wanted), (name, said)
    assert not found and status == 1
    assert "11 files of 11 formats: 1 read, 1 refused, 9 wrong;" in said
    assert len(re.findall(r"^(one sentence +1 +0 +1 +0|read +1 +1 +0 +0)$", said, re.MULTILINE)) == 2


@pytest.mark.slow
def test_mutated_files_are_read_or_raise():
    said, status = run("--count", "430")
    assert status == 0, said
    assert re.search(r"^430 files of (7[5-9]|8\d) formats: \d\d+ read, \d\d+ refused, 0 wrong;", said, re.MULTILINE), (
        said
    )


@pytest.mark.parametrize("name", ["a.txt", "a.json", "a.stl"])
def test_mutations_follow_from_their_number(name):
    data = b'{"frames": [1, 2.5, {"name": "x"}]}\n' * 3
    made = [mutate(np.random.default_rng(number), name, data) for number in range(200)]
    assert made == [mutate(np.random.default_rng(number), name, data) for number in range(200)]
    assert len(set(made)) > 150 and sum(item == data for item in made) < 10
