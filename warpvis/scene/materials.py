# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearances as data: textures, materials, and the material and color of each face; and conversions of colors.

`Scene.add` accepts an `Appearance`, a `Material` or a color, and file readers create them.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.checks import check_choice, check_flag, check_number
from warpvis.errors import SceneError
from warpvis.scene._pixels import pixels_or_white
from warpvis.scene.vertex_grids import VertexGrid

Wrap = Literal["repeat", "mirror", "clamp"]
"""A texture outside of 0 to 1: repeated, repeated with every other copy mirrored, or clamped to its edge."""

Filter = Literal["nearest", "linear"]
"""Color between texels: that of the nearest one, or bilinear interpolation."""

AlphaMode = Literal["opaque", "mask", "blend"]
"""How opacity is used: ignored, compared to a cutoff, or blended with what is behind."""

Projection = Literal["uv", "plane", "cube"]
"""Source of a texture's coordinates: those of the faces; x and y of the object's frame [m]; or the direction from its
origin, in six images of a cube map, one below the other, as in OpenGL and `lights.cube_coordinates`: +x, -x, +y, -y,
+z, -z (right, left, up, down, front, back)."""

MaterialMap = Literal["metallic_roughness_texture", "normal_texture", "occlusion_texture", "emissive_texture"]
"""A texture of a `Material` apart from that of its base color."""

Shading = Literal["phong", "pbr", "webots", "unlit"]
"""How a material reflects light: ``"phong"``, by its base color, with Blinn-Phong highlights (`specular`, `shininess`);
``"pbr"``, by its base color, `metallic` and `roughness`, and all of its maps (appendix B of glTF 2.0); ``"webots"``, as
``"pbr"`` in the variant of Webots' PBRAppearance; or ``"unlit"``, not at all: it shows its base color under any lights,
without shadows, highlights and emission."""

ColorSpace = Literal["srgb", "linear"]
"""Whether colors are in sRGB, as on screens and in image files, or linear, proportional to light."""

_COUNTS = {2: "two", 3: "three", 4: "four"}


@dataclass(frozen=True, eq=False)
class Texture:
    """An image on a surface.

    Coordinates ``(u, v)`` go from the image's lower left corner, ``(0, 0)``, to its upper right one, ``(1, 1)``, as in
    OBJ, COLLADA and trimesh. In glTF and MuJoCo, v points down; their readers flip it.
    """

    source: NDArray[np.uint8] | Path | bytes = field(repr=False)
    """The image, top row first, shape ``(H, W, 3)`` or ``(H, W, 4)``; or a file, or the bytes of a file, which are
    decoded when `image` is first accessed."""
    name: str = ""
    """Name in warnings; a file's path by default."""
    wrap_u: Wrap = "repeat"
    wrap_v: Wrap = "repeat"
    filter: Filter = "linear"
    color_space: ColorSpace = "srgb"
    """Color space of the stored values. Opacity is always linear."""
    mipmaps: bool = True
    """Whether distant texels are averaged. Without mip maps, fine patterns flicker."""

    def __post_init__(self) -> None:
        source = self.source
        if isinstance(source, str | os.PathLike):
            source = Path(source)
        if isinstance(source, bytearray | memoryview):
            source = bytes(source)
        if not isinstance(source, Path | bytes):
            source = _image(source, self.name)
        object.__setattr__(self, "source", source)
        object.__setattr__(self, "name", str(self.name) or (str(source) if isinstance(source, Path) else "texture"))
        for key, choices in (("wrap_u", Wrap), ("wrap_v", Wrap), ("filter", Filter), ("color_space", ColorSpace)):
            check_choice(getattr(self, key), key, get_args(choices), SceneError)

    @property
    def image(self) -> NDArray[np.uint8]:
        """The image, top row first, shape ``(H, W, 3)`` or ``(H, W, 4)``.

        If the file is missing or cannot be decoded, this is one white pixel, so that the material's base color shows,
        and a warning names the file.
        """
        if isinstance(self.source, np.ndarray):
            return self.source
        if "_decoded" not in self.__dict__:
            object.__setattr__(self, "_decoded", pixels_or_white(self.source, self.name))
        return self.__dict__["_decoded"]

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without the decoded image."""
        return {name: value for name, value in self.__dict__.items() if name != "_decoded"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


@dataclass(frozen=True, eq=False)
class Material:
    """Optical properties of a surface."""

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Red, green, blue and opacity from 0 to 1, in `color_space`; three numbers are opaque. Multiplied with the
    texture and with colors of vertices and faces."""
    color_space: ColorSpace = "srgb"
    """Color space of `base_color`, `specular`, `emission` and colors of vertices and faces, in which they are
    multiplied: linear in glTF, sRGB in formats whose numbers are display values (MTL, PLY, MuJoCo)."""
    texture: Texture | None = None
    alpha_mode: AlphaMode = "opaque"
    alpha_cutoff: float = 0.5
    """Minimum visible opacity with the mode ``"mask"``."""
    metallic: float = 0.0
    roughness: float = 1.0
    """Both from 0 to 1, as in glTF; of the shading ``"pbr"``."""
    specular: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Color of the Blinn-Phong highlight."""
    shininess: float = 0.0
    """Exponent of the Blinn-Phong highlight."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Color of emitted light; may exceed 1."""
    reflectance: float = 0.0
    """Fraction of a mirror image that flat, opaque surfaces add to their color, from 0 to 1, as in MuJoCo."""
    double_sided: bool = True
    """Whether both sides of a face are rendered, for masks and blended surfaces. Depth does not depend on it."""
    projection: Projection = "uv"
    """Source of the texture's coordinates."""
    texture_repeat: tuple[float, float] = (1.0, 1.0)
    """Repetitions of the texture in u and v: factors of the coordinates."""
    blends_twice: bool = False
    """Whether a surface of the mode ``"blend"`` is blended twice, as in MuJoCo's renderer: transparent surfaces are
    drawn front to back, and then back to front. If a world gives it another color, that color's opacity counts."""
    texture_uniform: bool = False
    """Whether directions in a cube map point to the actual shape; if false, as in MuJoCo, the shape is first normalized
    to equal size along all axes."""
    texture_stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factors of directions in a cube map along the axes of the object's frame."""
    metallic_roughness_texture: Texture | None = None
    """Factors of `roughness` (green) and `metallic` (blue). The maps are as in glTF, require the shading ``"pbr"``, and
    use the texture coordinates of `Appearance.map_uv`; all but that of emission are linear."""
    normal_texture: Texture | None = None
    """Normals in tangent space: 0 to 255 is -1 to 1; x and y are multiplied by `normal_scale`."""
    normal_scale: float = 1.0
    occlusion_texture: Texture | None = None
    """Fraction of ambient light that reaches the surface (red)."""
    occlusion_strength: float = 1.0
    """Effect of the `occlusion_texture`, from 0 to 1."""
    emissive_texture: Texture | None = None
    """Factors of `emission`. With the shading ``"phong"``, a material with this texture does not emit light."""
    shading: Shading = "phong"
    """How it reflects light. Readers of glTF choose ``"pbr"``."""
    ambient_strength: float = 1.0
    """Factor of ambient light, of the shading ``"pbr"``."""
    tone_mapped: bool = False
    """Whether the sum x of linear light is displayed as ``(1 - exp(-x)) ** (1 / 2.2)``, as in Webots at an exposure of
    1, instead of as an sRGB color that is clipped."""

    def __post_init__(self) -> None:
        subject = f"material {self.name!r}" if self.name else "a material"
        put = partial(object.__setattr__, self)
        put("name", str(self.name))
        put("base_color", check_color(self.base_color, f"base_color of {subject}", (3, 4)))
        put("specular", check_color(self.specular, f"specular of {subject}", (3,)))
        put("emission", check_color(self.emission, f"emission of {subject}", (3,), maximum=np.inf))
        check_choice(self.color_space, "color_space", get_args(ColorSpace), SceneError)
        check_choice(self.alpha_mode, "alpha_mode", get_args(AlphaMode), SceneError)
        check_choice(self.projection, "projection", get_args(Projection), SceneError)
        check_choice(self.shading, "shading", get_args(Shading), SceneError)
        put("texture_repeat", check_color(self.texture_repeat, f"texture_repeat of {subject}", (2,), maximum=np.inf))
        stretch = check_color(self.texture_stretch, f"texture_stretch of {subject}", (3,), maximum=np.inf)
        put("texture_stretch", stretch)
        put("texture_uniform", check_flag(self.texture_uniform, "texture_uniform", SceneError))
        put("normal_scale", check_number(self.normal_scale, f"normal_scale of {subject}", error=SceneError))
        fractions = ("metallic", "roughness", "occlusion_strength", "reflectance")
        others = ("shininess", "alpha_cutoff", "ambient_strength")
        for name, upper in {**dict.fromkeys(fractions, 1.0), **dict.fromkeys(others, np.inf)}.items():
            value = check_number(getattr(self, name), f"{name} of {subject}", error=SceneError)
            if not 0 <= value <= upper:
                expected = "at least 0" if upper == np.inf else "from 0 to 1"
                raise SceneError(f"{name} of {subject} must be {expected}, got {value:g}")
            put(name, float(value))
        for flag in ("double_sided", "blends_twice", "tone_mapped"):
            put(flag, check_flag(getattr(self, flag), flag, SceneError))
        for name in ("texture", *get_args(MaterialMap)):
            texture = getattr(self, name)
            if texture is not None and not isinstance(texture, Texture):
                raise SceneError(f"{name} of {subject} must be a Texture, got {type(texture).__name__}")


@dataclass(frozen=True, eq=False)
class Appearance:
    """The appearance of an object: materials, and the material, color and texture coordinates of each face."""

    materials: tuple[Material, ...] = field(default_factory=lambda: (Material(),))
    face_materials: NDArray[np.int32] | None = field(default=None, repr=False)
    """Index of each face's material, shape ``(m,)``; None if all use the first."""
    uv: NDArray[np.float32] | None = field(default=None, repr=False)
    """Texture coordinates of each corner of each face, shape ``(m, 3, 2)``, or of each vertex, ``(n, 2)``. Outside of 0
    to 1 the texture's wrap modes apply."""
    vertex_colors: NDArray[np.uint8 | np.float32] | None = field(default=None, repr=False)
    """Color of each vertex, shape ``(n, 4)``; uint8, or float32 from 0 to 1; in the color space of the material."""
    face_colors: NDArray[np.uint8 | np.float32] | None = field(default=None, repr=False)
    """Color of each face, shape ``(m, 4)``, with the same types."""
    normals: NDArray[np.float32] | None = field(default=None, repr=False)
    """Shading normals of each corner of each face, shape ``(m, 3, 3)``, or of each vertex, ``(n, 3)``, in the mesh's
    frame, of any length but 0; None for flat shading."""
    vertex_grid: VertexGrid | None = field(default=None, repr=False)
    """Cells at whose corners light is computed with ``lighting="vertex"``; None for the triangles of the mesh."""
    map_uv: Mapping[MaterialMap, NDArray[np.float32]] = field(default_factory=dict, repr=False)
    """Texture coordinates of other maps of the materials, by their field, where they differ from `uv`; shapes as of
    `uv`."""

    def __post_init__(self) -> None:
        materials = (self.materials,) if isinstance(self.materials, Material) else self.materials
        if (
            not isinstance(materials, tuple | list)
            or not materials
            or not all(isinstance(item, Material) for item in materials)
        ):
            raise SceneError(f"materials must be at least one Material, got {shown(materials)}")
        object.__setattr__(self, "materials", tuple(materials))
        for name, check in (
            ("face_materials", self._check_face_materials),
            ("uv", _check_uv),
            ("vertex_colors", _check_colors),
            ("face_colors", _check_colors),
            ("normals", _check_normals),
        ):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, check(_array(value, name), name))
        object.__setattr__(self, "map_uv", _check_map_uv(self.map_uv))
        if self.vertex_grid is not None and not isinstance(self.vertex_grid, VertexGrid):
            raise SceneError(f"vertex_grid must be a VertexGrid or None, got {shown(self.vertex_grid)}")

    def _check_face_materials(self, rows: np.ndarray, name: str) -> NDArray[np.int32]:
        if rows.ndim != 1 or rows.dtype.kind not in "iu":
            raise SceneError(f"{name} must be whole numbers of shape (m,), got {rows.dtype} {rows.shape}")
        if len(rows) and not (rows.min() >= 0 and rows.max() < len(self.materials)):
            raise SceneError(
                f"{name} must be material indices from 0 to {len(self.materials) - 1}, got {rows.min()} to {rows.max()}"
            )
        return rows.astype(np.int32)

    def check_fits(self, vertices: int, faces: int, name: str) -> None:
        """Raise a `SceneError` unless it fits a mesh of this number of vertices and faces."""
        per_face, per_vertex = (faces, "faces"), (vertices, "vertices")
        lengths = {"face_materials": per_face, "vertex_colors": per_vertex, "face_colors": per_face}
        arrays = {key: getattr(self, key) for key in ("uv", "normals", *lengths)}
        arrays |= {f"map_uv[{key!r}]": rows for key, rows in self.map_uv.items()}
        for key, rows in arrays.items():
            if rows is None:
                continue
            count, noun = lengths.get(key, per_vertex if rows.ndim == 2 else per_face)
            if len(rows) != count:
                raise SceneError(f"{key} of {name!r} must be one for each of its {count} {noun}, got {len(rows)}")

    def corner_uv(self, faces: NDArray[np.integer], map: MaterialMap | None = None) -> NDArray[np.float32] | None:
        """Return texture coordinates of each corner of the mesh's faces, shape ``(m, 3, 2)``; None if it has none.

        They are those of the materials' base color textures, or of another `map`.
        """
        rows = self.uv if map is None else self.map_uv.get(map, self.uv)
        return rows if rows is None or rows.ndim == 3 else rows[faces]

    def corner_normals(self, faces: NDArray[np.integer]) -> NDArray[np.float32] | None:
        """Return normals of each corner of the mesh's faces, shape ``(m, 3, 3)``; None if it has none."""
        return self.normals if self.normals is None or self.normals.ndim == 3 else self.normals[faces]

    def with_material(self, material: Material) -> Appearance:
        """Return the appearance with another first material; its arrays are shared, and not checked again."""
        changed = copy.copy(self)
        object.__setattr__(changed, "materials", (material, *self.materials[1:]))
        return changed

    def for_any_mesh(self) -> Appearance:
        """Return the part that is valid for any mesh: its first material."""
        return Appearance((self.materials[0],))


AppearanceLike = Appearance | Material | ArrayLike
"""An appearance, a material, or a color in sRGB: three or four numbers from 0 to 1."""


def as_appearance(value: AppearanceLike, name: str) -> Appearance:
    """Convert the `appearance` argument of `Scene.add` to an `Appearance`."""
    if isinstance(value, Appearance):
        return value
    if isinstance(value, Material):
        return Appearance((value,))
    if isinstance(value, Texture):
        return Appearance((Material(texture=value),))
    color = check_color(value, f"appearance of {name!r}", (3, 4), alternatives="an Appearance, a Material or ")
    return Appearance((Material(base_color=color, alpha_mode="blend" if color[3] < 1 else "opaque"),))


def _array(array: ArrayLike, name: str) -> np.ndarray:
    if isinstance(array, np.ndarray) and array.dtype.kind in "iuf":  # the message takes long for large arrays
        return array
    return as_numbers(array, f"{name} must be an array of numbers, got {shown(array)}")


def _check_corner_shape(rows: np.ndarray, name: str, width: int) -> None:
    if rows.ndim not in (2, 3) or rows.shape[-1] != width or (rows.ndim == 3 and rows.shape[1] != 3):
        raise SceneError(f"{name} must have shape (m, 3, {width}) or (n, {width}), got {rows.shape}")


def _check_uv(rows: np.ndarray, name: str) -> NDArray[np.float32]:
    _check_corner_shape(rows, name, 2)
    with np.errstate(over="ignore"):
        rows = rows.astype(np.float32)
    if np.isfinite(rows).all():
        return rows
    bad = np.flatnonzero(~np.isfinite(rows).reshape(len(rows), -1).all(axis=1))
    raise SceneError(f"{name} must be finite: {len(bad)} are not, the first at {bad[0]}")


def _check_map_uv(given: Mapping[MaterialMap, ArrayLike]) -> dict[MaterialMap, NDArray[np.float32]]:
    names = get_args(MaterialMap)
    if not isinstance(given, Mapping) or not all(name in names for name in given):
        raise SceneError(f"map_uv must be arrays by any of {', '.join(names)}, got {shown(given)}")
    return {name: _check_uv(_array(rows, f"map_uv[{name!r}]"), f"map_uv[{name!r}]") for name, rows in given.items()}


def _check_normals(rows: np.ndarray, name: str) -> NDArray[np.float32]:
    _check_corner_shape(rows, name, 3)
    rows = rows.astype(np.float64)
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    wrong = ~(np.isfinite(length) & (length > 0)).reshape(len(rows), -1).all(axis=1)
    if wrong.any():
        raise SceneError(
            f"{name} must be finite and not 0: {int(wrong.sum())} are not, the first at {int(np.flatnonzero(wrong)[0])}"
        )
    return (rows / length).astype(np.float32)


def _check_colors(rows: np.ndarray, name: str) -> NDArray[np.uint8 | np.float32]:
    if rows.ndim != 2 or rows.shape[1] not in (3, 4) or (rows.dtype != np.uint8 and rows.dtype.kind != "f"):
        raise SceneError(f"{name} must be uint8 or floats of shape (n, 3) or (n, 4), got {rows.dtype} {rows.shape}")
    if rows.dtype == np.uint8:
        opaque = np.full((len(rows), 1), 255, dtype=np.uint8)
    else:
        if not ((rows >= 0) & (rows <= 1)).all():
            raise SceneError(f"{name} of floats must be from 0 to 1; use uint8 for 0 to 255")
        rows, opaque = rows.astype(np.float32), np.ones((len(rows), 1), dtype=np.float32)
    return rows.copy() if rows.shape[1] == 4 else np.concatenate([rows, opaque], axis=1)


def _image(image: ArrayLike, name: str) -> NDArray[np.uint8]:
    subject = f"image of texture {name!r}" if name else "image of a texture"
    rows = _array(image, subject)
    if rows.dtype != np.uint8 or rows.ndim != 3 or rows.shape[2] not in (3, 4) or not rows.size:
        raise SceneError(f"{subject} must be uint8 of shape (H, W, 3) or (H, W, 4), got {rows.dtype} {rows.shape}")
    return rows.copy()


def as_numbers(value: ArrayLike, message: str) -> np.ndarray:
    """Return an array of integers or floats; raise a `SceneError` with the message for anything else."""
    try:
        numbers = np.asarray(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # other libraries' arrays may raise any exception
        raise SceneError(message) from None
    if numbers.dtype.kind not in "iuf":
        raise SceneError(message)
    return numbers


def check_color(
    color: ArrayLike, subject: str, lengths: tuple[int, ...], *, maximum: float = 1.0, alternatives: str = ""
) -> tuple[Any, ...]:
    """Return a color of one of the `lengths` as numbers; the fourth is 1 where it is optional and not given."""
    count = " or ".join(_COUNTS[length] for length in lengths)
    limit = "from 0 to 1" if maximum == 1 else "of at least 0"
    message = f"{subject} must be {alternatives}{count} numbers {limit}, got {shown(color)}"
    numbers = as_numbers(color, message)
    if numbers.ndim != 1 or len(numbers) not in lengths:
        raise SceneError(message)
    values = numbers.astype(np.float64).tolist()
    if not all(0 <= value <= maximum and value != np.inf for value in values):
        raise SceneError(message)
    return (*values, *([1.0] if len(values) < lengths[-1] else []))


def check_vector(vector: ArrayLike, subject: str) -> tuple[float, float, float]:
    """Return three finite numbers."""
    message = f"{subject} must be three finite numbers, got {shown(vector)}"
    numbers = as_numbers(vector, message)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise SceneError(message)
    return tuple(numbers.astype(np.float64).tolist())


def linear_color(color: ArrayLike) -> tuple[float, ...]:
    """Convert an sRGB color, from 0 to 1, to a linear one (IEC 61966-2-1)."""
    parts = np.asarray(color, dtype=np.float64)
    return tuple(np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4).tolist())


def screen_color(color: ArrayLike) -> tuple[float, ...]:
    """Convert a linear color to sRGB."""
    parts = np.asarray(color, dtype=np.float64)
    return tuple(np.where(parts <= 0.0031308, parts * 12.92, 1.055 * parts ** (1 / 2.4) - 0.055).tolist())


def shown(value: object) -> str:
    """Return the text of a value for a message: its type, if its repr is long."""
    text = repr(value)
    return text if len(text) <= 80 else type(value).__name__
