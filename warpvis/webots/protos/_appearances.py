# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors for Webots' appearance PROTOs without a file or texture, and appearances of objects without a file.

Most of these PROTOs (Webots' user guide, "Appearances") are a PBRAppearance with a texture, which is multiplied by the
field `colorOverride` or `baseColor`. The colors here stand for the mean color of that texture, estimated by eye.
Default appearances are those of the user guide (https://cyberbotics.com/doc/guide, the pages Floors, Tables, Apartment
Structure, Factory and Cabinet).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError
from warpvis.scene.materials import linear_color, screen_color
from warpvis.webots._nodes import Node, Value, new_node

_Color = tuple[float, float, float]

_WHITE, _WOOD, _DARK, _STEEL = (1.0, 1.0, 1.0), (0.62, 0.46, 0.31), (0.15, 0.15, 0.15), (0.6, 0.6, 0.6)
_CONCRETE, _STONE, _RUST, _SOIL = (0.6, 0.59, 0.57), (0.55, 0.52, 0.48), (0.45, 0.3, 0.2), (0.36, 0.28, 0.2)

_MATT: dict[str, _Color] = {
    "AcousticFoam": (0.25, 0.25, 0.26),
    "ArtificialGrass": (0.25, 0.45, 0.15),
    "Asphalt": (0.3, 0.3, 0.3),
    "BakelitePlastic": _DARK,
    "BeigeMarble": (0.8, 0.74, 0.65),
    "BlanketFabric": (0.5, 0.45, 0.4),
    "CarLeather": _DARK,
    "Cardboard": (0.72, 0.56, 0.38),
    "CarpetFabric": (0.45, 0.4, 0.38),
    "CarpetFibers": (0.5, 0.45, 0.4),
    "CasterTireRubberWheel": _DARK,
    "CementTiles": _CONCRETE,
    "ChequeredParquetry": (0.62, 0.46, 0.32),
    "CimentTiles": _CONCRETE,
    "Cloth": (0.6, 0.58, 0.55),
    "CorrugatedPlates": (0.65, 0.66, 0.66),
    "CorrugatedPvc": (0.75, 0.75, 0.75),
    "CrossTireRubberWheel": _DARK,
    "DarkParquetry": (0.35, 0.23, 0.15),
    "DryMud": (0.5, 0.41, 0.31),
    "ElectricConduit": (0.45, 0.45, 0.45),
    "Fabric": (0.55, 0.5, 0.45),
    "FormedConcrete": _CONCRETE,
    "GenericDoorAppearance": (0.8, 0.78, 0.74),
    "GlossyCarPaint": _WHITE,
    "GlossyPaint": _WHITE,
    "Grass": (0.28, 0.4, 0.17),
    "GridTiles": (0.75, 0.75, 0.75),
    "Leather": (0.35, 0.22, 0.15),
    "LedStrip": (0.9, 0.9, 0.85),
    "LightParquetry": (0.72, 0.56, 0.38),
    "Marble": (0.8, 0.79, 0.77),
    "MarbleTiles": (0.78, 0.76, 0.72),
    "MatteCarPaint": _WHITE,
    "MattePaint": _WHITE,
    "OldPlywood": (0.6, 0.48, 0.34),
    "OldStonePavement": _STONE,
    "OsbWood": (0.7, 0.56, 0.36),
    "PaintedWood": (0.85, 0.85, 0.83),
    "Parquetry": (0.6, 0.43, 0.28),
    "Pavement": (0.58, 0.56, 0.53),
    "Pcb": (0.1, 0.35, 0.18),
    "Plaster": (0.85, 0.83, 0.78),
    "Plastic": _WHITE,
    "PlasticGrid": (0.4, 0.4, 0.4),
    "PlasticPolymer": (0.3, 0.3, 0.3),
    "PlasticTarp": (0.3, 0.4, 0.55),
    "PorcelainChevron": (0.8, 0.79, 0.76),
    "PorcelainChevronTiles": (0.8, 0.79, 0.76),
    "RedBricks": (0.55, 0.3, 0.22),
    "Roughcast": _WHITE,
    "RoughConcrete": _CONCRETE,
    "RoughOak": (0.55, 0.42, 0.28),
    "RoughPine": (0.7, 0.53, 0.34),
    "RoughPolymer": (0.25, 0.25, 0.25),
    "Rubber": _DARK,
    "RusticVeneerWood": (0.5, 0.36, 0.24),
    "Sand": (0.76, 0.66, 0.5),
    "SandyGround": (0.66, 0.56, 0.42),
    "ScratchedPaint": (0.7, 0.7, 0.7),
    "ScuffedPlastic": (0.75, 0.75, 0.75),
    "ShinyLeather": (0.2, 0.15, 0.13),
    "SlatePavement": (0.4, 0.41, 0.42),
    "Soil": _SOIL,
    "SolarCell": (0.1, 0.12, 0.25),
    "SquarePavement": _STONE,
    "StonePavement": _STONE,
    "TireRubber": _DARK,
    "VarnishedPine": (0.66, 0.44, 0.25),
    "WireFence": (0.6, 0.6, 0.6),
    "WoodPanel": _WOOD,
    "WornBurlap": (0.6, 0.5, 0.36),
}
_METALS: dict[str, _Color] = {
    "BrushedAluminium": (0.78, 0.78, 0.79),
    "BrushedSteel": (0.62, 0.62, 0.62),
    "Copper": (0.75, 0.46, 0.33),
    "CorrodedMetal": (0.42, 0.33, 0.27),
    "CorrugatedMetal": (0.66, 0.67, 0.68),
    "DamascusSteel": (0.5, 0.5, 0.5),
    "FlexibleAluminiumDuct": (0.75, 0.75, 0.75),
    "GalvanizedMetal": (0.63, 0.65, 0.66),
    "GoldPaper": (0.83, 0.67, 0.35),
    "HammeredCopper": (0.72, 0.45, 0.32),
    "HolesPerforatedSteel": _STEEL,
    "MetalPipePaint": (0.6, 0.6, 0.62),
    "MetalStainlessSteelCable": _STEEL,
    "OldSteel": (0.5, 0.48, 0.46),
    "PerforatedMetal": _STEEL,
    "ReflectiveSurface": (0.9, 0.9, 0.9),
    "RustyMetal": _RUST,
    "ScrewThread": _STEEL,
    "ThreadMetalPlate": (0.58, 0.58, 0.58),
}
_PARQUETRY: dict[str, _Color] = {
    "chequered": _MATT["ChequeredParquetry"],
    "dark strip": _MATT["DarkParquetry"],
    "light strip": _MATT["LightParquetry"],
}
_COLOR_FIELDS = ("colorOverride", "baseColor", "color", "diffuseColor", "mainColor")


def stand_in_appearance(node: Node) -> Node | None:
    """Build a PBRAppearance with the mean color of an appearance PROTO; None for an unknown PROTO without a color."""
    color = {**_MATT, **_METALS}.get(node.type)
    if node.type == "Parquetry":
        color = _PARQUETRY.get(_text(node, "type", ""), color)
    factor = field_color(node)
    if color is None and factor is None:
        return None
    mixed = np.array(linear_color(color or _WHITE)) * linear_color(_WHITE if factor is None else factor)
    is_metal = float(node.type in _METALS)
    return plain_appearance(node, screen_color(mixed), metalness=is_metal, roughness=0.4 if is_metal else 1.0)


def field_color(node: Node) -> NDArray[np.float64] | None:
    """Return the color in the fields of an instance, sRGB from 0 to 1; None if it has none."""
    for field in _COLOR_FIELDS:
        try:
            values = node.numbers(field)
        except FileFormatError:
            continue
        if len(values) == 3:
            return np.clip(values, 0.0, 1.0)
    return None


def plain_appearance(like: Node, color: tuple[float, ...], **numbers: float) -> Node:
    """Build a PBRAppearance of one sRGB color, matt by default; `numbers` are other fields."""
    fields: dict[str, Value] = {"baseColor": [*color], "metalness": [0.0], "roughness": [1.0]}
    return new_node(like, "PBRAppearance", fields | {name: [value] for name, value in numbers.items()})


def field_appearance(node: Node, field: str, default: str = "") -> Node | None:
    """Return the appearance in a field of an instance; without that field, an instance of the PROTO `default`."""
    if field in node.fields:
        try:
            return node.node(field)
        except FileFormatError:
            return None
    return new_node(node, default, {}) if default else None


def object_appearance(node: Node) -> Node | None:
    """Return the appearance of all shapes of an object without a file: in its field, or of its color; else None."""
    color = field_color(node)
    if color is None or "appearance" in node.fields:
        return field_appearance(node, "appearance", _DEFAULTS.get(node.type, ""))
    return plain_appearance(node, tuple(color.tolist()), roughness=0.5)


def _text(node: Node, field: str, default: str) -> str:
    try:
        return node.text(field, default)
    except FileFormatError:
        return default


_DEFAULTS = {
    "Armchair": "BlanketFabric",
    "Bed": "VarnishedPine",
    "Cabinet": "VarnishedPine",
    "CardboardBox": "Cardboard",
    "Ceiling": "Roughcast",
    "Chair": "VarnishedPine",
    "Desk": "VarnishedPine",
    "DesktopComputer": "BakelitePlastic",
    "E-puck": "Pcb",
    "EPuck": "Pcb",
    "Floor": "ChequeredParquetry",
    "HotPlate": "BakelitePlastic",
    "Keyboard": "BakelitePlastic",
    "LJoint": "OldSteel",
    "Monitor": "BakelitePlastic",
    "OfficeChair": "BakelitePlastic",
    "PipeSection": "MetalPipePaint",
    "PottedTree": "Grass",
    "RoundTable": "VarnishedPine",
    "Sink": "BrushedSteel",
    "Sofa": "BlanketFabric",
    "TJoint": "OldSteel",
    "Television": "BakelitePlastic",
    "TurtleBot3Burger": "BakelitePlastic",
    "Wall": "Roughcast",
    "WoodenBox": "RoughPine",
    "WoodenChair": "VarnishedPine",
    "WoodenPallet": "RoughPine",
    "WoodenPalletStack": "RoughPine",
}
"""Appearances of objects by default: those of the field `appearance` in Webots, or similar ones."""
