# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What objects look like, as long as nobody has asked: trimesh's visuals are remembered, and read when asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception
from warpvis.core.user_warnings import warn_user
from warpvis.errors import WarpvisError
from warpvis.scene._images import pixels_or_white
from warpvis.scene.materials import Appearance, AppearanceLike, ColorSpace, Material, Texture, as_appearance

_UNSAID = (102, 102, 102, 255)
"""What trimesh says of a SimpleMaterial's colours that nobody has said."""


class Look:
    """An appearance, or what makes it when it is first asked for."""

    def __init__(
        self,
        make: Callable[[], Appearance | None] | None,
        found: Appearance | None = None,
        *,
        fits_any_mesh: bool = False,
    ) -> None:
        """Remember what makes it, or what it is; and whether that counts for any mesh."""
        self._make, self._found, self._fits_any_mesh = make, found, fits_any_mesh
        self._lock = threading.Lock()

    def get(self) -> Appearance | None:
        """Return it; None if there is none."""
        with self._lock:
            if self._make is not None:
                self._found, self._make = self._make(), None
            return self._found

    def of_another_mesh(self) -> Look:
        """Return what of it counts for any mesh."""
        return self if self._fits_any_mesh else Look(self._first_material, fits_any_mesh=True)

    def _first_material(self) -> Appearance | None:
        found = self.get()
        return None if found is None else found.of_another_mesh()

    def __reduce__(self) -> tuple[Any, ...]:
        """Be the appearance itself in another process."""
        return Look, (None, self.get())


def look_of(
    given: AppearanceLike | Look | None,
    mesh: object,
    name: str,
    counts: tuple[int, int],
    *,
    color_space: ColorSpace | None = None,
) -> Look | None:
    """Return what `Scene.add` was given, or else what the mesh says.

    Args:
        given: What the user says; None for what the mesh says.
        mesh: The mesh, of which a `visual` like trimesh's says what it looks like.
        name: The object's.
        counts: Vertices and faces.
        color_space: Of materials that the mesh has; by default linear of a PBRMaterial, else sRGB.

    Raises:
        SceneError: What the user says is no appearance, or not of such a mesh.
    """
    if isinstance(given, Look):
        return given
    if given is not None:
        found = as_appearance(given, name)
        found.check_fits(*counts, name)
        return Look(None, found)
    visual = getattr(mesh, "visual", None)
    parts = None if visual is None else _parts_of(visual)
    if parts is None:
        return None
    return Look(lambda: _from_visual(parts, name, counts, color_space))


def _parts_of(visual: Any) -> dict[str, Any] | None:
    """Take hold of what a visual of trimesh has now: the arrays, which trimesh replaces and rarely writes into."""
    stored = getattr(getattr(visual, "_data", None), "data", None)
    if isinstance(stored, dict) and stored:  # trimesh takes a hash of all colours to say their kind
        return {key: stored[key] for key in ("vertex_colors", "face_colors") if key in stored} or None
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        return {"uv": visual.uv, "material": visual.material, "face_materials": visual.face_materials}
    return None if kind not in ("vertex", "face") else {f"{kind}_colors": getattr(visual, f"{kind}_colors", None)}


def _from_visual(
    parts: dict[str, Any], name: str, counts: tuple[int, int], color_space: ColorSpace | None
) -> Appearance | None:
    """Make an appearance of what a visual has; a warning, and none, where it does not fit the mesh."""
    try:
        materials = _materials(parts.pop("material", None))
        if color_space is not None:
            materials = tuple(replace(item, color_space=color_space) for item in materials)
        arrays = {key: np.asarray(value) for key, value in parts.items() if value is not None}
        found = Appearance(materials, **arrays)
        found.check_fits(*counts, name)
    except (WarpvisError, TypeError, ValueError, AttributeError) as error:  # other libraries' raise what they like
        warn_user(f"the colours of {name!r} are left out: {describe_exception(error)}", UserWarning)
        return None
    return found


def _materials(given: Any) -> tuple[Material, ...]:
    several = getattr(given, "materials", None)
    if isinstance(several, list | tuple) and several:
        return tuple(map(_material, several))
    return (Material() if given is None else _material(given),)


def _material(given: Any) -> Material:
    """Make a material of one of trimesh's: a PBRMaterial has factors of glTF, a SimpleMaterial those of MTL."""
    name = str(getattr(given, "name", None) or "")
    if hasattr(given, "baseColorFactor"):
        mode = str(given.alphaMode or "OPAQUE").lower()
        return Material(
            name,
            _unit_color(given.baseColorFactor, (1.0, 1.0, 1.0, 1.0)),
            "linear",
            _texture(given.baseColorTexture, name),
            mode if mode in ("opaque", "mask", "blend") else "opaque",  # type: ignore[arg-type]
            alpha_cutoff=_or(given.alphaCutoff, 0.5),
            metallic=_or(given.metallicFactor, 1.0),
            roughness=_or(given.roughnessFactor, 1.0),
            emission=_unit_color(given.emissiveFactor, (0.0, 0.0, 0.0))[:3],
            double_sided=bool(given.doubleSided),
        )
    image = getattr(given, "image", None)
    color = _said_color(getattr(given, "diffuse", None), (1.0, 1.0, 1.0, 1.0), image is not None)
    return Material(
        name,
        color,
        texture=_texture(image, name),
        alpha_mode="blend" if color[3] < 1 else "opaque",
        specular=_said_color(getattr(given, "specular", None), (0.0, 0.0, 0.0), True)[:3],
        shininess=max(0.0, _or(getattr(given, "glossiness", None), 0.0)),
    )


def _or(value: Any, otherwise: float) -> float:
    return otherwise if value is None else float(value)


def _unit_color(given: Any, otherwise: tuple[float, ...]) -> tuple[Any, ...]:
    """Return a colour from 0 to 1 of one of trimesh's, which are bytes or such numbers."""
    if given is None:
        return otherwise
    numbers: NDArray[Any] = np.asarray(given)
    values = numbers.astype(np.float64) / (255.0 if numbers.dtype.kind in "iu" else 1.0)
    return tuple(values.tolist())


def _said_color(given: Any, otherwise: tuple[float, ...], may_be_unsaid: bool) -> tuple[Any, ...]:
    """Return a colour of a SimpleMaterial, which has a gray one where nothing was said: it would darken a texture."""
    if may_be_unsaid and given is not None and np.array_equal(given, _UNSAID):
        return otherwise
    return _unit_color(given, otherwise)


def _texture(image: Any, name: str) -> Texture | None:
    """Keep an image of Pillow. trimesh turns v upwards, and keeps neither wrap modes nor filters."""
    return None if image is None else Texture(pixels_or_white(image, name or "a texture"), name)
