# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearances of USD meshes, built on first use from primvars and materials that were read with the stage."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Ar

from warpvis.core.checks import describe_exception, truncate
from warpvis.core.user_warnings import warn_user
from warpvis.io.usd._materials import MaterialSource, PrimvarSource, TextureSource, UvSource
from warpvis.io.usd._meshes import Geometry, digest, face_normals, smooth_normals
from warpvis.scene.materials import Appearance, ColorSpace, Material, MaterialMap, Texture
from warpvis.scene.normals import have_direction

_MAPS = ("metallic", "roughness", "normal", "occlusion", "emissiveColor")
_COLOR = "displayColor"


@dataclass(eq=False)
class Primvar:
    """Values of a primvar, without indices."""

    values: NDArray[Any]
    """Shape ``(n, k)``."""
    interpolation: str


@dataclass(eq=False)
class Surface:
    """What determines the appearance of a mesh, apart from its triangles."""

    file: str
    name: str
    double_sided: bool = False
    materials: list[MaterialSource | None] = field(default_factory=list)
    """Its materials; None for polygons without one, which show the primvar `displayColor`."""
    polygon_materials: NDArray[np.int32] | None = None
    """Index of each polygon's material; None if all have the first."""
    primvars: dict[str, Primvar] = field(default_factory=dict)
    """`displayColor`, `displayOpacity`, `normals`, and those that materials use."""
    textures: dict[Any, Texture | None] = field(default_factory=dict, repr=False)
    """Textures of the stage, which meshes share."""

    @property
    def content(self) -> tuple[Any, ...]:
        """A key that is equal for equal surfaces."""
        arrays = {name: (item.interpolation, digest(item.values)) for name, item in self.primvars.items()}
        polygons = b"" if self.polygon_materials is None else digest(self.polygon_materials)
        materials = tuple(None if item is None else item.content for item in self.materials)
        return self.double_sided, materials, polygons, tuple(sorted(arrays.items()))

    def appearance(self, geometry: Geometry) -> Appearance | None:
        """Build the appearance; warn of arrays that do not fit, and leave them out."""
        try:
            found = _Builder(self, geometry).build()
            if found is not None:
                found.check_fits(len(geometry.vertices), len(geometry.faces), self.name)
            return found
        except Exception as error:  # malformed files may raise any exception
            reason = truncate(describe_exception(error))
            warn_user(f"{self.file}: left out the colors of {self.name} ({reason})", UserWarning)
            return None


def needed_primvars(materials: Sequence[MaterialSource | None]) -> set[str]:
    """Return the names of the primvars that materials use."""
    names = {"displayColor", "displayOpacity"} if None in materials or not materials else set()
    for material in materials:
        for value in () if material is None else material.inputs.values():
            if isinstance(value, PrimvarSource):
                names.add(value.primvar)
            if isinstance(value, TextureSource) and value.path:
                names.add(value.uv.primvar)
    return names


class _Builder:
    """Builds one appearance."""

    def __init__(self, surface: Surface, geometry: Geometry) -> None:
        self._surface, self._geometry = surface, geometry
        counts = geometry.counts
        self._primvars = {
            name: primvar
            for name, primvar in surface.primvars.items()
            if len(primvar.values) == counts.get(primvar.interpolation, -1)
        }
        wrong = sorted(set(surface.primvars) - set(self._primvars))
        if wrong:
            primvar = surface.primvars[wrong[0]]
            count = counts.get(primvar.interpolation, 0)
            message = f"primvar {wrong[0]} must have {count} values, got {len(primvar.values)}"
            warn_user(f"{surface.file}: left out colors of {surface.name}: {message}", UserWarning)

    def build(self) -> Appearance | None:
        """Return the appearance; None if the mesh defines none."""
        sources = self._surface.materials or [None]
        normals = self._normals()
        colors, per_face = self._colors(sources)
        if normals is None and colors is None and all(source is None for source in sources):
            if _COLOR not in self._primvars:
                return None
        materials = tuple(self._material(source) for source in sources)
        face_materials = None
        if self._surface.polygon_materials is not None:
            face_materials = self._surface.polygon_materials[self._geometry.polygons]
        uv, map_uv = self._coordinates(sources, face_materials)
        arrays: dict[str, Any] = {"face_colors" if per_face else "vertex_colors": colors}
        return Appearance(
            materials, face_materials=face_materials, uv=uv, map_uv=map_uv, normals=normals, **arrays
        )  # fmt: skip

    def _normals(self) -> NDArray[np.floating] | None:
        """Return normals of vertices or corners; None for flat surfaces."""
        geometry, primvar = self._geometry, self._primvars.get("normals")
        if primvar is None:
            smooth = smooth_normals(geometry.vertices, geometry.faces) if geometry.is_smooth else geometry.normals
            if smooth is None:
                return None
            rows = smooth
        elif primvar.interpolation == "uniform":
            return None
        else:
            rows = geometry.spread(primvar.values.astype(np.float64), primvar.interpolation)
        is_bad = ~have_direction(rows)
        if is_bad.all():
            return None
        if is_bad.any():
            rows = np.array(rows if rows.ndim == 3 else rows[geometry.faces])
            bad = is_bad if is_bad.ndim == 2 else is_bad[geometry.faces]
            flat = np.repeat(face_normals(geometry.vertices, geometry.faces)[:, None], 3, axis=1)
            rows[bad] = flat[bad]
        return rows

    def _colors(self, sources: Sequence[MaterialSource | None]) -> tuple[NDArray[np.float32] | None, bool]:
        """Return colors of vertices or faces, and whether they are of faces; None if they are constant."""
        name = next((used for source in sources if (used := _color_primvar(source))), "")
        color, opacity = self._primvars.get(name), self._primvars.get("displayOpacity")
        if color is None or (len(color.values) == 1 and (opacity is None or len(opacity.values) == 1)):
            return None, False
        geometry = self._geometry
        parts = [geometry.spread(_columns(color.values, 3), color.interpolation)]
        if opacity is not None:
            parts.append(geometry.spread(_columns(opacity.values, 1), opacity.interpolation))
        per_face = any(part.ndim == 3 for part in parts)
        if per_face:  # a face has one color: the mean of its corners
            parts = [(part if part.ndim == 3 else part[geometry.faces]).mean(axis=1) for part in parts]
        rows = np.clip(np.concatenate(parts, axis=1), 0.0, 1.0).astype(np.float32)
        if self._surface.polygon_materials is not None and self._has_other_colors(sources):
            rows = self._only_unbound(rows if per_face else rows[geometry.faces].mean(axis=1), sources)
            per_face = True
        return rows, per_face

    def _has_other_colors(self, sources: Sequence[MaterialSource | None]) -> bool:
        return any(source is not None and not _color_primvar(source) for source in sources)

    def _only_unbound(self, rows: NDArray[np.float32], sources: Sequence[MaterialSource | None]) -> NDArray[np.float32]:
        """Return colors of faces that are white where a material does not use them."""
        uses = np.array([bool(_color_primvar(source)) for source in sources])
        chosen = self._surface.polygon_materials
        used = uses[chosen[self._geometry.polygons]] if chosen is not None else np.ones(len(rows), dtype=bool)
        return np.where(used[:, None], rows, np.float32(1.0))

    def _material(self, source: MaterialSource | None) -> Material:
        if source is None:
            return self._plain()
        color = source.color("diffuseColor", (1.0, 1.0, 1.0) if _color_primvar(source) else (0.18, 0.18, 0.18))
        diffuse, opacity = source.texture("diffuseColor"), source.texture("opacity")
        alpha = source.number("opacity", 1.0)
        if diffuse is not None:
            color = diffuse.scale[:3]  # type: ignore[assignment]
        threshold = source.number("opacityThreshold", 0.0)
        mode = "mask" if threshold > 0 else "blend" if alpha < 1 or opacity is not None else "opaque"
        emissive = source.texture("emissiveColor")
        emission = emissive.scale[:3] if emissive is not None else source.color("emissiveColor", (0.0, 0.0, 0.0))
        rough, metal = source.texture("roughness"), source.texture("metallic")
        normal, occlusion = source.texture("normal"), source.texture("occlusion")
        return Material(
            source.name.rpartition("/")[2],
            (*(float(np.clip(value, 0, 1)) for value in color), float(np.clip(alpha, 0, 1))),  # type: ignore[arg-type]
            "linear",
            self._shared(_color_texture, diffuse, opacity),
            mode,  # type: ignore[arg-type]
            alpha_cutoff=threshold if threshold > 0 else 0.5,
            metallic=1.0 if metal else float(np.clip(source.number("metallic", 0.0), 0, 1)),
            roughness=1.0 if rough else float(np.clip(source.number("roughness", 0.5), 0, 1)),
            emission=tuple(max(0.0, value) for value in emission),  # type: ignore[arg-type]
            double_sided=self._surface.double_sided,
            shading="pbr",
            metallic_roughness_texture=self._shared(_packed, rough, metal),
            normal_texture=self._shared(_texture, normal, "linear"),
            normal_scale=1.0 if normal is None else normal.scale[0] / 2 or 1.0,
            occlusion_texture=self._shared(_single, occlusion),
            emissive_texture=self._shared(_texture, emissive, "srgb"),
        )

    def _shared(self, make: Callable[..., Texture | None], *sources: TextureSource | str | None) -> Texture | None:
        """Return a texture of sources, which is the same for all meshes; None if there are none."""
        if all(source is None or isinstance(source, str) for source in sources):
            return None
        key, known = (make.__name__, *sources), self._surface.textures
        if key not in known:
            known[key] = make(*sources)
        return known[key]

    def _plain(self) -> Material:
        """Return the material of polygons without one, which has the constant color of primvars."""
        color, opacity = self._primvars.get(_COLOR), self._primvars.get("displayOpacity")
        base, alpha = (1.0, 1.0, 1.0), 1.0
        varies = any(item is not None and len(item.values) > 1 for item in (color, opacity)) and color is not None
        if color is None:
            base = (0.18, 0.18, 0.18) if len(self._surface.materials) > 1 else (1.0, 1.0, 1.0)
        elif not varies:
            base = tuple(np.clip(_columns(color.values, 3)[0], 0, 1).tolist())
        if opacity is not None and not varies:
            alpha = float(np.clip(opacity.values.reshape(-1)[0], 0, 1))
        blends = opacity is not None and bool((opacity.values < 1).any())
        sided = self._surface.double_sided
        return Material("", (*base, alpha), "linear", None, "blend" if blends else "opaque", double_sided=sided)

    def _coordinates(
        self, sources: Sequence[MaterialSource | None], face_materials: NDArray[np.int32] | None
    ) -> tuple[NDArray[np.float32] | None, dict[MaterialMap, NDArray[np.float32]]]:
        """Return texture coordinates of the base color, and those of maps that differ."""
        found: dict[str, NDArray[np.float32]] = {}
        slots: dict[str, tuple[str, ...]] = {
            "texture": ("diffuseColor", "opacity"),
            "metallic_roughness_texture": ("roughness", "metallic"),
            "normal_texture": ("normal",),
            "occlusion_texture": ("occlusion",),
            "emissive_texture": ("emissiveColor",),
        }
        chosen: dict[str, list[UvSource | None]] = {}
        for slot, names in slots.items():
            chosen[slot] = [_uv_of(source, names) for source in sources]
        first: list[UvSource | None] = [
            next((chosen[slot][index] for slot in slots if chosen[slot][index] is not None), None)
            for index in range(len(sources))
        ]
        first = [own or other for own, other in zip(chosen["texture"], first, strict=True)]
        uv = self._rows(first, face_materials)
        for slot in slots:
            mine = [own or other for own, other in zip(chosen[slot], first, strict=True)]
            if slot != "texture" and mine != first:
                rows = self._rows(mine, face_materials)
                if rows is not None:
                    found[slot] = rows
        return uv, found  # type: ignore[return-value]

    def _rows(
        self, sources: Sequence[UvSource | None], face_materials: NDArray[np.int32] | None
    ) -> NDArray[np.float32] | None:
        """Return coordinates where each material has its own source; None if there are none."""
        different = list(dict.fromkeys(source for source in sources if source is not None))
        rows = {source: row for source in different if (row := self._transformed(source)) is not None}
        if not rows:
            return None
        if len(different) == 1 or face_materials is None:
            return rows.get(different[0])
        corners = np.zeros((len(self._geometry.faces), 3, 2), dtype=np.float32)
        for index, source in enumerate(sources):
            if source in rows:
                own, mask = rows[source], face_materials == index
                corners[mask] = (own if own.ndim == 3 else own[self._geometry.faces])[mask]
        return corners

    def _transformed(self, source: UvSource) -> NDArray[np.float32] | None:
        primvar = self._primvars.get(source.primvar)
        if primvar is None or primvar.values.ndim != 2 or primvar.values.shape[1] < 2:
            return None
        values = primvar.values[:, :2].astype(np.float64)
        for scale, degrees, translation in source.transforms:
            angle = np.radians(degrees)
            rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            values = (values * scale) @ rotation.T + translation
        return self._geometry.spread(values.astype(np.float32), primvar.interpolation)


def _color_primvar(source: MaterialSource | None) -> str:
    """Return the primvar that gives a material its color; empty if it has another one."""
    if source is None:
        return _COLOR
    value = source.inputs.get("diffuseColor")
    return value.primvar if isinstance(value, PrimvarSource) else ""


def _uv_of(source: MaterialSource | None, names: Sequence[str]) -> UvSource | None:
    textures = (source.texture(name) for name in names) if source is not None else ()
    return next((texture.uv for texture in textures if texture is not None), None)


def _columns(values: NDArray[Any], count: int) -> NDArray[np.float64]:
    return values.reshape(len(values), -1)[:, :count].astype(np.float64)


def _texture(source: TextureSource, color_space: ColorSpace) -> Texture:
    """Return a texture as it is in its file, which is decoded on first use."""
    space: ColorSpace = {"raw": "linear", "sRGB": "srgb"}.get(source.color_space, color_space)  # type: ignore[assignment]
    return Texture(open_asset(source.path), source.name, source.wrap_u, source.wrap_v, color_space=space)


def open_asset(path: str) -> Path | bytes:
    """Return a file, or the bytes of one in an archive; no bytes if it is missing."""
    if os.path.isfile(path):
        return Path(path)
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    return b"" if not asset else bytes(asset.GetBuffer())


def _color_texture(color: TextureSource | None, opacity: TextureSource | None) -> Texture | None:
    """Return the texture of a base color, with the opacity of another one as its fourth channel."""
    if color is None and opacity is None:
        return None
    if color is not None and color.channel == "rgb" and (opacity is None or _is_alpha_of(opacity, color)):
        return _texture(color, "srgb")
    alpha = None if opacity is None else _pixels(opacity)
    if color is None:
        image = np.full((*alpha.shape, 3), 255, dtype=np.uint8)  # type: ignore[union-attr]
    else:
        image = _pixels(color)
        image = np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image
    if alpha is not None:
        image = np.dstack([image, _resized(alpha, image.shape[:2])])
    like = color or opacity
    assert like is not None
    space: ColorSpace = "linear" if like.color_space == "raw" else "srgb"
    return Texture(image, like.name, like.wrap_u, like.wrap_v, color_space=space)


def _is_alpha_of(opacity: TextureSource, color: TextureSource) -> bool:
    return opacity.channel == "a" and opacity.path == color.path and opacity.scale[3] == 1


def _packed(rough: TextureSource | None, metal: TextureSource | None) -> Texture | None:
    """Return a texture with roughness in green and metallic in blue."""
    like = rough or metal
    if like is None:
        return None
    if rough is not None and metal is not None and rough.path == metal.path:
        if (rough.channel, metal.channel) == ("g", "b") and rough.scale == metal.scale == (1.0, 1.0, 1.0, 1.0):
            return _texture(like, "linear")
    green, blue = (None if item is None else _pixels(item) for item in (rough, metal))
    shape = next(item.shape[:2] for item in (green, blue) if item is not None)
    full = np.full(shape, 255, dtype=np.uint8)
    channels = [full if item is None else _resized(_gray(item), shape) for item in (green, blue)]
    return Texture(np.dstack([full, *channels]), like.name, like.wrap_u, like.wrap_v, color_space="linear")


def _single(source: TextureSource) -> Texture:
    """Return a texture whose red channel is the one that is used."""
    if source.channel in ("rgb", "r"):
        return _texture(source, "linear")
    gray = _gray(_pixels(source))
    return Texture(np.dstack([gray] * 3), source.name, source.wrap_u, source.wrap_v, color_space="linear")


def _gray(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return image if image.ndim == 2 else image[..., 0]


def _pixels(source: TextureSource) -> NDArray[np.uint8]:
    """Return the channels of a texture that are used, with its scale and bias, ``(H, W)`` or ``(H, W, 3)``."""
    image = _decoded(source.path)
    if source.channel == "rgb":
        return image[..., :3]
    index = "rgba".index(source.channel)
    row, scale, bias = image[..., index], source.scale[index], source.bias[index]
    if (scale, bias) == (1.0, 0.0):
        return row
    return np.clip(np.round((row / 255.0 * scale + bias) * 255), 0, 255).astype(np.uint8)


def _decoded(path: str) -> NDArray[np.uint8]:
    """Decode an image, ``(H, W, 4)``."""
    from PIL import Image

    source = open_asset(path)
    with Image.open(source if isinstance(source, Path) else io.BytesIO(source)) as image:
        return np.asarray(image.convert("RGBA"))


def _resized(image: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a single channel in the size of another image."""
    from PIL import Image

    if image.shape[:2] == tuple(shape[:2]):
        return image
    return np.asarray(Image.fromarray(image).resize((shape[1], shape[0]), Image.Resampling.BILINEAR))
