# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Named colors of items, and of the materials of their parts."""

from __future__ import annotations

COLORS: dict[str, tuple[int, int, int]] = {
    "red": (196, 42, 40),
    "orange": (232, 128, 36),
    "yellow": (236, 198, 52),
    "green": (62, 138, 66),
    "blue": (44, 92, 176),
    "purple": (118, 72, 150),
    "pink": (226, 138, 160),
    "brown": (128, 82, 48),
    "beige": (206, 184, 148),
    "white": (236, 236, 232),
    "gray": (140, 144, 148),
    "black": (38, 38, 42),
    "turquoise": (48, 160, 158),
}
"""Colors that an item may have, by their word [sRGB, 0 to 255]."""

MATERIALS: dict[str, tuple[int, int, int]] = {
    "oak": (186, 142, 92),
    "walnut": (108, 72, 46),
    "pine": (216, 180, 128),
    "metal": (168, 172, 178),
    "dark metal": (78, 82, 88),
    "plastic": (52, 54, 58),
    "screen": (24, 32, 44),
    "screen light": (96, 150, 204),
    "paper": (244, 240, 228),
    "ceramic": (238, 236, 230),
    "soil": (74, 54, 40),
    "leaf": (58, 122, 52),
    "light leaf": (104, 158, 72),
    "terracotta": (184, 104, 70),
    "glow": (255, 246, 218),
    "linen": (240, 236, 224),
    "skin": (196, 150, 104),
    "snout": (230, 202, 162),
    "cardboard line": (150, 112, 70),
    "wall": (232, 228, 216),
    "ceiling": (246, 246, 242),
    "frame": (240, 240, 236),
    "burner": (30, 30, 32),
    "glass": (196, 220, 226),
    "liquid": (84, 150, 204),
    "cork": (176, 130, 84),
}
"""Colors of parts that are the same for every item of a category [sRGB, 0 to 255]."""

MAIN = "main"
"""The material of parts that have the item's color."""
DARK = "main dark"
"""The material of parts that have a darker shade of the item's color."""
LIGHT = "main light"
"""The material of parts that have a lighter shade of the item's color."""


def color_of(material: str, word: str) -> tuple[int, int, int]:
    """Return the sRGB color, 0 to 255, of a material of an item whose color is `word`."""
    if material not in (MAIN, DARK, LIGHT):
        return MATERIALS.get(material) or COLORS[material]
    red, green, blue = COLORS[word]
    if material == DARK:
        return red * 7 // 10, green * 7 // 10, blue * 7 // 10
    if material == LIGHT:
        return 255 - (255 - red) * 3 // 4, 255 - (255 - green) * 3 // 4, 255 - (255 - blue) * 3 // 4
    return red, green, blue
