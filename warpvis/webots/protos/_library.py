# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of Webots' library that stand in for missing PROTO files and textures, in sRGB from 0 to 1.

Numbers of appearances (colors without a texture, roughness, metalness, default factors) are those of the PROTO files in
projects/appearances/protos. Colors of textures are estimates of their means: measured on public copies of the images
(chequered parquetry, light asphalt, red bricks), otherwise by eye. Colors of objects are the defaults of their PROTO
files and of Webots' user guide (https://cyberbotics.com/doc/guide, the pages of objects), or of pictures there and
of worlds, divided by the light in them.
"""

from __future__ import annotations

import re
from typing import NamedTuple

Color = tuple[float, float, float]


class Finish(NamedTuple):
    """An appearance without its textures."""

    color: Color
    """Its color by default: of the texture, times `factor`."""
    roughness: float = 1.0
    metalness: float = 0.0
    factor: Color = (1.0, 1.0, 1.0)
    """Default of the field that multiplies the texture."""


WHITE = (1.0, 1.0, 1.0)
_DARK, _STEEL, _WOOD = (0.15, 0.15, 0.15), (0.6, 0.6, 0.6), (0.62, 0.46, 0.31)
_CONCRETE, _STONE, _SOIL = (0.6, 0.59, 0.57), (0.55, 0.52, 0.48), (0.36, 0.28, 0.2)
_PINE = (0.8039, 0.6745, 0.5764)  # the default color of VarnishedPine, which multiplies the next
_VARNISHED = (0.82, 0.66, 0.455)

FINISHES: dict[str, Finish] = {
    "AcousticFoam": Finish((0.25, 0.25, 0.26)),
    "ArtificialGrass": Finish((0.25, 0.45, 0.15)),
    "Asphalt": Finish((0.3, 0.3, 0.3)),
    "BakelitePlastic": Finish((0.36, 0.12, 0.1), 0.4),
    "BeigeMarble": Finish((0.8, 0.74, 0.65), 0.3),
    "BlanketFabric": Finish((0.78, 0.78, 0.77)),
    "BrushedAluminium": Finish((0.78, 0.78, 0.79), 0.4, 1.0),
    "BrushedSteel": Finish((0.62, 0.62, 0.62), 0.4, 1.0),
    "CarLeather": Finish(_DARK, 0.6),
    "Cardboard": Finish((0.72, 0.56, 0.38)),
    "CarpetFabric": Finish((0.45, 0.4, 0.38)),
    "CarpetFibers": Finish((0.5, 0.45, 0.4)),
    "CasterTireRubberWheel": Finish(_DARK),
    "CementTiles": Finish(_CONCRETE, 0.7),
    "ChequeredParquetry": Finish((0.65, 0.45, 0.37), 0.6),
    "CimentTiles": Finish(_CONCRETE, 0.7),
    "Cloth": Finish((0.6, 0.58, 0.55)),
    "Copper": Finish((0.75, 0.46, 0.33), 0.4, 1.0),
    "CorrodedMetal": Finish((0.42, 0.33, 0.27), 0.7, 0.5),
    "CorrugatedMetal": Finish((0.66, 0.67, 0.68), 0.4, 1.0),
    "CorrugatedPlates": Finish((0.65, 0.66, 0.66), 0.5, 0.5),
    "CorrugatedPvc": Finish((0.75, 0.75, 0.75), 0.6),
    "CrossTireRubberWheel": Finish(_DARK),
    "DamascusSteel": Finish((0.5, 0.5, 0.5), 0.4, 1.0),
    "DarkParquetry": Finish((0.35, 0.23, 0.15), 0.6),
    "DryMud": Finish((0.5, 0.41, 0.31)),
    "ElectricConduit": Finish((0.45, 0.45, 0.45), 0.6),
    "Fabric": Finish((0.55, 0.5, 0.45)),
    "FlexibleAluminiumDuct": Finish((0.75, 0.75, 0.75), 0.4, 1.0),
    "FormedConcrete": Finish(_CONCRETE),
    "GalvanizedMetal": Finish((0.63, 0.65, 0.66), 0.4, 1.0),
    "GenericDoorAppearance": Finish((0.8, 0.78, 0.74), 0.6),
    "GlossyCarPaint": Finish(WHITE, 0.2),
    "GlossyPaint": Finish(WHITE, 0.2),
    "GoldPaper": Finish((0.83, 0.67, 0.35), 0.4, 1.0),
    "Grass": Finish((0.28, 0.4, 0.17)),
    "GridTiles": Finish((0.75, 0.75, 0.75), 0.5),
    "HammeredCopper": Finish((0.72, 0.45, 0.32), 0.4, 1.0),
    "HolesPerforatedSteel": Finish(_STEEL, 0.4, 1.0),
    "Leather": Finish((0.35, 0.22, 0.15), 0.6),
    "LedStrip": Finish((0.9, 0.9, 0.85), 0.5),
    "LightParquetry": Finish((0.72, 0.56, 0.38), 0.6),
    "Marble": Finish((0.8, 0.79, 0.77), 0.3),
    "MarbleTiles": Finish((0.78, 0.76, 0.72), 0.3),
    "MatteCarPaint": Finish(WHITE, 0.7),
    "MattePaint": Finish(WHITE, 0.7),
    "MetalPipePaint": Finish((0.75, 0.64, 0.13), 0.5),
    "MetalStainlessSteelCable": Finish(_STEEL, 0.4, 1.0),
    "OldPlywood": Finish((0.6, 0.48, 0.34)),
    "OldSteel": Finish((0.5, 0.48, 0.46), 0.5, 1.0),
    "OldStonePavement": Finish(_STONE),
    "OsbWood": Finish((0.7, 0.56, 0.36)),
    "PaintedWood": Finish(WHITE, 0.6),
    "Parquetry": Finish((0.6, 0.43, 0.28), 0.6),
    "Pavement": Finish((0.58, 0.56, 0.53)),
    "Pcb": Finish((0.1, 0.35, 0.18), 0.5),
    "PerforatedMetal": Finish(_STEEL, 0.3, 1.0),
    "Plaster": Finish((0.85, 0.83, 0.78)),
    "Plastic": Finish(WHITE, 0.6),
    "PlasticGrid": Finish((0.4, 0.4, 0.4), 0.6),
    "PlasticPolymer": Finish((0.3, 0.3, 0.3), 0.6),
    "PlasticTarp": Finish((0.3, 0.4, 0.55), 0.5),
    "PorcelainChevron": Finish((0.8, 0.79, 0.76), 0.3),
    "PorcelainChevronTiles": Finish((0.8, 0.79, 0.76), 0.3),
    "RedBricks": Finish((0.61, 0.47, 0.44)),
    "ReflectiveSurface": Finish((0.9, 0.9, 0.9), 0.2, 0.5),
    "Roughcast": Finish(WHITE),
    "RoughConcrete": Finish(_CONCRETE),
    "RoughOak": Finish((0.55, 0.42, 0.28)),
    "RoughPine": Finish((0.75, 0.6, 0.4)),
    "RoughPolymer": Finish(WHITE, 0.7),
    "Rubber": Finish(_DARK),
    "RusticVeneerWood": Finish((0.5, 0.36, 0.24), 0.6),
    "RustyMetal": Finish((0.45, 0.3, 0.2), 0.8, 0.5),
    "Sand": Finish((0.76, 0.66, 0.5)),
    "SandyGround": Finish((0.66, 0.56, 0.42)),
    "ScratchedPaint": Finish((0.7, 0.7, 0.7), 0.5),
    "ScrewThread": Finish(_STEEL, 0.4, 1.0),
    "ScuffedPlastic": Finish((0.75, 0.75, 0.75), 0.6),
    "ShinyLeather": Finish((0.2, 0.15, 0.13), 0.3),
    "SlatePavement": Finish((0.4, 0.41, 0.42)),
    "Soil": Finish(_SOIL),
    "SolarCell": Finish((0.1, 0.12, 0.25), 0.3),
    "SquarePavement": Finish(_STONE),
    "StonePavement": Finish(_STONE),
    "ThreadMetalPlate": Finish((0.58, 0.58, 0.58), 0.4, 1.0),
    "TireRubber": Finish(_DARK),
    "VarnishedPine": Finish((0.66, 0.44, 0.25), 0.5, factor=_PINE),
    "WireFence": Finish((0.6, 0.6, 0.6), 0.6),
    "WoodPanel": Finish(_WOOD, 0.6),
    "WornBurlap": Finish((0.6, 0.5, 0.36)),
}
"""Appearance PROTOs."""

VARIANTS: dict[str, tuple[str, dict[str, Color]]] = {
    "BakelitePlastic": ("color", {"braun": (0.24, 0.16, 0.12)}),
    "CarpetFibers": ("type", {"synthetic": (0.45, 0.45, 0.45), "wooly": (0.6, 0.55, 0.48)}),
    "Grass": (
        "type",
        {
            "artificial": (0.25, 0.45, 0.15),
            "artificial_white": (0.85, 0.87, 0.85),
            "mossy": (0.3, 0.36, 0.18),
            "prickly": (0.38, 0.42, 0.22),
        },
    ),
    "Leather": ("tone", {"light": (0.62, 0.46, 0.32)}),
    "Parquetry": (
        "type",
        {
            "chequered": FINISHES["ChequeredParquetry"].color,
            "dark strip": FINISHES["DarkParquetry"].color,
            "light strip": FINISHES["LightParquetry"].color,
        },
    ),
    "Pavement": (
        "type",
        {
            "black stone": (0.27, 0.27, 0.28),
            "braun square stone": (0.52, 0.45, 0.38),
            "braun stone": (0.5, 0.43, 0.36),
            "slate": FINISHES["SlatePavement"].color,
            "tiles": (0.66, 0.63, 0.6),
        },
    ),
}
"""Field that chooses between textures of an appearance PROTO, and their colors; other values have that of `FINISHES`.
"""

_WORDS: tuple[tuple[str, Color], ...] = (
    ("light_asphalt", (0.52, 0.52, 0.52)),
    ("lightwood|light_wood", (0.75, 0.6, 0.42)),
    ("tagged_wall", (0.5, 0.38, 0.24)),
    ("asphalt|road", FINISHES["Asphalt"].color),
    ("parquet", FINISHES["Parquetry"].color),
    ("dry_grass", (0.55, 0.5, 0.3)),
    ("grass|leaves|lawn", FINISHES["Grass"].color),
    ("brick", FINISHES["RedBricks"].color),
    ("cardboard|cork", FINISHES["Cardboard"].color),
    ("oil_barrel", (0.37, 0.18, 0.15)),
    ("rust", FINISHES["RustyMetal"].color),
    ("wood|plank|oak|pine|bark", _WOOD),
    ("marble", FINISHES["Marble"].color),
    ("tile", (0.78, 0.77, 0.75)),
    ("concrete|cement", _CONCRETE),
    ("stone|rock|pavement", _STONE),
    ("sand", FINISHES["Sand"].color),
    ("soil|mud|dirt|ground", _SOIL),
    ("carpet|fabric|cloth", FINISHES["Fabric"].color),
    ("leather", FINISHES["Leather"].color),
    ("rubber|tire", _DARK),
    ("steel|alumin|metal|iron", _STEEL),
)
"""Words in the names of texture files, the first match applies, and mean colors of such textures."""

OBJECTS: dict[str, str | Color] = {
    "Apple": (0.42, 0.58, 0.18),
    "Armchair": "BlanketFabric",
    "Astra": _DARK,
    "Bed": "VarnishedPine",
    "BmwX5": (0.43, 0.11, 0.1),
    "Cabinet": "VarnishedPine",
    "Can": (0.55, 0.12, 0.14),
    "Carafe": (0.86, 0.88, 0.88),
    "CardboardBox": "Cardboard",
    "Carpet": "CarpetFibers",
    "Ceiling": "Roughcast",
    "Chair": "VarnishedPine",
    "CitroenCZero": (0.85, 0.85, 0.05),
    "ConveyorBelt": (0.25, 0.25, 0.26),
    "Desk": "VarnishedPine",
    "DesktopComputer": _DARK,
    "E-puck": "Pcb",
    "EPuck": "Pcb",
    "Floor": "ChequeredParquetry",
    "Fridge": (0.74, 0.72, 0.71),
    "HotPlate": (0.06, 0.06, 0.06),
    "Keyboard": _DARK,
    "Kinect": _DARK,
    "KukaBox": "Cardboard",
    "LJoint": "OldSteel",
    "LincolnMKZ": (0.3, 0.3, 0.32),
    "Monitor": (0.06, 0.06, 0.06),
    "OfficeChair": _DARK,
    "OilBarrel": (0.37, 0.18, 0.15),
    "Orange": (0.9, 0.52, 0.12),
    "Oven": (0.52, 0.52, 0.52),
    "Panel": (0.62, 0.45, 0.3),
    "PipeSection": "MetalPipePaint",
    "PlasticCrate": (0.35, 0.45, 0.6),
    "PottedTree": "Grass",
    "RangeRoverSportSVR": (0.0, 0.25, 0.65),
    "RoundTable": "VarnishedPine",
    "Sink": "BrushedSteel",
    "Sofa": "BlanketFabric",
    "SolidBox": (0.5, 0.38, 0.24),
    "SquareManhole": (0.3, 0.3, 0.3),
    "TJoint": "OldSteel",
    "Television": (0.06, 0.06, 0.06),
    "TeslaModel3": (1.0, 0.0, 0.0),
    "TexturedBox": (0.5, 0.38, 0.24),
    "TexturedBoxShape": (0.5, 0.38, 0.24),
    "ToyotaPrius": (0.68, 0.7, 0.72),
    "TrafficCone": (0.9, 0.42, 0.06),
    "TurtleBot3Burger": _DARK,
    "Wall": "Roughcast",
    "WoodenBox": (0.34, 0.25, 0.17),
    "WoodenChair": "VarnishedPine",
    "WoodenPallet": "RoughPine",
    "WoodenPalletStack": "RoughPine",
    "Worktop": (0.86, 0.79, 0.63),
    **dict.fromkeys(("BathroomSink", "Bathtube", "Toilet", "WashingMachine"), (0.93, 0.93, 0.92)),
}
"""Appearance or color of an object by default, by PROTO; cars have theirs also as "Simple"."""

UNKNOWN: Color = (0.7, 0.7, 0.7)
"""Color of other stand-ins."""


def texture_finish(url: str) -> Finish | None:
    """Return the mean color of a texture, by the name of its file, and the finish; None if the name is unknown.

    Webots' own textures are named by their appearance: ``brushed_aluminium_base_color.jpg``.
    """
    name = re.split(r"[/\\]", url)[-1].lower()
    stem = re.sub(r"(_base_color|_diffuse)?\.\w+$", "", name)
    finish = _BY_FILE.get(stem.replace("_", ""))
    if finish is not None:
        return finish
    color = next((color for words, color in _WORDS if re.search(words, name)), None)
    return None if color is None else Finish(color)


_BY_FILE = {
    name.lower(): finish._replace(color=_VARNISHED if finish.factor == _PINE else finish.color)
    for name, finish in FINISHES.items()
}
