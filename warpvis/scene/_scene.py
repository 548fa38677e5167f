# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: named, labeled triangle meshes, and their acceleration structures."""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import get_device
from warpvis.core.checks import check_flag, describe_exception, pluralize
from warpvis.core.label_rules import LabelInput, LabelPatterns, LabelRules
from warpvis.core.labels import Label
from warpvis.core.poses import (
    QuaternionOrder,
    check_quaternion,
    check_up,
    poses_to_matrices,
    poses_to_opencv,
    read_pose,
    to_xyzw,
)
from warpvis.core.types import ArrayInput, DeviceLike, MeshLike
from warpvis.errors import FileFormatError, SceneError, WarpvisError
from warpvis.scene._bounds import bounds_of
from warpvis.scene._exports import SceneExports
from warpvis.scene._meshes import SharedMeshes, instance_names
from warpvis.scene._object import SceneObject, check_scale, detach, take_snapshot
from warpvis.scene._object_list import Instances, ObjectList
from warpvis.scene._parts import merge_instances
from warpvis.scene.acceleration.traversal_plan import instance_indices
from warpvis.scene.appearances import LazyAppearance, choose_appearance
from warpvis.scene.materials import AppearanceLike
from warpvis.scene.solids import Solid

_IDENTITY = np.array([0.0, 0, 0, 0, 0, 0, 1])

if TYPE_CHECKING:
    from warpvis.scene._parts import FileParts


class Scene(SceneExports):
    """Triangle meshes in the world frame, right-handed, in meters.

    Example:
        >>> scene = Scene()
        >>> scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(1, 0, 0.1, 0, 0, 0, 1))
        0
    """

    def __init__(
        self,
        *,
        device: DeviceLike = "cpu",
        up: Literal["z", "y"] = "z",
        label_names: Mapping[int, str] | None = None,
        ground_labels: Iterable[Label | int | str] = (Label.GROUND,),
    ) -> None:
        """Create an empty scene.

        Args:
            device: Device that renders it: ``"cpu"``, ``"cuda:0"``, ...
            up: The world's vertical axis.
            label_names: Names of user-defined classes, by their numbers from 0 to 255: ``{40: "road"}``. They extend or
                override those of `Label`.
            ground_labels: Classes that are ground; see `ground_labels`.

        Raises:
            SceneError: If a number, a name or a class is invalid, or two numbers have the same name.
        """
        check_up(up)
        super().__init__(get_device(device), up, label_names, ground_labels)
        self._meshes = SharedMeshes()
        self._isolated: Scene | None = None

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        *,
        device: DeviceLike = "cpu",
        up: Literal["z", "y"] | None = None,
        file_up: Literal["z", "y"] | None = None,
        scale: float = 1.0,
        labels: LabelInput | None = None,
        label_names: Mapping[int, str] | None = None,
        movable: bool | Sequence[str] = False,
        search_path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
        strict: bool = False,
    ) -> Scene:
        """Load a scene from a file: OBJ, STL, PLY, GLB and other formats of trimesh, Webots worlds, MJCF, or URDF.

        Every named part of the file becomes one object, in the file's order. Its label is taken from `labels`, else
        from the file (``"label"`` in the ``extras`` of a glTF node or mesh), else it is `Label.OBSTACLE`. For Webots
        worlds (``.wbt``), see `warpvis.webots.load_webots` about names, labels, and devices; for MJCF (``.xml``) and
        URDF (``.urdf``), which MuJoCo compiles, `warpvis.mujoco.read_model`.

        Args:
            path: The file.
            device: Device that renders the scene.
            up: The scene's vertical axis. By default that of the Webots world, else ``"z"``.
            file_up: The file's vertical axis. By default ``"y"`` for glTF, as in its specification, the axis defined in
                a COLLADA file, and the scene's axis for every other mesh format; where the two differ, the geometry is
                rotated upright. Webots, MJCF and URDF define it themselves.
            scale: Factor from a mesh file's unit to meters (0.001 for millimeters), in addition to the unit that
                COLLADA and 3MF files define; other formats are in meters.
            labels: Labels by name; a name may be a pattern (``"wall_*"``), and the last match wins. Or a JSON, TOML or
                YAML file with such ``labels``, and optionally ``label_names`` and ``ground_labels``.
            label_names: Names of user-defined classes, as for `Scene`.
            movable: Names or patterns of the objects that are movable, each with a separate pose; or True for the
                moving bodies of MJCF or URDF, one pose for each body.
            search_path: Folders to search for other files that the file references: PROTO files and meshes of Webots,
                meshes and includes of MJCF, packages and meshes of URDF, buffers of glTF.
            strict: Whether unsupported content is an error. By default it is skipped, and a warning lists it.

        Raises:
            FileFormatError: If the file is missing, does not parse, or contains an invalid mesh, or if it has
                unsupported content and `strict` is set.
            SceneError: If it contains no triangles, a pattern matches nothing, or an argument does not apply to it.
        """
        from warpvis.io import read_parts

        if up is not None:
            check_up(up)
        rules = LabelRules.of(labels, label_names)
        found = read_parts(path, search_path=search_path, strict=strict)
        scene = cls(device=device, up=found.scene_up(up))
        scene.add_parts(found, rules, file_up=file_up, scale=scale, movable=movable)
        for message in found.warnings:
            warnings.warn(message, stacklevel=2)
        return scene

    def add(
        self,
        mesh: MeshLike,
        *,
        name: str | None = None,
        label: Label | int | str = Label.OBSTACLE,
        pose: ArrayLike | None = None,
        quaternion: QuaternionOrder = "xyzw",
        scale: float | ArrayLike = 1.0,
        movable: bool = False,
        attach_to: str | None = None,
        appearance: AppearanceLike | LazyAppearance | None = None,
    ) -> int:
        """Add an object.

        Args:
            mesh: A `trimesh.Trimesh`, any other object with `vertices` and `faces`, or the pair ``(vertices, faces)``:
                vertices [m] of shape ``(n, 3)``, corner indices of shape ``(m, 3)``. A movable
                `warpvis.scene.solids.Solid` is rendered as the true round surface, from outside; otherwise as its
                triangles.
            name: A unique name; by default ``object_`` and the object's index, or the next free number.
            label: Class of its pixels: a `Label`, another number up to 255, or the name of one.
            pose: Object to world, ``x y z qx qy qz qw`` or a 4x4 matrix; identity by default.
            quaternion: Order of the quaternion in a pose of 7 numbers, ``"xyzw"`` or ``"wxyz"``.
            scale: Scale factor, or three of them along the mesh's axes, applied before the pose.
            movable: Whether the object may have a different pose in each world of `Renderer.render`. Moving it rebuilds
                nothing, and movable objects with equal meshes share one tree. Static objects render faster, as one
                merged mesh; very many static objects with the same mesh share one tree, too.
            attach_to: Name of a movable object that this one is rigidly attached to. It then has no separate pose, and
                both render faster than two movable objects. Only for meshes, not for solids.
            appearance: A `scene.materials.Appearance`, a `Material`, or a color (red, green, blue, and optionally
                opacity, from 0 to 1, sRGB). By default trimesh's `visual`, which is read when
                `SceneObject.appearance` is first accessed, or colors are rendered.

        Returns:
            The object's index, which is the value of its pixels in the object image.

        Raises:
            SceneError: If the mesh is empty or malformed, the name is taken, the object cannot be attached to
                `attach_to`, or the appearance does not fit the mesh.
            PoseError: If the pose is invalid.
        """
        index = len(self._objects)
        name = self._free_name() if name is None else str(name)
        if name in self._index:
            raise SceneError(f"the scene already has an object named {name!r}; give another name")
        movable = check_flag(movable, "movable", SceneError)
        factors = check_scale(scale, name)
        shared = self._meshes.get(mesh, factors, name)
        check_quaternion(quaternion)
        row = None if pose is None else read_pose(pose, quaternion, name=f"pose of {name!r}")
        number = self._label_names.number(label)
        lazy_appearance = choose_appearance(appearance, mesh, name, (len(shared.vertices), len(shared.faces)))
        stays = attach_to is None and not movable
        if stays and shared.uses:
            shared.check_reach((_IDENTITY if row is None else row)[None], name)
            item = SceneObject.from_shared_mesh(name, number, shared, row, lazy_appearance)
        elif attach_to is not None or not movable:
            placed = shared.placed(row, name)
            frame = {} if attach_to is None else self._attach(attach_to, mesh, name, placed)
            item = SceneObject(
                name,
                number,
                placed.astype(np.float32),
                shared.faces,
                origin=row,
                lazy_appearance=lazy_appearance,
                **frame,
            )
        else:
            pose = (_IDENTITY if row is None else row).astype(np.float32)
            shared.check_reach(pose[None], name)
            solid = mesh.scaled(factors) if isinstance(mesh, Solid) else None
            item = SceneObject.placed(name, number, (shared.rounded, shared.faces), pose, solid, lazy_appearance)
        shared.uses += stays
        self._objects.append(item)
        self._index[name] = index
        self._movable += [index] if movable and attach_to is None else []
        self._forget()
        return index

    def add_instances(
        self,
        mesh: MeshLike,
        poses: ArrayInput,
        *,
        names: str | Sequence[str] | None = None,
        label: Label | int | str = Label.OBSTACLE,
        quaternion: QuaternionOrder = "xyzw",
        scale: float | ArrayLike = 1.0,
        movable: bool = True,
        appearance: AppearanceLike | LazyAppearance | None = None,
    ) -> range:
        """Add many objects with the same mesh, which share its memory and its tree.

        Static ones share a tree where there are enough of them for it to render faster than one merged mesh.

        Args:
            mesh: As for `add`.
            poses: Object to world, rows ``x y z qx qy qz qw``, shape ``(n, 7)``, or matrices ``(n, 4, 4)``.
            names: One name per pose, or a prefix: ``"chair"`` gives ``chair_0``, ``chair_1``, ...; by default
                ``object_`` and the objects' indices.
            label: As for `add`; the same for all.
            quaternion: Order of the quaternions in rows of 7 numbers, ``"xyzw"`` or ``"wxyz"``.
            scale: As for `add`; the same for all.
            movable: As for `add`; the same for all.
            appearance: As for `add`; the same for all.

        Returns:
            The objects' indices, in the order of the poses.

        Raises:
            SceneError: If the mesh is empty or malformed, a name is taken, or the appearance does not fit the mesh.
            PoseError: If the poses are invalid.
        """
        movable = check_flag(movable, "movable", SceneError)
        rows = poses_to_opencv(to_xyzw(poses, quaternion, "poses"), name="poses")
        indices = range(len(self._objects), len(self._objects) + len(rows))
        chosen = instance_names(names, indices, self._index)
        subject = chosen[0] if chosen else "instances"
        factors = check_scale(scale, subject)
        shared = self._meshes.get(mesh, factors, subject)
        shared.check_reach(rows, subject)
        number = self._label_names.number(label)
        lazy_appearance = choose_appearance(appearance, mesh, subject, (len(shared.vertices), len(shared.faces)))
        solid = mesh.scaled(factors) if isinstance(mesh, Solid) and movable else None
        shared.uses += 0 if movable else len(rows)
        self._objects.add_instances(
            Instances(indices.start, chosen, number, shared, rows, movable, solid, lazy_appearance)
        )
        self._index.update(zip(chosen, indices, strict=True))
        self._movable += indices if movable else []
        self._forget()
        return indices

    def _free_name(self) -> str:
        """Return the first free name ``object_N``, with N from the number of objects on."""
        numbers = itertools.count(len(self._objects))
        return next(name for name in map("object_{}".format, numbers) if name not in self._index)

    def _attach(self, attach_to: str, mesh: MeshLike, name: str, placed: NDArray[np.float64]) -> dict[str, Any]:
        """Return the fields of an object that is attached to another one, from its vertices in the world."""
        index = self.index(attach_to)
        item = self._objects[index]
        if item.pose is None:
            obstacle = (
                "which is itself attached to another object"
                if item.movable
                else "which is static; add it with movable=True"
            )
            raise SceneError(f"{name!r} cannot be attached to {attach_to!r}, {obstacle}")
        if isinstance(mesh, Solid) or item.solid is not None or item.points is not None:
            reason = f"{name!r} is a solid" if isinstance(mesh, Solid) else f"{attach_to!r} is a solid"
            reason = reason if item.points is None else f"{attach_to!r} is deforming"
            raise SceneError(
                f"{name!r} cannot be attached to {attach_to!r}: {reason}, and only rigid meshes can be attached"
            )
        place = poses_to_matrices(item.pose)
        inside = (placed - place[:3, 3]) @ place[:3, :3]
        return {"mesh_vertices": inside.astype(np.float32), "parent": index}

    def add_parts(self, found: FileParts, rules: LabelRules, **options: Any) -> None:
        """Add the parts of a file, labeled by rules; options as for `FileParts.objects`.

        Raises:
            FileFormatError: If a part is an invalid mesh: vertices are not finite, or face indices are out of range.
            SceneError: If an option does not apply to the file.
        """
        self.use_labels(found.classes.followed_by(rules))
        objects = found.objects(self.up, labels=LabelPatterns(rules.labels, self._label_names), **options)
        lights, background = found.environment(self.up, options.get("file_up"), options.get("scale", 1.0))
        self.lights, self.background = (*self.lights, *lights), background or self.background
        for arguments in merge_instances(objects):
            try:
                (self.add_instances if "poses" in arguments else self.add)(**arguments)
            except WarpvisError as error:
                raise FileFormatError(f"{found.path}: {describe_exception(error)}") from None

    @property
    def triangle_count(self) -> int:
        """Number of triangles of all objects."""
        return sum(count * item.triangle_count for _, count, item in self._objects.runs())

    @property
    def bounds(self) -> NDArray[np.float32]:
        """Minimum and maximum corner of the scene's axis-aligned box [m], shape ``(2, 3)``."""
        return bounds_of(self.require_objects())

    def __getitem__(self, name: str) -> SceneObject:
        return self._objects[self.index(name)]

    def __iter__(self) -> Iterator[SceneObject]:
        return iter(self.objects)

    def __len__(self) -> int:
        return len(self._objects)

    def __contains__(self, name: object) -> bool:
        return name in self._index

    def __repr__(self) -> str:
        holds = f"{pluralize(len(self), 'object')}, {pluralize(self.triangle_count, 'triangle')}"
        return f"Scene({holds}, device={str(self.device)!r})"

    def to(self, device: DeviceLike) -> Scene:
        """Return a copy of the scene on another device."""
        scene = Scene(device=device, up=self.up, label_names=self._label_names, ground_labels=self._ground_labels)
        scene._objects = ObjectList(map(take_snapshot, self._objects))
        scene._index, scene._movable = dict(self._index), list(self._movable)
        scene._take_environment(self)
        return scene

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the objects without trees; another process builds them again."""
        objects = [take_snapshot(item) for item in self._objects]
        classes = {"label_names": dict(self._label_names), "ground_labels": sorted(self._ground_labels)}
        places = {"device": str(self.device), "up": self.up}
        around = {"lights": self.lights, "background": self.background}
        return {**places, **classes, **around, "objects": objects, "movable": list(self._movable)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        arguments = {name: state[name] for name in ("device", "up", "label_names", "ground_labels") if name in state}
        self.__init__(**arguments)  # type: ignore[misc]
        self._objects, self._movable = ObjectList(state["objects"]), state["movable"]
        self._index = {item.name: index for index, item in enumerate(self._objects)}
        self.lights, self.background = state.get("lights", ()), state.get("background")

    def _forget(self) -> None:
        super()._forget()
        self._isolated = None

    def isolated(self) -> Scene:
        """Return a scene of the same objects, each movable and with a separate tree, so that each can be isolated.

        It is cached until the scene changes. The columns of its `object_poses` are all objects. A static object has its
        vertices in the world and the identity for a pose; if it shares a tree, its mesh's frame and its pose.

        Raises:
            SceneError: If the scene is empty.
        """
        with self._lock:
            if self._isolated is None:
                items = [take_snapshot(item) for item in self.require_objects()]
                isolated = Scene(
                    device=self.device, up=self.up, label_names=self._label_names, ground_labels=self._ground_labels
                )
                instances = instance_indices(self._objects, self.device)
                isolated._objects = ObjectList(
                    detach(item, items, is_instance=index in instances) for index, item in enumerate(items)
                )
                isolated._index, isolated._movable = dict(self._index), list(range(len(items)))
                isolated._take_environment(self)
                if any(item.points is not None for item in self._objects):
                    return isolated  # not cached: a replayed CUDA graph may deform objects without notice
                self._isolated = isolated
            return self._isolated


def require_scene(scene: object) -> Scene:
    """Return `scene`, or raise a `SceneError` if it is not a `Scene`."""
    if not isinstance(scene, Scene):
        raise SceneError(f"scene must be a warpvis.Scene, got {type(scene).__name__}")
    return scene
