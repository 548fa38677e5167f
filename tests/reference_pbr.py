# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of materials with metallic and roughness: appendix B of the glTF 2.0 specification."""

import numpy as np
from reference_shading import converted, exact_base_color, lit_color, sample, weights

from warpvis.core.poses import poses_to_matrices

MAPS = ("metallic_roughness_texture", "normal_texture", "occlusion_texture", "emissive_texture")
LEAST_ROUGHNESS = 0.045


def unit(vector):
    return vector / np.linalg.norm(vector)


def brdf(base, metallic, roughness, normal, to_eye, to_light):
    """Return reflected over incoming light [1/sr] (B.3)."""
    alpha = max(roughness, LEAST_ROUGHNESS) ** 2
    half = unit(to_eye + to_light)
    along, of_eye, of_light = half @ normal, abs(normal @ to_eye), abs(normal @ to_light)
    if along <= 0:
        distribution = 0.0
    else:
        distribution = alpha**2 / (np.pi * (along**2 * (alpha**2 - 1) + 1) ** 2)
    masking = [2 * a / (a + np.sqrt(alpha**2 + (1 - alpha**2) * a**2)) for a in (of_eye, of_light)]
    specular = distribution * np.prod(masking) / (4 * of_eye * of_light)
    facing = 0.04 + (base - 0.04) * metallic
    fresnel = facing + (1 - facing) * (1 - abs(half @ to_eye)) ** 5
    return (1 - fresnel) * base * (1 - metallic) / np.pi + fresnel * specular


def webots_brdf(base, metallic, roughness, normal, to_eye, to_light, intensity):
    """Return reflected over incoming light in Webots' pbr.frag, with the intensity of the light in the diffuse part."""
    alpha = max(roughness, LEAST_ROUGHNESS) ** 2
    half = unit(to_eye + to_light)
    along, of_eye, of_light = max(half @ normal, 0), abs(normal @ to_eye), max(normal @ to_light, 0)
    facing = 0.04 * (1 - metallic) + base * metallic
    fresnel = facing + (min(25 * max(facing), 1) - facing) * (1 - half @ to_eye) ** 5
    masking = [2 * a / (a + np.sqrt(alpha**2 + (1 - alpha**2) * a**2)) for a in (of_eye, of_light)]
    spread = alpha**2 / (np.pi * ((along * alpha**2 - along) * along + 1) ** 2)
    diffuse = (1 - fresnel) * base * 0.96 * (1 - metallic) / np.pi * intensity
    return diffuse + fresnel * np.prod(masking) * spread / (4 * of_light * of_eye)


def uniform_reflection(base, metallic, roughness, cosine, is_webots=False, count=300):
    """Return the part of uniform light that is reflected, where the cosine of the viewing angle is given.

    Specular light is summed over half vectors of the same probability by their distribution; what it leaves is diffuse.
    """
    alpha = max(roughness, LEAST_ROUGHNESS) ** 2
    cosine = max(cosine, 1e-3)
    share, turn = np.meshgrid((np.arange(count) + 0.5) / count, (np.arange(count) + 0.5) / count * np.pi)
    to_eye = np.array([np.sqrt(1 - cosine**2), 0, cosine])

    def directions(z):
        return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=-1)

    def masking(a):
        return 2 * a / (a + np.sqrt(alpha**2 + (1 - alpha**2) * a**2))

    half = directions(np.sqrt((1 - share) / (1 + (alpha**2 - 1) * share)))
    facing = half @ to_eye
    light = 2 * facing[..., None] * half - to_eye
    is_above = (light[..., 2] > 0) & (facing > 0)
    sizes = np.where(is_above, masking(np.abs(light[..., 2])) * masking(cosine) * facing / (half[..., 2] * cosine), 0)
    normal = 0.04 + (base - 0.04) * metallic
    fresnel = (1 - np.abs(facing)) ** 5
    specular = normal * (sizes * (1 - fresnel)).mean() + (sizes * fresnel).mean()
    return base * (1 - metallic) * (0.96 if is_webots else 1 - specular) + specular


class MappedSurface:
    """A point of a mesh: the values of the maps of its material there."""

    def __init__(self, item, face, eye, ray, steps, corners, tangents=None):
        """Sample the maps where a ray hits a triangle, whose corners are in the world.

        `tangents` are those of its corners, instead of the triangle's own.
        """
        self.tangents = tangents
        look = item.appearance
        number = 0 if look.face_materials is None else look.face_materials[face]
        self.material = look.materials[number]
        self.corners, faces = corners - eye, item.faces
        self.plane = unit(np.cross(self.corners[1] - self.corners[0], self.corners[2] - self.corners[0]))
        depth = self.plane @ self.corners[0] / (self.plane @ ray)
        self.share = weights(self.corners, ray * depth)
        moves = [(step - ray * (self.plane @ step) / (self.plane @ ray)) * depth for step in steps]
        self.changes = [weights(self.corners, ray * depth + move) - self.share for move in moves]
        self.uv = {name: look.corner_uv(faces, name) for name in MAPS}
        self.uv = {name: None if uv is None else uv[face].astype(float) for name, uv in self.uv.items()}
        self.repeat = np.array(self.material.texture_repeat)

    def texel(self, name, space="linear"):
        """Return the value of a map, or None without it."""
        texture, uv = getattr(self.material, name), self.uv[name]
        if texture is None or uv is None:
            return None
        uv = uv * self.repeat
        return sample(texture, self.share @ uv, *(change @ uv for change in self.changes), space)[:3]

    def tilted(self, normal):
        """Return the normal of the map, of a normal that faces the camera; T, B and N as in 3.7.2.1."""
        value = self.texel("normal_texture")
        if value is None:
            return normal
        side = np.sign(self.plane @ -(self.corners[0]))
        uv, edges = self.uv["normal_texture"], self.corners[1:] - self.corners[0]
        along_u, along_v = np.linalg.solve((uv[1:] - uv[0]), edges)
        normal = normal * side
        tangent = along_u if self.tangents is None else self.share @ self.tangents
        tangent = unit(tangent - normal * (normal @ tangent))
        bitangent = np.cross(normal, tangent)
        bitangent *= np.sign(np.cross(along_u, along_v) @ self.plane)
        scale = self.material.normal_scale
        value = (2 * value - 1) * [scale, scale, 1]
        return side * unit(value @ [tangent, bitangent, normal])


def pbr_color(lights, surface, base, point, normal, eye, forward, unblocked=None):
    """Return the color of a surface point under all lights, sRGB from 0 to 1; see `reference_shading.lit_color`."""
    material = surface.material
    fractions = iter(() if unblocked is None else unblocked)
    space = "linear" if any(light.color_space == "linear" for light in lights) else "srgb"

    def of(color, stored):
        return converted(np.array([*color[:3], 1.0]), stored, space)[:3]

    texel = surface.texel("emissive_texture", material.color_space)
    glow = np.array(material.emission) * (1.0 if texel is None else texel)
    total = of(glow, material.color_space)
    packed, openness = surface.texel("metallic_roughness_texture"), surface.texel("occlusion_texture")
    metallic, roughness = material.metallic, material.roughness
    if packed is not None:
        metallic, roughness = metallic * packed[2], roughness * packed[1]
    open_part = 1.0 if openness is None else 1 + material.occlusion_strength * (openness[0] - 1)
    normal = surface.tilted(normal)
    to_eye, ambient, is_webots = unit(eye - point), np.zeros(3), material.shading == "webots"
    for light in lights:
        color = of(light.color, light.color_space)
        share = light.intensity * light.strength(point)
        ambient = ambient + share * of(light.ambient, light.color_space)
        if light.kind == "ambient":
            continue
        fraction = next(fractions, 1.0) if light.casts_shadow else 1.0
        if light.kind in ("point", "spot"):
            way = unit(np.array(light.position) - point)
        else:
            way = unit(-np.array(forward if light.kind == "headlight" else light.direction))
        facing = way @ normal
        if facing > 0:
            where = base, metallic, roughness, normal, to_eye, way
            if is_webots:
                total = total + share * fraction * facing * color * webots_brdf(*where, light.intensity)
                continue
            scale = share * fraction * facing * (1.0 if light.falloff == "gltf" else np.pi)
            total = total + scale * color * brdf(*where)
    if ambient.any():
        cosine = min(abs(normal @ to_eye), 1.0)
        part = uniform_reflection(base, metallic, roughness, cosine, is_webots)
        total = total + open_part * material.ambient_strength * ambient * part
    if material.tone_mapped and space == "linear":
        return tone_mapped(total)
    return np.clip(converted(np.array([*total, 1.0]), space, "srgb")[:3], 0, 1)


def tone_mapped(light):
    return (1 - np.exp(-light)) ** (1 / 2.2)


def shade_pbr_colors(scene, camera, poses, views, shadows=None, tangents=None):
    """Return the expected colors of pixels of static objects with appearances, (V, H, W, 3).

    `shadows` are images of the lights with shadows, 255 where they shine, (light, V, H, W); `tangents` those of the
    vertices of every object, (n, 3).
    """
    space = "linear" if any(light.color_space == "linear" for light in scene.lights) else "srgb"
    seg, faces, points = (getattr(views, key).numpy() for key in ("segmentation", "faces", "points"))
    expected = np.zeros((*seg.shape, 3))
    offsets = np.diag([1 / camera.fx, 1 / camera.fy, 1])[:2]
    for view, pose in enumerate(poses_to_matrices(np.atleast_2d(poses)).astype(np.float64)):
        axes, eye = pose[:3, :3], pose[:3, 3]
        for y, x in np.argwhere(seg[view] >= 0):
            item, face = scene.objects[seg[view, y, x]], faces[view, y, x]
            corners = item.vertices[item.faces[face]].astype(np.float64)
            ray = axes @ [(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1.0]
            where = ray, offsets @ axes.T
            of_corners = None if tangents is None else tangents[item.faces[face]]
            surface = MappedSurface(item, face, eye, *where, corners, of_corners)
            look = item.appearance
            normal = surface.plane
            if look.normals is not None:
                normal = unit(surface.share @ look.corner_normals(item.faces)[face])
            normal = normal * np.sign(surface.plane @ -ray)
            unblocked = None if shadows is None else shadows[:, view, y, x] / 255
            at = points[view, y, x].astype(np.float64), normal, eye, axes[:, 2], unblocked
            if surface.material.shading == "unlit":
                shown = exact_base_color(look, item.faces, face, corners - eye, *where)
            elif surface.material.shading == "phong":
                shown = lit_color(scene.lights, surface.material, *at)
            else:
                base = exact_base_color(look, item.faces, face, corners - eye, *where, space)
                shown = pbr_color(scene.lights, surface, base, *at)
            expected[view, y, x] = shown * 255
    return expected


shade_pbr_rows = shade_pbr_colors  # on CPU cores
