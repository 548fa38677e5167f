# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Semantic labels of prims: SemanticsLabelsAPI of UsdSemantics, and the older SemanticsAPI of Isaac Sim."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Labels = tuple[tuple[str, str], ...]
"""Pairs of a taxonomy ("class") and a label ("chair")."""

_NEW, _OLD = "SemanticsLabelsAPI:", "semantic"
_PREFERRED = ("class", "category", "type")
"""Taxonomies that name the class of a prim, the best first; others follow in alphabetical order."""


def direct_labels(prim: Any, schemas: Sequence[str], time: Any) -> Labels:
    """Return the labels of a prim itself, in the order in which they describe its class."""
    found: list[tuple[str, str]] = []
    for schema in schemas:
        if schema.startswith(_NEW):
            taxonomy = schema.removeprefix(_NEW)
            labels = prim.GetAttribute(f"semantics:labels:{taxonomy}").Get(time) or ()
            found += [(taxonomy, str(label)) for label in labels]
    for item in prim.GetAuthoredPropertiesInNamespace(_OLD):
        name = str(item.GetName())
        if name.endswith(":params:semanticType"):
            data = prim.GetAttribute(name.removesuffix("Type") + "Data").Get(time)
            words = str(data or "").split(",")
            found += [(str(prim.GetAttribute(name).Get(time)), word.strip()) for word in words]
    return tuple(sorted(((kind, word) for kind, word in found if word), key=lambda pair: _rank(pair[0])))


def category(labels: Labels) -> str:
    """Return the word that describes the class of a prim best: of the nearest labels, by their taxonomy."""
    return min(labels, key=lambda pair: _rank(pair[0])[0], default=("", ""))[1]


def _rank(taxonomy: str) -> tuple[int, str]:
    folded = taxonomy.lower()
    return _PREFERRED.index(folded) if folded in _PREFERRED else len(_PREFERRED), taxonomy
