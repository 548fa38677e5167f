# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders with gradients, on arrays of Warp: the part that `warpvis.torch` and `warpvis.jax` share."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING, Any, cast
from weakref import WeakValueDictionary, finalize, ref

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras import with_parameters
from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import as_items
from warpvis.errors import ArrayError, SceneError
from warpvis.rendering._choices import CasterName, Output
from warpvis.rendering._renderer import Renderer
from warpvis.rendering._views import as_views, pixel_type
from warpvis.rendering.color_gradients import ColorGradients
from warpvis.rendering.coverage import Coverage, other_objects
from warpvis.rendering.gradients import NEEDED_IMAGES, DepthGradients, Zeros
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

WITH_GRADIENT = ("depth", "points", "normals")
"""Images that gradients flow through."""

WITHOUT_GRADIENT = ("labels", "segmentation", "faces")
"""Images of integers."""


@dataclass(frozen=True)
class Inputs:
    """The arrays that a render depends on, on the scene's device."""

    poses: wp.array
    """Camera to world in the camera's axes, ``(V,)`` transform."""
    object_poses: wp.array | None = None
    """Poses of the movable objects, ``(W, M)`` transform; None for their initial poses."""
    world_index: wp.array | None = None
    """World of each view, ``(V,)`` int32; None if there is one world, or view i shows world i."""
    vertices: Sequence[wp.array] = ()
    """Vertices of each deforming object, ``(n,)`` vec3."""


class DifferentiableRenderer:
    """Render images of a scene through a camera, and compute gradients of a loss with respect to the inputs."""

    def __init__(
        self,
        scene: Scene,
        camera: AnyCamera,
        *,
        deforming: Sequence[str] = (),
        caster: CasterName = "auto",
        threads: int | None = None,
        zeros: Zeros | None = None,
    ) -> None:
        """Set up the renderer.

        Args:
            scene: The scene.
            camera: The camera.
            deforming: Names of movable objects whose vertices are inputs.
            caster: As for `Renderer`.
            threads: As for `Renderer`.
            zeros: Allocates the arrays of gradients, as for `DepthGradients`.
        """
        require_scene(scene)
        self.scene, self.camera = scene, camera
        self.deforming = tuple(deforming)
        for name in self.deforming:
            if scene.index(name) not in scene.movable:
                raise SceneError(f"vertices must be those of movable objects, got {name!r}, which is static")
        self._options: dict[str, Any] = {"caster": caster, "threads": threads}
        self._renderers: dict[tuple[str, ...], Renderer] = {}
        self._zeros = zeros
        self._changed: tuple[tuple[float, ...], DifferentiableRenderer] | None = None
        self._gradients = DepthGradients(scene, camera, threads=threads, zeros=zeros)
        self._colors = ColorGradients(scene, threads=threads, zeros=zeros)
        self._renderer(("depth",))  # checks the arguments

    def render(self, inputs: Inputs, images: Mapping[str, wp.array], *, only: Sequence[str] | None = None) -> None:
        """Render into images of ``(V, *camera.shape)``, by name; moves the vertices of the deforming objects first.

        `only` are the names of the rendered objects, by default all.
        """
        for name, vertices in zip(self.deforming, inputs.vertices, strict=True):
            self.scene.update_vertices(name, vertices)
        self._renderer(tuple(images)).render(
            inputs.poses,
            object_poses=inputs.object_poses,
            world_index=inputs.world_index,
            exclude=None if only is None else other_objects(self.scene, only),
            convention=self.camera.axes,
            out=as_views(images),
        )

    def pose_gradients(
        self, inputs: Inputs, images: Mapping[str, wp.array], gradients: Mapping[str, wp.array]
    ) -> wp.array:
        """Return gradients with respect to poses, as `DepthGradients.poses` does."""
        return self._gradients.poses(inputs.poses, self._worlds(inputs), images, gradients)

    def vertex_gradients(
        self, inputs: Inputs, images: Mapping[str, wp.array], gradients: Mapping[str, wp.array]
    ) -> list[wp.array]:
        """Return gradients with respect to the vertices of each deforming object, as `DepthGradients.vertices` does."""
        worlds = self._worlds(inputs)
        return [
            self._gradients.vertices(name, vertices, inputs.poses, worlds, images, gradients)
            for name, vertices in zip(self.deforming, inputs.vertices, strict=True)
        ]

    def parameter_gradients(
        self, inputs: Inputs, images: Mapping[str, wp.array], gradients: Mapping[str, wp.array]
    ) -> wp.array:
        """Return gradients with respect to the camera's parameters, as `DepthGradients.parameters` does."""
        return self._gradients.parameters(inputs.poses, images, gradients)

    def silhouettes(self, poses: wp.array, images: Mapping[str, wp.array]) -> wp.array:
        """Return the mask of pixels next to silhouettes, as `DepthGradients.silhouettes` does."""
        return self._gradients.silhouettes(poses, images)

    def areas(self, inputs: Inputs, images: Mapping[str, wp.array], names: tuple[str, ...], out: wp.array) -> None:
        """Write areas of objects, as `Coverage.areas` does."""
        self._coverage.areas(names, inputs.poses, self._worlds(inputs), images, out)

    def masks(self, inputs: Inputs, images: Mapping[str, wp.array], names: tuple[str, ...], out: wp.array) -> None:
        """Write masks of objects, as `Coverage.masks` does."""
        self._coverage.masks(names, inputs.poses, self._worlds(inputs), images, out)

    def area_gradients(
        self, inputs: Inputs, images: Mapping[str, wp.array], names: tuple[str, ...], weights: wp.array
    ) -> tuple[wp.array, list[wp.array]]:
        """Return gradients of areas with respect to poses and vertices, as `Coverage.gradients` does."""
        vertices = dict(zip(self.deforming, inputs.vertices, strict=True))
        worlds = self._worlds(inputs)
        of_poses, found = self._coverage.gradients(names, inputs.poses, worlds, images, weights, vertices)
        return of_poses, [found[name] for name in self.deforming]

    @cached_property
    def _coverage(self) -> Coverage:
        return Coverage(self.scene, self.camera, threads=self._options["threads"], zeros=self._zeros)

    def with_parameters(self, values: NDArray[np.float64]) -> DifferentiableRenderer:
        """Return the renderer of the camera with other values of its parameters; that of the last values is cached."""
        key = tuple(values.tolist())
        if self._changed is None or self._changed[0] != key:
            camera = with_parameters(self.camera, values)
            self._changed = (
                key,
                DifferentiableRenderer(
                    self.scene, camera, deforming=self.deforming, zeros=self._zeros, **self._options
                ),
            )
        return self._changed[1]

    def check_colors(self, shapes: Mapping[int, tuple[int, ...]]) -> None:
        """Check the shapes of given colors by index of the object, as `ColorGradients.check_shape` does."""
        for index, shape in shapes.items():
            self._colors.check_shape(index, shape)

    def interpolate_colors(
        self,
        inputs: Inputs,
        colors: Mapping[int, wp.array],
        images: Mapping[str, wp.array],
        out: wp.array,
    ) -> None:
        """Write the colors of pixels that see objects, as `ColorGradients.interpolate` does.

        `colors` are by index of the object; `out` has the colors of other pixels.
        """
        worlds = self._worlds(inputs)
        for index, given in colors.items():
            self._colors.interpolate(index, given, worlds, images, out, vertices=self._vertices_of(inputs, index))

    def color_gradients(
        self,
        inputs: Inputs,
        shapes: Mapping[int, tuple[int, ...]],
        images: Mapping[str, wp.array],
        of_colors: wp.array,
    ) -> list[wp.array]:
        """Return gradients with respect to colors of these shapes, by object, as `ColorGradients.gradients` does."""
        worlds = self._worlds(inputs)
        return [
            self._colors.gradients(index, shape, worlds, images, of_colors, vertices=self._vertices_of(inputs, index))
            for index, shape in shapes.items()
        ]

    def check_normals(self, names: Iterable[str]) -> None:
        """Raise a `SceneError` for gradients of normals that do not exist, as `DepthGradients.check_normals` does."""
        self._gradients.check_normals(names)

    def needed_images(self) -> tuple[str, ...]:
        """Return the images of a render that its gradients are computed from."""
        names = NEEDED_IMAGES if self.scene.movable else NEEDED_IMAGES[:2]
        return (*names, "faces") if self.deforming else names

    def _vertices_of(self, inputs: Inputs, index: int) -> wp.array | None:
        """Return the vertices of an object if they are inputs."""
        name = self.scene.objects[index].name
        return inputs.vertices[self.deforming.index(name)] if name in self.deforming else None

    def _worlds(self, inputs: Inputs) -> Worlds:
        return parse_worlds(self.scene, len(inputs.poses), inputs.object_poses, inputs.world_index, None)

    def _renderer(self, outputs: tuple[str, ...]) -> Renderer:
        """Return the renderer of these images, cached."""
        if outputs not in self._renderers:
            chosen = cast("Sequence[Output]", outputs)
            self._renderers[outputs] = Renderer(self.scene, self.camera, outputs=chosen, **self._options)
        return self._renderers[outputs]


_MAX_CACHED = 64
"""Largest number of renderers that a scene keeps."""

_numbers = count(1)
_numbered: WeakValueDictionary[int, DifferentiableRenderer] = WeakValueDictionary()
"""Renderers by number. Functions of other libraries that are traced take numbers, but no objects."""

_arguments: dict[int, tuple[ref[Scene], ref[AnyCamera], dict[str, Any]]] = {}
"""What renderers are made from, by number, as long as the camera exists."""


def renderer_number(scene: Scene, camera: AnyCamera, **options: Any) -> int:
    """Return the number of the renderer of a scene, a camera and options."""
    require_scene(scene)
    cached: dict[Hashable, tuple[int, DifferentiableRenderer]] = scene.differentiable
    key = _key(camera, options)
    if key not in cached or cached[key][1].camera is not camera:
        number = next(_numbers)
        _keep(number, DifferentiableRenderer(scene, camera, **options), key)
        _arguments[number] = ref(scene), ref(camera), options
        finalize(camera, _arguments.pop, number, None)
    return cached[key][0]


def numbered_renderer(number: int) -> DifferentiableRenderer:
    """Return a renderer by its number; it is made again if its scene has dropped it in favor of newer ones."""
    renderer = _numbered.get(number)
    if renderer is None:
        known = _arguments.get(number)
        scene, camera = (None, None) if known is None else (known[0](), known[1]())
        if known is None or scene is None or camera is None:
            raise SceneError("scene and camera must exist as long as functions that were traced with them")
        renderer = DifferentiableRenderer(scene, camera, **known[2])
        _keep(number, renderer, _key(camera, known[2]))
    return renderer


def _key(camera: AnyCamera, options: Mapping[str, Any]) -> Hashable:
    return id(camera), *sorted(options.items())


def _keep(number: int, renderer: DifferentiableRenderer, key: Hashable) -> None:
    """Let the scene keep a renderer."""
    cached = renderer.scene.differentiable
    while len(cached) >= _MAX_CACHED:
        del cached[next(iter(cached))]
    cached[key] = number, renderer
    _numbered[number] = renderer


def check_image_names(outputs: object, *others: str) -> tuple[str, ...]:
    """Return the names of requested images, without duplicates; `others` are valid, too."""
    names = as_items(outputs, "outputs")
    known = (*WITH_GRADIENT, *WITHOUT_GRADIENT, *others)
    unknown = [str(name) for name in names if name not in known]
    if unknown or not names:
        raise ArrayError(f"outputs must be some of {', '.join(known)}, got {', '.join(unknown) or 'none'}")
    return tuple(dict.fromkeys(names))


def check_vertices(vertices: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Return given vertices by name of the object."""
    if vertices is None:
        return {}
    if not isinstance(vertices, Mapping):
        raise ArrayError(f"vertices must be arrays by name of the object, got {type(vertices).__name__}")
    return vertices


def image_shape(name: str, views: int, camera: AnyCamera) -> tuple[int, ...]:
    """Return the shape of an image of all views, with its components."""
    return (views, *camera.shape, *([3] if pixel_type(name) in (wp.vec3, wp.vec3ub) else []))
