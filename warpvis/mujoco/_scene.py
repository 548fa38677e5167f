# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A MuJoCo model's geoms as a scene."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import check_metres
from warpvis.core.checks import as_items, check_choice, check_flag, check_mapping, is_whole
from warpvis.core.label_rules import LabelInput, LabelRules
from warpvis.core.labels import LabelNames
from warpvis.core.types import DeviceLike
from warpvis.errors import SceneError
from warpvis.mujoco._geoms import (
    DEFAULT_GROUPS,
    FIXED,
    check_groups,
    default_label,
    fits,
    geom_parts,
    movable_bodies,
    rigid_pieces,
    shown_geoms,
)
from warpvis.mujoco._lights import model_background, model_lights
from warpvis.mujoco._numbers import check_shape_numbers
from warpvis.mujoco._shapes import object_names, shape_bodies
from warpvis.mujoco._visuals import soft_names
from warpvis.scene import Scene
from warpvis.scene.solids import DEFAULT_TOLERANCE

_NAMED = 5

Movable = Literal["bodies", "all"] | Iterable[str]


@dataclass(frozen=True, eq=False)
class MujocoScene:
    """A MuJoCo model's geoms and sites as a scene, and which is which object; `scene_from_mujoco` makes it.

    Objects that are added to `scene` come after the model's own.
    """

    scene: Scene
    """The geoms as objects, in the order of `geom_ids`, then the sites, and whatever was added to them."""
    geom_ids: NDArray[np.int32]
    """The geom of each of the scene's first objects, shape ``(G,)``."""
    movable_geoms: NDArray[np.int32]
    """The geoms whose poses say where all that moves is: the first columns of object poses, shape ``(M,)``."""
    geom_count: int
    """How many geoms the model has, shown or not."""
    site_ids: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """The site of each of the next objects, shape ``(S,)``."""
    movable_sites: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """The sites whose poses are the next columns of object poses."""
    site_count: int = 0
    """How many sites the model has, shown or not."""

    def __copy__(self) -> MujocoScene:
        """Share the meshes only: what is added to the copy is not in this one."""
        return replace(self, scene=copy.copy(self.scene))

    def to(self, device: DeviceLike) -> MujocoScene:
        """Return the same scene for another device."""
        return replace(self, scene=self.scene.to(device))

    def geoms_of_objects(self) -> NDArray[np.int32]:
        """List the geom of every object of the scene, shape ``(objects,)``; -1 of sites and what was added to it."""
        geoms = np.full(len(self.scene), -1, dtype=np.int32)
        geoms[: len(self.geom_ids)] = self.geom_ids
        return geoms

    def shapes(self) -> NDArray[np.int32]:
        """List the geoms and sites of the scene's first objects, sites behind all geoms, shape ``(G + S,)``."""
        return np.concatenate([self.geom_ids, self.geom_count + self.site_ids])


def scene_from_mujoco(
    model: mujoco.MjModel,
    *,
    geom_groups: Iterable[int] = DEFAULT_GROUPS,
    site_groups: Iterable[int] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    labels: LabelInput | None = None,
    label_names: Mapping[int, str] | None = None,
    exclude: Iterable[str] = (),
    movable: Movable = "bodies",
    static: bool = True,
    device: DeviceLike = "cpu",
) -> MujocoScene:
    """Make a scene of a MuJoCo model's geoms, one object each, whether or not they collide.

    What MuJoCo's renderer leaves out is left out: geoms whose colour has alpha 0 (`addGeomGeoms` in
    src/engine/engine_vis_visualize.c). So are sites, unless `site_groups` names theirs, and tendons, skins and flexes,
    which MuJoCo draws, and `Renderer` too. Sizes, meshes, heights and colours are read once, and so is where geoms are
    in their bodies; make another scene after changing them, or take `Renderer`, which follows them.

    All shapes are exact, but for planes from below, which are 0.1 mm lower there, and infinite ones, which end at 10
    times the distance of MuJoCo's far clipping plane from their origin. From inside of a round shape, and on export,
    its triangles stand for it; they are nowhere farther from it than `tolerance`, or 1e-4 of its largest radius if that
    is more.

    An object is named as its geom, or as the geom's body if the geom has no name, with ``_1``, ``_2``, ... where that
    is taken. Planes, height fields, and what has "floor" or "ground" in its name are `Label.GROUND`; the rest are
    `Label.OBSTACLE`, unless `labels` says otherwise.

    Args:
        model: A `mujoco.MjModel`.
        geom_groups: Groups of geoms to show, of 0 to 5; 0, 1 and 2 by default, as in MuJoCo.
        site_groups: Groups of sites to show, none by default: they are marks, which no sensor sees.
        tolerance: Most distance between round shapes and their triangles [m].
        labels: Labels by name of the object or its body; a name may be a pattern (``"wall_*"``), and the last one that
            fits counts. Or a file of them, as for `Scene.load`.
        label_names: Names of classes of your own, as for `Scene`.
        exclude: Names or patterns of objects or bodies to leave out, and of tendons, skins and flexes not to be warned
            of.
        movable: ``"bodies"``: geoms of bodies that are not welded to the world, and of mocap bodies, move, and all
            round ones; ``"all"``: so does every other geom, each by itself, for models whose geoms are moved by hand;
            names or patterns: so do these bodies, each of one piece, and these geoms, each by itself.
        static: Whether geoms show whose body is welded to the world.
        device: Where the scene is rendered.

    Warns:
        UserWarning: The model has skins, flexes or tendons that MuJoCo draws, and `exclude` does not name them.

    Raises:
        SceneError: An argument is invalid, a pattern fits nothing, or numbers of the model are not finite.
    """
    selection = select_geoms(
        model,
        geom_groups=geom_groups,
        site_groups=site_groups,
        tolerance=tolerance,
        labels=labels,
        label_names=label_names,
        exclude=exclude,
        static=static,
    )
    warn_of_soft(model, selection, None)
    return make_scene(model, selection, movable=movable, device=device)


def make_scene(
    model: mujoco.MjModel, selection: Selection, *, movable: Movable, device: DeviceLike, alone: Iterable[int] = ()
) -> MujocoScene:
    """Make the scene of `scene_from_mujoco`, and say nothing of what is not in it; some geoms move by themselves."""
    pieces = _choose_pieces(model, selection.names, movable)
    single = list(alone)
    pieces[single] = model.nbody + np.array(single, dtype=np.int32)
    scene = Scene(device=device)
    scene.use_labels(selection.rules)
    scene.lights, scene.background = model_lights(model), model_background(model)
    kept = []
    parts = geom_parts(
        model, selection.shown(model), selection.names, selection.labels, tolerance=selection.tolerance, pieces=pieces
    )
    for geom, part in parts:
        scene.add(**part.arguments())
        kept.append(geom)
    shapes = np.array(kept, dtype=np.int32)
    moving, count = shapes[list(scene.movable)], int(model.ngeom)
    geom_ids, site_ids = shapes[shapes < count], shapes[shapes >= count] - count
    movable_geoms, movable_sites = moving[moving < count], moving[moving >= count] - count
    return MujocoScene(scene, geom_ids, movable_geoms, count, site_ids, movable_sites, int(model.nsite))


@dataclass(frozen=True)
class Selection:
    """Which of a model's geoms a scene shows, and as what."""

    names: list[str]
    """Names of all that is drawn, as `object_names` counts."""
    labels: list[int]
    """Their labels."""
    rules: LabelRules
    """What was said of labels, and of the classes that they are."""
    left_out: frozenset[int]
    """What is not shown, whatever its group."""
    groups: tuple[int, ...]
    """Groups of geoms that are."""
    site_groups: tuple[int, ...]
    """Groups of sites that are."""
    static: bool
    """Whether geoms show whose body is welded to the world."""
    tolerance: float
    """Most distance between round shapes and their triangles [m]."""

    def shown(self, model: mujoco.MjModel) -> list[int]:
        """List the geoms and sites that the model shows now."""
        moves = movable_bodies(model)[shape_bodies(model)]
        return [
            geom
            for geom in shown_geoms(model, self.groups, self.site_groups)
            if geom not in self.left_out and (self.static or moves[geom])
        ]


def select_geoms(
    model: mujoco.MjModel,
    *,
    geom_groups: Iterable[int] = DEFAULT_GROUPS,
    site_groups: Iterable[int] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    labels: LabelInput | None = None,
    label_names: Mapping[int, str] | None = None,
    exclude: Iterable[str] = (),
    static: bool = True,
) -> Selection:
    """Check and read the arguments of `scene_from_mujoco` that say what a scene shows, and as what.

    Raises:
        SceneError: An argument is invalid, a pattern fits nothing, or numbers of the model are not finite.
    """
    if not isinstance(model, mujoco.MjModel):
        raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
    static = check_flag(static, "static", SceneError)
    tolerance = check_metres(tolerance, "tolerance", zero=False, error=SceneError)
    groups, sites, exclude = (
        check_groups(geom_groups),
        check_groups(site_groups, "site_groups"),
        check_patterns(exclude),
    )
    check_shape_numbers(model)
    names = object_names(model)
    rules = LabelRules.of(labels, label_names)
    wanted, left_out = _assign_labels(model, names, rules, exclude)
    return Selection(names, wanted, rules, frozenset(left_out), groups, sites, static, tolerance)


def warn_of_soft(model: mujoco.MjModel, selection: Selection, option: mujoco.MjvOption | None) -> None:
    """Name the skins, flexes and tendons that MuJoCo draws and that move in no way that a scene's objects do."""
    found = soft_names(model, selection.names, option)
    names = [name for number, name in found.items() if number not in selection.left_out]
    if names:
        some = ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
        warnings.warn(f"not rendered, which mujoco.Renderer and warpvis.mujoco.Renderer draw: {some}", stacklevel=3)


def _choose_pieces(model: mujoco.MjModel, names: list[str], movable: Movable) -> NDArray[np.int32]:
    """Give a number to what moves together, ``(shapes,)``, as `scene_from_mujoco` is asked for it."""
    if isinstance(movable, str):
        check_choice(movable, "movable", ("bodies", "all"), SceneError)
        return rigid_pieces(model, alone=range(len(shape_bodies(model))) if movable == "all" else ())
    patterns = check_patterns(movable, "movable")
    fixed, bodies = rigid_pieces(model) == FIXED, shape_bodies(model)
    alone, loose = set(), set()
    for pattern in patterns:
        for geom in fitting(model, names[: len(bodies)], pattern, "movable"):
            body = int(bodies[geom])
            if fixed[geom] and body and fits(model.body(body).name, (pattern,)):
                loose.add(body)
            elif fixed[geom]:
                alone.add(geom)
    return rigid_pieces(model, loose_bodies=loose, alone=alone)


def class_of_geoms(model: mujoco.MjModel, classes: Mapping[str, int], name: str = "classes") -> NDArray[np.int32]:
    """Give every shape the number of the last pattern that fits its object or body, ``(shapes,)``; -1 if none does.

    Args:
        model: The model.
        classes: Numbers by name or pattern.
        name: What messages call them: the argument of who asks.

    Raises:
        SceneError: A pattern fits nothing, or a number is none.
    """
    numbers = np.full(len(shape_bodies(model)), -1, dtype=np.int32)
    names = object_names(model)[: len(numbers)]
    check_patterns(check_mapping(classes, name, SceneError), name)
    for pattern, number in classes.items():
        if not is_whole(number) or not 0 <= number < 2**31:
            raise SceneError(f"{name} must be whole numbers from 0 up, got {number!r} for {pattern!r}")
        numbers[fitting(model, names, pattern, name)] = number
    return numbers


def check_patterns(patterns: Any, name: str = "exclude") -> tuple[str, ...]:
    """Return names or patterns of names.

    Raises:
        SceneError: They are none.
    """
    items = as_items(patterns, name, SceneError)
    wrong = [item for item in items if not isinstance(item, str)]
    if wrong:
        raise SceneError(f"{name} must be names or patterns of names, got {wrong[0]!r}")
    return tuple(items)


def _assign_labels(
    model: mujoco.MjModel, names: list[str], rules: LabelRules, exclude: tuple[str, ...]
) -> tuple[list[int], set[int]]:
    """Choose labels of all that is drawn, and what is left out."""
    classes = LabelNames(rules.label_names)
    wanted: list[int] = [default_label(model, geom, name) for geom, name in enumerate(names)]
    for pattern, label in rules.labels.items():
        for geom in fitting(model, names, pattern, "labels"):
            wanted[geom] = classes.number(label)
    return wanted, {geom for pattern in exclude for geom in fitting(model, names, pattern, "exclude")}


def fitting(model: mujoco.MjModel, names: list[str], pattern: str, argument: str) -> list[int]:
    """Find the geoms and sites whose object or body has a name that fits, and what else is drawn of such a name."""
    of_bodies = [model.body(body).name for body in range(model.nbody)]
    bodies = [of_bodies[body] for body in shape_bodies(model)]
    bodies += names[len(bodies) :]  # skins, flexes and tendons have none
    fitting = [
        number
        for number, (name, body) in enumerate(zip(names, bodies, strict=False))
        if fits(name, (pattern,)) or fits(body, (pattern,))
    ]
    if not fitting:
        some = ", ".join(map(repr, names[:10])) or "none"
        raise SceneError(f"{pattern!r} in {argument} fits no geom and no body of the model, which has {some}")
    return fitting
