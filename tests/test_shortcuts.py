# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The shortcut test: planted shortcuts are found, and balanced questions pass."""

from dataclasses import replace

import pytest
from situation_jobs import FakeGenerator, FakeOptions

from warpvis.errors import ArrayError, ShortcutError
from warpvis.situations import find_shortcuts

pytest.importorskip("sklearn")


def situations(rooms=30, **options):
    generator = FakeGenerator(FakeOptions(**options))
    return [situation for room in range(rooms) for situation in generator.shard(room)]


def test_balanced_questions_pass():
    report = find_shortcuts(situations())
    assert not report.found and not report.untested
    report.require_none()
    assert {item.kind for item in report.results} == {"sees", "which"}
    assert all(item.chance == 0.5 and item.questions == 300 for item in report.results)
    assert all(abs(item.accuracy - 0.5) < 0.12 for item in report.results)


@pytest.mark.parametrize("name", ["distance", "text"])
def test_planted_shortcut_is_found(name):
    report = find_shortcuts(situations(shortcut=name))
    found = {(item.kind, item.name): item for item in report.found}
    assert found["sees", name].accuracy > 0.85
    assert {kind for kind, _ in found} == {"sees"}
    with pytest.raises(ShortcutError, match=r"questions of kind 'sees' are answered by the shortcut '.*' with an "):
        report.require_none()


def test_bounds():
    report = find_shortcuts(situations())
    for item in report.results:
        assert item.lower_bound < item.accuracy < item.lower_bound + 0.1
    assert {item.name for item in report.results if item.is_diagnostic} == {"agent_distance", "gaze_angle"}


def test_few_questions_are_not_tested():
    assert find_shortcuts(situations(rooms=9)).untested == {"sees": 90, "which": 90}
    assert find_shortcuts(situations(rooms=3, per_shard=50)).untested == {"sees": 150, "which": 150}
    assert find_shortcuts([]).results == ()


def test_wrong_arguments():
    with pytest.raises(ArrayError, match="folds must be a whole number from 2 up, got 1"):
        find_shortcuts([], folds=1)
    with pytest.raises(ArrayError, match="threshold must be a number from 0 to 1, got 2"):
        find_shortcuts([], threshold=2)
    for wrong in (3, [None], "rooms"):
        with pytest.raises(ArrayError, match="situations must be a sequence of Situation, got "):
            find_shortcuts(wrong)
    situation = situations(1)[0]
    wrong = replace(situation, questions=(replace(situation.questions[0], answer="maybe"),))
    with pytest.raises(ArrayError, match="the answer of a question must be one of its choices, got 'maybe' in 00000-0"):
        find_shortcuts([wrong])
