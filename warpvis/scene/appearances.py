# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Deferred appearances: trimesh's visuals and vertex normals of files are stored, and converted on first use."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception, truncate
from warpvis.core.user_warnings import warn_user
from warpvis.errors import WarpvisError
from warpvis.scene._pixels import pixels_or_white
from warpvis.scene.materials import (
    Appearance,
    AppearanceLike,
    ColorSpace,
    Material,
    Texture,
    as_appearance,
)
from warpvis.scene.normals import replace_arrays, replace_invalid, transform_appearance

_DEFAULT_COLOR = (102, 102, 102, 255)
"""trimesh's default for colors that a SimpleMaterial does not define."""


class LazyAppearance:
    """An appearance, or a function that creates it on first use."""

    def __init__(
        self,
        make: Callable[[], Appearance | None] | None,
        found: Appearance | None = None,
        *,
        fits_any_mesh: bool = False,
        has_colors: bool = True,
    ) -> None:
        """Store the function or the appearance, and whether it is valid for any mesh."""
        self._make, self._found, self._fits_any_mesh = make, found, fits_any_mesh
        self.has_colors = has_colors
        """False if it has normals only, and no materials or colors."""
        self._lock = threading.Lock()

    def get(self) -> Appearance | None:
        """Return the appearance, creating it on first use; None if not defined."""
        with self._lock:
            if self._make is not None:
                self._found, self._make = self._make(), None
            return self._found

    def for_any_mesh(self) -> LazyAppearance:
        """Return the part that is valid for any mesh."""
        if self._fits_any_mesh:
            return self
        return LazyAppearance(lambda: (found := self.get()) and found.for_any_mesh(), fits_any_mesh=True)

    def transformed(self, linear: NDArray[np.float64]) -> LazyAppearance:
        """Return the appearance of a mesh transformed by a linear map, shape ``(3, 3)``; see `transform_appearance`."""
        if np.array_equal(linear, np.eye(3)):
            return self
        return self._changed(lambda found: transform_appearance(found, linear))

    def without_normals(self) -> LazyAppearance:
        """Return the appearance of a mesh whose vertices were changed."""

        def change(found: Appearance) -> Appearance:
            if found.normals is None and found.vertex_grid is None:
                return found
            return replace_arrays(found, normals=None, vertex_grid=None)

        return self._changed(change)

    def _changed(self, change: Callable[[Appearance], Appearance]) -> LazyAppearance:
        return LazyAppearance(lambda: (found := self.get()) and change(found), has_colors=self.has_colors)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the appearance itself."""
        return LazyAppearance, (None, self.get())


def choose_appearance(
    appearance: AppearanceLike | LazyAppearance | None,
    mesh: object,
    name: str,
    counts: tuple[int, int],
    *,
    color_space: ColorSpace | None = None,
) -> LazyAppearance | None:
    """Return the appearance given to `Scene.add`, or else that of the mesh of ``(vertices, faces)`` `counts`.

    `color_space` is that of the mesh's materials; by default linear for a PBRMaterial, else sRGB.
    """
    if isinstance(appearance, LazyAppearance):
        return appearance
    if appearance is not None:
        found = as_appearance(appearance, name)
        found.check_fits(*counts, name)
        return LazyAppearance(None, found)
    visual = getattr(mesh, "visual", None)
    parts = None if visual is None else _parts_of(visual)
    if parts is None:
        return None
    return LazyAppearance(lambda: _from_visual(parts, name, counts, color_space))


class FileNormals:
    """Vertex normals of a file's meshes; invalid ones cause one warning per file."""

    def __init__(self, file: str) -> None:
        """Store the name of the file for the warning."""
        self._file, self._has_warned = file, False

    def add(
        self,
        appearance: LazyAppearance | None,
        name: str,
        read: Callable[[], NDArray[np.generic]],
        mesh: Callable[[], tuple[NDArray[np.floating], NDArray[np.integer]]] | None,
    ) -> LazyAppearance:
        """Return an appearance with normals of vertices.

        Args:
            appearance: The appearance without normals.
            name: Name of the mesh in the warning.
            read: Returns the normals, shape ``(n, 3)``. It may raise any exception.
            mesh: Returns the vertices, shape ``(n, 3)``, and the triangles, ``(m, 3)``; None if all normals are valid.
        """

        def make() -> Appearance | None:
            found = None if appearance is None else appearance.get()
            rows = self._read(name, read, mesh)
            if rows is None or found is None:
                return found if rows is None else Appearance(normals=rows)
            return replace_arrays(found, normals=rows)

        return LazyAppearance(make, has_colors=appearance is not None and appearance.has_colors)

    def _read(
        self,
        name: str,
        read: Callable[[], NDArray[np.generic]],
        mesh: Callable[[], tuple[NDArray[np.floating], NDArray[np.integer]]] | None,
    ) -> NDArray[np.float32] | None:
        """Return valid normals; None if none is."""
        reason, normals = "", None
        try:
            rows: NDArray[Any] = read()
            valid: NDArray[Any] | None = rows
            if mesh is not None:
                vertices, faces = mesh()
                if rows.shape != vertices.shape:
                    raise ValueError(f"there must be one for each of {len(vertices)} vertices, got {rows.shape}")
                valid, count = replace_invalid(rows, vertices, faces)
                reason = f"{count} of {len(vertices)} are 0 or not finite" if count else ""
            normals = None if valid is None else Appearance(normals=valid).normals
        except Exception as error:  # malformed files may raise any exception
            reason = truncate(describe_exception(error))
        if reason and not self._has_warned:
            self._has_warned = True
            warn_user(
                f"{self._file}: using face normals where vertex normals of {name} are invalid: {reason}", UserWarning
            )
        return normals


def _parts_of(visual: Any) -> dict[str, Any] | None:
    """Return the current arrays of a trimesh visual, which trimesh replaces and rarely modifies in place."""
    stored = getattr(getattr(visual, "_data", None), "data", None)
    if isinstance(stored, dict) and stored:  # the property `kind` would hash all colors
        return {key: stored[key] for key in ("vertex_colors", "face_colors") if key in stored} or None
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        return {"uv": visual.uv, "material": visual.material, "face_materials": visual.face_materials}
    return None if kind not in ("vertex", "face") else {f"{kind}_colors": getattr(visual, f"{kind}_colors", None)}


def _from_visual(
    parts: dict[str, Any], name: str, counts: tuple[int, int], color_space: ColorSpace | None
) -> Appearance | None:
    """Create an appearance from the arrays of a visual; warn and return None where it does not fit the mesh."""
    try:
        materials = _materials(parts.pop("material", None))
        if color_space is not None:
            materials = tuple(replace(item, color_space=color_space, shading="phong") for item in materials)
        arrays = {key: np.asarray(value) for key, value in parts.items() if value is not None}
        found = Appearance(materials, **arrays)  # type: ignore[arg-type]  # the names of `_parts_of`
        found.check_fits(*counts, name)
    except (WarpvisError, TypeError, ValueError, AttributeError) as error:  # other libraries may raise these
        warn_user(f"the colors of {name!r} are ignored: {describe_exception(error)}", UserWarning)
        return None
    return found


def _materials(material: Any) -> tuple[Material, ...]:
    several = getattr(material, "materials", None)
    if isinstance(several, list | tuple) and several:
        return tuple(map(_material, several))
    return (Material() if material is None else _material(material),)


def _material(source: Any) -> Material:
    """Convert a material of trimesh: a PBRMaterial has factors of glTF, a SimpleMaterial those of MTL."""
    name = str(getattr(source, "name", None) or "")
    if hasattr(source, "baseColorFactor"):
        mode = str(source.alphaMode or "OPAQUE").lower()
        return Material(
            name,
            _unit_color(source.baseColorFactor, (1.0, 1.0, 1.0, 1.0)),
            "linear",
            _texture(source.baseColorTexture, name),
            mode if mode in ("opaque", "mask", "blend") else "opaque",  # type: ignore[arg-type]
            alpha_cutoff=_or(source.alphaCutoff, 0.5),
            metallic=_or(source.metallicFactor, 1.0),
            roughness=_or(source.roughnessFactor, 1.0),
            emission=_unit_color(source.emissiveFactor, (0.0, 0.0, 0.0))[:3],
            double_sided=bool(source.doubleSided),
            shading="pbr",
            metallic_roughness_texture=_texture(source.metallicRoughnessTexture, name, "linear"),
            normal_texture=_texture(source.normalTexture, name, "linear"),
            occlusion_texture=_texture(source.occlusionTexture, name, "linear"),
            emissive_texture=_texture(source.emissiveTexture, name),
        )
    image = getattr(source, "image", None)
    color = _simple_color(getattr(source, "diffuse", None), (1.0, 1.0, 1.0, 1.0), image is not None)
    return Material(
        name,
        color,
        texture=_texture(image, name),
        alpha_mode="blend" if color[3] < 1 else "opaque",
        specular=_simple_color(getattr(source, "specular", None), (0.0, 0.0, 0.0), True)[:3],
        shininess=max(0.0, _or(getattr(source, "glossiness", None), 0.0)),
    )


def _or(value: Any, otherwise: float) -> float:
    return otherwise if value is None else float(value)


def _unit_color(color: Any, otherwise: tuple[float, ...]) -> tuple[Any, ...]:
    """Return a color of trimesh, which are bytes or floats from 0 to 1, as numbers from 0 to 1."""
    if color is None:
        return otherwise
    numbers: NDArray[Any] = np.asarray(color)
    values = numbers.astype(np.float64) / (255.0 if numbers.dtype.kind in "iu" else 1.0)
    return tuple(values.tolist())


def _simple_color(color: Any, otherwise: tuple[float, ...], may_be_default: bool) -> tuple[Any, ...]:
    """Return a color of a SimpleMaterial; the gray default of an undefined one is replaced, as it darkens textures."""
    if may_be_default and color is not None and np.array_equal(color, _DEFAULT_COLOR):
        return otherwise
    return _unit_color(color, otherwise)


def _texture(image: Any, name: str, color_space: ColorSpace = "srgb") -> Texture | None:
    """Convert a Pillow image. trimesh flips v upwards, and stores neither wrap modes nor filters."""
    if image is None:
        return None
    return Texture(pixels_or_white(image, name or "a texture"), name, color_space=color_space)
