# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of a scene's objects: their names, and which of them are ground."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from warpvis.core.label_rules import LabelRules
from warpvis.core.labels import Label, LabelNames


class SceneClasses:
    """The classes of a scene."""

    def __init__(self, label_names: Mapping[int, str] | None, ground_labels: Iterable[Label | int | str]) -> None:
        """Check and store the arguments of `Scene`."""
        self._label_names = LabelNames(label_names)
        self.ground_labels = ground_labels

    @property
    def label_names(self) -> LabelNames:
        """Names of the classes of pixels, by number: those of `Label` and user-defined ones.

        Add one by ``scene.label_names[40] = "road"``; ``scene.label_names.number("road")`` is the value of its pixels.
        """
        return self._label_names

    @label_names.setter
    def label_names(self, names: Mapping[int, str]) -> None:
        self._label_names = LabelNames(names)

    @property
    def ground_labels(self) -> frozenset[int]:
        """Classes that are ground: robots stand on them, and maps show them where there is no obstacle.

        Only `Label.GROUND` by default. All other classes except those of `Label` are obstacles.
        """
        return self._ground_labels

    @ground_labels.setter
    def ground_labels(self, labels: Iterable[Label | int | str]) -> None:
        self._ground_labels = frozenset(self._label_names.numbers(labels, "ground_labels"))

    def use_labels(self, rules: LabelRules) -> None:
        """Add the class names of label rules, and their ground classes if given."""
        self._label_names.update(rules.label_names)
        if rules.ground_labels is not None:
            self.ground_labels = rules.ground_labels

    def _metadata(self, label: int) -> dict[str, int | str | bool]:
        """Return the metadata from which `load` restores a mesh's label, with ``ground`` if not the default."""
        number, word = self._label_names.number(label), self._label_names.word(label)
        ground = number in self._ground_labels
        flags: dict[str, int | str | bool] = {} if ground == (number == Label.GROUND) else {"ground": ground}
        if isinstance(number, Label) and word == number.name:
            return {"label": word, **flags}
        return {"label": int(number), **({"label_name": word} if number in self._label_names else {}), **flags}
