# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of shadows: every triangle and solid is tested for every pixel and light."""

from dataclasses import replace

import numpy as np

from warpvis.core.poses import poses_to_matrices
from warpvis.scene.light_samples import direction_samples, sphere_samples
from warpvis.scene.solids import SolidKind


def is_lit(light, point, normal):
    """Return whether a point is within a light's reach and cone, and its surface faces the light."""
    way = -np.array(light.direction) if light.kind == "directional" else np.array(light.position) - point
    return normal @ way > 0 and light.strength(point) > 0


def crosses_triangles(corners, start, way, limit):
    """Return whether a ray crosses one of the triangles, (m, 3, 3), with a parameter from 0 to `limit`."""
    a, b, c = np.moveaxis(corners - start, 1, 0)
    sides = np.stack([np.cross(a, b) @ way, np.cross(b, c) @ way, np.cross(c, a) @ way])
    normal = np.cross(b - a, c - a)
    steepness = normal @ way
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (normal * a).sum(axis=1) / steepness
    inside = (sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)
    return bool((inside & (steepness != 0) & (t > 0) & (t < limit)).any())


def crosses_solid(solid, radii, half, start, way, limit):
    """Return whether a ray of the solid's frame crosses its surface, by the roots of its quadrics."""
    o, d = start / radii, way / radii
    hits = []

    def roots(axes, height, kept):
        p = (o - [0, 0, height])[:axes]
        a, b, c = d[:axes] @ d[:axes], p @ d[:axes], p @ p - 1
        if a > 0 and b * b - a * c >= 0:
            for t in (np.array([-1, 1]) * np.sqrt(b * b - a * c) - b) / a:
                if kept(o[2] + t * d[2]):
                    hits.append(t)

    if solid.kind == SolidKind.BALL:
        roots(3, 0.0, lambda z: True)
    else:
        roots(2, 0.0, lambda z: abs(z) <= half)
    if solid.kind == SolidKind.CAPSULE:
        roots(3, half, lambda z: z >= half)
        roots(3, -half, lambda z: z <= -half)
    if solid.kind == SolidKind.CYLINDER and d[2] != 0:
        hits += [t for t in (np.array([half, -half]) - o[2]) / d[2] if ((o + t * d)[:2] ** 2).sum() <= 1]
    return any(0 < t < limit for t in hits)


class ShadowReference:
    """The surfaces of a scene in one world, in double precision.

    Args:
        scene: The scene; its analytic solids must be movable.
        poses: Poses of the movable objects, (M, 7); those they were added with by default.
        scales: Scale factors of the movable objects, (M, 3), which are meshes then.
        excluded: Indices of objects that block nothing.
    """

    def __init__(self, scene, *, poses=None, scales=None, excluded=()):
        triangles, self.solids = [np.zeros((0, 3, 3))], []
        for index, item in enumerate(scene.objects):
            if index in excluded:
                continue
            vertices = np.asarray(item.vertices, dtype=np.float64)
            if item.movable:
                row = list(scene.movable).index(index)
                place = poses_to_matrices(item.pose if poses is None else poses[row]).astype(np.float64)
                if item.solid is not None:
                    self.solids.append((item.solid, place))
                    continue
                vertices = item.mesh_vertices.astype(np.float64) * (1 if scales is None else scales[row])
                vertices = vertices @ place[:3, :3].T + place[:3, 3]
            triangles.append(vertices[item.faces])
        self.triangles = np.concatenate(triangles)

    def blocks(self, light, start):
        """Return whether a surface is between a point and a light."""
        way, limit = -np.array(light.direction), np.inf
        if light.kind != "directional":
            way, limit = np.array(light.position) - start, 1.0
        elif light.shadow_plane:
            limit = (np.array(light.position) - start) @ way
        return self.blocks_up_to(start, way, limit)

    def blocks_up_to(self, start, way, limit):
        """Return whether a surface crosses a ray with a parameter up to a limit."""
        if crosses_triangles(self.triangles, start, way, limit):
            return True
        for solid, place in self.solids:
            local = (start - place[:3, 3]) @ place[:3, :3], way @ place[:3, :3]
            if crosses_solid(solid, np.array(solid.radii), solid.half, *local, limit):
                return True
        return False

    def is_lit(self, light, point, normal, camera):
        """Return whether a light shines on a point of a surface that a camera position sees."""
        lift = 6e-7 * (np.abs(point).sum() + np.linalg.norm(point - camera))
        return is_lit(light, point, normal) and not self.blocks(light, point + lift * normal)


def lights_with_shadows(lights):
    return [light for light in lights if light.cast_shadow and light.kind not in ("ambient", "headlight")]


def cast_shadow_rays(lights, references, cameras, views):
    """Return where lights with shadows shine, (light, V, H, W) uint8, from a view's points, normals and segmentation.

    `references` are `ShadowReference`s of the views, and `cameras` the positions of their cameras, (V, 3).
    """
    seg, points, normals = (getattr(views, key).numpy() for key in ("segmentation", "points", "normals"))
    lights = lights_with_shadows(lights)
    shine = np.zeros((len(lights), *seg.shape), dtype=np.uint8)
    for view, y, x in np.argwhere(seg >= 0):
        point, normal = (image[view, y, x].astype(np.float64) for image in (points, normals))
        for number, light in enumerate(lights):
            shine[number, view, y, x] = 255 * references[view].is_lit(light, point, normal, cameras[view])
    return shine


def cast_shadow_packets(lights, references, cameras, views):
    """Return the images of `cast_shadow_rays`: packets are faster, but decide each ray in the same way."""
    return cast_shadow_rays(lights, references, cameras, views)


cast_shadow_packets_cuda = cast_shadow_packets


def pixel_class(y, x):
    """Return the class of a pixel, by which points of lights are chosen."""
    return 4 * (y % 4) + x % 4


def light_points(light, y, x):
    """Return a light at each of its points for a pixel, in double precision."""
    axis = np.array(light.direction)
    sign = -1.0 if axis[2] < 0 else 1.0
    a = -1 / (sign + axis[2])
    b = axis[0] * axis[1] * a
    first = np.array([1 + sign * axis[0] ** 2 * a, sign * b, -sign * axis[0]])
    second = np.array([b, sign + axis[1] ** 2 * a, -axis[1]])
    for u, v, w in sphere_samples(light.shadow_samples)[pixel_class(y, x)].astype(np.float64):
        if light.kind == "directional":
            aside = np.tan(light.radius) * (u * first + v * second)
            yield replace(light, direction=tuple(axis + aside), radius=0.0)
        else:
            offset = light.radius * (u * first + v * second + w * axis)
            yield replace(light, position=tuple(np.array(light.position) + offset), radius=0.0)


def cast_soft_shadow_rays(lights, references, cameras, views):
    """Return the fraction of each light with a radius, as `cast_shadow_rays` does for those without."""
    seg, points, normals = (getattr(views, key).numpy() for key in ("segmentation", "points", "normals"))
    lights = lights_with_shadows(lights)
    shine = np.zeros((len(lights), *seg.shape), dtype=np.uint8)
    for view, y, x in np.argwhere(seg >= 0):
        point, normal = (image[view, y, x].astype(np.float64) for image in (points, normals))
        start = point + 6e-7 * (np.abs(point).sum() + np.linalg.norm(point - cameras[view])) * normal
        for number, light in enumerate(lights):
            if not is_lit(light, point, normal):
                continue
            way = np.array([-np.array(at.direction) for at in light_points(light, y, x)])
            if light.kind != "directional":
                way = np.array([at.position for at in light_points(light, y, x)]) - point
            above = [at for at, w in zip(light_points(light, y, x), way, strict=True) if normal @ w > 0]
            open_points = sum(not references[view].blocks(at, start) for at in above)
            if above:
                shine[number, view, y, x] = np.floor(255 * open_points / len(above) + 0.5)
    return shine


def cast_soft_shadow_packets(lights, references, cameras, views):
    """Return the images of `cast_soft_shadow_rays`."""
    return cast_soft_shadow_rays(lights, references, cameras, views)


def cast_occlusion_rays(occlusion, references, cameras, views):
    """Return the fraction of ambient light that no surface within a distance blocks, (V, H, W) uint8."""
    seg, points, normals = (getattr(views, key).numpy() for key in ("segmentation", "points", "normals"))
    fraction = np.full(seg.shape, 255, dtype=np.uint8)
    directions = direction_samples(occlusion.samples).astype(np.float64)
    for view, y, x in np.argwhere(seg >= 0):
        point, normal = (image[view, y, x].astype(np.float64) for image in (points, normals))
        start = point + 6e-7 * (np.abs(point).sum() + np.linalg.norm(point - cameras[view])) * normal
        total = clear = 0.0
        for direction in directions[pixel_class(y, x)]:
            cosine = normal @ direction
            if cosine > 0:
                total += cosine
                clear += cosine * (not references[view].blocks_up_to(start, direction, occlusion.distance))
        fraction[view, y, x] = np.floor(255 * clear / total + 0.5)
    return fraction


def cast_occlusion_packets(occlusion, references, cameras, views):
    """Return the images of `cast_occlusion_rays`."""
    return cast_occlusion_rays(occlusion, references, cameras, views)


def is_near_boundary(reference, light, point, normal, camera, distance):
    """Return whether points of the surface's plane within a distance are partly lit and partly not."""
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    across /= np.linalg.norm(across)
    along, angles = np.cross(normal, across), np.linspace(0, 2 * np.pi, 16, endpoint=False)
    around = [point + distance * (np.cos(a) * across + np.sin(a) * along) for a in angles]
    return len({reference.is_lit(light, p, normal, camera) for p in (point, *around)}) == 2
