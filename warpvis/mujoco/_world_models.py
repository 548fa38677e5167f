# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Model fields that differ between worlds: arrays of the models of MuJoCo Warp and MJX."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, cast

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_warp, on_gpu
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, SceneError
from warpvis.mujoco._scene import MujocoScene, Selection, check_patterns, fitting

POSE_FIELDS = (
    *("body_pos", "body_quat", "geom_pos", "geom_quat", "cam_pos", "cam_quat"),
    *("light_pos", "light_dir"),
)
"""Fields that determine poses for given joint positions; given poses already include them."""
COLOR_FIELDS = {"geom_rgba": wp.vec4, "geom_matid": wp.int32, "mat_rgba": wp.vec4}
TEXTURE_FIELDS = ("mat_texid",)
_LIGHT_FIELDS = (
    *("light_active", "light_type", "light_cutoff", "light_exponent", "light_attenuation"),
    *("light_diffuse", "light_ambient", "light_specular"),
)
# Properties that all worlds share, if colors are rendered.
_SHARED_LOOKS = (*("light_castshadow", "mat_texrepeat", "mat_texuniform", "mat_specular", "mat_shininess"),)
# Worlds share meshes and lenses, so these fields must be equal.
_SHARED_FIELDS = ("geom_dataid", "cam_intrinsic")
_KNOWN = (*POSE_FIELDS, "cam_fovy", *COLOR_FIELDS, *TEXTURE_FIELDS, "mat_emission", *_LIGHT_FIELDS, "geom_size")


class WorldModels:
    """The arrays of a call that differ between worlds."""

    def __init__(self, model: mujoco.MjModel, source: object, worlds: int) -> None:
        """Read a mapping of names to arrays, or an object with them as attributes, as the models of Warp and MJX."""
        self._model, self._worlds = model, worlds
        self._fields = _read(source, model)
        for name in _SHARED_FIELDS:
            if name in self._fields:
                self._check_shared(name)

    def poses(self) -> dict[str, NDArray[np.float64]]:
        """Return the fields that determine poses, arrays of shape ``(1 or W, ...)``."""
        return {name: self._host(name) for name in POSE_FIELDS if name in self._fields}

    def fovy(self) -> NDArray[np.float64] | None:
        """Return vertical fields of view [degrees], shape ``(1 or W, ncam)``; None for the model's."""
        if "cam_fovy" not in self._fields:
            return None
        fovy = self._host("cam_fovy")
        upper = np.where(self._model.cam_projection == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC, np.inf, 180.0)
        bad = np.argwhere(~((fovy > 0) & (fovy < upper)))
        if len(bad):
            world, camera = bad[0].tolist()
            limits = "from 0 to 180 degrees" if upper[camera] == 180 else "a number of meters above 0"
            raise ArrayError(
                f"cam_fovy must be {limits}, got {fovy[world, camera]} for camera {camera} in world {world}"
            )
        return fovy

    def geom_size(self) -> Any | None:
        """Return sizes of geoms in one world or all, on the host or on a GPU; None for the model's."""
        return self._value("geom_size") if "geom_size" in self._fields else None

    def hidden_objects(
        self, mujoco_scene: MujocoScene, rows: NDArray[np.int32], views: int, *, changed: bool = False
    ) -> wp.array | None:
        """Flag the objects that are hidden in each view, ``(views, objects)`` uint8; None if colors are the model's.

        `changed` states whether the colors of the model have changed.
        """
        from warpvis.kernels.mujoco.arrays import hidden_objects

        if not (changed or self.has(*COLOR_FIELDS)):
            return None
        device = mujoco_scene.scene.device
        inputs = self.color_arrays(device)
        inputs += [wp.array(ids, dtype=wp.int32, device=device) for ids in (rows, mujoco_scene.geoms_of_objects())]
        hidden = wp.empty((views, len(mujoco_scene.scene)), dtype=wp.uint8, device=device)
        launch(hidden_objects, hidden.shape, [*inputs, hidden], device)
        return hidden

    def _check_values(self, name: str, rows: NDArray[Any]) -> None:
        """Raise an `ArrayError` if a color is not finite, or a material is not in the model."""
        count = int(self._model.nmat)
        is_material = name == "geom_matid"
        bad = np.argwhere((rows < -1) | (rows >= count) if is_material else ~np.isfinite(rows))
        if len(bad):
            world, index = bad[0, :2].tolist()
            expected = f"from -1 to {count - 1}" if is_material else "finite"
            raise ArrayError(
                f"{name} must be {expected}, got {rows[world, index].tolist()} at index {index} in world {world}"
            )

    def has(self, *names: str) -> bool:
        """Return whether one of some fields is given."""
        return any(name in self._fields for name in names)

    def value(self, name: str) -> Any:
        """Return a field of one world or all, by default the model's; numbers in host memory are checked."""
        value = self._value(name)
        if isinstance(value, np.ndarray):
            own = getattr(self._model, name)
            if value.shape[1:] != own.shape or value.dtype.kind not in "fiub":
                expected = ", ".join(map(str, ("W", *own.shape)))
                raise ArrayError(f"{name} must have shape ({expected}), got {value.dtype} of shape {value.shape}")
            if not np.isfinite(value).all():
                world, index = np.argwhere(~np.isfinite(value))[0, :2].tolist()
                raise ArrayError(
                    f"{name} must be finite, got {value[world, index].tolist()} at index {index} in world {world}"
                )
        return value

    def color_arrays(self, device: wp.Device) -> list[wp.array]:
        """Return colors and materials of geoms, and colors of materials, of one world or all, on a device."""
        inputs = []
        for name, dtype in COLOR_FIELDS.items():
            value = self._value(name)
            if isinstance(value, np.ndarray):
                self._check_values(name, value)
            inputs.append(as_warp(value, dtype, ("W", len(getattr(self._model, name))), name=name, device=device))
        return inputs

    def materials(self) -> tuple[NDArray[np.int32] | None, NDArray[np.int32] | None]:
        """Return `geom_matid` and `mat_texid` of one world or all; None if one is on a GPU and equal in all worlds."""
        found: list[NDArray[np.int32] | None] = []
        for name in ("geom_matid", *TEXTURE_FIELDS):
            value = self._value(name)
            if on_gpu(value):
                if value.shape[0] > 1:
                    raise ArrayError(
                        f"{name} must be in host memory, or of one world, for the outputs color and albedo: texture "
                        "coordinates are made for each material of a geom"
                    )
                found.append(None)
                continue
            rows = self.value(name)
            if name == "geom_matid":
                self._check_values(name, rows)
            elif rows.size and (rows.min() < -1 or rows.max() >= self._model.ntex):
                raise ArrayError(f"{name} must be from -1 to {self._model.ntex - 1}, got {rows.min()} to {rows.max()}")
            found.append(rows.astype(np.int32))
        return found[0], found[1]

    def check_shared_looks(self) -> None:
        """Raise an `ArrayError` if properties of materials or lights differ that all worlds share."""
        for name in _SHARED_LOOKS:
            if name in self._fields:
                self._check_shared(name)

    def _value(self, name: str) -> Any:
        """Return a field of one world or all, by default the model's: a NumPy array, or an array on a GPU."""
        value = self._fields.get(name)
        value = getattr(self._model, name)[None] if value is None else value
        value = value if on_gpu(value) else as_numpy(value, name=name)
        self._check_worlds(name, value)
        return value

    def _check_shared(self, name: str) -> None:
        """Raise an `ArrayError` if a shared field differs from the model; arrays on a GPU are not compared."""
        value, own = self._fields[name], getattr(self._model, name)
        if on_gpu(value):
            differs = value.shape[0] > 1
        else:
            rows = as_numpy(value, name=name)
            differs = rows.shape[1:] != own.shape or (rows.astype(np.float32) != own.astype(np.float32)).any()
        if differs:
            raise ArrayError(f"{name} must equal that of the renderer's model, which all worlds share; omit it")

    def _host(self, name: str) -> NDArray[np.float64]:
        """Return an array on the host, with quaternions normalized."""
        rows = as_numpy(self._fields[name], name=name)
        shape = getattr(self._model, name).shape
        if rows.dtype.kind not in "fiu" or rows.shape[1:] != shape or not len(rows):
            expected = ", ".join(map(str, ("W", *shape)))
            raise ArrayError(f"{name} must be numbers of shape ({expected}), got {rows.dtype} of shape {rows.shape}")
        self._check_worlds(name, rows)
        if not np.isfinite(rows).all():
            raise ArrayError(f"{name} must be finite")
        rows = rows.astype(np.float64)
        if not name.endswith("_quat"):
            return rows
        length = np.linalg.norm(rows, axis=-1, keepdims=True)
        if not length.all():
            world, index = np.argwhere(length[..., 0] == 0)[0].tolist()
            raise ArrayError(f"{name} must be quaternions, got one of length 0 at index {index} in world {world}")
        return cast("NDArray[np.float64]", rows / length)

    def _check_worlds(self, name: str, value: Any) -> None:
        if not value.shape:
            raise ArrayError(f"{name} must be an array of 1 or {self._worlds} worlds, got {value}")
        if value.shape[0] not in (1, self._worlds):
            raise ArrayError(f"{name} must be of 1 world or of {self._worlds}, like the poses, got {value.shape[0]}")


def _read(source: object, model: mujoco.MjModel) -> dict[str, Any]:
    """Collect the arrays by name, with a leading dimension for worlds."""
    if isinstance(source, mujoco.MjModel):
        raise ArrayError("model must have arrays with a dimension for worlds, like MuJoCo Warp's model, got an MjModel")
    if isinstance(source, Mapping):
        unknown = [str(name) for name in source if name not in _KNOWN + _SHARED_FIELDS + _SHARED_LOOKS]
        if unknown:
            raise ArrayError(f"model must have keys among {', '.join(_KNOWN)}, got {', '.join(unknown)}")
        return dict(source)
    found = {name: getattr(source, name) for name in _KNOWN + _SHARED_FIELDS + _SHARED_LOOKS if hasattr(source, name)}
    if not found:
        raise ArrayError(f"model must have attributes among {', '.join(_KNOWN)}, got {type(source).__name__}")
    # In MJX's model, only fields that differ between worlds have a dimension for worlds.
    for name, value in found.items():
        if not isinstance(value, wp.array) and getattr(value, "shape", None) == getattr(model, name).shape:
            found[name] = value[None]
    return found


Resizable = Literal["all"] | Iterable[str]

# Number of elements of geom_size that define the size of a geom.
_NUMBERS = {
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")): count
    for name, count in {"SPHERE": 1, "CAPSULE": 2, "CYLINDER": 2, "ELLIPSOID": 3, "BOX": 3}.items()
}


def resizable_geoms(model: mujoco.MjModel, selection: Selection, resizable: Resizable) -> tuple[int, ...]:
    """List the geoms selected by name or pattern, or all resizable geoms with ``"all"``, in ascending order."""
    primitive = {geom for geom in range(model.ngeom) if int(model.geom_type[geom]) in _NUMBERS}
    if isinstance(resizable, str):
        if resizable != "all":
            raise SceneError(f'resizable must be "all", or a list of names or patterns of names, got {resizable!r}')
        return tuple(sorted(primitive))
    chosen: set[int] = set()
    for pattern in check_patterns(resizable, "resizable"):
        found = primitive.intersection(fitting(model, selection.names, pattern, "resizable"))
        if not found:
            raise SceneError(
                f"{pattern!r} in resizable must match a geom that is a box, sphere, capsule, cylinder or ellipsoid; "
                "other geoms cannot be resized"
            )
        chosen |= found
    return tuple(sorted(chosen))


class ResizableGeoms:
    """The resizable geoms of a scene, and the sizes of all geoms in the scene."""

    def __init__(self, model: mujoco.MjModel, mujoco_scene: MujocoScene, geoms: Iterable[int]) -> None:
        self._scene = mujoco_scene
        self._geoms = np.array(sorted(set(geoms) & set(mujoco_scene.geom_ids.tolist())), dtype=np.int64)
        self._kinds = np.array(model.geom_type, dtype=np.int32)
        self._model_size = model.geom_size.astype(np.float32)
        self._arrays: list[wp.array] | None = None

    @property
    def objects(self) -> NDArray[np.int64]:
        """Indices of their objects."""
        return np.flatnonzero(np.isin(self._scene.geom_ids, self._geoms))

    def sizes(self, models: WorldModels, rows: NDArray[np.int32]) -> wp.array | None:
        """Return the sizes of all movable objects in some worlds, for `warpvis.kernels.casting.worlds.Worlds`.

        They are an array of shape ``(worlds, M)`` vec4 on the scene's device; None if all equal the scene's.
        """
        from warpvis.kernels.mujoco.arrays import geom_sizes

        field = models.geom_size()
        if field is None or not self._checked(field):
            return None
        device, movable = self._scene.scene.device, len(self._scene.scene.movable)
        sizes = wp.empty((len(rows), movable), dtype=wp.vec4, device=device)
        geom_size = as_warp(field, wp.vec3, ("W", len(self._kinds)), name="geom_size", device=device)
        worlds = wp.array(rows, dtype=wp.int32, device=device)
        inputs = [geom_size, worlds, *self._on_device(movable), self._scene.scene.movable_sizes(), sizes]
        launch(geom_sizes, sizes.shape, inputs, device)
        return sizes

    def _on_device(self, movable: int) -> list[wp.array]:
        """Return the resizable geom of each movable object, -1 for none, and types and model sizes of all geoms."""
        if self._arrays is None or len(self._arrays[0]) != movable:
            device, columns = self._scene.scene.device, np.full(movable, -1, dtype=np.int32)
            moving = self._scene.movable_geoms
            columns[: len(moving)] = np.where(np.isin(moving, self._geoms), moving, -1)
            self._arrays = [wp.array(part, dtype=wp.int32, device=device) for part in (columns, self._kinds)]
            self._arrays.append(wp.array(self._model_size, dtype=wp.vec3, device=device))
        return self._arrays

    def _checked(self, sizes: Any) -> bool:
        """Check sizes, except on a GPU; return whether there are resizable geoms."""
        if on_gpu(sizes):
            if not len(self._geoms) and sizes.shape[0] > 1:
                raise ArrayError(
                    "geom_size must be of 1 world if no geom is resizable; create the BatchRenderer with "
                    'resizable=["box*", ...] or resizable="all"'
                )
            return len(self._geoms) > 0
        if sizes.shape[1:] != self._model_size.shape or sizes.dtype.kind not in "fiu":
            raise ArrayError(
                f"geom_size must be numbers of shape (W, {len(self._model_size)}, 3), got {sizes.dtype} of shape "
                f"{sizes.shape}"
            )
        with np.errstate(over="ignore"):
            rows = sizes.astype(np.float32)
        self._check_constant(rows)
        self._check_positive(rows)
        return len(self._geoms) > 0

    def _check_constant(self, rows: NDArray[np.float32]) -> None:
        """Raise an `ArrayError` if a geom that is not resizable differs from the model."""
        constant = np.setdiff1d(self._scene.geom_ids, self._geoms)
        other = np.argwhere((rows[:, constant] != self._model_size[constant]).any(axis=2))
        if not len(other):
            return
        world, place = other[0].tolist()
        name = self._name(int(constant[place]))
        message = f"geom_size of {name!r} must equal the model's, got another in world {world}"
        if int(self._kinds[constant[place]]) not in _NUMBERS:
            raise ArrayError(f"{message}; planes, height fields and meshes cannot be resized")
        raise ArrayError(f'{message}; create the BatchRenderer with resizable=[{name!r}] or resizable="all"')

    def _check_positive(self, rows: NDArray[np.float32]) -> None:
        for kind, count in _NUMBERS.items():
            geoms = self._geoms[self._kinds[self._geoms] == kind]
            numbers = rows[:, geoms, :count]
            bad = np.argwhere(~((numbers > 0) & np.isfinite(numbers)).all(axis=2))
            if len(bad):
                world, place = bad[0].tolist()
                got = rows[world, geoms[place], :count].tolist()
                raise ArrayError(
                    f"geom_size of {self._name(int(geoms[place]))!r} must be positive lengths [m] in every world, "
                    f"got {got} in world {world}"
                )

    def _name(self, geom: int) -> str:
        place = int(np.flatnonzero(self._scene.geom_ids == geom)[0])
        return self._scene.scene.objects[place].name

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_arrays": None}
