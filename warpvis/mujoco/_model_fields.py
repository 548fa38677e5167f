# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fields of a model that determine images: numbering and names of elements, detection of changes, and checks.

Geoms and sites have one numbering: geoms have their ids, and sites follow them. MuJoCo draws sites like geoms, after
them (`mjv_addGeoms` in src/engine/engine_vis_visualize.c). Skins, flexes and tendons, which have no pose, have the
numbers after the sites.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.errors import SceneError, WarpvisError

GEOM, SITE, UNKNOWN = (int(getattr(mujoco.mjtObj, f"mjOBJ_{name}")) for name in ("GEOM", "SITE", "UNKNOWN"))
SKIN, FLEX, TENDON = (int(getattr(mujoco.mjtObj, f"mjOBJ_{name}")) for name in ("SKIN", "FLEX", "TENDON"))

DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)
"""A geom that has a material and this color takes the material's color (`setMaterial` in engine_vis_visualize.c)."""


def shape_count(model: mujoco.MjModel) -> int:
    """Return the number of geoms and sites."""
    return int(model.ngeom + model.nsite)


def shape_value(model: mujoco.MjModel, name: str, shape: int) -> Any:
    """Return the current value of a shape's field, ``geom_<name>`` or ``site_<name>``."""
    if shape < model.ngeom:
        return getattr(model, f"geom_{name}")[shape]
    return getattr(model, f"site_{name}")[shape - model.ngeom]


def shape_data(model: mujoco.MjModel, shape: int) -> int:
    """Return the id of a shape's mesh or height field; -1 for none."""
    return int(model.geom_dataid[shape]) if shape < model.ngeom else -1


def shape_bodies(model: mujoco.MjModel) -> NDArray[np.int32]:
    """Return the body id of every shape, ``(shapes,)``."""
    return np.concatenate([model.geom_bodyid, model.site_bodyid])


def shape_meaning(model: mujoco.MjModel, shape: int) -> tuple[int, int]:
    """Return the id and `mujoco.mjtObj` of a shape."""
    return (shape, GEOM) if shape < model.ngeom else (shape - int(model.ngeom), SITE)


def shape_places(data: mujoco.MjData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Copy the poses of all shapes: positions [m], ``(shapes, 3)``, and rotations, ``(shapes, 9)``."""
    return np.concatenate([data.geom_xpos, data.site_xpos]), np.concatenate([data.geom_xmat, data.site_xmat])


def element_meanings(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """List id and `mujoco.mjtObj` of all visual elements, in the order of `object_names`."""
    return [(index, kind) for kind, count in _counts(model).items() for index in range(count)]


def drawn_number(model: mujoco.MjModel, kind: int, index: int) -> int | None:
    """Return the number in `object_names` of a visual element, a `mujoco.mjtObj` and an id; None for decorations."""
    first = 0
    for known, count in _counts(model).items():
        if kind == known:
            return first + index
        first += count
    return None


def object_names(model: mujoco.MjModel) -> list[str]:
    """Return unique names of all visual elements: geoms, sites, skins, flexes and tendons."""
    names = [model.geom(geom).name for geom in range(model.ngeom)]
    taken, last = {name for name in names if name}, dict.fromkeys(range(model.nbody), -1)
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        while not names[geom]:
            last[body] += 1
            name = (model.body(body).name or f"body_{body}") + (f"_{last[body]}" if last[body] else "")
            if name not in taken:
                names[geom] = name
                taken.add(name)
    for kind, count in _counts(model).items():
        if kind == GEOM:
            continue
        for index in range(count):
            names.append(free_name(_own_name(model, kind, index), taken))
            taken.add(names[-1])
    return names


def free_name(preferred: str, taken: set[str]) -> str:
    """Return `preferred`, with ``_1``, ``_2``, ... appended if it is taken."""
    name, number = preferred, 0
    while name in taken:
        number += 1
        name = f"{preferred}_{number}"
    return name


def _own_name(model: mujoco.MjModel, kind: int, index: int) -> str:
    found = mujoco.mj_id2name(model, kind, index)
    if found:
        return str(found)
    if kind == SITE:
        body = int(model.site_bodyid[index])
        return (model.body(body).name or f"body_{body}") + "_site"
    return f"{mujoco.mju_type2Str(kind)}_{index}"


def _counts(model: mujoco.MjModel) -> dict[int, int]:
    """Return the numbers of visual elements by type, in order."""
    counts = (model.ngeom, model.nsite, model.nskin, model.nflex, model.ntendon)
    return dict(zip((GEOM, SITE, SKIN, FLEX, TENDON), map(int, counts), strict=True))


MATERIAL_FIELDS = (
    *("mat_rgba", "mat_texid", "mat_texrepeat", "mat_texuniform"),
    *("mat_emission", "mat_specular", "mat_shininess", "mat_reflectance", "mat_metallic", "mat_roughness"),
)
LIGHT_FIELDS = (
    *("light_pos", "light_dir", "light_cutoff", "light_exponent"),
    *("light_attenuation", "light_ambient", "light_diffuse", "light_specular"),
)
HEADLIGHT_FIELDS = ("ambient", "diffuse", "specular")
CAMERA_FIELDS = ("cam_fovy", "cam_intrinsic", "cam_sensorsize")
# Numbers that determine shapes, their visibility and their appearance.
_SHAPE_NUMBERS = (
    *("geom_size", "geom_rgba", "site_size", "site_rgba", *MATERIAL_FIELDS),
    *("hfield_size", "skin_rgba", "flex_rgba", "tendon_rgba"),
)
# Visibility and sizes of geoms.
_SHAPE_FIELDS = (
    *("geom_type", "geom_dataid", "geom_size", "geom_rgba", "geom_matid", "mat_rgba", "geom_group", "hfield_size"),
)
# Poses of geoms in their bodies, and of bodies in their parents.
_POSES = ("geom_pos", "geom_quat", "body_pos", "body_quat")
# The same fields of sites, which are optional.
_SITE_FIELDS = ("site_type", "site_size", "site_rgba", "site_matid", "site_group")
_SITE_POSES = ("site_pos", "site_quat")
# Fields that determine colors. Like in MuJoCo, images of textures are read once.
_COLOR_FIELDS = (
    *("geom_rgba", "geom_matid", "site_rgba", "site_matid", *MATERIAL_FIELDS),
    *("light_active", "light_type", "light_bodyid", *LIGHT_FIELDS),
)
_MESHES = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_SDF))
_HEIGHT_FIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)


class Watched:
    """An array of a model, and a copy of its previous values. Models never reallocate their arrays.

    Comparing a `bytearray` with memory is limited by memory bandwidth only, and faster than comparing NumPy arrays.
    """

    def __init__(self, array: np.ndarray) -> None:
        """Copy the current values of a contiguous array."""
        self.array = array
        self._memory = array.reshape(-1).data.cast("B") if array.size else memoryview(b"")
        self._before = bytearray(self._memory)

    def changed(self) -> bool:
        """Return whether values have changed."""
        return self._before != self._memory

    def before(self) -> np.ndarray:
        """Return the previous values, as a view that is valid until `accept`."""
        return np.frombuffer(self._before, dtype=self.array.dtype).reshape(self.array.shape)

    def accept(self) -> None:
        """Copy the current values as the previous ones."""
        self._before = bytearray(self._memory)

    def restore(self, before: np.ndarray) -> None:
        """Set the previous values."""
        self._before = bytearray(np.ascontiguousarray(before).tobytes())


def any_changed(arrays: Iterable[Watched]) -> bool:
    """Return whether values of any array have changed; faster than `any`, for callers in every frame."""
    for watched in arrays:
        if watched._before != watched._memory:
            return True
    return False


class ModelWatch:
    """Watches the fields of a model that determine shapes and visibility of geoms and sites."""

    def __init__(self, model: mujoco.MjModel, geoms: Iterable[int], *, sites: bool = False) -> None:
        """Copy the current values, including meshes and height fields of `geoms`, and sites if `sites` is set."""
        self._map, self._statistic = model.vis.map, model.stat
        poses = _POSES + (_SITE_POSES if sites else ())
        names = _SHAPE_FIELDS + poses + (_SITE_FIELDS if sites else ())
        self._fields = {name: Watched(getattr(model, name)) for name in names}
        self._poses = [self._fields[name] for name in poses]
        self._plane = self._far()
        assets = {(int(model.geom_type[geom]), int(model.geom_dataid[geom])) for geom in geoms if geom < model.ngeom}
        meshes = {index for kind, index in assets if kind in _MESHES and index >= 0}
        fields = {index for kind, index in assets if kind == _HEIGHT_FIELD and index >= 0}
        self._vertices = [_AssetRun(model, run, of_meshes=True) for run in _runs(meshes)]
        self._heights = [_AssetRun(model, run, of_meshes=False) for run in _runs(fields)]
        runs = [*self._vertices, *self._heights]
        self._all = [*self._fields.values(), *(run.watched for run in runs)]

    def changed(self) -> bool:
        """Return whether any value has changed."""
        return any_changed(self._all) or self._far() != self._plane

    def only_poses_changed(self) -> bool:
        """Return whether no values except poses of geoms, sites and bodies have changed."""
        changed = [watched for watched in self._all if watched.changed()]
        return self._far() == self._plane and all(watched in self._poses for watched in changed)

    def accept(self) -> None:
        """Copy the current values as the previous ones."""
        self._plane = self._far()
        for watched in self._all:
            watched.accept()

    def changed_assets(self) -> set[tuple[int, int]]:
        """List the changed meshes and height fields, as type and data id of a geom."""
        sizes = self._fields["hfield_size"]
        before = sizes.before()
        resized = [k for k in range(len(before)) if not np.array_equal(before[k], sizes.array[k])]
        changed = {(_HEIGHT_FIELD, index) for index in resized}
        changed |= {(_HEIGHT_FIELD, index) for run in self._heights for index in run.changed()}
        return changed | {(kind, index) for run in self._vertices for index in run.changed() for kind in _MESHES}

    def _far(self) -> float:
        """Return the distance of the far plane, which determines the size of infinite planes."""
        return float(self._map.zfar * self._statistic.extent)


class AppearanceWatch:
    """Watches the fields of a model that determine colors, except shapes."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._fields = {name: Watched(getattr(model, name)) for name in _COLOR_FIELDS}
        headlight = model.vis.headlight
        self._fields |= {f"vis.headlight.{name}": Watched(getattr(headlight, name)) for name in HEADLIGHT_FIELDS}

    def changed(self) -> list[str]:
        """List the changed fields."""
        return [name for name, watched in self._fields.items() if watched.changed()]

    def accept(self, names: Iterable[str]) -> None:
        """Copy the current values of some fields as the previous ones."""
        for name in names:
            self._fields[name].accept()

    def before(self, name: str) -> np.ndarray:
        """Return the values of a field at construction, or when they were accepted."""
        return self._fields[name].before()

    def __getstate__(self) -> dict[str, Any]:
        before = {name: watched.before().copy() for name, watched in self._fields.items()}
        return {"model": self._model, "before": before}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Watch the same fields of the unpickled model."""
        self.__init__(state["model"])  # type: ignore[misc]
        for name, before in state["before"].items():
            self._fields[name].restore(before)


class _AssetRun:
    """Meshes or height fields that are contiguous in a model's memory."""

    def __init__(self, model: mujoco.MjModel, run: list[int], *, of_meshes: bool) -> None:
        if of_meshes:
            array, first, count = model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum
        else:
            array, first, count = model.hfield_data, model.hfield_adr, model.hfield_nrow * model.hfield_ncol
        begin = int(first[run[0]])
        self._parts = [(k, int(first[k]) - begin, int(first[k] + count[k]) - begin) for k in run]
        self.watched = Watched(array[begin : begin + self._parts[-1][2]])

    def changed(self) -> list[int]:
        """List the changed ones."""
        if not self.watched.changed():
            return []
        before, current = self.watched.before(), self.watched.array
        return [k for k, begin, end in self._parts if not np.array_equal(before[begin:end], current[begin:end])]


def _runs(indices: Iterable[int]) -> list[list[int]]:
    """Split indices into runs of consecutive ones."""
    places = enumerate(sorted(indices))
    return [[index for _, index in run] for _, run in groupby(places, key=lambda pair: pair[1] - pair[0])]


def check_shape_numbers(model: mujoco.MjModel) -> None:
    """Raise a `SceneError` if a number that determines shapes, visibility or appearance is not finite."""
    check_numbers(model, _SHAPE_NUMBERS, SceneError)


def check_light_numbers(model: mujoco.MjModel, lights: Iterable[int]) -> None:
    """Raise a `SceneError` if a number of the given lights, or of the headlight, is not finite."""
    check_numbers(model, LIGHT_FIELDS, SceneError, list(lights))
    for name in HEADLIGHT_FIELDS:
        value = getattr(model.vis.headlight, name)
        if not np.isfinite(value).all():
            raise SceneError(f"vis.headlight.{name} must be finite numbers, got {value.tolist()}")


def check_numbers(
    model: mujoco.MjModel, fields: Iterable[str], error: type[WarpvisError], chosen: list[int] | None = None
) -> None:
    """Raise an error if a number of the chosen rows of some fields, or of all, is not finite."""
    for name in fields:
        values = getattr(model, name)
        rows = values if chosen is None else values[chosen]
        if np.isfinite(rows).all():
            continue
        row = int(np.argwhere(~np.isfinite(rows))[0, 0])
        index, kind = row if chosen is None else chosen[row], name.split("_")[0]
        noun = {"mat": "material", "cam": "camera"}.get(kind, kind)
        label = getattr(model, noun)(index).name or index
        raise error(f"{name} of {noun} {label!r} must be finite, got {values[index].tolist()}")
