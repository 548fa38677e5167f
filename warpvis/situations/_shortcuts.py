# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The shortcut test: how well questions are answered without looking at who sees what.

Models that see no picture are trained and tested on the questions themselves, in k folds, as the Test-set Stress-Test
does (Brown et al. 2025, https://arxiv.org/abs/2511.04655): there a language model on the texts and a random forest on
simple features, here a linear model on the texts, one decision tree for each simple measure, and a forest for all.
All questions of a room are in the same fold.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_number, check_whole, format_percent, pluralize, truncate
from warpvis.core.file_content import require_package
from warpvis.errors import ArrayError, ShortcutError
from warpvis.situations._question_features import (
    DIAGNOSTICS,
    SHORTCUTS,
    choice_features,
    measure,
    subject_features,
)
from warpvis.situations._situation import Situation

MIN_QUESTIONS = 100
"""Kinds with fewer questions are not tested: their accuracy would be too uncertain."""
THRESHOLD = 0.15
"""Default of the accuracy above chance that is accepted."""

_MAX_QUESTIONS = 5_000  # of a kind: more would hardly change an accuracy by 1 %
_MAX_ANSWERS = 50
_QUANTILE = 2.326  # of the normal distribution, at 99 %
_WORD = r"(?u)\b\w+\b"
_DECIDED_BY_PLACES = ("left_right", "nearer")
_TEXT, _PRIOR, _POSITION, _ALL = "text", "frequent_answer", "answer_position", "all_measures"


@dataclass(frozen=True)
class Shortcut:
    """How well a shortcut answers the questions of a kind."""

    kind: str
    """The questions' kind."""
    name: str
    """``"frequent_answer"``, ``"answer_position"``, ``"text"``, ``"distance"``, ``"image_height"``, ``"image_size"``,
    ``"image_column"``, ``"all_measures"``; of diagnostics ``"agent_distance"`` and ``"gaze_angle"``."""
    questions: int
    """Number of questions."""
    correct: float
    """Number of correct answers, all of them to questions of rooms that the model was not trained on."""
    chance: float
    """Share that random choices answer."""

    @property
    def accuracy(self) -> float:
        """Share of correct answers."""
        return self.correct / self.questions

    @property
    def lower_bound(self) -> float:
        """Lower bound of the accuracy at 99 % confidence: Wilson's score interval of a binomial distribution."""
        n, z = self.questions, _QUANTILE
        center = self.accuracy + z * z / (2 * n)
        spread = z * math.sqrt(self.accuracy * (1 - self.accuracy) / n + z * z / (4 * n * n))
        return max((center - spread) / (1 + z * z / n), 0.0)

    @property
    def is_diagnostic(self) -> bool:
        """Whether it uses the geometry that the question is about, so that a high accuracy is no fault of the set.

        The places of both objects and of the participant in the picture, all measures together, determine which object
        is nearer to a participant, or on which side.
        """
        return self.name in DIAGNOSTICS or (self.name == _ALL and self.kind in _DECIDED_BY_PLACES)


@dataclass(frozen=True)
class ShortcutReport:
    """The result of `find_shortcuts`."""

    results: tuple[Shortcut, ...]
    """A result for each kind of questions and each shortcut."""
    untested: dict[str, int] = field(default_factory=dict)
    """Kinds with too few questions or rooms, and their numbers of questions."""
    threshold: float = THRESHOLD
    """Accuracy above chance that is accepted."""

    @property
    def found(self) -> tuple[Shortcut, ...]:
        """Shortcuts whose accuracy exceeds chance by more than the threshold, with 99 % confidence; best first."""
        tested = [item for item in self.results if not item.is_diagnostic]
        found = [item for item in tested if item.lower_bound > item.chance + self.threshold]
        return tuple(sorted(found, key=lambda item: item.chance - item.accuracy))

    def require_none(self) -> None:
        """Raise a `ShortcutError` if a shortcut was found."""
        if not self.found:
            return
        best, others = self.found[0], len(self.found) - 1
        more = f"; {pluralize(others, 'other shortcut')} also" if others else ""
        raise ShortcutError(
            f"questions of kind {best.kind!r} are answered by the shortcut {best.name!r} with an accuracy of "
            f"{format_percent(best.accuracy)} (chance {format_percent(best.chance)}, accepted "
            f"{format_percent(best.chance + self.threshold)}){more}. Use allow_shortcuts=True to accept this"
        )


@dataclass(frozen=True, eq=False)
class _Example:
    """A question as a shortcut gets it."""

    room: str
    text: str
    choices: tuple[str, ...]
    answer: int
    subjects: dict[str, NDArray[np.float64]]
    options: dict[str, NDArray[np.float64]] | None


def find_shortcuts(situations: Iterable[Situation], *, folds: int = 5, threshold: float = THRESHOLD) -> ShortcutReport:
    """Test how well the questions of situations are answered by shortcuts, which see no picture.

    Args:
        situations: The situations; pictures are not used. The part of a name before ``-`` is its room.
        folds: Number of parts. Each is answered by models that were trained on the others.
        threshold: Accuracy above chance that is accepted, from 0 to 1.

    Raises:
        ArrayError: If an argument is invalid, or an answer is not one of the choices.
        FileFormatError: If scikit-learn is not installed.
    """
    check_whole(folds, "folds", minimum=2)
    check_number(threshold, "threshold", minimum=0, maximum=1)
    require_package("sklearn", "shortcuts are tested with scikit-learn", "situations")
    limit = require_package("threadpoolctl", "shortcuts are tested with scikit-learn", "situations")
    kinds: dict[str, list[_Example]] = {}
    for situation in _require_situations(situations):
        measures = measure(situation)
        for question in situation.questions:
            if question.answer not in question.choices:
                raise ArrayError(
                    f"the answer of a question must be one of its choices, got {truncate(question.answer)!r} in "
                    f"{situation.name}"
                )
            example = _Example(
                situation.name.partition("-")[0],
                question.text,
                question.choices,
                question.choices.index(question.answer),
                subject_features(measures, question),
                choice_features(measures, question),
            )
            kinds.setdefault(question.kind, []).append(example)
    results: list[Shortcut] = []
    untested: dict[str, int] = {}
    with limit.threadpool_limits(1):  # sums in another order could change a result
        for kind, examples in sorted(kinds.items()):
            if len(examples) < MIN_QUESTIONS or len({example.room for example in examples}) < folds:
                untested[kind] = len(examples)
            else:
                results += _test_kind(kind, _sample(examples), folds)
    return ShortcutReport(tuple(results), untested, threshold)


def _require_situations(situations: Iterable[Situation]) -> Iterator[Situation]:
    """Yield the situations; raise an ArrayError if they are something else."""
    if not isinstance(situations, Iterable):
        raise ArrayError(f"situations must be a sequence of Situation, got {type(situations).__name__}")
    for situation in situations:
        if not isinstance(situation, Situation):
            raise ArrayError(f"situations must be a sequence of Situation, got one of {type(situation).__name__}")
        yield situation


def _sample(examples: list[_Example]) -> list[_Example]:
    """Return at most `_MAX_QUESTIONS` of the examples, in their order."""
    if len(examples) <= _MAX_QUESTIONS:
        return examples
    chosen = np.random.default_rng(0).choice(len(examples), _MAX_QUESTIONS, replace=False)
    return [examples[index] for index in np.sort(chosen)]


def _test_kind(kind: str, examples: list[_Example], folds: int) -> list[Shortcut]:
    """Test all shortcuts for the questions of one kind."""
    rooms = {room: number for number, room in enumerate(sorted({example.room for example in examples}))}
    parts = np.array([rooms[example.room] % folds for example in examples])
    chance = float(np.mean([1 / len(example.choices) for example in examples]))
    shortcuts: dict[str, _Guess] = {_PRIOR: _guess_frequent, _POSITION: _guess_position, _TEXT: _guess_by_text}
    measures = (*SHORTCUTS, *DIAGNOSTICS)
    shortcuts |= {name: partial(_guess_by_measures, names=(name,)) for name in measures}
    shortcuts[_ALL] = partial(_guess_by_measures, names=SHORTCUTS)
    results = []
    for name, guess in shortcuts.items():
        correct = 0.0
        for part in range(folds):
            train = [example for example, its in zip(examples, parts, strict=True) if its != part]
            test = [example for example, its in zip(examples, parts, strict=True) if its == part]
            scores = guess(train, test)
            correct += sum(_score_of(example, row) for example, row in zip(test, scores, strict=True))
        results.append(Shortcut(kind, name, len(examples), correct, chance))
    return results


def _score_of(example: _Example, scores: Sequence[float]) -> float:
    """Return 1 if the answer has the highest score, a part of 1 if several choices share it, else 0."""
    best = max(scores)
    if scores[example.answer] < best:
        return 0.0
    return 1 / sum(score == best for score in scores)


_Guess = Callable[[list[_Example], list[_Example]], Iterable[Sequence[float]]]
"""Learns from examples, and returns a score for each choice of other examples."""


def _guess_frequent(train: list[_Example], test: list[_Example]) -> Iterable[Sequence[float]]:
    counts = Counter(example.choices[example.answer] for example in train)
    return [[counts[choice] for choice in example.choices] for example in test]


def _guess_position(train: list[_Example], test: list[_Example]) -> Iterable[Sequence[float]]:
    counts = Counter(example.answer for example in train)
    return [[counts[place] for place in range(len(example.choices))] for example in test]


def _guess_by_text(train: list[_Example], test: list[_Example]) -> Iterable[Sequence[float]]:
    """Predict the answer from the words of the question, or whether a choice is it from the words of both."""
    from sklearn.feature_extraction.text import TfidfVectorizer
    from sklearn.linear_model import LogisticRegression

    model = LogisticRegression(max_iter=200)
    if not _is_of_choices(train):
        words = TfidfVectorizer(ngram_range=(1, 2), sublinear_tf=True, token_pattern=_WORD)
        rows = words.fit_transform([example.text for example in train])
        return _predict_answers(model, rows, words.transform([example.text for example in test]), train, test)
    words = TfidfVectorizer(sublinear_tf=True, token_pattern=_WORD)
    words.fit(_choice_texts(train))
    return _predict_choices(
        model, words.transform(_choice_texts(train)), words.transform(_choice_texts(test)), train, test
    )


def _choice_texts(examples: list[_Example]) -> list[str]:
    """Return the words of each choice, marked, and those of its question."""
    marked = [[" ".join(f"_{word}" for word in choice.lower().split()) for choice in item.choices] for item in examples]
    return [f"{example.text} {choice}" for example, row in zip(examples, marked, strict=True) for choice in row]


def _guess_by_measures(
    train: list[_Example], test: list[_Example], *, names: tuple[str, ...]
) -> Iterable[Sequence[float]]:
    """Predict the answer from measures: by a decision tree from one, by a random forest from several."""
    from sklearn.ensemble import RandomForestClassifier
    from sklearn.tree import DecisionTreeClassifier

    leaf = max(5, len(train) // 200)
    model: Any = DecisionTreeClassifier(max_depth=6, min_samples_leaf=leaf, random_state=0)
    if len(names) > 1:
        model = RandomForestClassifier(60, max_depth=10, min_samples_leaf=max(3, leaf // 4), random_state=0)

    if _is_of_choices(train):
        rows, others = (
            np.concatenate([_columns(example.options or {}, names) for example in part]) for part in (train, test)
        )
        return _predict_choices(model, rows, others, train, test)
    rows, others = (np.stack([_columns(example.subjects, names) for example in part]) for part in (train, test))
    return _predict_answers(model, rows, others, train, test)


def _columns(features: dict[str, NDArray[np.float64]], names: tuple[str, ...]) -> NDArray[np.float64]:
    return np.concatenate([features[name] for name in names], axis=-1)


def _is_of_choices(examples: list[_Example]) -> bool:
    """Return whether the choices of all questions are objects or people, which differ between questions."""
    return all(example.options is not None for example in examples)


def _predict_answers(
    model: Any, rows: Any, others: Any, train: list[_Example], test: list[_Example]
) -> Iterable[Sequence[float]]:
    """Train a model to predict answers, and return the probabilities of the choices of the test questions."""
    given = [example.choices[example.answer] for example in train]
    frequent = {answer: number for number, (answer, _) in enumerate(Counter(given).most_common(_MAX_ANSWERS))}
    labels = np.array([frequent.get(answer, -1) for answer in given])
    if len(set(labels)) < 2:
        return _guess_frequent(train, test)
    model.fit(rows, labels)
    columns = {label: column for column, label in enumerate(model.classes_.tolist())}
    known = {answer: columns[label] for answer, label in frequent.items()}
    probabilities = model.predict_proba(others)
    return [
        [float(row[known[choice]]) if choice in known else 0.0 for choice in example.choices]
        for example, row in zip(test, probabilities, strict=True)
    ]


def _predict_choices(
    model: Any, rows: Any, others: Any, train: list[_Example], test: list[_Example]
) -> Iterable[Sequence[float]]:
    """Train a model to recognize the correct choice, and return the probability of each choice."""
    labels = np.concatenate([np.arange(len(example.choices)) == example.answer for example in train])
    model.fit(rows, labels)
    probabilities = model.predict_proba(others)[:, 1]
    ends = np.cumsum([len(example.choices) for example in test])
    return [part.tolist() for part in np.split(probabilities, ends[:-1])]
