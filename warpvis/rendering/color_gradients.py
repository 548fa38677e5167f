# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of objects from given vertex colors or textures, and their gradients, from the images of a finished render."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, get_args

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.threads import check_threads, launch_images
from warpvis.errors import ArrayError, SceneError
from warpvis.rendering.casters.base import ImagesByName, as_image
from warpvis.rendering.gradients import Zeros
from warpvis.scene import Scene, SceneObject
from warpvis.scene.materials import Appearance, Wrap

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.gradients.color_gradients import ColoredObject, SeenPoints

COLOR_IMAGES = ("points", "segmentation", "faces", "albedo")
"""Images of the render that colors are computed from."""


class _Tables(NamedTuple):
    """What an object's colors are computed with, on the scene's device."""

    vertices: wp.array
    """The scene's, or those of the last update."""
    faces: wp.array
    uv: wp.array | None
    wraps: tuple[int, int]


class ColorGradients:
    """Compute colors of objects of one scene, and gradients of a loss with respect to the given colors.

    Given colors are those of the vertices of an object, ``(n,)`` vec3, or the texels of a texture, ``(h, w)`` vec3, the
    top row first. They are interpolated as they are, without a conversion of color spaces, and replace the object's
    base color, vertex colors, texture and opacity. Textures are sampled bilinearly, without mip maps, at the texture
    coordinates of the object's appearance, with the wrap modes of its first texture.
    """

    def __init__(self, scene: Scene, *, threads: int | None = None, zeros: Zeros | None = None) -> None:
        """Set up for a scene; `threads` as for `Renderer`, `zeros` as for `DepthGradients`."""
        self._scene, self._threads, self._zeros = scene, check_threads(threads), zeros
        self._cached: dict[tuple[int, bool], tuple[tuple[object, ...], _Tables]] = {}

    def check_shape(self, index: int, shape: tuple[int, ...]) -> None:
        """Check the shape of given colors, with their components.

        Raises:
            ArrayError: If the shape is neither ``(n, 3)`` for the object's n vertices nor ``(h, w, 3)``.
            SceneError: If the object is a solid, or has no texture coordinates for a texture.
        """
        item = self._scene.objects[index]
        if item.solid is not None:
            raise SceneError(f"colors must be those of meshes, got {item.name!r}, which is a solid")
        count = len(item.mesh.source)
        if shape != (count, 3) and (len(shape) != 3 or shape[2] != 3 or 0 in shape):
            raise ArrayError(f"colors[{item.name!r}] must have shape ({count}, 3) or (h, w, 3), got {shape}")
        if len(shape) == 3:
            _check_coordinates(item)

    def interpolate(
        self,
        index: int,
        given: wp.array,
        worlds: Worlds,
        images: ImagesByName,
        out: wp.array,
        *,
        vertices: wp.array | None = None,
    ) -> None:
        """Write the colors of the pixels that see an object.

        Args:
            index: The object.
            given: Colors of its vertices, ``(n,)`` vec3, or of texels, ``(h, w)`` vec3.
            worlds: Worlds of the render.
            images: Its images ``points``, ``segmentation`` and ``faces``.
            out: Colors, ``(V, *camera.shape)`` vec3; those of other pixels remain.
            vertices: Vertices of the object in the render [m], ``(n,)`` vec3; by default the scene's.
        """
        from warpvis.kernels.gradients.color_gradients import interpolate_colors

        colored = self._colored(index, vertices, is_texture=given.ndim == 2)
        seen, colors = _seen_points(images), as_image(out)
        table = given if given.ndim == 2 else given.reshape((1, len(given)))
        launch_images(
            interpolate_colors,
            colors.shape,
            lambda window: [worlds, colored, window, seen, table, colors],
            device=self._scene.device,
            threads=self._threads,
        )

    def gradients(
        self,
        index: int,
        shape: tuple[int, ...],
        worlds: Worlds,
        images: ImagesByName,
        of_colors: wp.array,
        *,
        vertices: wp.array | None = None,
    ) -> wp.array:
        """Return gradients with respect to the given colors of an object, of this `shape`, vec3d.

        Args:
            index: The object.
            shape: ``(n,)`` for its vertices, or ``(h, w)`` for a texture.
            worlds: As for `interpolate`.
            images: As for `interpolate`.
            of_colors: Gradients of a loss with respect to the colors of pixels, ``(V, *camera.shape)`` vec3.
            vertices: As for `interpolate`.
        """
        from warpvis.kernels.gradients.color_gradients import sum_color_gradients

        colored = self._colored(index, vertices, is_texture=len(shape) == 2)
        seen, gradients = _seen_points(images), as_image(of_colors)
        device = self._scene.device
        zeros = self._zeros
        result = wp.zeros(shape, dtype=wp.vec3d, device=device) if zeros is None else zeros(shape, wp.vec3d, device)
        table = result if len(shape) == 2 else result.reshape((1, *shape))
        launch_images(
            sum_color_gradients,
            gradients.shape,
            lambda window: [worlds, colored, window, seen, gradients, table],
            device=self._scene.device,
            threads=1,  # several would add to the same colors at once
        )
        return result

    def _colored(self, index: int, vertices: wp.array | None, *, is_texture: bool) -> ColoredObject:
        from warpvis.kernels.gradients.color_gradients import ColoredObject

        item, tables = self._scene.objects[index], self._tables(index, is_texture=is_texture)
        colored = ColoredObject()
        colored.index, colored.column = index, -1
        if item.movable:
            colored.column = self._scene.movable.index(index if item.parent is None else item.parent)
        colored.vertices = tables.vertices if vertices is None else vertices
        colored.faces = tables.faces
        colored.wrap_u, colored.wrap_v = tables.wraps
        if tables.uv is not None:
            colored.uv = tables.uv
        return colored

    def _tables(self, index: int, *, is_texture: bool) -> _Tables:
        """Return the tables of an object, which are made again when its mesh or appearance is replaced.

        They are not made while a CUDA graph is captured, if the same call ran before.
        """
        item, device = self._scene.objects[index], self._scene.device
        appearance = item.appearance if is_texture else None
        sources = (item.mesh, appearance)
        known = self._cached.get((index, is_texture))
        if known is None or any(old is not new for old, new in zip(known[0], sources, strict=True)):
            vertices = item.points
            if vertices is None:
                vertices = wp.array(item.frame_vertices, dtype=wp.vec3, device=device)
            uv, wraps = None, (0, 0)
            if appearance is not None:
                uv = wp.array(_coordinates(item, appearance), dtype=wp.vec2, device=device)
                wraps = _wrap_modes(appearance)
            faces = wp.array(item.faces, dtype=wp.int32, device=device)
            known = sources, _Tables(vertices, faces, uv, wraps)
            self._cached[index, is_texture] = known
        return known[1]


def _check_coordinates(item: SceneObject) -> None:
    """Raise a `SceneError` if an object has no texture coordinates."""
    appearance = item.appearance
    if appearance is None or appearance.uv is None:
        raise SceneError(
            f"colors[{item.name!r}] must be those of vertices, ({len(item.mesh.source)}, 3), since the object has no "
            "texture coordinates"
        )


def _coordinates(item: SceneObject, appearance: Appearance) -> NDArray[np.float32]:
    """Return texture coordinates of the corners of faces, with the repetitions of their materials, ``(m, 3, 2)``."""
    uv = appearance.corner_uv(item.faces)
    assert uv is not None  # as `_check_coordinates` found
    repeats = np.array([material.texture_repeat for material in appearance.materials], dtype=np.float32)
    numbers = appearance.face_materials
    return np.ascontiguousarray(uv * (repeats[0] if numbers is None else repeats[numbers][:, None]))


def _wrap_modes(appearance: Appearance) -> tuple[int, int]:
    """Return the numbers of the wrap modes of the first texture; by default it repeats."""
    textures = (material.texture for material in appearance.materials)
    texture = next((texture for texture in textures if texture is not None), None)
    modes: tuple[Wrap, Wrap] = ("repeat", "repeat") if texture is None else (texture.wrap_u, texture.wrap_v)
    return get_args(Wrap).index(modes[0]), get_args(Wrap).index(modes[1])


def _seen_points(images: ImagesByName) -> SeenPoints:
    from warpvis.kernels.gradients.color_gradients import SeenPoints

    missing = [name for name in COLOR_IMAGES[:3] if name not in images]
    if missing:
        raise ArrayError(f"images must have {', '.join(COLOR_IMAGES[:3])}, got none of {', '.join(missing)}")
    seen = SeenPoints()
    for name in COLOR_IMAGES[:3]:
        setattr(seen, name, as_image(images[name]))
    return seen
