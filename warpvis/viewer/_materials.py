# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearances of objects for the page: base colors and textures as binary glTF, which browsers show."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpvis.scene import Scene, SceneObject
from warpvis.scene.materials import Appearance, Material, Texture

if TYPE_CHECKING:
    from PIL.Image import Image

MAX_SIDE = 1024
"""Maximum width and height of a texture on the page [px]."""
MAX_TEXELS = 1 << 22
"""Maximum number of pixels of all textures of a page; a texture counts for each object that it is on."""

_JPEG = 85
_OPAQUE = 0.995  # as in rendered images


def has_colors(scene: Scene) -> bool:
    """Return whether an object of a scene has an appearance."""
    return any(item.lazy_appearance is not None and item.lazy_appearance.has_colors for item in scene.objects)


def _face_colors(look: Appearance, faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return colors of faces from 0 to 1, ``(m, 4)``: white without, and means of those of vertices."""
    found = np.ones((len(faces), 4), dtype=np.float32)
    given = look.vertex_colors if look.face_colors is None else look.face_colors
    if given is None:
        return found
    scaled = given.astype(np.float32) / (255 if given.dtype == np.uint8 else 1)
    rows = scaled[faces].mean(axis=1) if look.face_colors is None else scaled
    found[:, : rows.shape[1]] = rows
    return found


def base_color(look: Appearance) -> tuple[int, int, int]:
    """Return the sRGB color of an appearance's first material, with the mean of its texture."""
    red, green, blue = np.rint(255 * _encoded(_factor(look.materials[0], textured=False)[:3])).astype(int).tolist()
    return red, green, blue


class Shelf:
    """Converts the appearances of a page, with textures whose sizes fit into its limits."""

    def __init__(self, looks: Iterable[Appearance]) -> None:
        """Choose a scale for the textures of all objects of a page, one appearance for each."""
        sizes = [texture.image.shape[:2] for texture in _textures(looks)]
        texels = sum(math.prod(size) * min(MAX_SIDE / max(size), 1.0) ** 2 for size in sizes)
        self._scale = min(1.0, math.sqrt(MAX_TEXELS / texels)) if texels else 1.0
        self._images: dict[int, tuple[Texture, Image]] = {}

    def glb(self, items: Sequence[SceneObject]) -> bytes:
        """Return the meshes of objects, in their frames, with their appearances as binary glTF."""
        import trimesh

        scene = trimesh.Scene()
        for item in items:
            self._add(scene, item.frame_vertices, item.faces, item.appearance or Appearance())
        return scene.export(file_type="glb", include_normals=False)

    def glb_of(self, vertices: NDArray[np.float32], faces: NDArray[np.int32], look: Appearance | None) -> bytes:
        """Return one mesh with its appearance as binary glTF."""
        import trimesh

        scene = trimesh.Scene()
        self._add(scene, vertices, faces, look or Appearance())
        return scene.export(file_type="glb", include_normals=False)

    def _add(self, scene: Any, vertices: NDArray[np.float32], faces: NDArray[np.int32], look: Appearance) -> None:
        """Add a mesh to a `trimesh.Scene`, with one geometry for each material and color."""
        numbers = np.zeros(len(faces), dtype=np.int32) if look.face_materials is None else look.face_materials
        corners = look.corner_uv(faces)
        has_own = look.face_colors is not None or look.vertex_colors is not None
        colors = _face_colors(look, faces) if has_own else None
        for number in np.unique(numbers).tolist():
            chosen, material = numbers == number, look.materials[number]
            uv = None if corners is None or not _is_shown(material) else corners[chosen] * material.texture_repeat
            own = None if colors is None else colors[chosen]
            groups = [(slice(None), np.ones(4))] if own is None else _by_color(own)
            for rows, color in groups:
                part = faces[chosen][rows]
                mesh = _mesh(vertices, part, None if uv is None else uv[rows])
                mesh.visual.material = self._material(material, color, textured=uv is not None)
                scene.add_geometry(mesh)

    def _material(self, material: Material, color: NDArray[np.floating], *, textured: bool) -> Any:
        from trimesh.visual.material import PBRMaterial

        factor = _factor(material, textured=textured) * [*_linear(color[:3], material.color_space), color[3]]
        mode = "MASK" if material.alpha_mode == "mask" else "OPAQUE"
        if material.alpha_mode == "blend" and (textured or factor[3] < _OPAQUE):
            mode = "BLEND"
        options: dict[str, Any] = {"alphaCutoff": material.alpha_cutoff} if mode == "MASK" else {}
        if textured and material.texture is not None:
            options["baseColorTexture"] = self._image(material.texture, opaque=mode == "OPAQUE")
        emission = np.clip(_linear(np.array(material.emission), material.color_space), 0, 1)
        return PBRMaterial(
            name=material.name or None,
            baseColorFactor=np.clip(np.rint(255 * factor), 0, 255).astype(np.uint8),
            emissiveFactor=emission.tolist(),
            metallicFactor=0.0,  # metals need surroundings that they reflect
            roughnessFactor=material.roughness,
            alphaMode=mode,
            doubleSided=True,
            **options,
        )

    def _image(self, texture: Texture, *, opaque: bool) -> Image:
        """Return a scaled image in the format in which it is written: JPEG without opacity, else PNG."""
        from PIL import Image

        key = 2 * id(texture) + opaque
        if key not in self._images:
            pixels = texture.image if texture.color_space == "srgb" else _encoded_image(texture.image)
            image = Image.fromarray(pixels[..., :3] if opaque else pixels)
            side = min(MAX_SIDE / max(image.size), 1.0) * self._scale
            if side < 1:
                image = image.resize([max(1, round(side * length)) for length in image.size], Image.Resampling.BOX)
            data = io.BytesIO()
            if image.mode == "RGB":
                image.save(data, "JPEG", quality=_JPEG)
            else:
                image.save(data, "PNG")
            self._images[key] = texture, Image.open(data)
        return self._images[key][1]


def _textures(looks: Iterable[Appearance]) -> Iterable[Texture]:
    """Yield the textures that the page shows."""
    for look in looks:
        if look.uv is not None:
            yield from (
                material.texture for material in look.materials if material.texture is not None and _is_shown(material)
            )


def _is_shown(material: Material) -> bool:
    """Return whether a browser can show a material's texture, given coordinates; others become mean colors."""
    return material.texture is not None and material.projection != "plane"


def _by_color(colors: NDArray[np.float32]) -> list[tuple[NDArray[np.int64], NDArray[np.float32]]]:
    """Group faces by color, in at most 64 groups: beyond, colors are rounded to 4 levels."""
    found, which = np.unique(colors, axis=0, return_inverse=True)
    if len(found) > 64:
        found, which = np.unique(np.rint(3 * colors) / 3, axis=0, return_inverse=True)
    return [(np.flatnonzero(which.ravel() == k), color) for k, color in enumerate(found)]


def _mesh(vertices: NDArray[np.float32], faces: NDArray[np.int32], uv: NDArray[np.float32] | None) -> Any:
    """Return a mesh of some triangles, without unused vertices; vertices are split at seams of a texture."""
    import trimesh

    if uv is None:
        used, places = np.unique(faces, return_inverse=True)
        coordinates = None
    else:
        rows = np.column_stack([faces.reshape(-1).astype(np.float64), uv.reshape(-1, 2)])
        distinct, places = np.unique(rows, axis=0, return_inverse=True)
        used, coordinates = distinct[:, 0].astype(np.int64), distinct[:, 1:]
    visual = trimesh.visual.TextureVisuals(uv=coordinates)
    return trimesh.Trimesh(vertices[used], places.reshape(-1, 3), visual=visual, process=False)


def _factor(material: Material, *, textured: bool) -> NDArray[np.float64]:
    """Return a material's linear color and its opacity; if the page does not show its texture, with its mean."""
    color = np.array(material.base_color, dtype=np.float64)
    color[:3] = _linear(color[:3], material.color_space)
    if material.texture is not None and not textured:
        image = material.texture.image.reshape(-1, material.texture.image.shape[-1]) / 255
        color[:3] *= _linear(image[:, :3], material.texture.color_space).mean(axis=0)
        if material.alpha_mode != "opaque" and image.shape[1] == 4:
            color[3] *= image[:, 3].mean()
    return color


def _linear(color: NDArray[np.floating], space: str) -> NDArray[np.float64]:
    """Decode sRGB (IEC 61966-2-1)."""
    values = np.asarray(color, dtype=np.float64)
    if space == "linear":
        return values
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0) + 0.055) / 1.055) ** 2.4)


def _encoded(color: NDArray[np.floating]) -> NDArray[np.float64]:
    """Encode linear colors from 0 to 1 as sRGB."""
    values = np.clip(np.asarray(color, dtype=np.float64), 0, 1)
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)


def _encoded_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    table = np.rint(255 * _encoded(np.arange(256) / 255)).astype(np.uint8)
    return np.concatenate([table[image[..., :3]], image[..., 3:]], axis=-1)
