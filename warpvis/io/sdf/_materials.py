# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials of visuals: colors, maps of physically based rendering, and scripts of Ogre.

Colors are display values (sRGB). The base color is `diffuse`; the separate `ambient` color of a surface is not used,
unless it is the only one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from warpvis.core.checks import truncate
from warpvis.core.file_content import is_file
from warpvis.io.sdf._files import Finder
from warpvis.io.sdf._xml import Node
from warpvis.scene.materials import Material, Texture

DEFAULT = Material("gazebo default", base_color=(0.7, 0.7, 0.7, 1.0))
"""Material of shapes without one: the diffuse color of gz-sim's (src/rendering/SceneManager.cc)."""

Color = tuple[float, ...]

# Diffuse colors of the materials of Gazebo Classic (media/materials/scripts/gazebo.material), by name after "Gazebo/";
# emitted ones follow. SkyBlue has its ambient color: its diffuse color is that of Blue.
_GAZEBO: dict[str, tuple[Color, Color]] = {
    "Grey": ((0.7, 0.7, 0.7), ()),  # codespell:ignore
    "Gray": ((0.7, 0.7, 0.7), ()),
    "DarkGrey": ((0.175, 0.175, 0.175), ()),
    "DarkGray": ((0.175, 0.175, 0.175), ()),
    "White": ((1, 1, 1), ()),
    "FlatBlack": ((0.1, 0.1, 0.1), ()),
    "Black": ((0, 0, 0), ()),
    "Red": ((1, 0, 0), ()),
    "RedBright": ((0.87, 0.26, 0.07), ()),
    "Green": ((0, 1, 0), ()),
    "Blue": ((0, 0, 1), ()),
    "SkyBlue": ((0.13, 0.44, 0.7), ()),
    "Yellow": ((1, 1, 0), ()),
    "ZincYellow": ((0.9725, 0.9529, 0.2078), ()),
    "Purple": ((1, 0, 1), ()),
    "Turquoise": ((0, 1, 1), ()),
    "Orange": ((1, 0.5088, 0.0468), ()),
    "WhiteGlow": ((1, 1, 1), (1, 1, 1)),
    "RedGlow": ((1, 0, 0), (1, 0, 0)),
    "GreenGlow": ((0, 1, 0), (0, 1, 0)),
    "BlueGlow": ((0, 0, 1), (0, 0, 1)),
    "YellowGlow": ((1, 1, 0), (1, 1, 0)),
    "PurpleGlow": ((1, 0, 1), (1, 0, 1)),
    "TurquoiseGlow": ((0, 1, 1), (0, 1, 1)),
    "LightOn": ((0, 1, 0), (0, 1, 0)),
    "LightOff": ((1, 0, 0), (1, 0, 0)),
    "RedTransparent": ((1, 0, 0, 0.5), ()),
    "GreenTransparent": ((0, 1, 0, 0.5), ()),
    "BlueTransparent": ((0, 0, 1, 0.5), ()),
    "GreyTransparent": ((0.5, 0.5, 0.5, 0.5), ()),
    "YellowTransparent": ((1, 1, 0, 0.5), ()),
    "OrangeTransparent": ((1, 0.44, 0, 0.4), ()),
    "BlueLaser": ((0, 0, 1, 0.4), ()),
    "Pioneer2Body": ((0.681193, 0.000923, 0.000923), ()),
    "Gold": ((0.8, 0.648690, 0.120759), ()),
}
# Mean colors of the textures of other materials, estimated by eye, where the images are not available.
_GAZEBO_TEXTURED: dict[str, Color] = {
    "WoodFloor": (0.63, 0.45, 0.29),
    "Wood": (0.55, 0.37, 0.22),
    "WoodPallet": (0.62, 0.49, 0.34),
    "CeilingTiled": (0.8, 0.8, 0.78),
    "PaintedWall": (0.86, 0.83, 0.76),
    "Bricks": (0.55, 0.3, 0.24),
    "Road": (0.3, 0.3, 0.3),
    "Residential": (0.33, 0.33, 0.33),
    "Pedestrian": (0.6, 0.58, 0.55),
    "Grass": (0.3, 0.45, 0.2),
    "CloudySky": (0.65, 0.75, 0.88),
}
_MAX_SCRIPT = 4_000_000
"""Maximum size of a script [bytes]."""
_TOKEN = re.compile(r'"[^"]*"|[{}:]|[^\s{}:"]+')
_COMMENTS = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_COLORS = ("ambient", "diffuse", "specular", "emissive")


@dataclass
class _Script:
    """A material of an Ogre script."""

    colors: dict[str, Color] = field(default_factory=dict)
    texture: str = ""
    folder: Path = field(default_factory=Path)


@dataclass
class Materials:
    """Reads the materials of visuals."""

    finder: Finder
    missing: dict[str, None] = field(default_factory=dict)
    """Names of materials and images that were not found."""
    _scripts: dict[Path, dict[str, _Script]] = field(default_factory=dict)
    _textures: dict[tuple[Path, str], Texture] = field(default_factory=dict)

    def material(self, visual: Node) -> Material | None:
        """Return the material of a visual or an actor's skin; None without one."""
        node = visual.child("material")
        if node is None:
            return None
        named = self._script_material(node)
        found = self._with_colors(node, named or Material("sdf"))
        if (
            named is None
            and node.child("pbr") is None
            and all(node.child(tag) is None for tag in ("diffuse", "ambient"))
        ):
            found = replace(found, base_color=DEFAULT.base_color)
        found = self._with_maps(node, found)
        alpha = found.base_color[3]
        mode = "blend" if alpha < 1 else found.alpha_mode
        shading = found.shading if node.flag("lighting", True) else "unlit"
        return replace(found, alpha_mode=mode, shading=shading, double_sided=node.flag("double_sided", False))

    def _with_colors(self, node: Node, found: Material) -> Material:
        changes: dict[str, Any] = {}
        base = node.color("diffuse") or node.color("ambient")
        if base is not None and found.texture is None:
            changes["base_color"] = base
        if (specular := node.color("specular")) is not None:
            changes["specular"] = specular[:3]
        if (emissive := node.color("emissive")) is not None:
            changes["emission"] = emissive[:3]
        # Highlights with the exponent 0, the default, would cover the whole surface.
        changes["shininess"] = node.number("shininess", found.shininess, minimum=0.0)
        if changes["shininess"] == 0:
            changes["specular"] = (0.0, 0.0, 0.0)
        return replace(found, **changes)

    def _with_maps(self, node: Node, found: Material) -> Material:
        """Add the properties of ``<pbr>``: the metal workflow, else the specular one."""
        metal = node.child("pbr/metal")
        pbr = metal if metal is not None else node.child("pbr/specular")
        if pbr is None:
            return found
        maps = {
            "texture": self._texture(pbr, "albedo_map"),
            "normal_texture": self._texture(pbr, "normal_map", "linear"),
            "emissive_texture": self._texture(pbr, "emissive_map"),
            "occlusion_texture": self._texture(pbr, "ambient_occlusion_map", "linear"),
        }
        roughness_map, metalness_map = (self._path(pbr, name) for name in ("roughness_map", "metalness_map"))
        gloss = min(max(pbr.number("glossiness", 0.5), 0.0), 1.0)
        roughness = min(max(pbr.number("roughness", 1.0 if roughness_map else 0.5), 0.0), 1.0)
        metallic = min(max(pbr.number("metalness", 1.0 if metalness_map else 0.5), 0.0), 1.0)
        if metal is None:
            roughness, metallic = 1 - gloss, 0.0
        if roughness_map is not None or metalness_map is not None:
            maps["metallic_roughness_texture"] = _packed(roughness_map, metalness_map)
        changes: dict[str, Any] = {name: texture for name, texture in maps.items() if texture is not None}
        if "texture" in changes and node.child("diffuse") is None:
            changes["base_color"] = (1.0, 1.0, 1.0, 1.0)
        if "emissive_texture" in changes and node.child("emissive") is None:
            changes["emission"] = (1.0, 1.0, 1.0)
        return replace(found, shading="pbr", roughness=roughness, metallic=metallic, **changes)

    def _path(self, pbr: Node, tag: str) -> Path | None:
        node = pbr.child(tag)
        uri = "" if node is None else node.string()
        if node is None or not uri:
            return None
        found = self.finder.file(uri, node)
        if found is None:
            self.missing[truncate(uri)] = None
        return found

    def _texture(self, pbr: Node, tag: str, color_space: Any = "srgb") -> Texture | None:
        path = self._path(pbr, tag)
        return None if path is None else self.texture(path, color_space)

    def texture(self, path: Path, color_space: Any = "srgb") -> Texture:
        """Return the texture of an image file; the same object for the same file."""
        key = path, color_space
        if key not in self._textures:
            self._textures[key] = Texture(path, color_space=color_space)
        return self._textures[key]

    def _script_material(self, node: Node) -> Material | None:
        """Return the material of a script of Ogre; None without one."""
        script = node.child("script")
        name = "" if script is None else script.string("name") or script.string()
        if script is None or not name:
            return None
        folders = [place for uri in script.children("uri") if (place := self._folder(uri)) is not None]
        for place in folders:
            for path in [place] if is_file(place) else sorted(place.glob("*.material")):
                found = self._read_script(path).get(name)
                if found is not None:
                    return self._from_script(name, found, [item if item.is_dir() else item.parent for item in folders])
        head, _, tail = name.partition("/")
        if head == "Gazebo" and tail in _GAZEBO:
            color, emission = _GAZEBO[tail]
            return Material(name, (*color, 1.0)[:4], emission=emission or (0.0, 0.0, 0.0))  # type: ignore[arg-type]
        if head == "Gazebo" and tail in _GAZEBO_TEXTURED:
            return Material(name, (*_GAZEBO_TEXTURED[tail], 1.0))  # type: ignore[arg-type]
        if node.child("diffuse") is None and node.child("ambient") is None and node.child("pbr") is None:
            self.missing[truncate(name)] = None
            return replace(DEFAULT, name=name)
        return None

    def _folder(self, uri: Node) -> Path | None:
        """Return the file or folder of a script's URI."""
        for place in self.finder.places(uri.string(), uri):
            try:
                if place.exists():
                    return place
            except (OSError, ValueError):
                continue
        return None

    def _read_script(self, path: Path) -> dict[str, _Script]:
        if path not in self._scripts:
            try:
                text = path.read_bytes()[:_MAX_SCRIPT].decode(errors="replace")
            except OSError:
                text = ""
            self._scripts[path] = parse_script(text, path.parent)
        return self._scripts[path]

    def _from_script(self, name: str, script: _Script, folders: list[Path]) -> Material:
        color = script.colors.get("diffuse") or script.colors.get("ambient") or (1.0, 1.0, 1.0)
        r, g, b, alpha = (*color, 1.0)[:4]
        texture = None
        if script.texture:
            places = [*folders, script.folder, script.folder.parent / "textures"]
            path = next((place / script.texture for place in places if is_file(place / script.texture)), None)
            if path is None:
                self.missing[truncate(script.texture)] = None
            else:
                texture = self.texture(path)
        red, green, blue = (*script.colors.get("emissive", ()), 0.0, 0.0, 0.0)[:3]
        # Ogre's textures replace nothing: they are multiplied with diffuse light, which is white by default.
        return Material(name, (r, g, b, alpha), texture=texture, emission=(red, green, blue))


def parse_script(text: str, folder: Path) -> dict[str, _Script]:
    """Parse the materials of an Ogre script: their first colors and their first texture; others are ignored."""
    tokens = _TOKEN.findall(_COMMENTS.sub(" ", text))
    found: dict[str, _Script] = {}
    position = 0
    while position < len(tokens):
        if tokens[position] != "material" or position + 1 >= len(tokens):
            position += 1
            continue
        end = next((index for index in range(position, len(tokens)) if tokens[index] == "{"), len(tokens))
        name, _, parent = " ".join(tokens[position + 1 : end]).replace('"', "").partition(" : ")
        script = _Script(dict(found[parent].colors), found[parent].texture) if parent in found else _Script()
        script.folder = folder
        own: dict[str, Color] = {}
        depth, position, own_texture = 1, end + 1, ""
        while position < len(tokens) and depth:
            token = tokens[position]
            depth += (token == "{") - (token == "}")
            if token in _COLORS and token not in own and (color := _script_color(tokens, position + 1)):
                own[token] = color
            if token == "texture" and not own_texture and position + 1 < len(tokens):
                own_texture = tokens[position + 1].strip('"')
            position += 1
        script.colors.update(own)
        script.texture = own_texture or script.texture
        found.setdefault(name.strip(), script)
    return found


def _script_color(tokens: list[str], position: int) -> Color:
    values: list[float] = []
    for token in tokens[position : position + 4]:
        try:
            values.append(min(max(float(token), 0.0), 1.0))
        except ValueError:
            break
    return tuple(values) if len(values) >= 3 and np.isfinite(values).all() else ()


def _packed(roughness: Path | None, metalness: Path | None) -> Texture:
    """Return a texture with roughness in green and metalness in blue, as in glTF; a missing one is white."""
    sources = [None if path is None else Texture(path, color_space="linear").image for path in (roughness, metalness)]
    shape = max((image.shape[:2] for image in sources if image is not None), default=(1, 1))
    packed = np.full((*shape, 3), 255, dtype=np.uint8)
    rows, columns = (np.arange(count) for count in shape)
    for channel, image in zip((1, 2), sources, strict=True):
        if image is not None:
            nearest = np.ix_(rows * image.shape[0] // shape[0], columns * image.shape[1] // shape[1])
            packed[..., channel] = image[..., 0][nearest]
    return Texture(packed, "roughness and metalness", color_space="linear")
