# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The visible prims of a stage, with their placements, labels and rigid bodies; instances are expanded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from warpvis.core.checks import describe_exception
from warpvis.io.usd._open import stage_meters
from warpvis.io.usd._semantics import Labels, direct_labels

SHAPES = (
    *("Mesh", "TetMesh", "Cube", "Sphere", "Cylinder", "Cone", "Capsule", "Plane"),
    *("Cylinder_1", "Capsule_1"),
)
"""Types of prims that have triangles."""

_NOT_READ = {
    "BasisCurves": "curves",
    "NurbsCurves": "curves",
    "HermiteCurves": "curves",
    "NurbsPatch": "NURBS patches",
    "Points": "points",
    "Volume": "volumes",
    "ParticleField": "particle fields",
    "ParticleField3DGaussianSplat": "Gaussian splats",
}
_SHOWN = ("default", "render")
_MAX_PLACES = 1_000_000
"""Maximum number of visible prims, all instances counted."""

_CHILDREN = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# Prototypes of point instancers may be overs, so that they are not drawn on their own.
_PROTOTYPE_CHILDREN = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract)


@dataclass(frozen=True, eq=False)
class Place:
    """A visible prim at one placement."""

    prim: Any
    kind: str
    """Type of the prim."""
    name: str
    """Its path; below a point instancer, the instancer's path, the instance's index, and the path from the prototype's
    parent."""
    matrix: NDArray[np.float64]
    """Prim to stage in meters, shape ``(4, 4)``."""
    names: tuple[str, ...]
    """Names and paths of the prims above it."""
    labels: Labels
    """Its semantic labels, the nearest first."""
    body: str = ""
    """Name of the rigid body that it belongs to."""
    is_instance: bool = False
    """Whether it is one of several instances."""


class _Above(NamedTuple):
    """What a prim inherits."""

    matrix: NDArray[np.float64]
    purpose: str = "default"
    names: tuple[str, ...] = ()
    labels: Labels = ()
    body: str = ""
    prefix: tuple[str, str] = ("", "")
    """The beginning of paths, and its replacement in names."""
    predicate: Any = _CHILDREN
    is_instance: bool = False


class StageWalk:
    """Visits a stage once, and collects its shapes, lights, cameras, bodies and joints in depth-first order."""

    def __init__(self, stage: Any, time: Any) -> None:
        self.places: list[Place] = []
        self.lights: list[tuple[Any, NDArray[np.float64]]] = []
        self.cameras: list[tuple[Any, NDArray[np.float64]]] = []
        self.bodies: dict[str, NDArray[np.float64]] = {}
        """Placements of rigid bodies by name."""
        self.joints: list[Any] = []
        self.skipped: Counter[str] = Counter()
        """Kinds of prims that have no triangles, such as "curves"."""
        self.invalid: list[str] = []
        """Reasons why prims are left out, one clause each."""
        self._time, self._open_instancers = time, set[str]()
        self._count = 0
        self.meters = stage_meters(stage)
        root = np.diag([self.meters, self.meters, self.meters, 1.0])
        for prim in stage.GetPseudoRoot().GetFilteredChildren(_CHILDREN):
            self._visit(prim, _Above(root))

    def _visit(self, root: Any, start: _Above) -> None:
        """Visit a prim and those below it."""
        stack = [(root, start)]
        while stack:
            prim, above = stack.pop()
            found = self._enter(prim, above)
            if found is not None:
                children = prim.GetFilteredChildren(found.predicate)
                stack += [(child, found) for child in reversed(children)]

    def _enter(self, prim: Any, above: _Above) -> _Above | None:
        """Collect a prim, and return what its children inherit; None if they are not visible."""
        kind = str(prim.GetTypeName())
        if kind in ("Material", "Shader", "NodeGraph", "GeomSubset"):
            return None
        if kind.startswith("Physics"):
            self.joints += [prim] if kind.endswith("Joint") else []
            return above
        if prim.IsA(UsdGeom.Imageable):
            imageable = UsdGeom.Imageable(prim)
            if imageable.GetVisibilityAttr().Get(self._time) == "invisible":
                return None
            purpose = imageable.GetPurposeAttr()
            if purpose.HasAuthoredValue():
                above = above._replace(purpose=str(purpose.Get()))
        above = self._below(prim, above)
        if above.purpose in _SHOWN:
            if kind == "PointInstancer":
                self._expand(prim, above)
                return None
            self._collect(prim, kind, above)
        elif kind == "PointInstancer":
            return None
        return above

    def _below(self, prim: Any, above: _Above) -> _Above:
        """Return what the children of a prim inherit."""
        path, name = str(prim.GetPath()), str(prim.GetName())
        names = above.names if above.prefix[0] else (*above.names, path)
        changes: dict[str, Any] = {"names": (*names, name)}
        if prim.IsA(UsdGeom.Xformable):
            changes["matrix"] = self._matrix(prim, above)
        schemas = prim.GetAppliedSchemas()
        labels = direct_labels(prim, schemas, self._time)
        if labels:
            changes["labels"] = (*labels, *above.labels)
        if "PhysicsRigidBodyAPI" in schemas and prim.GetAttribute("physics:rigidBodyEnabled").Get() is not False:
            changes["body"] = _named(path, above)
            self.bodies[changes["body"]] = changes.get("matrix", above.matrix)
        if prim.IsInstance():
            changes["is_instance"] = True
        return above._replace(**changes)

    def _matrix(self, prim: Any, above: _Above) -> NDArray[np.float64]:
        form = UsdGeom.Xformable(prim)
        local = np.array(form.GetLocalTransformation(self._time), dtype=np.float64).T
        if not np.isfinite(local).all():
            raise ValueError(f"the transform of <{prim.GetPath()}> must be finite")
        if local[3, 3] not in (0.0, 1.0):  # homogeneous coordinates, which renderers divide by their last one
            local /= local[3, 3]
        local[3] = (0.0, 0.0, 0.0, 1.0)
        if form.GetResetXformStack():
            return np.diag([self.meters, self.meters, self.meters, 1.0]) @ local
        return above.matrix @ local

    def _collect(self, prim: Any, kind: str, above: _Above) -> None:
        if kind in SHAPES:
            self._count += 1
            if self._count > _MAX_PLACES:
                raise ValueError(f"it has more than {_MAX_PLACES} visible prims, all instances counted")
            path = str(prim.GetPath())
            place = Place(
                prim, kind, _named(path, above), above.matrix, above.names, above.labels, above.body, above.is_instance
            )
            self.places.append(place)
        elif kind == "Camera":
            self.cameras.append((prim, above.matrix))
        elif kind.endswith("Light") or kind == "DomeLight_1":
            self.lights.append((prim, above.matrix))
        elif kind in _NOT_READ:
            self.skipped[_NOT_READ[kind]] += 1

    def _expand(self, prim: Any, above: _Above) -> None:
        """Add the instances of a point instancer, prototype by prototype."""
        path = str(prim.GetPath())
        if path in self._open_instancers:
            raise ValueError(f"<{path}> is below its own prototype")
        self._open_instancers.add(path)
        name = _named(path, above)
        try:
            try:
                matrices, numbers, chosen = _instances(prim, self._time)
            except ValueError as error:
                self.invalid.append(str(error))
                return
            targets = prim.GetRelationship("prototypes").GetForwardedTargets()
            for number, target in enumerate(targets):
                rows = np.flatnonzero(chosen == number)
                prototype = prim.GetStage().GetPrimAtPath(target)
                if len(rows) and prototype:
                    placements = above.matrix @ matrices[rows]
                    self._add_copies(prototype, name, placements, numbers[rows], above)
        finally:
            self._open_instancers.discard(path)

    def _add_copies(
        self, prototype: Any, name: str, placements: NDArray[np.float64], numbers: NDArray[np.intp], above: _Above
    ) -> None:
        """Add the prims of a prototype at all of its placements."""
        path = str(prototype.GetPath())
        parent = path.rpartition("/")[0]
        outer, self.places = self.places, list[Place]()
        outer_lights, outer_cameras = len(self.lights), len(self.cameras)
        bodies = dict(self.bodies)
        start = above._replace(
            matrix=np.eye(4), prefix=(f"{parent}/", "/"), predicate=_PROTOTYPE_CHILDREN, is_instance=True, body=""
        )
        self._visit(prototype, start)
        inner, self.places = self.places, outer
        lights, cameras = self.lights[outer_lights:], self.cameras[outer_cameras:]
        del self.lights[outer_lights:], self.cameras[outer_cameras:]
        own = {key: matrix for key, matrix in self.bodies.items() if key not in bodies}
        self.bodies = bodies
        self._count += (len(placements) - 1) * len(inner)
        if self._count > _MAX_PLACES:
            raise ValueError(f"it has more than {_MAX_PLACES} visible prims, all instances counted")
        self.places += _copies(inner, name, placements, numbers, above)
        for number, matrix in zip(numbers.tolist(), placements, strict=True):
            self.bodies |= {f"{name}/{number}{key}": matrix @ place for key, place in own.items()}
            self.lights += [(light, matrix @ place) for light, place in lights]
            self.cameras += [(camera, matrix @ place) for camera, place in cameras]


def _copies(
    inner: list[Place], name: str, placements: NDArray[np.float64], numbers: NDArray[np.intp], above: _Above
) -> Iterator[Place]:
    """Yield the prims of a prototype at all placements; the copies of each prim follow each other."""
    for place in inner:
        for number, matrix in zip(numbers.tolist(), placements @ place.matrix, strict=True):
            body = f"{name}/{number}{place.body}" if place.body else above.body
            yield replace(place, name=f"{name}/{number}{place.name}", matrix=matrix, body=body)


def _instances(prim: Any, time: Any) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
    """Return the visible instances of a point instancer: matrices without those of prototypes, indices, prototypes."""
    instancer, path = UsdGeom.PointInstancer(prim), prim.GetPath()
    chosen = np.array(instancer.GetProtoIndicesAttr().Get(time) or [], dtype=np.intp)
    for name in ("positions", "orientations", "scales"):
        rows = prim.GetAttribute(name).Get(time)
        if len(rows or ()) not in ((len(chosen),) if name == "positions" else (0, len(chosen))):
            raise ValueError(f"<{path}> must have one of {name} for each of its {len(chosen)} protoIndices")
    count = len(prim.GetRelationship("prototypes").GetForwardedTargets())
    if len(chosen) and not 0 <= chosen.min() <= chosen.max() < count:
        raise ValueError(f"protoIndices of <{path}> must be from 0 to {count - 1}, got {chosen.max()}")
    if not len(chosen):
        return np.zeros((0, 4, 4)), np.zeros(0, dtype=np.intp), chosen
    try:
        found = instancer.ComputeInstanceTransformsAtTime(
            time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        )
    except Exception as error:
        raise ValueError(f"the instances of <{path}> cannot be read: {describe_exception(error)}") from None
    matrices = np.array(found, dtype=np.float64).reshape(-1, 4, 4).swapaxes(1, 2)
    if len(matrices) != len(chosen) or not np.isfinite(matrices).all():
        raise ValueError(f"<{path}> must have finite positions, orientations and scales")
    mask = np.array(instancer.ComputeMaskAtTime(time) or np.ones(len(chosen)), dtype=bool)
    numbers = np.flatnonzero(mask) if len(mask) == len(chosen) else np.arange(len(chosen))
    return matrices[numbers], numbers, chosen[numbers]


def _named(path: str, above: _Above) -> str:
    """Return the name of a prim: its path, or below a prototype, the path from the prototype's parent."""
    start, replacement = above.prefix
    return replacement + path.removeprefix(start) if start else path
