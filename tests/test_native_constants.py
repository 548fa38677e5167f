# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that C++ and Python share are written once, in C++; Python's are made of them."""

import importlib.util
import re
from pathlib import Path

import pytest

from warpvis import Label, Visibility
from warpvis.kernels import constants
from warpvis.scene.solids import SolidKind
from warpvis.sensors import Reason

ROOT = Path(__file__).parent.parent
HEADER = ROOT / "kernels" / "native" / "shared" / "constants.h"


def load_script():
    spec = importlib.util.spec_from_file_location("generate_constants", ROOT / "scripts" / "generate_constants.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_module_is_fresh():
    """`python scripts/generate_constants.py` makes it."""
    made = load_script().generate(HEADER.read_text(encoding="utf-8"))
    assert made == (ROOT / "kernels" / "constants.py").read_text(encoding="utf-8")


def test_every_number_of_the_header_is_there():
    """Whatever the generator's patterns leave out: every name with a value."""
    values = dict(re.findall(r"^(?:constexpr float |    )(\w+) = ([^,;]+)[,;]", HEADER.read_text(), re.MULTILINE))
    assert len(values) > 50
    for name, value in values.items():
        assert getattr(constants, name) == eval(value.removesuffix("f")), name


@pytest.mark.parametrize("line", ["    WRONG,\n", "    WRONG = SOLID_NONE + 1,\n", "    WRONG = 1, OTHER = 2,\n"])
def test_what_the_generator_cannot_read_is_an_error(line):
    header = HEADER.read_text().replace("    SOLID_BALL = 1,\n", line)
    with pytest.raises(ValueError, match="WRONG"):
        load_script().generate(header)


def test_public_enums_are_as_in_cpp():
    def of(name):
        body = re.search(rf"enum {name} \{{\n(.*?)\}};", HEADER.read_text(), re.DOTALL)[1]
        return {member: int(value) for member, value in re.findall(r"    [A-Z]+?_(\w+) = (\d+),", body)}

    assert {label.name: label.value for label in Label} == of("Label")
    assert {status.name: status.value for status in Visibility} == of("Visibility")
    assert {reason.name: reason.value for reason in Reason} == of("Reason")
    assert {"NONE" if kind == 0 else kind.name: kind.value for kind in SolidKind} == of("SolidKind")
