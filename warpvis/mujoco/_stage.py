# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A model's scene that follows the model: what is where, how large, and what shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.kernel_cache import launch
from warpvis.errors import SceneError
from warpvis.mujoco._geom_renderer import CoincidingGeoms, GeomRenderer
from warpvis.mujoco._geoms import FIXED, geom_parts, initial_poses, rigid_pieces, shape_key
from warpvis.mujoco._numbers import check_shape_numbers
from warpvis.mujoco._scene import Selection
from warpvis.mujoco._shapes import UNKNOWN, shape_bodies, shape_count, shape_meaning, shape_places
from warpvis.mujoco._viewer_scene import RendererScene
from warpvis.mujoco._visual_objects import VisualObjects
from warpvis.mujoco._visual_shapes import Blocks
from warpvis.mujoco._visuals import VisualKey
from warpvis.mujoco._watch import ModelWatch
from warpvis.rendering import AnyCamera, Output
from warpvis.scene import Part, Scene, SceneObject, as_it_is
from warpvis.scene.solids import Solid

# Entries of poses in double precision differ by less than this where nothing has moved [m, or none].
_STILL = 1e-9


class _Made(NamedTuple):
    """What a geom's object was made of."""

    shape: tuple[float, ...]
    piece: int


class StageState(NamedTuple):
    """What a stage cannot make of its model."""

    geoms: list[int]
    """The geoms that have objects, shown or not."""
    added: list[tuple[SceneObject, str | None]]
    """Objects that were added, and what they are attached to."""
    visuals: dict[VisualKey, Blocks]
    """What else was drawn."""
    position: NDArray[np.float32]
    rotation: NDArray[np.float32]


class Stage:
    """A scene of a model's geoms and sites and what else MuJoCo draws, where it is now, and the renderers for it.

    The scene is made for speed: what is fixed lies in one tree, and what moves together shares one. When the model says
    otherwise than it did, as much of it is made anew as has to be: fixed bodies that were moved, and geoms that were
    moved in their bodies or changed their shape, are movable from there on, and to move them again costs nothing.
    """

    def __init__(self, model: mujoco.MjModel, selection: Selection, scene: RendererScene) -> None:
        """Add the geoms to a scene.

        Args:
            model: The model.
            selection: What to show of it.
            scene: An empty scene.
        """
        self.scene = scene
        self.renderers: dict[tuple[tuple[Output, ...], AnyCamera, bool], GeomRenderer] = {}
        self.coinciding = CoincidingGeoms(model, scene)
        self.visuals = VisualObjects(model, selection, scene)
        self._hidden: list[int] = []
        self._model, self._selection = model, selection
        self._sites = bool(model.nsite and selection.site_groups)
        self._spare = mujoco.MjData(model)
        self._loose_bodies: set[int] = set()
        self._alone: set[int] = set()
        pieces, self._poses = rigid_pieces(model), initial_poses(model, self._spare)
        """Geoms to world as they were when their objects were made, ``(ngeom, 4, 4)``."""
        self._made: dict[int, _Made] = {}
        """What the objects were made of, by geom, in the order of the objects."""
        for geom, part in self._parts(selection.shown(model), pieces, self._poses):
            scene.add(**part.arguments())
            self._made[geom] = _Made(shape_key(model, geom), int(pieces[geom]))
        self._watch = ModelWatch(model, self._made, sites=self._sites)
        self._get_ready()

    @property
    def hidden(self) -> list[int]:
        """Objects that the model does not show now."""
        return self._hidden + self.visuals.hidden(len(self._made))

    def meanings(self) -> NDArray[np.int32]:
        """List the id and type of every object, and at last of none, which is object -1."""
        pairs = np.full((len(self.scene) + 1, 2), -1, dtype=np.int32)
        pairs[:-1, 1] = UNKNOWN
        known = [*(shape_meaning(self._model, geom) for geom in self._made), *self.visuals.meanings()]
        pairs[: len(known)] = np.array(known, dtype=np.int32).reshape(-1, 2)
        return pairs

    def update(self, data: mujoco.MjData) -> None:
        """Update the poses of the geoms, and what follows from the model.

        Args:
            data: Computed data of the model.

        Raises:
            SceneError: Numbers of the model are not finite.
        """
        if self._watch.changed():
            self._follow_model()
        if len(self._fixed):
            self._follow_fixed(data)
        count = self._model.ngeom
        self._position[:count] = data.geom_xpos
        self._rotation[:count] = data.geom_xmat.reshape(-1, 3, 3)
        if self._sites:
            self._position[count:] = data.site_xpos
            self._rotation[count:] = data.site_xmat.reshape(-1, 3, 3)

    def draw(self, drawn: Mapping[VisualKey, Blocks]) -> None:
        """Take over what MuJoCo draws beside geoms and sites."""
        self.visuals.update(drawn, len(self._made))

    def object_poses(self) -> NDArray[np.float32] | None:
        """Make rows of the movable objects, shape ``(1, M, 7)``; None if nothing moves."""
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
        """Return what `restore` makes of a new stage what this one is."""
        objects = self.scene.objects
        carriers = [None if item.carrier is None else objects[item.carrier].name for item in objects]
        items = [(as_it_is(item), carrier) for item, carrier in zip(objects, carriers, strict=True)]
        added, places = items[len(self._made) + len(self.visuals) :], (self._position.copy(), self._rotation.copy())
        return StageState(list(self._made), added, self.visuals.state(), *places)

    def restore(self, state: StageState) -> None:
        """Take over the state of another stage of the same model."""
        # Those that were hidden when this stage was made: objects may be attached to them.
        shown = set(self._made)
        self._replace(set(), set(state.geoms) - shown, initial_poses(self._model, self._spare))
        self._hide_all_but(shown)
        self.draw(state.visuals)
        if state.added:
            objects = self.scene.objects
            index = {item.name: number for number, item in enumerate([*objects, *(item for item, _ in state.added)])}
            moved = [
                replace(item, carrier=None if carrier is None else index[carrier]) for item, carrier in state.added
            ]
            self.scene.replace_objects([*objects, *moved])
        self._position[:], self._rotation[:] = state.position, state.rotation

    def _hide_all_but(self, shown: set[int]) -> None:
        self._hidden = [index for index, geom in enumerate(self._made) if geom not in shown]

    def _parts(
        self, geoms: Iterable[int], pieces: NDArray[np.int32], poses: NDArray[np.float64]
    ) -> list[tuple[int, Part]]:
        names, labels, tolerance = self._selection.names, self._selection.labels, self._selection.tolerance
        return geom_parts(self._model, geoms, names, labels, tolerance=tolerance, pieces=pieces, poses=poses)

    def _get_ready(self) -> None:
        """Make what updates work with, for the geoms' objects as they are."""
        from warpvis.kernels.mujoco import geom_transforms

        geoms, objects = np.array(list(self._made), dtype=np.int32), self.scene.objects[: len(self._made)]
        self.coinciding.follow(geoms)
        self._fixed = geoms[[index for index, item in enumerate(objects) if not item.movable]]
        self._fixed_now = np.empty((len(self._fixed), 3)), np.empty((len(self._fixed), 9))
        self._fixed_before = [bytearray(), bytearray()]
        self._fixed_sites = bool((self._fixed >= self._model.ngeom).any())
        self._attached = geoms[[index for index, item in enumerate(objects) if item.carrier is not None]]
        self._carriers = geoms[[item.carrier for item in objects if item.carrier is not None]]
        movable = geoms[[index for index, item in enumerate(objects) if item.pose is not None]]

        position = wp.zeros((1, shape_count(self._model)), dtype=wp.vec3, device="cpu")
        rotation = wp.zeros((1, shape_count(self._model)), dtype=wp.mat33, device="cpu")
        places = wp.zeros((1, len(movable)), dtype=wp.transform, device="cpu")
        self._position, self._rotation, self._places = position.numpy()[0], rotation.numpy()[0], places.numpy()
        world, movable_ids = (wp.array(ids, dtype=wp.int32, device="cpu") for ids in ([0], movable))
        inputs = [position, rotation, world, movable_ids, places]
        self._place = launch(geom_transforms, places.shape, inputs, wp.get_device("cpu"), record_cmd=True)

    def _follow_model(self) -> None:
        """Make the scene what the model says now."""
        check_shape_numbers(self._model)
        poses = initial_poses(self._model, self._spare)
        self._release(poses)
        if self._watch.only_poses_changed():
            self._replace(set(), set(), poses)
            self._watch.accept()
            return
        changed = self._watch.changed_assets()
        keys = {geom: shape_key(self._model, geom) for geom in self._made}
        reshaped = {geom for geom, made in self._made.items() if keys[geom] != made.shape or keys[geom] in changed}
        shown = self._selection.shown(self._model)
        self._replace(reshaped - self._deform(reshaped), set(shown) - set(self._made), poses)
        self._watch = ModelWatch(self._model, self._made, sites=self._sites)
        self._hide_all_but(set(shown))

    def _follow_fixed(self, data: mujoco.MjData) -> None:
        """Let go of fixed geoms that the data has elsewhere than the model."""
        places = shape_places(data) if self._fixed_sites else (data.geom_xpos, data.geom_xmat)
        for place, now in zip(places, self._fixed_now, strict=True):
            place.take(self._fixed, axis=0, out=now, mode="clip")
        pairs = zip(self._fixed_before, self._fixed_now, strict=True)
        if all(before == now.data.cast("B") for before, now in pairs):
            return
        position, rotation = self._fixed_now
        made = self._poses[self._fixed]
        moved = (np.abs(position - made[:, :3, 3]) > _STILL).any(axis=1)
        moved |= (np.abs(rotation.reshape(-1, 3, 3) - made[:, :3, :3]) > _STILL).any(axis=(1, 2))
        if moved.any():
            self._alone.update(self._fixed[moved].tolist())
            self._replace(set(), set(), initial_poses(self._model, self._spare))
        else:
            self._fixed_before = [bytearray(now.tobytes()) for now in self._fixed_now]

    def _release(self, poses: NDArray[np.float64]) -> None:
        """Let go of what the model has elsewhere: fixed bodies, and geoms that have moved in their pieces."""
        fixed = self._fixed
        moved = fixed[_differs(poses[fixed], self._poses[fixed])]
        bodies = shape_bodies(self._model)[moved]
        self._loose_bodies.update(bodies[bodies != 0].tolist())
        self._alone.update(moved[bodies == 0].tolist())
        now, before = (np.linalg.inv(p[self._carriers]) @ p[self._attached] for p in (poses, self._poses))
        self._alone.update(self._attached[_differs(now, before)].tolist())

    def _deform(self, geoms: Iterable[int]) -> set[int]:
        """Give geoms another shape of the same triangles, where they have trees of their own; say which."""
        done, objects = set(), dict(zip(self._made, self.scene.objects, strict=False))
        alone = [geom for geom in geoms if objects[geom].points is not None]
        pieces = rigid_pieces(self._model, loose_bodies=self._loose_bodies, alone=self._alone)
        for geom, part in self._parts(alone, pieces, self._poses):
            if not isinstance(part.mesh, Solid) and np.array_equal(part.mesh[1], objects[geom].faces):
                self.scene.update_vertices(part.name, part.mesh[0])
                self._made[geom] = self._made[geom]._replace(shape=shape_key(self._model, geom))
                done.add(geom)
        if done:
            self.coinciding.follow(list(self._made))
        return done

    def _replace(self, reshaped: set[int], new: set[int], poses: NDArray[np.float64]) -> None:
        """Make anew the objects of geoms that changed, or that belong to another piece now."""
        old = rigid_pieces(self._model, loose_bodies=self._loose_bodies, alone=self._alone)
        occupied = {made.piece for made in self._made.values()} - {FIXED}
        self._alone |= reshaped | {geom for geom in new if int(old[geom]) in occupied}
        pieces = rigid_pieces(self._model, loose_bodies=self._loose_bodies, alone=self._alone)
        gone = {geom for geom, made in self._made.items() if made.piece != pieces[geom]}
        left = {self._made[geom].piece for geom in gone & set(self._carriers.tolist())}
        affected = reshaped | new | gone | {geom for geom, made in self._made.items() if made.piece in left}
        if not affected:
            return
        parts = self._parts(sorted(affected), pieces, poses)
        self._put(parts)
        for geom, _ in parts:
            self._made[geom] = _Made(shape_key(self._model, geom), int(pieces[geom]))
            self._poses[geom] = poses[geom]
        self._made = dict(sorted(self._made.items()))
        self._get_ready()
        for geom, part in parts:
            if geom in reshaped and not isinstance(part.mesh, Solid) and self._moves_alone(part.name):
                self.scene.update_vertices(part.name, part.mesh[0])

    def _put(self, parts: Iterable[tuple[int, Part]]) -> None:
        """Put parts in the place of their geoms' objects; what was added to the scene stays behind the geoms."""
        objects = self.scene.objects
        items = dict(zip(self._made, objects, strict=False))
        added = objects[len(self._made) :]
        carriers = {item.name: objects[item.carrier].name for item in objects if item.carrier is not None}
        draft = Scene()
        for geom, part in parts:
            draft.add(**part.arguments())
            items[geom] = draft[part.name]
            carriers.pop(part.name, None)
            if part.attach_to is not None:
                carriers[part.name] = part.attach_to
        ordered = [*(items[geom] for geom in sorted(items)), *added]
        taken = {item.name for item in ordered[: len(items)]} & {item.name for item in added}
        if taken:
            raise SceneError(
                f"the model shows a geom named {min(taken)!r} now, as an object is that was added to the scene; "
                "add it under another name"
            )
        index = {item.name: number for number, item in enumerate(ordered)}
        self.scene.replace_objects(
            [replace(item, carrier=index[carriers[item.name]]) if item.name in carriers else item for item in ordered]
        )

    def _moves_alone(self, name: str) -> bool:
        """Tell whether nothing that was added moves with an object."""
        index = self.scene.index(name)
        return all(item.carrier != index for item in self.scene.objects)


def _differs(poses: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.abs(poses - others).max(axis=(1, 2), initial=0.0) > _STILL
