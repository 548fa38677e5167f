# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials of UsdShade: UsdPreviewSurface with its textures, and the constant colors of other surface shaders."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Sdf, UsdShade

from warpvis.scene.materials import Wrap

Transform = tuple[tuple[float, float], float, tuple[float, float]]
"""Scale, rotation [degrees, counterclockwise] and translation of texture coordinates."""

_WRAPS: dict[str, Wrap] = {"clamp": "clamp", "black": "clamp", "mirror": "mirror"}
_SURFACES = ("UsdPreviewSurface", "ND_UsdPreviewSurface_surfaceshader")
_COLORS = (
    *("diffuse_color_constant", "diffuse_reflection_color", "base_color", "baseColor", "diffuse_color"),
    *("diffuseColor", "diffuse_tint", "glass_color", "albedo", "basecolor", "Base_Color", "color", "tint"),
)
"""Inputs for the color of shaders other than UsdPreviewSurface, the best first."""

_MDL_DEFAULT = (0.2, 0.2, 0.2)
"""The default of `diffuse_color_constant` of OmniPBR."""

_GRAY = (0.18, 0.18, 0.18)
"""The default color of UsdPreviewSurface."""

_MAX_NODES = 64


@dataclass(frozen=True)
class UvSource:
    """Where a texture has its coordinates from."""

    primvar: str = "st"
    transforms: tuple[Transform, ...] = ()
    """Transforms of UsdTransform2d, the first to be applied first."""


@dataclass(frozen=True)
class TextureSource:
    """A texture, and the channel of it that an input is connected to."""

    path: str
    """Resolved path, possibly in an archive; empty if the file is missing."""
    name: str
    channel: str
    """``"rgb"``, ``"r"``, ``"g"``, ``"b"`` or ``"a"``."""
    uv: UvSource
    wrap_u: Wrap = "repeat"
    wrap_v: Wrap = "repeat"
    color_space: str = "auto"
    """``"raw"``, ``"sRGB"`` or ``"auto"``."""
    scale: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    fallback: tuple[float, ...] | None = None


@dataclass(frozen=True)
class PrimvarSource:
    """A primvar that an input is connected to."""

    primvar: str
    fallback: Any = None


Value = float | tuple[float, ...] | TextureSource | PrimvarSource


@dataclass(eq=False)
class MaterialSource:
    """The inputs of a material's surface shader, by the names of UsdPreviewSurface."""

    name: str
    inputs: dict[str, Value] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """Properties that are not read, as parts of a sentence."""

    @property
    def content(self) -> tuple[tuple[str, Value], ...]:
        """A key that is equal for equal materials."""
        return tuple(sorted(self.inputs.items(), key=lambda item: item[0]))

    def number(self, name: str, default: float) -> float:
        """Return a constant input, or the default if it is not constant."""
        value = self.inputs.get(name)
        return value if isinstance(value, float) and np.isfinite(value) else default

    def color(self, name: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return a constant color, or the default if it is not constant."""
        value = self.inputs.get(name)
        value = value.fallback if isinstance(value, PrimvarSource) else value
        if not isinstance(value, tuple) or len(value) < 3 or not np.isfinite(value).all():
            return default
        return value[0], value[1], value[2]

    def texture(self, name: str) -> TextureSource | None:
        """Return the texture of an input, if its file exists."""
        value = self.inputs.get(name)
        return value if isinstance(value, TextureSource) and value.path else None


def read_material(material: Any, time: Any) -> MaterialSource:
    """Read a `UsdShade.Material`."""
    found = MaterialSource(str(material.GetPath()))
    shader = _surface(material)
    if shader is None:
        found.notes.append(f"material <{found.name}> without a surface shader")
        return found
    kind = _shader_id(shader)
    if kind in _SURFACES:
        for item in shader.GetInputs():
            value = _value(item, time, found)
            if value is not None:
                found.inputs[str(item.GetBaseName())] = value
        return found
    _read_other(shader, kind, time, found)
    return found


def _surface(material: Any) -> Any:
    """Return the surface shader of a material, UsdPreviewSurface if it has one."""
    found = None
    for context in ("", "mtlx", "mdl"):
        shader = material.ComputeSurfaceSource(context)[0]
        if shader:
            if _shader_id(shader) in _SURFACES:
                return shader
            found = found or shader
    if found is None:  # a renderer's own context
        for output in material.GetSurfaceOutputs():
            for source in output.GetConnectedSources()[0]:
                return UsdShade.Shader(source.source.GetPrim())
    return found


def _shader_id(shader: Any) -> str:
    """Return the identifier of a shader: its id, or the name of its MDL material."""
    prim = shader.GetPrim()
    for name in ("info:id", "info:mdl:sourceAsset:subIdentifier"):
        value = prim.GetAttribute(name).Get()
        if value:
            return str(value)
    asset = prim.GetAttribute("info:mdl:sourceAsset").Get()
    return str(asset.path) if asset else ""


def _read_other(shader: Any, kind: str, time: Any, found: MaterialSource) -> None:
    """Read the color of a shader that is not UsdPreviewSurface."""
    inputs = {str(item.GetBaseName()): item for item in shader.GetInputs()}
    values = {name: _value(inputs[name], time, found) for name in _COLORS if name in inputs}
    color = next((value for value in values.values() if isinstance(value, tuple) and len(value) >= 3), None)
    texture = _mdl_texture(inputs, time)
    if texture is not None:
        tint = values.get("diffuse_tint")
        scale = (*tint[:3], 1.0) if isinstance(tint, tuple) and len(tint) >= 3 else (1.0, 1.0, 1.0, 1.0)
        found.inputs["diffuseColor"] = TextureSource(*texture, "rgb", UvSource(), scale=scale)
    elif color is not None:
        found.inputs["diffuseColor"] = color
    elif kind.startswith("OmniPBR"):
        found.inputs["diffuseColor"] = _MDL_DEFAULT
    else:
        found.notes.append(f"{kind or 'shader'} of material <{found.name}>, which is gray")
    names = {
        "roughness": ("reflection_roughness_constant", "specular_roughness", "roughness"),
        "metallic": ("metallic_constant", "metalness", "base_metalness", "metallic"),
    }
    for target, sources in names.items():
        numbers = (_value(inputs[name], time, found) for name in sources if name in inputs)
        number = next((value for value in numbers if isinstance(value, float)), None)
        if number is not None:
            found.inputs[target] = number


def _mdl_texture(inputs: dict[str, Any], time: Any) -> tuple[str, str] | None:
    """Return the resolved path and the name of the color texture of OmniPBR; None without one."""
    item = inputs.get("diffuse_texture")
    source = None if item is None else _constant(item, time)
    if not isinstance(source, Sdf.AssetPath) or not source.resolvedPath:
        return None
    return str(source.resolvedPath), str(source.path)


def _constant(item: Any, time: Any) -> Any:
    """Return the value of an input, followed through the inputs that it is connected to."""
    for attribute in item.GetValueProducingAttributes():
        if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Input:
            return attribute.Get(time)
    return item.Get(time)


def _value(item: Any, time: Any, found: MaterialSource) -> Value | None:
    """Read an input of a surface shader: a constant, a texture or a primvar; None if it is not authored."""
    attributes = item.GetValueProducingAttributes()
    if not attributes:
        return None
    attribute = attributes[0]
    if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Input:
        return _plain(attribute.Get(time))
    shader = UsdShade.Shader(attribute.GetPrim())
    kind = _shader_id(shader)
    if kind == "UsdUVTexture":
        return _texture(shader, str(attribute.GetName()).removeprefix("outputs:"), time, found)
    if kind.startswith("UsdPrimvarReader"):
        name = _constant_of(shader, "varname", time)
        return PrimvarSource(str(name or ""), _plain(_constant_of(shader, "fallback", time)))
    found.notes.append(f"{kind or 'a shader'} at {item.GetBaseName()} of material <{found.name}>")
    return None


def _plain(value: Any) -> Any:
    """Return a number or a vector of USD as Python numbers; None for others."""
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int | float):
        return float(value)
    try:
        return tuple(float(number) for number in value)
    except (TypeError, ValueError):
        return None


def _constant_of(shader: Any, name: str, time: Any) -> Any:
    item = shader.GetInput(name)
    return _constant(item, time) if item else None


def _texture(shader: Any, output: str, time: Any, found: MaterialSource) -> TextureSource | None:
    source = _constant_of(shader, "file", time)
    if not isinstance(source, Sdf.AssetPath) or not source.path:
        found.notes.append(f"a texture without a file of material <{found.name}>")
        return None
    path, name = str(source.resolvedPath), str(source.path)
    if "<UDIM>" in name or "<UVTILE>" in name:
        found.notes.append(f"UDIM texture {name!r} of material <{found.name}>, which Blender can bake into one image")
        path = ""
    elif not path:
        found.notes.append(f"texture {name!r}, which was not found")
    wraps = [_WRAPS.get(str(_constant_of(shader, key, time)), "repeat") for key in ("wrapS", "wrapT")]
    numbers = {key: _plain(_constant_of(shader, key, time)) for key in ("scale", "bias", "fallback")}
    given = {key: value for key, value in numbers.items() if isinstance(value, tuple) and len(value) == 4}
    color_space = str(_constant_of(shader, "sourceColorSpace", time) or "auto")
    uv = _uv_source(shader.GetInput("st"), time)
    channel = output if output in ("r", "g", "b", "a") else "rgb"
    texture = TextureSource(path, name, channel, uv, wraps[0], wraps[1], color_space, **given)
    if not path and texture.fallback is not None:
        fallback = texture.fallback
        return fallback[:3] if channel == "rgb" else fallback["rgba".index(channel)]  # type: ignore[return-value]
    return texture


def _uv_source(item: Any, time: Any) -> UvSource:
    """Follow the connection of texture coordinates to the primvar, through transforms."""
    transforms: list[Transform] = []
    for _ in range(_MAX_NODES):
        attributes = item.GetValueProducingAttributes() if item else []
        if not attributes:
            break
        shader = UsdShade.Shader(attributes[0].GetPrim())
        kind = _shader_id(shader) if shader else ""
        if kind.startswith("UsdPrimvarReader"):
            return UvSource(str(_constant_of(shader, "varname", time) or "st"), tuple(reversed(transforms)))
        if kind != "UsdTransform2d":
            break
        scale, translation = (_plain(_constant_of(shader, key, time)) for key in ("scale", "translation"))
        rotation = _plain(_constant_of(shader, "rotation", time))
        transforms.append((_pair(scale, 1.0), rotation or 0.0, _pair(translation, 0.0)))
        item = shader.GetInput("in")
    return UvSource(transforms=tuple(reversed(transforms)))


def _pair(value: Any, default: float) -> tuple[float, float]:
    return value if isinstance(value, tuple) and len(value) == 2 else (default, default)
