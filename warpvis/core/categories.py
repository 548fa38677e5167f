# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of objects whose source only has a class in words, such as a semantic label."""

from __future__ import annotations

import re

from warpvis.core.labels import Label

# The structure of rooms, and furniture: they hide objects of interest.
_OBSTACLES = (
    "wall ceiling door doorframe window windowframe column pillar beam stairs staircase stair step railing "
    "banister roof partition screen fence building room house floorplan table desk counter countertop cabinet "
    "cupboard wardrobe closet drawer dresser shelf shelving bookshelf bookcase rack sofa couch bed armchair "
    "chair stool bench ottoman nightstand fridge refrigerator oven stove dishwasher washer dryer sink bathtub "
    "shower toilet fireplace radiator curtain blinds whiteboard blackboard mirror machine conveyor appliance "
    "furniture structure tree plant stage car truck vehicle"
)
_WORDS = {
    Label.GROUND: "floor ground terrain carpet rug mat floormat lawn grass road sidewalk",
    Label.HUMAN: "person human man woman child boy girl pedestrian people worker",
    Label.ROBOT: "robot manipulator gripper drone quadruped humanoid",
    Label.OBSTACLE: _OBSTACLES,
}
_LABELS = {word: label for label, words in _WORDS.items() for word in words.split()}
_NOTHING = frozenset({"other", "unknown", "misc", "unlabeled", "unlabelled", "undefined", "none", "object", "objects"})


def label_of_category(category: str) -> Label:
    """Return the label of a class in words: that of its last word that has one, else `Label.OBJECT`.

    A plural has the label of its singular. ``"other"``, ``"unknown"`` and the empty word are `Label.OBSTACLE`.

    Args:
        category: The class: ``"floor"``, ``"office chair"``, ``"coffee_mug"``, ``"DiningTable"``.
    """
    words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", category).lower())
    for word in reversed(words):
        for form in (word, word.removesuffix("s"), word.removesuffix("es")):
            if form in _LABELS:
                return _LABELS[form]
    return Label.OBJECT if words and words[-1] not in _NOTHING else Label.OBSTACLE
