# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Constants shared by C++ and Python are defined in C++, and Python's are generated from them."""

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


def test_generated_module_is_up_to_date():
    """Run `python scripts/generate_constants.py` to update it."""
    made = load_script().generate(HEADER.read_text(encoding="utf-8"))
    assert made == (ROOT / "kernels" / "constants.py").read_text(encoding="utf-8")


def test_all_constants_of_the_header_are_generated():
    """This finds all names with values, independently of the generator's patterns."""
    values = dict(re.findall(r"^(?:constexpr float |    )(\w+) = ([^,;]+)[,;]", HEADER.read_text(), re.MULTILINE))
    assert len(values) > 50
    for name, value in values.items():
        assert getattr(constants, name) == eval(value.removesuffix("f")), name


@pytest.mark.parametrize("line", ["    WRONG,\n", "    WRONG = SOLID_NONE + 1,\n", "    WRONG = 1, OTHER = 2,\n"])
def test_unsupported_header_lines_raise(line):
    header = HEADER.read_text().replace("    SOLID_BALL = 1,\n", line)
    with pytest.raises(ValueError, match="WRONG"):
        load_script().generate(header)


def test_public_enums_match_cpp():
    def of(name):
        body = re.search(rf"enum {name} \{{\n(.*?)\}};", HEADER.read_text(), re.DOTALL)[1]
        return {member: int(value) for member, value in re.findall(r"    [A-Z]+?_(\w+) = (\d+),", body)}

    assert {label.name: label.value for label in Label} == of("Label")
    assert {status.name: status.value for status in Visibility} == of("Visibility")
    assert {reason.name: reason.value for reason in Reason} == of("Reason")
    assert {"NONE" if kind == 0 else kind.name: kind.value for kind in SolidKind} == of("SolidKind")
