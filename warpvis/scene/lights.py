# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and the background of a scene; the output ``color`` is shaded with them.

Positions and directions are in the world's frame, right-handed, in meters. Three falloff models are supported, with
formulas in `Light.strength`: OpenGL's fixed functions, as in MuJoCo (OpenGL 2.1 specification, 2.14.1); Webots' shaders
(resources/wren/shaders/phong.frag and pbr.frag); and glTF's KHR_lights_punctual.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.core.checks import as_path, check_angle, check_choice, check_flag, check_number, check_whole
from warpvis.core.file_content import reading
from warpvis.core.user_warnings import warn_user
from warpvis.errors import FileFormatError, SceneError
from warpvis.scene.materials import ColorSpace, Texture, as_numbers, check_color, check_vector, shown

LightKind = Literal["ambient", "directional", "point", "spot", "headlight"]
"""Ambient light; light from one direction; from a point; from a point within a cone; or a headlight, which is a
directional light along the camera's viewing direction."""

Falloff = Literal["opengl", "webots", "gltf"]
"""Falloff model with distance and with the angle from a spot's axis."""

Vector = tuple[float, float, float]

_HALF_TURN = float(np.float32(np.pi))
"""Maximum angle [rad]: formats store pi in single precision, which is greater than pi."""

_MAX_COLORS = 4096

MAX_SAMPLES = 1024
"""Maximum number of points of a light, or of directions of ambient light, for a pixel."""

_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Light:
    """A light.

    With the shading "phong", the light reflected by a surface with normal n in the direction v of the camera is
    ``strength * intensity * (ambient * base_color + max(n.l, 0) * color * base_color + (n.l > 0) *
    max(n.h, 0) ** shininess * specular * material.specular)``, where l points to the light and h is halfway between l
    and v. With other shadings, surfaces reflect `color`, and `ambient` as light from all directions, by appendix B of
    glTF 2.0 or its variant in Webots.
    """

    kind: LightKind = "directional"
    name: str = ""
    position: Vector = (0.0, 0.0, 0.0)
    """Position of a point light or a spot in the world [m]; of a directional light, see `shadow_plane`."""
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
    """Whether surfaces block its light; ambient lights and headlights are never blocked. In linear color space, its
    `ambient` part is not blocked, either."""
    radius: float = 0.0
    """Radius of a point light or spot, which is a sphere [m], or the angular radius of a directional light [rad]:
    its shadows have soft edges if it is not 0. Shading is that of its center."""
    shadow_samples: int = 16
    """Number of points of a light with a radius to which each pixel casts rays, from 1 to 1024."""
    shadow_plane: bool = False
    """Whether a directional light comes from the plane through its `position`, as in MuJoCo: only surfaces beyond that
    plane, in the light's direction, block it. By default it comes from infinity."""

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
        put("direction", _unit_vector(self.direction, f"direction of {light}"))
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
        put("radius", check_number(self.radius, f"radius of {light}", minimum=0.0, error=SceneError))
        if not self.radius <= FARTHEST:
            raise SceneError(f"radius of {light} must be at most {FARTHEST:g} m, got {self.radius:g}")
        if self.kind == "directional" and not self.radius < np.pi / 2:
            raise SceneError(f"radius of {light} must be less than pi / 2, in radians, got {self.radius:g}")
        put("shadow_samples", check_samples(self.shadow_samples, f"shadow_samples of {light}"))
        if self.reach != np.inf:
            put("reach", check_number(self.reach, f"reach of {light}", minimum=0.0, error=SceneError))
        for name in ("cast_shadow", "shadow_plane"):
            put(name, check_flag(getattr(self, name), f"{name} of {light}", SceneError))

    @property
    def casts_shadow(self) -> bool:
        """Whether surfaces can block it: `cast_shadow`, and not ambient light or a headlight."""
        return self.cast_shadow and self.kind not in ("ambient", "headlight")

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
            radius=self.radius if self.kind == "directional" else scale * self.radius,
        )


@dataclass(frozen=True)
class AmbientOcclusion:
    """Ambient light that surfaces block: what `Renderer(ambient_occlusion=...)` multiplies ambient light by.

    Each point of a surface receives the fraction of ambient light that arrives from directions in which no other
    surface is nearer than `distance`, weighted by the cosine of the angle to its normal.
    """

    distance: float = 1.0
    """Distance up to which surfaces block ambient light [m]."""
    samples: int = 32
    """Number of directions over the whole sphere, about half of which are above a surface, from 1 to 1024."""

    def __post_init__(self) -> None:
        distance = check_number(self.distance, "distance of ambient occlusion", minimum=0.0, error=SceneError)
        if not 0 < distance <= FARTHEST:
            raise SceneError(
                f"distance of ambient occlusion must be greater than 0 and at most {FARTHEST:g} m, got {distance:g}"
            )
        object.__setattr__(self, "distance", distance)
        object.__setattr__(self, "samples", check_samples(self.samples, "samples of ambient occlusion"))


def check_samples(count: int, subject: str) -> int:
    """Return a number of points or directions, or raise a `SceneError`."""
    count = check_whole(count, subject, error=SceneError)
    if count > MAX_SAMPLES:
        raise SceneError(f"{subject} must be at most {MAX_SAMPLES}, got {count}")
    return count


@dataclass(frozen=True, eq=False)
class Haze:
    """Haze between a ground plane and the sky, as drawn by MuJoCo's renderer (`haze` in render_context.c).

    The sky stands at the distance `radius` around the camera and hides surfaces beyond it. Haze is a cone in front of
    it, from the ground at the distance ``(1 - width) * radius`` up to the horizon. It is densest, and opaque, at `peak`
    of its height, and transparent at both ends. A camera below the ground sees none.
    """

    color: Vector = (1.0, 1.0, 1.0)
    """Color in `color_space`."""
    color_space: ColorSpace = "srgb"
    radius: float = 100.0
    """Horizontal distance of the sky from the camera [m]."""
    width: float = 0.3
    """Width of the strip of ground under haze, as a fraction of `radius`."""
    position: Vector = (0.0, 0.0, 0.0)
    """A point of the ground [m]."""
    normal: Vector = (0.0, 0.0, 1.0)
    """Direction away from the ground; it is normalized."""

    def __post_init__(self) -> None:
        put = partial(object.__setattr__, self)
        put("color", check_color(self.color, "color of haze", (3,)))
        check_choice(self.color_space, "color_space of haze", get_args(ColorSpace), SceneError)
        put("radius", check_number(self.radius, "radius of haze", minimum=0.0, error=SceneError))
        put("width", check_number(self.width, "width of haze", minimum=0.0, error=SceneError))
        if not 0 < self.radius <= FARTHEST:
            raise SceneError(f"radius of haze must be greater than 0 and at most {FARTHEST:g} m, got {self.radius:g}")
        if self.width > 1:
            raise SceneError(f"width of haze must be from 0 to 1, got {self.width:g}")
        put("position", check_vector(self.position, "position of haze"))
        if max(map(abs, self.position)) > FARTHEST:
            raise SceneError(f"position of haze must be at most {FARTHEST:g} m from the origin, got {self.position}")
        put("normal", _unit_vector(self.normal, "normal of haze"))

    @property
    def peak(self) -> float:
        """Height of the densest haze, as a fraction of the height from the ground to the horizon."""
        angle = math.atan2(1.0, self.width)
        return math.sqrt(0.5) * self.width * math.sin(angle) / math.sin(0.75 * math.pi - angle)

    def moved(self, rotation: NDArray[np.float64], scale: float = 1.0) -> Haze:
        """Return the haze in a rotated frame and another unit: ``p' = scale rotation p``."""
        position, normal = scale * (rotation @ np.array(self.position)), rotation @ np.array(self.normal)
        return replace(self, position=tuple(position), normal=tuple(normal), radius=scale * self.radius)


@dataclass(frozen=True, eq=False)
class Background:
    """What rays that hit no object see: a color, or a sky at infinity.

    A sky is one of six images (`sky`), an image of all directions (`panorama`) or a `gradient`.
    """

    color: Vector = (0.0, 0.0, 0.0)
    """Color where there is no sky, in `color_space`."""
    color_space: ColorSpace = "srgb"
    """Color space of `color` and `gradient`."""
    sky: tuple[Texture, ...] = field(default=(), repr=False)
    """Six square images of a cube map, +x, -x, +y, -y, +z, -z of the sky's frame as in OpenGL."""
    world_to_cube: tuple[Vector, Vector, Vector] = _IDENTITY
    """Rows of the matrix that rotates a direction from the world to the sky's frame. Panoramas and gradients have z up
    in this frame, and cube maps y."""
    luminosity: float = 1.0
    """Factor of the light that it casts on surfaces (Webots' Background)."""
    panorama: Texture | NDArray[np.float32] | None = field(default=None, repr=False)
    """An equirectangular image: the upper row is up, the lower row down, the center of the image is the direction x of
    the sky's frame, and y is to its left. A `Texture`, or an array of linear light from 0 up, such as `read_light`
    returns, shape ``(H, W, 3)``."""
    exposure: float = 1.0
    """Factor of the light of a panorama of floats. The result is filtered, clipped to 0 to 1 and converted to sRGB."""
    gradient: tuple[Vector, ...] = ()
    """At least two colors from straight up to straight down, at equal steps of the angle, interpolated linearly."""
    haze: Haze | None = None
    """Haze between the ground and the sky; drawn only if there is a sky."""

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
        put("panorama", _check_panorama(self.panorama))
        put("exposure", check_number(self.exposure, "exposure of a background", minimum=0.0, error=SceneError))
        put("gradient", _check_gradient(self.gradient))
        if self.haze is not None and not isinstance(self.haze, Haze):
            raise SceneError(f"haze of a background must be a Haze or None, got {type(self.haze).__name__}")
        if bool(self.sky) + (self.panorama is not None) + bool(self.gradient) > 1:
            raise SceneError("a background must have at most one of sky, panorama and gradient")

    @property
    def has_sky(self) -> bool:
        """Whether it has a sky: images, a panorama or a gradient."""
        return bool(self.sky) or self.panorama is not None or bool(self.gradient)

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

    def rotated(self, rotation: NDArray[np.float64], scale: float = 1.0) -> Background:
        """Return the background in a rotated world, with another unit for haze: ``p' = scale rotation p``."""
        first, second, third = (tuple(row) for row in (np.array(self.world_to_cube) @ rotation.T).tolist())
        haze = None if self.haze is None else self.haze.moved(rotation, scale)
        return replace(self, world_to_cube=(first, second, third), haze=haze)


def _unit_vector(vector: ArrayLike, subject: str) -> Vector:
    """Check a direction and return it with length 1."""
    direction = np.array(check_vector(vector, subject))
    if not direction.any():
        raise SceneError(f"{subject} must not be 0")
    direction /= np.abs(direction).max()  # its square may be too large, or 0
    return tuple((direction / np.linalg.norm(direction)).tolist())


def _check_panorama(panorama: Any) -> Texture | NDArray[np.float32] | None:
    if panorama is None or isinstance(panorama, Texture):
        return panorama
    message = (
        "panorama of a background must be a Texture or finite floats from 0 up of shape (H, W, 3), got "
        f"{getattr(panorama, 'dtype', None) or type(panorama).__name__} {getattr(panorama, 'shape', '')}"
    ).rstrip()
    light = as_numbers(panorama, message)
    if light.dtype.kind != "f" or light.ndim != 3 or light.shape[2] != 3 or not light.size:
        raise SceneError(message)
    with np.errstate(over="ignore"):
        light = light.astype(np.float32)  # a copy
    if not (np.isfinite(light).all() and (light >= 0).all()):
        wrong = int((~(np.isfinite(light) & (light >= 0))).sum())
        raise SceneError(f"panorama of a background must be finite and from 0 up, and {wrong} numbers are not")
    return light


def _check_gradient(colors: Any) -> tuple[Vector, ...]:
    if not isinstance(colors, list | tuple | np.ndarray):
        raise SceneError(f"gradient of a background must be at least two colors or none, got {shown(colors)}")
    if len(colors) == 1 or len(colors) > _MAX_COLORS:
        raise SceneError(
            f"gradient of a background must be at least two and at most {_MAX_COLORS} colors, got {len(colors)}"
        )
    return tuple(
        check_color(color, "each color of the gradient of a background", (3,), maximum=np.inf) for color in colors
    )


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


def read_light(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """Read linear light from an image file of floats, such as Radiance's ``.hdr``, by OpenCV.

    Needs ``pip install 'warpvis[hdr]'``.

    Returns:
        The light of each pixel, red, green and blue from 0 up, first row at the top, shape ``(H, W, 3)``, for
        `Background.panorama`.

    Raises:
        FileFormatError: If the file cannot be read, does not have floats, or OpenCV is missing.
    """
    path = as_path(path)
    try:
        import cv2
    except ImportError:
        raise FileFormatError(f"{path}: light needs OpenCV, which is missing: pip install 'warpvis[hdr]'") from None
    with reading(path, "an image of light"):
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
        image = cv2.imdecode(content, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR) if content.size else None
    if image is None or image.dtype != np.float32:
        kind = "no known format" if image is None else image.dtype
        raise FileFormatError(f"{path}: must be an image of floats, such as Radiance's .hdr, got {kind}")
    return np.maximum(image[..., ::-1], np.float32(0))


HEADLIGHT = Light("headlight", "headlight", color=(0.8, 0.8, 0.8), ambient=(0.2, 0.2, 0.2), color_space="linear")
"""The light of mesh files without lights: surfaces that face the camera have their base color."""
