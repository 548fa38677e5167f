# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A scene that follows changes of a MuJoCo model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.core.kernel_cache import launch
from warpvis.errors import SceneError
from warpvis.mujoco._appearances import Style
from warpvis.mujoco._cameras import RendererScene
from warpvis.mujoco._geom_renderer import CoincidingGeoms, GeomRenderer
from warpvis.mujoco._geoms import FIXED, geom_parts, initial_poses, rigid_pieces, shape_key
from warpvis.mujoco._model_fields import (
    UNKNOWN,
    ModelWatch,
    Watched,
    check_shape_numbers,
    shape_bodies,
    shape_count,
    shape_meaning,
    shape_places,
)
from warpvis.mujoco._scene import Selection
from warpvis.mujoco._stage_colors import StageColors
from warpvis.mujoco._tessellation import Blocks
from warpvis.mujoco._visual_objects import VisualObjects, names_of_parents, put_objects
from warpvis.mujoco._visuals import Paint, VisualKey
from warpvis.rendering import Output
from warpvis.scene import Part, Scene, SceneObject, take_snapshot
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.lights import Background, Light
from warpvis.scene.solids import Solid

# Tolerance of comparisons of double-precision poses [m; rotations: 1].
_STILL = 1e-9


class _Built(NamedTuple):
    """The shape and rigid piece from which a geom's object was built."""

    shape: tuple[float, ...]
    piece: int


class StageState(NamedTuple):
    """State of a stage that does not follow from its model."""

    geoms: list[int]
    """Geoms with objects, visible or not."""
    added: list[tuple[SceneObject, str | None]]
    """Added objects, with the names of the objects to which they are attached."""
    visuals: dict[VisualKey, Blocks]
    """Other visual elements."""
    paints: dict[VisualKey, Paint] | None
    """Their appearances; None if they have none."""
    lights: tuple[Light, ...]
    background: Background | None
    position: NDArray[np.float32]
    rotation: NDArray[np.float32]


class Stage:
    """A scene of a model's geoms, sites and other visual elements at their current poses, with its renderers.

    For speed, all static geoms are in one tree, and each rigid piece has one tree. When the model changes, only the
    affected objects are rebuilt: static bodies that moved, and geoms that moved within their bodies or changed shape,
    become movable, so that later moves are cheap.
    """

    def __init__(self, model: mujoco.MjModel, selection: Selection, scene: RendererScene) -> None:
        """Add the selected geoms to an empty scene."""
        self.scene = scene
        self.renderers: dict[tuple[tuple[Output, ...], PlanarCamera, bool], GeomRenderer] = {}
        self.coinciding = CoincidingGeoms(model, scene)
        self.visuals = VisualObjects(model, selection, scene)
        self._hidden: list[int] = []
        self._model, self._selection = model, selection
        self._sites = bool(model.nsite and selection.site_groups)
        self._spare = mujoco.MjData(model)
        self._loose_bodies: set[int] = set()
        self._independent: set[int] = set()
        pieces, self._poses = rigid_pieces(model), initial_poses(model, self._spare)
        """Geom-to-world poses from which the objects were built, ``(ngeom, 4, 4)``."""
        self._colors = StageColors(model, scene, selection.mesh_tolerance)
        self._built: dict[int, _Built] = {}
        """Shapes and pieces from which the objects were built, by geom, in the order of the objects."""
        for geom, part in self._parts(selection.shown(model), pieces, self._poses):
            scene.add(**part.arguments())
            self._built[geom] = _Built(shape_key(model, geom), int(pieces[geom]))
        self._watch = ModelWatch(model, self._built, sites=self._sites)
        self._get_ready()

    @property
    def hidden(self) -> list[int]:
        """Indices of the objects that are not visible now."""
        return self._hidden + self.visuals.hidden(len(self._built))

    @property
    def shapes(self) -> list[int]:
        """The geoms and sites of the first objects."""
        return list(self._built)

    def meanings(self) -> NDArray[np.int32]:
        """List the id and type of every object, with a last row for no object (index -1)."""
        pairs = np.full((len(self.scene) + 1, 2), -1, dtype=np.int32)
        pairs[:-1, 1] = UNKNOWN
        known = [*(shape_meaning(self._model, geom) for geom in self._built), *self.visuals.meanings()]
        pairs[: len(known)] = np.array(known, dtype=np.int32).reshape(-1, 2)
        return pairs

    def update(self, data: mujoco.MjData) -> None:
        """Update the poses of the geoms, and follow changes of the model."""
        if self._watch.changed():
            self._follow_model()
        if len(self._fixed):
            self._follow_fixed(data)
        position, rotation = shape_places(data) if self._sites else (data.geom_xpos, data.geom_xmat)
        self._position[: len(position)], self._rotation[: len(position)] = position, rotation.reshape(-1, 3, 3)

    def draw(self, drawn: Mapping[VisualKey, Blocks], paints: Mapping[VisualKey, Paint] | None = None) -> None:
        """Update the visual elements other than geoms and sites, and their colors if they are given."""
        self.visuals.update(drawn, len(self._built), paints)

    def color(self, style: Style) -> None:
        """Update the colors of geoms and sites to those of the model."""
        self._colors.follow(self.shapes, style)

    def object_poses(self) -> NDArray[np.float32] | None:
        """Return poses of the movable objects, shape ``(1, M, 7)``; None without movable objects."""
        geoms = self._places.shape[1]
        if geoms:
            self._place.launch()
        added = self.scene.movable[geoms:]
        if not added:
            return self._places if geoms else None
        objects = self.scene.objects
        rows = np.array([[objects[index].pose for index in added]], dtype=np.float32)
        return np.concatenate([self._places, rows], axis=1)

    def state(self) -> StageState:
        """Return the state for `restore`."""
        objects = self.scene.objects
        parents = names_of_parents(objects)
        first = len(self._built) + len(self.visuals)
        added = [(take_snapshot(item), parents.get(item.name)) for item in objects[first:]]
        places = self._position.copy(), self._rotation.copy()
        shown = self.visuals.state(), self.visuals.paints(), self.scene.lights, self.scene.background
        return StageState(list(self._built), added, *shown, *places)

    def restore(self, state: StageState) -> None:
        """Restore the state of another stage of the same model."""
        # Add geoms that are hidden in this stage, since objects may be attached to them.
        shown = set(self._built)
        self._replace(set(), set(state.geoms) - shown, initial_poses(self._model, self._spare))
        self._hide_all_but(shown)
        self.draw(state.visuals, state.paints)
        self.scene.lights, self.scene.background = state.lights, state.background
        if state.added:
            objects = [*self.scene.objects, *(item for item, _ in state.added)]
            parents = {item.name: parent for item, parent in state.added if parent is not None}
            put_objects(self.scene, objects, names_of_parents(self.scene.objects) | parents)
        self._position[:], self._rotation[:] = state.position, state.rotation

    def _hide_all_but(self, shown: set[int]) -> None:
        self._hidden = [index for index, geom in enumerate(self._built) if geom not in shown]

    def _parts(
        self, geoms: Iterable[int], pieces: NDArray[np.int32], poses: NDArray[np.float64]
    ) -> list[tuple[int, Part]]:
        names, labels, mesh_tolerance = self._selection.names, self._selection.labels, self._selection.mesh_tolerance
        return geom_parts(self._model, geoms, names, labels, mesh_tolerance=mesh_tolerance, pieces=pieces, poses=poses)

    def _get_ready(self) -> None:
        """Allocate the arrays and the launch of updates for the current objects."""
        from warpvis.kernels.mujoco.arrays import geom_transforms

        geoms, objects = np.array(list(self._built), dtype=np.int32), self.scene.objects[: len(self._built)]
        self.coinciding.follow(geoms)
        self._fixed = geoms[[index for index, item in enumerate(objects) if not item.movable]]
        self._fixed_places = [Watched(np.full((len(self._fixed), size), np.nan)) for size in (3, 9)]
        self._fixed_sites = bool((self._fixed >= self._model.ngeom).any())
        self._attached = geoms[[index for index, item in enumerate(objects) if item.parent is not None]]
        self._parents = geoms[[item.parent for item in objects if item.parent is not None]]
        movable = geoms[[index for index, item in enumerate(objects) if item.pose is not None]]

        position = wp.zeros((1, shape_count(self._model)), dtype=wp.vec3, device="cpu")
        rotation = wp.zeros((1, shape_count(self._model)), dtype=wp.mat33, device="cpu")
        places = wp.zeros((1, len(movable)), dtype=wp.transform, device="cpu")
        self._position, self._rotation, self._places = position.numpy()[0], rotation.numpy()[0], places.numpy()
        world, movable_ids = (wp.array(ids, dtype=wp.int32, device="cpu") for ids in ([0], movable))
        inputs = [position, rotation, world, movable_ids, places]
        self._place = launch(geom_transforms, places.shape, inputs, wp.get_device("cpu"), record_cmd=True)

    def _follow_model(self) -> None:
        """Rebuild the parts of the scene that changed in the model."""
        check_shape_numbers(self._model)
        poses = initial_poses(self._model, self._spare)
        self._release(poses)
        if self._watch.only_poses_changed():
            self._replace(set(), set(), poses)
            self._watch.accept()
            return
        changed = self._watch.changed_assets()
        keys = {geom: shape_key(self._model, geom) for geom in self._built}
        reshaped = {geom for geom, built in self._built.items() if keys[geom] != built.shape or keys[geom] in changed}
        shown = self._selection.shown(self._model)
        self._replace(reshaped - self._deform(reshaped), set(shown) - set(self._built), poses)
        self._watch = ModelWatch(self._model, self._built, sites=self._sites)
        self._hide_all_but(set(shown))

    def _follow_fixed(self, data: mujoco.MjData) -> None:
        """Make static geoms movable whose poses in the data differ from the model's."""
        places = shape_places(data) if self._fixed_sites else (data.geom_xpos, data.geom_xmat)
        for place, watched in zip(places, self._fixed_places, strict=True):
            place.take(self._fixed, axis=0, out=watched.array, mode="clip")
        if not any(watched.changed() for watched in self._fixed_places):
            return
        position, rotation = (watched.array for watched in self._fixed_places)
        built = self._poses[self._fixed]
        moved = (np.abs(position - built[:, :3, 3]) > _STILL).any(axis=1)
        moved |= (np.abs(rotation.reshape(-1, 3, 3) - built[:, :3, :3]) > _STILL).any(axis=(1, 2))
        if moved.any():
            self._independent.update(self._fixed[moved].tolist())
            self._replace(set(), set(), initial_poses(self._model, self._spare))
        for watched in self._fixed_places:
            watched.accept()

    def _release(self, poses: NDArray[np.float64]) -> None:
        """Detach static bodies that moved, and geoms that moved within their rigid pieces."""
        fixed = self._fixed
        moved = fixed[_differs(poses[fixed], self._poses[fixed])]
        bodies = shape_bodies(self._model)[moved]
        self._loose_bodies.update(bodies[bodies != 0].tolist())
        self._independent.update(moved[bodies == 0].tolist())
        current, before = (np.linalg.inv(p[self._parents]) @ p[self._attached] for p in (poses, self._poses))
        self._independent.update(self._attached[_differs(current, before)].tolist())

    def _deform(self, geoms: Iterable[int]) -> set[int]:
        """Update the vertices of geoms with separate trees and unchanged faces; return these geoms."""
        done, objects = set(), dict(zip(self._built, self.scene.objects, strict=False))
        independent = [geom for geom in geoms if objects[geom].points is not None]
        pieces = rigid_pieces(self._model, loose_bodies=self._loose_bodies, independent=self._independent)
        for geom, part in self._parts(independent, pieces, self._poses):
            if not isinstance(part.mesh, Solid) and np.array_equal(part.mesh[1], objects[geom].faces):
                self.scene.update_vertices(part.name, part.mesh[0])
                found = part.appearance.get() if isinstance(part.appearance, LazyAppearance) else None
                if found is not None and found.vertex_grid is not None:
                    self.scene.set_appearance(part.name, found)
                self._built[geom] = self._built[geom]._replace(shape=shape_key(self._model, geom))
                done.add(geom)
        if done:
            self.coinciding.follow(list(self._built))
        return done

    def _replace(self, reshaped: set[int], new: set[int], poses: NDArray[np.float64]) -> None:
        """Rebuild the objects of geoms that changed, or that are now in another rigid piece."""
        old = rigid_pieces(self._model, loose_bodies=self._loose_bodies, independent=self._independent)
        occupied = {built.piece for built in self._built.values()} - {FIXED}
        self._independent |= reshaped | {geom for geom in new if int(old[geom]) in occupied}
        pieces = rigid_pieces(self._model, loose_bodies=self._loose_bodies, independent=self._independent)
        gone = {geom for geom, built in self._built.items() if built.piece != pieces[geom]}
        old_pieces = {self._built[geom].piece for geom in gone & set(self._parents.tolist())}
        affected = reshaped | new | gone | {geom for geom, built in self._built.items() if built.piece in old_pieces}
        if not affected:
            return
        parts = self._parts(sorted(affected), pieces, poses)
        self._put(parts)
        for geom, _ in parts:
            self._built[geom] = _Built(shape_key(self._model, geom), int(pieces[geom]))
            self._poses[geom] = poses[geom]
        self._colors.made(geom for geom, _ in parts)
        self._built = dict(sorted(self._built.items()))
        self._get_ready()
        for geom, part in parts:
            if geom in reshaped and not isinstance(part.mesh, Solid):
                index = self.scene.index(part.name)
                if all(item.parent != index for item in self.scene.objects):  # none is attached to it
                    self.scene.update_vertices(part.name, part.mesh[0])

    def _put(self, parts: Iterable[tuple[int, Part]]) -> None:
        """Replace the objects of geoms by parts; objects added to the scene remain after the geoms."""
        objects = self.scene.objects
        items = dict(zip(self._built, objects, strict=False))
        added = objects[len(self._built) :]
        parents = names_of_parents(objects)
        draft = Scene()
        for geom, part in parts:
            draft.add(**part.arguments())
            items[geom] = draft[part.name]
            parents.pop(part.name, None)
            if part.attach_to is not None:
                parents[part.name] = part.attach_to
        ordered = [*(items[geom] for geom in sorted(items)), *added]
        taken = {item.name for item in ordered[: len(items)]} & {item.name for item in added}
        if taken:
            raise SceneError(
                f"objects added to the scene must not have names of visible geoms, got {min(taken)!r}; "
                "add it with another name"
            )
        put_objects(self.scene, ordered, parents)


def _differs(poses: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.abs(poses - reference).max(axis=(1, 2), initial=0.0) > _STILL
