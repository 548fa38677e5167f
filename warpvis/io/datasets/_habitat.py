# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of Habitat's scene datasets (HSSD, ReplicaCAD): a stage, instances of objects, and lights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.categories import label_of_category
from warpvis.core.checks import pluralize
from warpvis.core.file_content import is_file
from warpvis.core.labels import Label
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.errors import FileFormatError
from warpvis.io._meshes import unique_names
from warpvis.io.datasets._bop import read_bop
from warpvis.io.datasets._fields import Fields
from warpvis.io.datasets._habitat_joints import ScaledMeshes, place_robot
from warpvis.io.datasets._habitat_templates import DATASET, SCENE, Dataset, Template
from warpvis.scene import FileParts, Part
from warpvis.scene.joints import JointTree
from warpvis.scene.lights import HEADLIGHT, Light

_CONFIGS = {".stage_config.json": "stages", ".object_config.json": "objects", ".ao_config.json": "articulated_objects"}
_MOTIONS = ("static", "kinematic", "dynamic")
_AMBIENT = Light("ambient", "ambient", ambient=(0.4, 0.4, 0.4), color_space="linear")
"""Habitat-Sim's ambient light wherever a scene has lights (getAmbientLightColor in LightSetup.cpp)."""
_DEFAULT_LIGHTS = tuple(
    Light("directional", f"default_{number}", direction=toward, color=(0.5, 0.5, 0.5), color_space="linear")
    for number, toward in enumerate([(0, 0.5, 0.5), (0, 0.5, -0.5), (0.5, 0.5, 0), (-0.5, 0.5, 0)])
)
"""Habitat-Sim's default lights (getDefaultLights in LightSetup.cpp), by the direction in which light travels."""
_MAX_NAMED = 5


def read_habitat(path: Path, *, search_path: Sequence[Path] = (), strict: bool = False) -> FileParts:
    """Read a scene (``*.scene_instance.json``), or one stage or object (``*.stage_config.json``, ...).

    Args:
        path: The file.
        search_path: Folders that are searched for templates in addition to that of the dataset.
        strict: Whether instances without a template, and other unsupported content, are errors.
    """
    if path.name.startswith("scene_gt") and not path.name.startswith("scene_gt_"):
        return read_bop(path, search_path=search_path, strict=strict)
    if path.name.endswith(DATASET):
        count = len(list(path.parent.rglob(f"*{SCENE}")))
        raise FileFormatError(f"{path}: lists the scenes of a dataset; load one of its {count} files *{SCENE}")
    fields, dataset = Fields.read(path), Dataset(path, search_path)
    kind = next((kind for suffix, kind in _CONFIGS.items() if path.name.endswith(suffix)), None)
    scene = _Scene(path, dataset, fields if kind is None else Fields({}, f"{path}:"))
    if kind is None:
        scene.add_all(fields)
    else:
        scene.add_template(kind, Template(path.name, fields, path.parent), Fields({}, f"{path}:"))
    left_out, lights = scene.left_out(), scene.lights(fields)
    if strict and left_out:
        raise FileFormatError(left_out[0])
    messages = (*left_out, *scene.notes, *dataset.warnings)
    names = unique_names([part.name for part in scene.parts])
    parts = [replace(part, name=name) for name, part in zip(names, scene.parts, strict=True)]
    return FileParts(path, parts, up="y", warnings=messages, lights=lights, joints=scene.joints)


class _Scene:
    """The parts of a scene."""

    def __init__(self, path: Path, dataset: Dataset, fields: Fields) -> None:
        self.path, self.parts, self.notes = path, list[Part](), list[str]()
        self._dataset = dataset
        self._origin = fields.text("translation_origin", "asset_local").lower()
        self._lexicon, self._categories = dataset.lexicon(fields), dataset.categories()
        self.joints, self._meshes = JointTree(), ScaledMeshes()
        self._missing: dict[str, int] = {}
        self._broken: dict[str, int] = {}

    def add_all(self, fields: Fields) -> None:
        """Add the stage and the instances of a scene."""
        if not {"stage_instance", "object_instances", "articulated_object_instances"} & fields.values.keys():
            raise FileFormatError(f"{self.path}: must have 'stage_instance' or 'object_instances', got neither")
        if "stage_instance" in fields.values:
            self._add("stages", fields.child("stage_instance"))
        for kind, key in (("objects", "object_instances"), ("articulated_objects", "articulated_object_instances")):
            for item in fields.children(key):
                self._add(kind, item)

    def _add(self, kind: str, item: Fields) -> None:
        handle = item.text("template_name")
        template = self._dataset.template(kind, handle)
        if template is None:
            self._missing[handle] = self._missing.get(handle, 0) + 1
            return
        self.add_template(kind, template, item)

    def add_template(self, kind: str, template: Template, item: Fields) -> None:
        """Add the parts of one instance of a template."""
        is_jointed = kind == "articulated_objects"
        path = template.file("urdf_filepath") if is_jointed else template.file("render_asset", "collision_asset")
        if path is None:
            key = "urdf_filepath" if is_jointed else "render_asset"
            raise FileFormatError(f"{template.fields.named(key)} must be the file of a mesh, got nothing")
        if not is_file(path):
            self._broken[str(path)] = self._broken.get(str(path), 0) + 1
            return
        if is_jointed:
            self._add_jointed(template, item, path)
            return
        if template.fields.number("units_to_meters", 1.0) != 1:
            note = f"{template.fields.location} units_to_meters is ignored, as in Habitat-Sim; write it into 'scale'"
            self.notes += [note] if note not in self.notes else []
        is_stage = kind == "stages"
        factors = template.fields.vector("scale", (1.0, 1.0, 1.0)) * _scale(item)
        if not np.abs(factors).min() > 0:
            raise FileFormatError(f"{item.location} the scale must not be 0, got {factors.tolist()}")
        shapes = self._dataset.shapes(path, np.diag(factors) @ template.frame(), joined=not is_stage)
        vertices = [shape.vertices for _, shape in shapes]
        if not vertices:
            return
        pose = _pose(item)
        if not is_stage and self._is_at_center(item):
            pose[:3, 3] -= pose[:3, :3] @ _center(template, factors, np.concatenate(vertices))
        name = template.name
        category = "" if is_stage else self._category(name, template)
        row = poses_to_opencv(pose)[0]
        for part_name, shape in shapes:
            self.parts.append(
                Part(
                    part_name if is_stage else name,
                    (shape.vertices, shape.faces),
                    Label.OBSTACLE if is_stage else label_of_category(category),
                    pose=row,
                    movable=not is_stage and _moves(item),
                    category=category,
                    aliases=(name, template.handle),
                    appearance=shape.appearance,
                    extras=_extras(template, item),
                )
            )

    def _is_at_center(self, item: Fields) -> bool:
        """Return whether an instance's translation is that of its center of mass."""
        origin = item.text("translation_origin", "default").lower()
        origin = self._origin if origin == "default" else origin
        if origin not in ("com", "asset_local", "default"):
            raise FileFormatError(f"{item.named('translation_origin')} must be 'COM' or 'asset_local', got {origin!r}")
        return origin == "com"

    def _category(self, name: str, template: Template) -> str:
        """Return the class of a template: by its semantic id, else by the tables of the dataset."""
        number = template.fields.whole("semantic_id", -1)
        known = self._categories.get(name, "")
        return self._lexicon.get(number, known) or known

    def _add_jointed(self, template: Template, item: Fields, path: Path) -> None:
        """Add an articulated object."""
        factor = template.fields.number("uniform_scale", 1.0) * item.number("uniform_scale", 1.0)
        if not factor > 0:
            raise FileFormatError(f"{item.location} the scale must be greater than 0, got {factor:g}")
        if "non_uniform_scale" in item.values:
            self.notes.append(
                f"{item.named('non_uniform_scale')} is ignored, since Habitat-Sim scales joints uniformly"
            )
        name = template.name
        prefix = unique_names([*dict.fromkeys(part.name.partition("/")[0] for part in self.parts), name])[-1]
        parts, joints = place_robot(self._dataset.robot(path), prefix, _pose(item), factor, item, self._meshes)
        if _moves(item):
            self.joints = self.joints.joined(joints)
        else:
            parts = [replace(part, movable=False, attach_to=None, link=None) for part in parts]
        category = self._category(name, template)
        shared: dict[str, Any] = {
            "label": label_of_category(category),
            "category": category,
            "extras": _extras(template, item),
        }
        self.parts += [replace(part, aliases=(*part.aliases, name), **shared) for part in parts]

    def left_out(self) -> list[str]:
        """Return sentences about instances without a template or a mesh."""
        return [
            f"{self.path}: left out {pluralize(sum(names.values()), 'instance')} whose {what} was not found: "
            + _listed(names)
            for names, what in ((self._missing, "template"), (self._broken, "mesh file"))
            if names
        ]

    def lights(self, fields: Fields) -> tuple[Light, ...]:
        """Return the lights of a scene: those of its lighting configuration, Habitat's default, or a headlight."""
        handle = fields.text("default_lighting", "no_lights")
        if handle in ("no_lights", "no_lights.lighting_config.json"):
            return (HEADLIGHT,)
        if not handle:
            return (*_DEFAULT_LIGHTS, _AMBIENT)
        setup = self._dataset.template("light_setups", handle)
        if setup is None:
            self.notes.append(f"{self.path}: lighting {handle!r} was not found; a headlight replaces it")
            return (HEADLIGHT,)
        lights, left_out = list[Light](), list[str]()
        for name in setup.fields.child("lights").values:
            light = _light(name, setup.fields.child("lights").child(name), setup.fields)
            if isinstance(light, str):
                left_out.append(light)
            else:
                lights.append(light)
        if left_out:
            self.notes.append(f"{setup.fields.location} left out the lights {', '.join(left_out[:_MAX_NAMED])}")
        return (*lights, _AMBIENT) if lights else (HEADLIGHT,)


def _light(name: str, fields: Fields, setup: Fields) -> Light | str:
    """Return a light; its name and the reason if it cannot be read."""
    intensity = fields.number("intensity", 1.0)
    scale = setup.number(f"{'positive' if intensity > 0 else 'negative'}_intensity_scale", 1.0)
    if intensity * scale < 0:
        return f"{name!r}, which has a negative intensity"
    if fields.text("position_model", "global").lower() != "global":
        return f"{name!r}, which moves with the camera or with an object"
    kind = fields.text(
        "type", "directional" if "direction" in fields.values and "position" not in fields.values else "point"
    )
    color = tuple(np.clip(fields.vector("color", (1.0, 1.0, 1.0)), 0, None).tolist())
    options: dict[str, Any] = {"color": color, "intensity": intensity * scale, "color_space": "linear"}
    if kind.lower() == "directional":
        toward = fields.vector("direction" if "direction" in fields.values else "position", (0.0, 1.0, 0.0))
        return (
            Light("directional", name, direction=tuple((-toward).tolist()), **options) if toward.any() else f"{name!r}"
        )
    position = fields.vector("position" if "position" in fields.values else "direction", (0.0, 0.0, 0.0))
    return Light(
        "point", name, position=tuple(position.tolist()), attenuation=(0.0, 0.0, 1.0), falloff="gltf", **options
    )


def _scale(item: Fields) -> NDArray[np.float64]:
    """Return the scale factors of an instance."""
    return item.vector("non_uniform_scale", (1.0, 1.0, 1.0)) * item.number("uniform_scale", 1.0)


def _pose(item: Fields) -> NDArray[np.float64]:
    """Return the matrix from an instance to the scene."""
    w, x, y, z = item.vector("rotation", (1.0, 0.0, 0.0, 0.0)).tolist()
    if not np.linalg.norm((w, x, y, z)) > 0:
        raise FileFormatError(f"{item.named('rotation')} must be a quaternion w x y z of length 1, got length 0")
    return poses_to_matrices(np.array([*item.vector("translation", (0.0, 0.0, 0.0)).tolist(), x, y, z, w]))


def _center(template: Template, factors: NDArray[np.float64], vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the center of mass in the object's frame; that of its bounding box by default."""
    if "COM" in template.fields.values:
        return factors * template.fields.vector("COM", (0.0, 0.0, 0.0))
    return (vertices.min(axis=0) + vertices.max(axis=0)) / 2


def _moves(item: Fields) -> bool:
    motion = item.text("motion_type", "dynamic").lower()
    if motion not in _MOTIONS:
        raise FileFormatError(f"{item.named('motion_type')} must be STATIC, KINEMATIC or DYNAMIC, got {motion!r}")
    return motion != "static"


def _extras(template: Template, item: Fields) -> dict[str, Any]:
    known = {"template": template.handle}
    for fields, key in ((template.fields, "semantic_id"), (item, "motion_type"), (item, "user_defined")):
        known |= {key: fields.values[key]} if key in fields.values else {}
    return known


def _listed(names: Mapping[str, int]) -> str:
    chosen = [repr(name) for name in list(names)[:_MAX_NAMED]]
    return ", ".join(chosen) + (", ..." if len(names) > _MAX_NAMED else "")
