# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of a MuJoCo model's geoms and sites to a scene."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import check_length
from warpvis.core.checks import as_items, check_choice, check_flag, check_mapping, is_whole
from warpvis.core.labels import LabelInput, LabelNames, LabelRules
from warpvis.core.types import DeviceLike
from warpvis.errors import SceneError
from warpvis.mujoco._geoms import (
    DEFAULT_GROUPS,
    FIXED,
    check_groups,
    default_label,
    fits,
    geom_parts,
    has_opacity,
    movable_bodies,
    rigid_pieces,
    shown_geoms,
)
from warpvis.mujoco._lights import model_background, model_lights
from warpvis.mujoco._model_fields import check_shape_numbers, drawn_number, object_names, shape_bodies
from warpvis.scene import Scene
from warpvis.scene.solids import DEFAULT_MESH_TOLERANCE

_NAMED = 5
JOINT_WRAP = int(mujoco.mjtWrap.mjWRAP_JOINT)

# Indices of the flags of a `mujoco.MjvOption`.
_FLAGS = {
    name.removeprefix("mjVIS_"): int(flag)
    for name, flag in mujoco.mjtVisFlag.__members__.items()
    if name.startswith("mjVIS_")
}
_SOFT_FLAGS = "SKIN", "TENDON", "FLEXVERT", "FLEXEDGE", "FLEXFACE", "FLEXSKIN"
# Flags that only change the appearance of geoms, sites, skins, flexes and tendons, or what other flags draw.
_ADD_NOTHING = (
    *("CONVEXHULL", "TEXTURE", "ACTIVATION", "RANGEFINDER", "SCLINERTIA", "PERTOBJ", "ISLAND", "CONTACTSPLIT"),
    *("TRANSPARENT", "STATIC", *_SOFT_FLAGS),
)
ADDING_FLAGS = [flag for name, flag in _FLAGS.items() if name not in _ADD_NOTHING]

Movable = Literal["bodies", "all"] | Iterable[str]


@dataclass(frozen=True, eq=False)
class MujocoScene:
    """A scene of a MuJoCo model's geoms and sites, with their ids; from `scene_from_mujoco`.

    Objects added to `scene` follow those of the model.
    """

    scene: Scene
    """Objects of the geoms, in the order of `geom_ids`, then of the sites, then added objects."""
    geom_ids: NDArray[np.int32]
    """Geom ids of the scene's first objects, shape ``(G,)``."""
    movable_geoms: NDArray[np.int32]
    """Geom ids of the first columns of object poses, shape ``(M,)``; other geoms are attached to these."""
    geom_count: int
    """Number of geoms of the model, visible or not."""
    site_ids: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """Site ids of the next objects, shape ``(S,)``."""
    movable_sites: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """Site ids of the next columns of object poses."""
    site_count: int = 0
    """Number of sites of the model, visible or not."""

    def __copy__(self) -> MujocoScene:
        """Return a copy that shares meshes but not later additions of objects."""
        return replace(self, scene=copy.copy(self.scene))

    def to(self, device: DeviceLike) -> MujocoScene:
        """Return a copy on another device."""
        return replace(self, scene=self.scene.to(device))

    def geoms_of_objects(self) -> NDArray[np.int32]:
        """List the geom id of every object of the scene, shape ``(objects,)``; -1 for sites and added objects."""
        geoms = np.full(len(self.scene), -1, dtype=np.int32)
        geoms[: len(self.geom_ids)] = self.geom_ids
        return geoms

    def shapes(self) -> NDArray[np.int32]:
        """List the shape numbers of geoms and sites (numbered after all geoms) of the first objects, ``(G + S,)``."""
        return np.concatenate([self.geom_ids, self.geom_count + self.site_ids])


def scene_from_mujoco(
    model: mujoco.MjModel,
    *,
    geom_groups: Iterable[int] = DEFAULT_GROUPS,
    site_groups: Iterable[int] = (),
    mesh_tolerance: float = DEFAULT_MESH_TOLERANCE,
    labels: LabelInput | None = None,
    label_names: Mapping[int, str] | None = None,
    exclude: Iterable[str] = (),
    movable: Movable = "bodies",
    static: bool = True,
    device: DeviceLike = "cpu",
) -> MujocoScene:
    """Build a scene of a MuJoCo model's geoms, one object each, regardless of whether they collide.

    Geoms whose color has alpha 0 are skipped, as by MuJoCo's renderer (`addGeomGeoms` in
    src/engine/engine_vis_visualize.c). Sites are skipped unless their group is in `site_groups`. Tendons, skins and
    flexes are skipped, although MuJoCo and `Renderer` draw them. Sizes, meshes, heights, colors and local poses of
    geoms are read once; build another scene after changing them, or use `Renderer`, which follows changes.

    All shapes are exact, except that planes are 0.1 mm lower when seen from below, and that infinite planes end at 10
    times the distance of MuJoCo's far clipping plane from their origin. From inside a round shape, and on export, its
    triangles are used; their distance from it is at most `mesh_tolerance`, or 1e-4 of its largest radius if that is
    greater.

    The name of an object is that of its geom, or of the geom's body if the geom has no name, with ``_1``, ``_2``, ...
    appended to duplicates. Planes, height fields, and names with "floor" or "ground" are `Label.GROUND`; others are
    `Label.OBSTACLE`, unless specified by `labels`.

    Args:
        model: A `mujoco.MjModel`.
        geom_groups: Groups of visible geoms, from 0 to 5; 0, 1 and 2 by default, as in MuJoCo.
        site_groups: Groups of visible sites; none by default, since sites are markers that sensors do not see.
        mesh_tolerance: Maximum distance between round shapes and their triangles [m].
        labels: Labels by name of the object or its body; a name may be a pattern (``"wall_*"``), and the last match
            applies. Or a file of labels, as for `Scene.load`.
        label_names: Names of user-defined classes, as for `Scene`.
        exclude: Names or patterns of objects or bodies to skip, and of tendons, skins and flexes not to warn of.
        movable: ``"bodies"`` for geoms of bodies that are not welded to the world, geoms of mocap bodies, and all round
            geoms; ``"all"`` for all geoms, where each of the others moves independently, for models whose geoms are
            moved by the user; or names or patterns of additional bodies, each of which moves rigidly, and geoms, each
            of which moves independently.
        static: Whether geoms of bodies welded to the world are visible.
        device: Device on which the scene is rendered.

    Warns:
        UserWarning: If the model has skins, flexes or tendons that MuJoCo draws and that are not in `exclude`.

    Raises:
        SceneError: If a pattern has no match, or values of the model are not finite.
    """
    options: dict[str, Any] = {"mesh_tolerance": mesh_tolerance, "labels": labels, "label_names": label_names}
    options |= {"geom_groups": geom_groups, "site_groups": site_groups, "exclude": exclude, "static": static}
    selection = select_geoms(model, **options)
    warn_of_soft(model, selection, None)
    return make_scene(model, selection, movable=movable, device=device)


def make_scene(
    model: mujoco.MjModel,
    selection: Selection,
    *,
    movable: Movable,
    device: DeviceLike,
    independent: Iterable[int] = (),
) -> MujocoScene:
    """Build the scene of `scene_from_mujoco` without warnings; the geoms in `independent` move independently."""
    pieces = _choose_pieces(model, selection.names, movable)
    single = list(independent)
    pieces[single] = model.nbody + np.array(single, dtype=np.int32)
    scene = Scene(device=device)
    scene.use_labels(selection.rules)
    scene.lights, scene.background = model_lights(model), model_background(model)
    added = []
    names, labels, mesh_tolerance = selection.names, selection.labels, selection.mesh_tolerance
    parts = geom_parts(model, selection.shown(model), names, labels, mesh_tolerance=mesh_tolerance, pieces=pieces)
    for geom, part in parts:
        scene.add(**part.arguments())
        added.append(geom)
    shapes = np.array(added, dtype=np.int32)
    moving, count = shapes[list(scene.movable)], int(model.ngeom)
    geom_ids, site_ids = shapes[shapes < count], shapes[shapes >= count] - count
    movable_geoms, movable_sites = moving[moving < count], moving[moving >= count] - count
    return MujocoScene(scene, geom_ids, movable_geoms, count, site_ids, movable_sites, int(model.nsite))


@dataclass(frozen=True)
class Selection:
    """The visible geoms of a model, with their names and labels."""

    names: list[str]
    """Names of all visual elements, in the numbering of `object_names`."""
    labels: list[int]
    """Their labels."""
    rules: LabelRules
    """Rules for labels and class names."""
    left_out: frozenset[int]
    """Numbers of elements that are excluded regardless of their group."""
    groups: tuple[int, ...]
    site_groups: tuple[int, ...]
    static: bool
    """Whether geoms of bodies welded to the world are visible."""
    mesh_tolerance: float

    def shown(self, model: mujoco.MjModel) -> list[int]:
        """List the currently visible geoms and sites."""
        moves = movable_bodies(model)[shape_bodies(model)]
        return [
            geom
            for geom in shown_geoms(model, self.groups, self.site_groups)
            if geom not in self.left_out and (self.static or moves[geom])
        ]


def select_geoms(
    model: mujoco.MjModel,
    *,
    geom_groups: Iterable[int],
    site_groups: Iterable[int],
    mesh_tolerance: float,
    labels: LabelInput | None,
    label_names: Mapping[int, str] | None = None,
    exclude: Iterable[str],
    static: bool,
) -> Selection:
    """Parse the arguments of `scene_from_mujoco` that select visible geoms, names and labels."""
    if not isinstance(model, mujoco.MjModel):
        raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
    static = check_flag(static, "static", SceneError)
    mesh_tolerance = check_length(mesh_tolerance, "mesh_tolerance", zero=False, error=SceneError)
    groups, sites = check_groups(geom_groups), check_groups(site_groups, "site_groups")
    check_shape_numbers(model)
    names = object_names(model)
    rules = LabelRules.of(labels, label_names)
    label_numbers, left_out = _assign_labels(model, names, rules, check_patterns(exclude))
    return Selection(names, label_numbers, rules, frozenset(left_out), groups, sites, static, mesh_tolerance)


def shown_by(option: mujoco.MjvOption | None) -> tuple[tuple[int, ...], bool, tuple[int, ...]]:
    """Return the shown groups of geoms, whether geoms welded to the world are shown, and the shown groups of sites."""
    if option is None:
        return DEFAULT_GROUPS, True, DEFAULT_GROUPS
    if not isinstance(option, mujoco.MjvOption):
        raise SceneError(f"scene_option must be a mujoco.MjvOption, got {type(option).__name__}")
    if option.flags[_FLAGS["CONVEXHULL"]]:
        raise SceneError("scene_option must not enable convex hulls (mjVIS_CONVEXHULL), which are not rendered")
    groups, sites = (tuple(np.flatnonzero(shown).tolist()) for shown in (option.geomgroup, option.sitegroup))
    return groups, bool(option.flags[_FLAGS["STATIC"]]), sites


def _soft_names(model: mujoco.MjModel, names: Sequence[str], option: mujoco.MjvOption | None) -> dict[int, str]:
    """Return the names of the skins, flexes and spatial tendons that MuJoCo draws, by their numbers in `names`."""
    option = mujoco.MjvOption() if option is None else option
    flags = {name: bool(option.flags[_FLAGS[name]]) for name in _SOFT_FLAGS}
    of_flex = any(flags[name] for name in _SOFT_FLAGS if name.startswith("FLEX"))
    kinds = (("skin", option.skingroup, flags["SKIN"]), ("flex", option.flexgroup, of_flex))
    found = {}
    for kind, groups, drawn in (*kinds, ("tendon", option.tendongroup, flags["TENDON"])):
        for index in range(getattr(model, f"n{kind}")):
            group, rgba, material = (getattr(model, f"{kind}_{name}")[index] for name in ("group", "rgba", "matid"))
            if kind == "tendon":  # visible regardless of opacity
                shows = model.wrap_type[model.tendon_adr[index]] != JOINT_WRAP
            else:
                shows = has_opacity(model, rgba, int(material))
            number = drawn_number(model, int(getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")), index)
            if drawn and shows and groups[min(max(int(group), 0), len(groups) - 1)] and number is not None:
                found[number] = f"{kind} {names[number]!r}"
    return found


def warn_of_soft(model: mujoco.MjModel, selection: Selection, option: mujoco.MjvOption | None) -> None:
    """Warn of the skins, flexes and tendons that MuJoCo draws and that cannot be rigid objects of a scene."""
    found = _soft_names(model, selection.names, option)
    names = [name for number, name in found.items() if number not in selection.left_out]
    if names:
        listed = ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
        warnings.warn(
            f"elements of mujoco.Renderer and warpvis.mujoco.Renderer that are not rendered: {listed}", stacklevel=3
        )


def _choose_pieces(model: mujoco.MjModel, names: list[str], movable: Movable) -> NDArray[np.int32]:
    """Return the number of the rigid piece of each shape, ``(shapes,)``, by the argument of `scene_from_mujoco`."""
    if isinstance(movable, str):
        check_choice(movable, "movable", ("bodies", "all"), SceneError)
        return rigid_pieces(model, independent=range(len(shape_bodies(model))) if movable == "all" else ())
    patterns = check_patterns(movable, "movable")
    fixed, bodies = rigid_pieces(model) == FIXED, shape_bodies(model)
    independent, loose = set(), set()
    for pattern in patterns:
        for geom in fitting(model, names[: len(bodies)], pattern, "movable"):
            body = int(bodies[geom])
            if fixed[geom] and body and fits(model.body(body).name, (pattern,)):
                loose.add(body)
            elif fixed[geom]:
                independent.add(geom)
    return rigid_pieces(model, loose_bodies=loose, independent=independent)


def class_of_elements(model: mujoco.MjModel, classes: Mapping[str, int], name: str = "classes") -> NDArray[np.int32]:
    """Return the number of the last pattern that matches a visual element or its body, in the order of `object_names`.

    Elements without a match have -1.
    """
    names = object_names(model)
    numbers = np.full(len(names), -1, dtype=np.int32)
    check_patterns(check_mapping(classes, name, SceneError), name)
    for pattern, number in classes.items():
        if not is_whole(number) or not 0 <= number < 2**31:
            raise SceneError(f"{name} must be whole numbers from 0 up, got {number!r} for {pattern!r}")
        numbers[fitting(model, names, pattern, name)] = number
    return numbers


def class_of_geoms(model: mujoco.MjModel, classes: Mapping[str, int], name: str = "classes") -> NDArray[np.int32]:
    """Return the numbers of `class_of_elements` of geoms and sites, ``(shapes,)``."""
    return class_of_elements(model, classes, name)[: len(shape_bodies(model))]


def check_patterns(patterns: Any, name: str = "exclude") -> tuple[str, ...]:
    """Check names or patterns of names, and return them as a tuple."""
    items = as_items(patterns, name, SceneError)
    wrong = [item for item in items if not isinstance(item, str)]
    if wrong:
        raise SceneError(f"{name} must be names or patterns of names, got {wrong[0]!r}")
    return tuple(items)


def _assign_labels(
    model: mujoco.MjModel, names: list[str], rules: LabelRules, exclude: tuple[str, ...]
) -> tuple[list[int], set[int]]:
    """Return labels of all visual elements, and numbers of excluded ones."""
    classes = LabelNames(rules.label_names)
    numbers: list[int] = [default_label(model, geom, name) for geom, name in enumerate(names)]
    for pattern, label in rules.labels.items():
        for geom in fitting(model, names, pattern, "labels"):
            numbers[geom] = classes.number(label)
    return numbers, {geom for pattern in exclude for geom in fitting(model, names, pattern, "exclude")}


def fitting(model: mujoco.MjModel, names: list[str], pattern: str, argument: str) -> list[int]:
    """Find the numbers of visual elements whose name, or body's name, matches a pattern."""
    of_bodies = [model.body(body).name for body in range(model.nbody)]
    bodies = [of_bodies[body] for body in shape_bodies(model)]
    bodies += names[len(bodies) :]  # skins, flexes and tendons have none
    fitting = [
        number
        for number, (name, body) in enumerate(zip(names, bodies, strict=False))
        if fits(name, (pattern,)) or fits(body, (pattern,))
    ]
    if not fitting:
        known = ", ".join(map(repr, names[:10])) or "none"
        raise SceneError(f"{pattern!r} in {argument} must match a geom or body of the model, which has {known}")
    return fitting
