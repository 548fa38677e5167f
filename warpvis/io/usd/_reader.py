# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""USD stages as the parts of a scene, in meters, with the vertical axis of the stage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, UsdGeom, UsdShade

from warpvis.core.categories import label_of_category
from warpvis.core.checks import describe_exception, pluralize, truncate
from warpvis.errors import FileFormatError
from warpvis.io._gltf_placements import split
from warpvis.io.usd._appearances import Primvar, Surface, needed_primvars
from warpvis.io.usd._joints import read_joints
from warpvis.io.usd._lights import read_lights
from warpvis.io.usd._materials import MaterialSource, read_material
from warpvis.io.usd._meshes import Geometry, Triangles, read_geometry
from warpvis.io.usd._open import bake_skins, composition_errors, first_error, open_stage, quiet, stage_time
from warpvis.io.usd._semantics import category
from warpvis.io.usd._walk import Place, StageWalk
from warpvis.scene import Axis, FileParts, Part, keep_winding, move_with_links
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.joints import JointTree
from warpvis.scene.lights import HEADLIGHT
from warpvis.scene.solids import Solid

_MAX_NAMED = 5
_MAX_LENGTH = 200
"""Maximum length of what a message names [characters]."""
_MAX_CORNERS = 100_000_000
"""Maximum number of corners of all copies of a mesh, one for each size."""


def read_stage(path: Path, *, search_path: Sequence[Path], strict: bool) -> FileParts:
    """Read a stage at its first frame; see `warpvis.Scene.load`."""
    with quiet():
        try:
            return _Reader(path, search_path).read(strict=strict)
        except FileFormatError:
            raise
        except Tf.ErrorException as error:
            raise FileFormatError(f"{path}: cannot be read as USD: {truncate(first_error(error), 300)}") from None
        except Exception as error:  # damaged files may raise any exception
            raise FileFormatError(f"{path}: {truncate(describe_exception(error), 400)}") from None


class _Reader:
    """Reads one stage."""

    def __init__(self, path: Path, search_path: Sequence[Path]) -> None:
        self._path = path
        self._stage = open_stage(path, search_path)
        self._time = stage_time(self._stage)
        self._geometries: dict[Any, Geometry | None] = {}
        self._by_content: dict[bytes, Geometry] = {}
        self._materials: dict[str, MaterialSource] = {}
        self._surfaces: dict[Any, LazyAppearance] = {}
        self._sized: dict[Any, tuple[Triangles | Solid, NDArray[np.float64]]] = {}
        self._shown: dict[Any, LazyAppearance] = {}
        self._textures: dict[Any, Any] = {}
        self._equal_materials: dict[Any, MaterialSource] = {}
        self._equal_surfaces: dict[Any, LazyAppearance] = {}
        self._corners = 0
        self._empty: list[str] = []

    def read(self, *, strict: bool) -> FileParts:
        """Return the parts, lights and warnings."""
        unposed = bake_skins(self._stage)
        walk = StageWalk(self._stage, self._time)
        bindings = self._bindings(walk.places)
        joints, unjoined = read_joints(walk.joints, walk.bodies, walk.meters)
        parts = self._parts(walk.places, bindings, joints)
        lights, background, unlit = read_lights(walk.lights, walk.meters, self._time, parts)
        missing = composition_errors(self._stage)
        messages = [f"{self._path}: {text}" for text in self._skipped(walk, missing)]
        if strict and messages:
            raise FileFormatError(messages[0])
        notes = [note for source in self._materials.values() for note in source.notes]
        notes = [*dict.fromkeys(notes), *unlit, *unjoined, *unposed]
        if notes:
            messages.append(f"{self._path}: not read: {_listed(notes)}")
        up: Axis = "z" if UsdGeom.GetStageUpAxis(self._stage) == UsdGeom.Tokens.z else "y"
        return FileParts(
            self._path,
            move_with_links(parts, joints),
            up=up,
            warnings=tuple(messages),
            lights=tuple(lights) or (HEADLIGHT,),
            background=background,
            joints=joints,
        )

    def _skipped(self, walk: StageWalk, missing: list[str]) -> list[str]:
        """Return sentences about content that is left out."""
        found = []
        if missing:
            more = f" (and {len(missing) - 1} others)" if len(missing) > 1 else ""
            found.append(f"left out references that cannot be opened: {truncate(missing[0], 300)}{more}")
        if walk.invalid:
            found.append(f"left out instances: {_listed(walk.invalid)}")
        if self._empty:
            found.append(f"left out {_listed(self._empty)}, which hold no triangles")
        if walk.skipped:
            kinds = ", ".join(f"{count} of {kind}" for kind, count in sorted(walk.skipped.items()))
            found.append(f"left out prims without triangles ({kinds}); Blender or Houdini can convert them to meshes")
        return found

    def _parts(self, places: Sequence[Place], bindings: dict[str, str], joints: JointTree) -> list[Part]:
        """Return the parts in the file's order; those with equal meshes follow each other.

        Round shapes are solids unless their body has other shapes, since nothing can be attached to solids.
        """
        shapes = [self._geometry(place) for place in places]
        kept = [(place, shape) for place, shape in zip(places, shapes, strict=True) if shape is not None]
        if not kept:
            return []
        found = split(np.stack([place.matrix for place, _ in kept]))
        pieces = joints.pieces()
        counts = Counter(pieces.get(place.body) for place, _ in kept)
        parts = []
        for (place, shape), one in zip(kept, found.one_by_one(), strict=True):
            linear = np.diag(one.factors[0]) if one.fits[0] else place.matrix[:3, :3]
            pose = one.rows[0] if one.fits[0] else np.array([*place.matrix[:3, 3], 0.0, 0.0, 0.0, 1.0])
            piece = pieces.get(place.body)
            is_solid = bool(one.fits[0]) and (piece is None or counts[piece] == 1)
            mesh, applied = self._mesh(shape, linear, is_solid=is_solid)
            word = category(place.labels)
            words = tuple(label for _, label in place.labels)
            part = Part(
                place.name,
                mesh,
                label_of_category(word),
                pose,
                link=place.body or None,
                category=word,
                aliases=tuple(dict.fromkeys((*place.names, *words))),
                appearance=self._appearance(place, shape, bindings, applied),
                extras={"kind": place.kind},
            )
            parts.append(part)
        return _grouped(parts)

    def _geometry(self, place: Place) -> Geometry | None:
        """Return the triangles of a prim; equal ones are the same object."""
        prim = place.prim
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = str(source.GetPath())
        if key not in self._geometries:
            found = read_geometry(prim, place.kind, self._time)
            if found is None or not len(found.faces):
                self._empty.append(repr(place.name))
                found = None
            else:
                found = self._by_content.setdefault(found.key, found)
            self._geometries[key] = found
        return self._geometries[key]

    def _mesh(
        self, shape: Geometry, linear: NDArray[np.float64], *, is_solid: bool
    ) -> tuple[Triangles | Solid, NDArray[np.float64]]:
        """Return the scaled mesh, a solid if possible, and the linear map that was applied; equal ones are the same."""
        is_solid = is_solid and shape.solid is not None
        with np.errstate(over="ignore"):
            key = shape.key, linear.astype(np.float32).tobytes(), is_solid
        if key not in self._sized:
            self._corners += len(shape.vertices)
            if self._corners > _MAX_CORNERS:
                raise ValueError(f"the sizes of its meshes have more than {_MAX_CORNERS} corners in total")
            with np.errstate(invalid="ignore", over="ignore"):  # the scene checks that vertices are finite
                vertices = shape.vertices @ linear.T
            mesh = vertices, keep_winding(shape.faces, linear)
            solid = shape.scaled_solid(np.diag(linear), mesh) if is_solid else None
            self._sized[key] = solid or mesh, linear
        return self._sized[key]

    def _bindings(self, places: Sequence[Place]) -> dict[str, str]:
        """Return the paths of the materials of prims and their subsets, by the paths of these."""
        prims = {}
        for place in places:
            prims[str(place.prim.GetPath())] = place.prim
            if place.kind == "Mesh":
                for subset in UsdShade.MaterialBindingAPI(place.prim).GetMaterialBindSubsets():
                    prims[str(subset.GetPath())] = subset.GetPrim()
        found: dict[str, str] = {}
        for purpose in ("preview", "full"):
            rest = {path: prim for path, prim in prims.items() if path not in found}
            if not rest:
                break
            materials, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(list(rest.values()), purpose)
            for path, material in zip(rest, materials, strict=True):
                if material:
                    found[path] = self._material(material)
        return found

    def _material(self, material: Any) -> str:
        """Read a material once, and return its path."""
        prim = material.GetPrim()
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        path = str(source.GetPath())
        if path not in self._materials:
            found = read_material(material, self._time)
            self._materials[path] = self._equal_materials.setdefault(found.content, found)
        return path

    def _appearance(
        self, place: Place, shape: Geometry, bindings: dict[str, str], linear: NDArray[np.float64]
    ) -> LazyAppearance | None:
        """Return the deferred appearance of a prim; equal ones are the same object."""
        prim = place.prim
        path = str(prim.GetPath())
        subsets = []
        if place.kind == "Mesh":
            subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        chosen = [bindings.get(path), *(bindings.get(str(subset.GetPath())) for subset in subsets)]
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = str(source.GetPath()), *chosen
        if key not in self._surfaces:
            surface = self._surface(place, shape, subsets, chosen)
            has_colors = any(chosen) or "displayColor" in surface.primvars
            lazy = LazyAppearance(partial(surface.appearance, shape), has_colors=has_colors)
            self._surfaces[key] = self._equal_surfaces.setdefault((shape.key, surface.content), lazy)
        sized = id(self._surfaces[key]), linear.astype(np.float32).tobytes()
        if sized not in self._shown:
            is_similar = np.array_equal(linear, np.eye(3) * linear[0, 0]) and linear[0, 0] > 0
            found = self._surfaces[key]
            self._shown[sized] = found if is_similar else found.transformed(linear)
        return self._shown[sized]

    def _surface(self, place: Place, shape: Geometry, subsets: Sequence[Any], chosen: Sequence[str | None]) -> Surface:
        """Read what determines the appearance of a prim."""
        prim = place.prim
        slots, polygons = [chosen[0]], np.zeros(shape.polygon_count, dtype=np.int32)
        for subset, material in zip(subsets, chosen[1:], strict=True):
            indices = np.array(subset.GetIndicesAttr().Get(self._time) or [], dtype=np.int64)
            indices = indices[(indices >= 0) & (indices < len(polygons))]
            if material not in slots:
                slots.append(material)
            polygons[indices] = slots.index(material)
        used = np.unique(polygons).tolist()
        polygons = np.searchsorted(used, polygons).astype(np.int32)
        materials = [None if (slot := slots[index]) is None else self._materials[slot] for index in used]
        sided = UsdGeom.Gprim(prim).GetDoubleSidedAttr().Get(self._time)
        return Surface(
            str(self._path),
            f"<{place.name}>",
            bool(sided),
            materials,
            polygons if len(used) > 1 else None,
            self._primvars(prim, needed_primvars(materials)),
            self._textures,
        )

    def _primvars(self, prim: Any, names: set[str]) -> dict[str, Primvar]:
        """Read primvars, also inherited ones, and normals."""
        api, found = UsdGeom.PrimvarsAPI(prim), {}
        for name in sorted({*names, "normals"}):
            primvar = api.FindPrimvarWithInheritance(name)
            values = primvar.ComputeFlattened(self._time) if primvar and primvar.HasValue() else None
            if values is not None:
                found[name] = _primvar(values, str(primvar.GetInterpolation()))
        if "normals" not in found and prim.IsA(UsdGeom.PointBased):
            based = UsdGeom.PointBased(prim)
            values = based.GetNormalsAttr().Get(self._time)
            if values:
                found["normals"] = _primvar(values, str(based.GetNormalsInterpolation()))
        return found


def _primvar(values: Any, interpolation: str) -> Primvar:
    try:
        rows = np.array(values)
    except (TypeError, ValueError):
        rows = np.zeros((0, 1))
    width = int(np.prod(rows.shape[1:]))
    return Primvar(rows.reshape(-1, width) if rows.ndim else rows.reshape(1, 1), interpolation)


def _grouped(parts: list[Part]) -> list[Part]:
    """Sort parts so that those that can be instances of one mesh follow the first of them."""
    first: dict[Any, int] = {}
    keys = []
    for number, part in enumerate(parts):
        arrays = (id(part.mesh),) if isinstance(part.mesh, Solid) else tuple(map(id, part.mesh))
        key = arrays, id(part.appearance), part.label, part.category, part.link is None
        keys.append(first.setdefault(key, number))
    order = sorted(range(len(parts)), key=lambda number: (keys[number], number))
    return [parts[number] for number in order]


def _listed(items: Sequence[str]) -> str:
    """Return the first items of a list in words, and the number of others."""
    more = len(items) - _MAX_NAMED
    named = ", ".join(truncate(item, _MAX_LENGTH) for item in items[:_MAX_NAMED])
    return named + (f", and {pluralize(more, 'other')}" if more > 0 else "")
