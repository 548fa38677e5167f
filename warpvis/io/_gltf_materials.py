# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials, textures and vertex colors of glTF files.

They are read on first use. trimesh's reader drops wrap modes and filters, texture transforms, and second texture
coordinates. Section numbers are those of the glTF 2.0 specification.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception, truncate
from warpvis.core.user_warnings import warn_user
from warpvis.io._gltf_data import GltfData, uri_bytes, uri_name
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, ColorSpace, Filter, Material, Shading, Texture, Wrap

Locate = Callable[[str], Path | bytes | None]
"""Finds a referenced image without reading it; returns its bytes if it is in an archive, None if it is missing."""

TRANSFORM = "KHR_texture_transform"
_OLD = "KHR_materials_pbrSpecularGlossiness"
_UNLIT = "KHR_materials_unlit"
_WRAPS: dict[Any, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
_FILTERS: dict[Any, Filter] = {9728: "nearest", 9729: "linear"}
_COLORED = ("texture", "emissive_texture")
_SOURCES = ("EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu", "MSFT_texture_dds")

Attribute = Callable[[str], NDArray[np.generic]]
"""Reads an attribute of a primitive's vertices."""


class GltfMaterials:
    """The materials and textures of a file; each is read once."""

    def __init__(self, file: str, data: GltfData, locate: Locate) -> None:
        self._file, self._data, self._locate = file, data, locate
        self._known: dict[int, Material] = {}
        self._textures: dict[tuple[int, ColorSpace], Texture] = {}
        self._plain: dict[int, LazyAppearance] = {}

    def appearance(
        self, primitive: dict[str, Any], attribute: Attribute, vertices: int, name: str
    ) -> LazyAppearance | None:
        """Return the deferred appearance of a primitive; None if it defines none."""
        if primitive.get("material") is None and "COLOR_0" not in primitive["attributes"]:
            return None
        entry = self._numbers_alone(primitive)
        if entry is None:
            return LazyAppearance(
                partial(_read_or_warn, self._file, name, vertices, self._appearance, primitive, attribute)
            )
        index = primitive["material"]
        if index not in self._plain:
            self._plain[index] = LazyAppearance(partial(_read_or_warn, self._file, name, vertices, _plain, entry))
        return self._plain[index]

    def _numbers_alone(self, primitive: dict[str, Any]) -> dict[str, Any] | None:
        """Return the material of a primitive without arrays and textures, which needs no bytes of the file later."""
        if "COLOR_0" in primitive["attributes"]:
            return None
        try:
            entry = self._data.one("materials", primitive["material"])
            return None if _infos(entry) else entry
        except Exception:  # malformed files may raise any exception; it is reported on first use
            return None

    def _appearance(self, primitive: dict[str, Any], attribute: Attribute) -> Appearance:
        """Read the appearance of a primitive."""
        attributes, index = primitive["attributes"], primitive.get("material")
        colors = None
        if "COLOR_0" in attributes:  # the specification limits them to 0 to 1 (3.7.2.1)
            colors = np.clip(attribute("COLOR_0").astype(np.float32), 0.0, 1.0)
        if index is None:
            return Appearance((Material(color_space="linear"),), vertex_colors=colors)
        entry = self._data.one("materials", index)
        infos = _infos(entry)
        if index not in self._known:
            self._known[index] = _material(entry, **self._maps(entry, infos))
        sources = {name: source for name, info in infos.items() if (source := _uv_source(info))[0] in attributes}
        arrays = {source: _coordinates(attribute(source[0]), dict(source[1])) for source in set(sources.values())}
        first = sources.get("texture") if "texture" in infos else next(iter(sources.values()), None)
        map_uv = {name: arrays[source] for name, source in sources.items() if source != first}
        uv = None if first is None else arrays[first]
        return Appearance((self._known[index],), uv=uv, vertex_colors=colors, map_uv=map_uv)  # type: ignore[arg-type]

    def _maps(self, entry: dict[str, Any], infos: dict[str, dict[str, Any]]) -> dict[str, Texture]:
        """Read the textures of a material; except for the base color's, unreadable ones are left out with a warning."""
        found = {}
        for name, info in infos.items():
            try:
                found[name] = self._texture(info["index"], "srgb" if name in _COLORED else "linear")
            except Exception as error:  # malformed files may raise any exception
                if name == "texture":
                    raise
                reason = truncate(describe_exception(error))
                subject = f"material {truncate(str(entry.get('name') or ''))!r}"
                warn_user(f"{self._file}: left out the {name} of {subject} ({reason})", UserWarning)
        return found

    def _texture(self, index: Any, color_space: ColorSpace) -> Texture:
        """Read a texture (3.8); its image is decoded on first use."""
        entry = self._data.one("textures", index)
        key = index, color_space
        if key in self._textures:
            return self._textures[key]
        sampler = self._data.one("samplers", entry["sampler"]) if entry.get("sampler") is not None else {}
        extensions = entry.get("extensions") or {}
        alternatives = [extensions[name]["source"] for name in _SOURCES if name in extensions]
        number = entry.get("source", *alternatives[:1]) if alternatives else entry.get("source")
        source, name = self.image(number)
        self._textures[key] = Texture(
            source,
            name,
            wrap_u=_WRAPS.get(sampler.get("wrapS"), "repeat"),
            wrap_v=_WRAPS.get(sampler.get("wrapT"), "repeat"),
            filter=_FILTERS.get(sampler.get("magFilter"), "linear"),
            color_space=color_space,
            mipmaps=sampler.get("minFilter") not in _FILTERS,
        )
        return self._textures[key]

    def image(self, number: Any) -> tuple[Path | bytes, str]:
        """Return the file or the bytes of an image, and its name; no bytes if it is missing."""
        if number is None:
            return b"", "a texture without an image"
        entry = self._data.one("images", number)
        name = str(entry.get("name") or f"image {number}")
        if "bufferView" in entry:
            return self._data.view(entry["bufferView"]).tobytes(), name
        uri = str(entry.get("uri", ""))
        if uri.startswith("data:"):
            return uri_bytes(uri), name
        found = self._locate(uri_name(uri))
        return (b"" if found is None else found), uri_name(uri) if not isinstance(found, Path) else str(found)


def _read_or_warn(
    file: str, name: str, vertices: int, read: Callable[..., Appearance], *arguments: Any
) -> Appearance | None:
    """Read the appearance of a primitive; warn and return None if it cannot be read, and keep the triangles."""
    try:
        found = read(*arguments)
        found.check_fits(vertices, 0, name)
    except Exception as error:  # malformed files may raise any exception
        warn_user(f"{file}: left out the colors of {name} ({truncate(describe_exception(error))})", UserWarning)
        return None
    return found


def _plain(entry: dict[str, Any]) -> Appearance:
    return Appearance((_material(entry),))


def _infos(entry: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the texture infos of a material, by the field of `Material`; that of the base color is first."""
    rough = entry.get("pbrMetallicRoughness") or {}
    if _UNLIT in (entry.get("extensions") or {}):  # which ignores the other maps
        texture = _base(entry)[1]
        return {} if texture is None else {"texture": texture}
    found = {"texture": _base(entry)[1], "metallic_roughness_texture": rough.get("metallicRoughnessTexture")}
    found |= {f"{name}_texture": entry.get(f"{name}Texture") for name in ("normal", "occlusion", "emissive")}
    return {name: info for name, info in found.items() if info is not None}


def _uv_source(info: dict[str, Any]) -> tuple[str, tuple[tuple[str, Any], ...]]:
    """Return the attribute of a texture's coordinates, and their transform."""
    transform = (info.get("extensions") or {}).get(TRANSFORM) or {}
    number = transform.get("texCoord", info.get("texCoord", 0))
    parts = {key: transform[key] for key in ("offset", "rotation", "scale") if key in transform}
    return f"TEXCOORD_{number}", tuple((key, _hashable(value)) for key, value in parts.items())


def _hashable(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _material(entry: dict[str, Any], **textures: Texture) -> Material:
    """Read a material (3.9); its factors are linear."""
    color, _ = _base(entry)
    rough = entry.get("pbrMetallicRoughness") or {}
    extensions = entry.get("extensions") or {}
    strength = float((extensions.get("KHR_materials_emissive_strength") or {}).get("emissiveStrength", 1.0))
    return Material(
        name=str(entry.get("name") or ""),
        base_color=tuple(color),
        color_space="linear",
        alpha_mode=str(entry.get("alphaMode", "OPAQUE")).lower(),  # type: ignore[arg-type]  # it checks it
        alpha_cutoff=entry.get("alphaCutoff", 0.5),
        metallic=rough.get("metallicFactor", 0.0 if _OLD in extensions else 1.0),
        roughness=rough.get("roughnessFactor", 1.0),
        emission=tuple(np.multiply(strength, entry.get("emissiveFactor", (0, 0, 0))).tolist()),
        double_sided=entry.get("doubleSided", False),
        shading=_shading(entry),
        normal_scale=(entry.get("normalTexture") or {}).get("scale", 1.0),
        occlusion_strength=(entry.get("occlusionTexture") or {}).get("strength", 1.0),
        **textures,  # type: ignore[arg-type]  # by the fields of `_infos`
    )


def _shading(entry: dict[str, Any]) -> Shading:
    extensions = entry.get("extensions") or {}
    if _UNLIT in extensions:
        return "unlit"
    return "phong" if _OLD in extensions and "pbrMetallicRoughness" not in entry else "pbr"


def _base(entry: dict[str, Any]) -> tuple[Any, dict[str, Any] | None]:
    """Return a material's base color, and its texture info."""
    old = (entry.get("extensions") or {}).get(_OLD)
    if old is not None and "pbrMetallicRoughness" not in entry:
        return old.get("diffuseFactor", (1, 1, 1, 1)), old.get("diffuseTexture")
    rough = entry.get("pbrMetallicRoughness") or {}
    return rough.get("baseColorFactor", (1, 1, 1, 1)), rough.get("baseColorTexture")


def _coordinates(rows: NDArray[np.generic], transform: dict[str, Any]) -> NDArray[np.float32]:
    """Transform texture coordinates (KHR_texture_transform: scale, rotate, translate), and flip v upwards."""
    uv: NDArray[Any] = rows.astype(np.float64) if transform else rows
    if uv.ndim != 2 or uv.shape[1] != 2:
        raise ValueError("texture coordinates must be of two numbers each")
    if transform:
        # The extension's text rotates counterclockwise as seen, as do Khronos's sample viewer and three.js; its GLSL
        # code rotates clockwise.
        angle = float(transform.get("rotation", 0.0))
        rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        scale = np.array(transform.get("scale", (1, 1)), dtype=np.float64).reshape(2)
        uv = (uv * scale) @ rotation.T + np.array(transform.get("offset", (0, 0)), dtype=np.float64).reshape(2)
    upwards: NDArray[np.float32] = uv.astype(np.float32)
    upwards[:, 1] = 1 - upwards[:, 1]
    return upwards
