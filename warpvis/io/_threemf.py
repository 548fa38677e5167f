# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of 3MF files that trimesh's reader ignores: the unit, and the order of the parts."""

from __future__ import annotations

import html
import re

# The 3MF core specification, section 3.4: a model without a unit is in millimeters.
_METERS = {
    b"micron": 1e-6,
    b"millimeter": 1e-3,
    b"centimeter": 1e-2,
    b"inch": 0.0254,
    b"foot": 0.3048,
    b"meter": 1.0,
}
_NAME = re.compile(rb"""\b(?:partnumber|name)\s*=\s*(?:"([^"]*)"|'([^']*)')""")


def unit_and_names(files: dict[str, bytes]) -> tuple[float, list[str]]:
    """Read the unit of a 3MF file [m], and the names of its parts, in order.

    Args:
        files: The files in the 3MF archive.
    """
    models = [files[name] for name in sorted(files) if name.lower().endswith(".model")]
    found: dict[str, None] = {}
    unit = b"millimeter"
    for model in models:
        root = re.search(rb"<(?:\w+:)?model\b[^>]*", model)
        match = re.search(rb"""\sunit\s*=\s*["']([^"']*)["']""", root[0]) if root else None
        unit = match[1] if match else unit
        found |= {html.unescape((a or b).decode(errors="replace")): None for a, b in _NAME.findall(model)}
    if unit not in _METERS:
        known = ", ".join(name.decode() for name in _METERS)
        raise ValueError(f"the unit must be one of {known}, got {unit.decode(errors='replace')!r}")
    return _METERS[unit], list(found)
