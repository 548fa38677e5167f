# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and the background of a scene; the output ``color`` is shaded with them.

Positions and directions are in the world's frame, right-handed, in meters. Three falloff models are supported, with
formulas in `Light.strength`: OpenGL's fixed functions, as in MuJoCo (OpenGL 2.1 specification, 2.14.1); Webots' shaders
(resources/wren/shaders/phong.frag and pbr.frag); and glTF's KHR_lights_punctual.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.core.checks import check_angle, check_choice, check_flag, check_number
from warpvis.core.user_warnings import warn_user
from warpvis.errors import SceneError
from warpvis.scene.materials import ColorSpace, Texture, check_color, check_vector

LightKind = Literal["ambient", "directional", "point", "spot", "headlight"]
"""Ambient light; light from one direction; from a point; from a point within a cone; or a headlight, which is a
directional light along the camera's viewing direction."""

Falloff = Literal["opengl", "webots", "gltf"]
"""Falloff model with distance and with the angle from a spot's axis."""

Vector = tuple[float, float, float]

_HALF_TURN = float(np.float32(np.pi))
"""Maximum angle [rad]: formats store pi in single precision, which is greater than pi."""

_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Light:
    """A light.

    With fixed functions and Webots' Appearance, the light reflected by a surface with normal n in the direction v of
    the camera is ``strength * intensity * (ambient * base_color + max(n.l, 0) * color * base_color + (n.l > 0) *
    max(n.h, 0) ** shininess * specular * material.specular)``, where l points to the light and h is halfway between l
    and v. Materials with `metallic` and `roughness` use `color` only (appendix B of glTF 2.0).
    """

    kind: LightKind = "directional"
    name: str = ""
    position: Vector = (0.0, 0.0, 0.0)
    """Position of a point light or a spot in the world [m]."""
    direction: Vector = (0.0, 0.0, -1.0)
    """Direction in which the light of directional lights and spots travels, in the world; it is normalized. A
    headlight uses the camera's z."""
    color: Vector = (1.0, 1.0, 1.0)
    """Color of diffuse light, in `color_space`; may exceed 1."""
    intensity: float = 1.0
    """Factor of all colors; in glTF [lx], for points and spots [cd]."""
    ambient: Vector = (0.0, 0.0, 0.0)
    """Color of light that reaches surfaces regardless of their orientation."""
    specular: Vector | None = None
    """Color of highlights; `color` by default."""
    color_space: ColorSpace = "srgb"
    """Color space of the colors, in which light is summed: linear for glTF and Webots, sRGB for formats whose numbers
    are display values (MuJoCo)."""
    falloff: Falloff = "opengl"
    attenuation: Vector = (1.0, 0.0, 0.0)
    """Coefficients a, b, c: light at the distance d [m] is divided by ``a + b d + c d**2``. glTF's are (0, 0, 1)."""
    reach: float = np.inf
    """Maximum distance that it lights [m]."""
    inner_angle: float = 0.0
    """Angle from a spot's axis up to which it has full brightness [rad]; unused with ``"opengl"``."""
    outer_angle: float = np.pi / 4
    """Angle from a spot's axis beyond which it is dark [rad]."""
    exponent: float = 0.0
    """Exponent of the cosine of the angle from a spot's axis, with ``"opengl"``."""
    cast_shadow: bool = True
    """Whether surfaces block its light; ambient light and headlights are never blocked."""

    def __post_init__(self) -> None:
        light = f"light {self.name!r}" if self.name else "a light"
        put = partial(object.__setattr__, self)
        check_choice(self.kind, f"kind of {light}", get_args(LightKind), SceneError)
        check_choice(self.color_space, f"color_space of {light}", get_args(ColorSpace), SceneError)
        check_choice(self.falloff, f"falloff of {light}", get_args(Falloff), SceneError)
        put("name", str(self.name))
        put("position", check_vector(self.position, f"position of {light}"))
        if max(map(abs, self.position)) > FARTHEST:
            raise SceneError(f"position of {light} must be at most {FARTHEST:g} m from the origin, got {self.position}")
        direction = np.array(check_vector(self.direction, f"direction of {light}"))
        if not direction.any():
            raise SceneError(f"direction of {light} must not be 0")
        direction /= np.abs(direction).max()  # its square may be too large, or 0
        put("direction", tuple((direction / np.linalg.norm(direction)).tolist()))
        for name in ("color", "ambient", "attenuation"):
            put(name, check_color(getattr(self, name), f"{name} of {light}", (3,), maximum=np.inf))
        if self.specular is not None:
            put("specular", check_color(self.specular, f"specular of {light}", (3,), maximum=np.inf))
        if not any(self.attenuation):
            raise SceneError(f"attenuation of {light} must not be 0")
        for name in ("intensity", "exponent"):
            put(name, check_number(getattr(self, name), f"{name} of {light}", minimum=0.0, error=SceneError))
        for name in ("inner_angle", "outer_angle"):
            value = check_angle(
                getattr(self, name), f"{name} of {light}", minimum=0.0, maximum=_HALF_TURN, error=SceneError
            )
            put(name, min(value, np.pi))
        if np.float32(self.inner_angle) > np.float32(self.outer_angle):
            raise SceneError(
                f"inner_angle of {light} must be at most its outer_angle {self.outer_angle:g}, got {self.inner_angle:g}"
            )
        put("inner_angle", min(self.inner_angle, self.outer_angle))
        if self.reach != np.inf:
            put("reach", check_number(self.reach, f"reach of {light}", minimum=0.0, error=SceneError))
        put("cast_shadow", check_flag(self.cast_shadow, f"cast_shadow of {light}", SceneError))

    def strength(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the fraction of its light that reaches points, without `intensity`, normals and shadows.

        It is 1 for ambient, directional and headlights. For other lights, at the distance d and the angle t from a
        spot's axis, with inner and outer angles i and o:

        - It is divided by ``a + b d + c d**2``, and zero beyond `reach`.
        - ``"opengl"``: times ``cos(t) ** exponent``, zero where ``t > o``; a spot with ``o = pi`` is a point light.
        - ``"webots"``: times ``(o - t) / (o - i)`` between i and o, zero beyond o.
        - ``"gltf"``: times ``clip((cos t - cos o) / max(cos i - cos o, 0.001), 0, 1) ** 2``; and toward `reach` times
          ``clip(1 - (d / reach) ** 4, 0, 1)``.

        Args:
            points: Positions in the world [m], shape ``(..., 3)``.

        Returns:
            Shape ``(...,)``; infinite where the divisor is zero.
        """
        points = np.clip(np.asarray(points, dtype=np.float64), -1e100, 1e100)
        if self.kind not in ("point", "spot"):
            return np.ones(points.shape[:-1])
        directions = points - np.array(self.position)
        distance = np.linalg.norm(directions, axis=-1)
        a, b, c = self.attenuation
        with np.errstate(divide="ignore", over="ignore"):
            share = np.where(distance <= self.reach, 1 / (a + b * distance + c * distance**2), 0.0)
        if self.falloff == "gltf" and self.reach < np.inf:
            share = share * np.clip(1 - (distance / max(self.reach, 1e-300)) ** 4, 0, 1)
        if self.kind == "point":
            return share
        along = (directions @ np.array(self.direction)) / np.where(distance > 0, distance, 1.0)
        return share * self._cone_falloff(np.where(distance > 0, np.clip(along, -1, 1), 1.0))

    def _cone_falloff(self, cosine: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fraction of light at angles from a spot's axis, given by their cosines."""
        inner, outer = self.inner_angle, self.outer_angle
        if self.falloff == "gltf":
            limit = np.cos(outer)
            return np.clip((cosine - limit) / max(np.cos(inner) - limit, 1e-3), 0, 1) ** 2
        angle = np.arccos(cosine)
        if self.falloff == "webots":
            return np.where(angle <= inner, 1.0, np.clip((outer - angle) / max(outer - inner, 1e-300), 0, 1))
        if outer >= np.pi:
            return np.ones_like(cosine)
        return np.where(angle <= outer, np.maximum(cosine, 0.0) ** self.exponent, 0.0)

    def moved(self, rotation: NDArray[np.float64], scale: float = 1.0) -> Light:
        """Return the light in a rotated frame and another unit: ``p' = scale rotation p``."""
        return replace(
            self,
            position=tuple((scale * (rotation @ np.array(self.position))).tolist()),
            direction=tuple((rotation @ np.array(self.direction)).tolist()),
            reach=scale * self.reach,
        )


@dataclass(frozen=True, eq=False)
class Background:
    """What rays that hit no object see: a color, or a sky at infinity."""

    color: Vector = (0.0, 0.0, 0.0)
    """Color where there is no sky, in `color_space`."""
    color_space: ColorSpace = "srgb"
    sky: tuple[Texture, ...] = field(default=(), repr=False)
    """Six square images of a cube map, +x, -x, +y, -y, +z, -z of the cube's frame as in OpenGL; empty for no sky."""
    world_to_cube: tuple[Vector, Vector, Vector] = _IDENTITY
    """Rows of the matrix that rotates a direction from the world to the cube's frame."""
    luminosity: float = 1.0
    """Factor of the light that it casts on surfaces (Webots' Background)."""

    def __post_init__(self) -> None:
        put = partial(object.__setattr__, self)
        put("color", check_color(self.color, "color of a background", (3,), maximum=np.inf))
        check_choice(self.color_space, "color_space of a background", get_args(ColorSpace), SceneError)
        put("luminosity", check_number(self.luminosity, "luminosity of a background", minimum=0.0, error=SceneError))
        sky = tuple(self.sky) if isinstance(self.sky, list | tuple) else (self.sky,)
        if len(sky) not in (0, 6) or not all(isinstance(face, Texture) for face in sky):
            raise SceneError(f"sky of a background must be six Textures or none, got {len(sky)} items")
        put("sky", sky)
        rows = self.world_to_cube
        if not isinstance(rows, list | tuple | np.ndarray) or len(rows) != 3:
            raise SceneError("world_to_cube of a background must have three rows")
        put("world_to_cube", tuple(check_vector(row, "each row of world_to_cube of a background") for row in rows))

    @property
    def image(self) -> NDArray[np.uint8] | None:
        """The sky's six images, one below the other, shape ``(6 n, n, 3)`` or ``(6 n, n, 4)``; None without a sky.

        None, with a warning, if the images are not squares of equal size.
        """
        if not self.sky:
            return None
        faces = [face.image for face in self.sky]
        if len({face.shape[:2] for face in faces}) > 1 or faces[0].shape[0] != faces[0].shape[1]:
            warn_user(
                f"the sky is ignored: images such as {self.sky[0].name} are not squares of equal size", UserWarning
            )
            return None
        if len({face.shape[2] for face in faces}) > 1:
            faces = [face[..., :3] for face in faces]
        return np.concatenate(faces)

    def rotated(self, rotation: NDArray[np.float64]) -> Background:
        """Return the background in a rotated world: ``p' = rotation p``."""
        first, second, third = (tuple(row) for row in (np.array(self.world_to_cube) @ rotation.T).tolist())
        return replace(self, world_to_cube=(first, second, third))


def cube_coordinates(directions: ArrayLike) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return the coordinates of directions in the images of a cube map (OpenGL 2.1 specification, 3.8.6).

    Args:
        directions: Directions in the cube's frame, of any length, shape ``(..., 3)``.

    Returns:
        The image, 0 to 5, shape ``(...,)``; and the position in it, shape ``(..., 2)``: from its left to its right
        edge, and from its upper to its lower one, 0 to 1.
    """
    directions = np.asarray(directions, dtype=np.float64)
    axis = np.abs(directions).argmax(axis=-1)
    longest = np.take_along_axis(directions, axis[..., None], axis=-1)[..., 0]
    image = 2 * axis + (longest < 0)
    x, y, z = np.moveaxis(directions, -1, 0)
    right = np.choose(image, [-z, z, x, x, x, -x])
    down = np.choose(image, [-y, -y, z, -z, -y, -y])
    size = np.where(longest == 0, 1.0, np.abs(longest))
    return image.astype(np.int32), (np.stack([right, down], axis=-1) / size[..., None] + 1) / 2
