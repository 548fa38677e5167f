# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of visible surfaces: base colors with textures, from objects, triangles and hit points."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.textures import DeviceTexture, sample, to_screen_color

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

PROJECTION_UV, PROJECTION_PLANE, PROJECTION_CUBE = wp.constant(0), wp.constant(1), wp.constant(2)
FOOTPRINT_NONE, FOOTPRINT_PINHOLE, FOOTPRINT_CONE, FOOTPRINT_PARALLEL = (wp.constant(kind) for kind in range(4))


@wp.struct
class DeviceMaterial:
    """The base color of a material; see `warpvis.scene.materials.Material`."""

    color: wp.vec4
    is_linear: bool  # whether its colors are linear light and are multiplied in linear space
    texture: int  # index of the texture; -1 without
    projection: int
    repeat: wp.vec2  # repetitions of the texture
    specular: wp.vec3
    shininess: float
    emission: wp.vec3
    scale: wp.vec3  # for cube projection: factors applied to coordinates of the object's frame


@wp.struct
class DeviceMaterials:
    """The appearance of all objects of a scene; see `warpvis.scene._device_materials`."""

    object_material: wp.array[wp.int32]
    """(object): its default material."""
    object_column: wp.array[wp.int32]
    """(object): index of the movable object whose pose it follows; -1 for static objects."""
    object_pose: wp.array[wp.transform]
    """(object): transform from the object's frame to that of its movable object, or to the world if static."""
    object_rows: wp.array2d[wp.int32]
    """(object, 5): first rows in corners, uv, colors, face_material and normals; -1 if it has none."""
    corners: wp.array2d[wp.vec3]
    """(row, corner), in the object's frame [m]."""
    uv: wp.array2d[wp.vec2]
    colors: wp.array2d[wp.vec4]
    normals: wp.array2d[wp.vec3]
    face_material: wp.array[wp.int32]
    materials: wp.array[DeviceMaterial]
    textures: wp.array[DeviceTexture]
    texels: wp.array[wp.uint32]
    """RGBA bytes; red is the lowest byte."""
    background: wp.vec3
    """Color where no surface is visible, in display color space, from 0 to 1."""


@wp.struct
class Footprint:
    """The size of a pixel on a surface."""

    kind: int
    size: wp.vec2
    """Pixel size: at depth 1 for a pinhole, at range 1 for a cone, at any depth for parallel rays [m]."""


@wp.struct
class SurfaceTriangle:
    """The visible triangle of a pixel, in its object's frame."""

    a: wp.vec3
    ab: wp.vec3
    ac: wp.vec3
    normal: wp.vec3


@wp.func
def weights(triangle: SurfaceTriangle, point: wp.vec3) -> wp.vec3:
    """Return the barycentric coordinates of a point in a triangle's plane."""
    offset = point - triangle.a
    size = wp.dot(triangle.normal, triangle.normal)
    if size == 0.0:
        return wp.vec3(1.0, 0.0, 0.0)
    weight_b = wp.dot(wp.cross(offset, triangle.ac), triangle.normal) / size
    weight_c = wp.dot(wp.cross(triangle.ab, offset), triangle.normal) / size
    return wp.vec3(1.0 - weight_b - weight_c, weight_b, weight_c)


@wp.func
def scaled_triangle(appearance: DeviceMaterials, row: int, factors: wp.vec3) -> SurfaceTriangle:
    """Return the scaled triangle of a row, or a degenerate triangle for row -1."""
    triangle = SurfaceTriangle()
    if row < 0:
        return triangle
    triangle.a = wp.cw_mul(appearance.corners[row, 0], factors)
    triangle.ab = wp.cw_mul(appearance.corners[row, 1], factors) - triangle.a
    triangle.ac = wp.cw_mul(appearance.corners[row, 2], factors) - triangle.a
    triangle.normal = wp.cross(triangle.ab, triangle.ac)
    return triangle


@wp.func
def project_to_cube(direction: wp.vec3, side: int) -> wp.vec2:
    """Project a direction to a cube's side: right, left, up, down, front, back (OpenGL 4.6, table 8.19)."""
    x, y, z = direction[0], direction[1], direction[2]
    s, t, along = float(0.0), float(0.0), float(1.0)
    if side == 0:
        s, t, along = -z, -y, x
    elif side == 1:
        s, t, along = z, -y, -x
    elif side == 2:
        s, t, along = x, z, y
    elif side == 3:
        s, t, along = x, -z, -y
    elif side == 4:
        s, t, along = x, -y, z
    else:
        s, t, along = -x, -y, -z
    along = wp.max(along, 1.0e-12)
    return wp.vec2(0.5 * (s / along + 1.0), 1.0 - 0.5 * (t / along + 1.0))


@wp.func
def cube_side(direction: wp.vec3) -> int:
    """Return the index of the cube's side that a direction points to."""
    x, y, z = wp.abs(direction[0]), wp.abs(direction[1]), wp.abs(direction[2])
    if x >= y and x >= z:
        return wp.where(direction[0] >= 0.0, 0, 1)
    if y >= z:
        return wp.where(direction[1] >= 0.0, 2, 3)
    return wp.where(direction[2] >= 0.0, 4, 5)


@wp.func
def texture_coordinates(
    appearance: DeviceMaterials,
    material: DeviceMaterial,
    uv_row: int,
    triangle: SurfaceTriangle,
    point: wp.vec3,
    side: int,
) -> wp.vec3:
    """Return the texture coordinates of a point of the object's frame, and the cube's side (-1 for no cube)."""
    if material.projection == PROJECTION_CUBE:
        cube_uv = project_to_cube(wp.cw_mul(point, material.scale), side)
        return wp.vec3(cube_uv[0], cube_uv[1], float(side))
    uv = wp.vec2(point[0], point[1])
    if material.projection == PROJECTION_UV:
        uv = wp.vec2(0.0, 0.0)
        if uv_row >= 0:
            w = weights(triangle, point)
            uv = w[0] * appearance.uv[uv_row, 0] + w[1] * appearance.uv[uv_row, 1] + w[2] * appearance.uv[uv_row, 2]
    return wp.vec3(uv[0] * material.repeat[0], uv[1] * material.repeat[1], -1.0)


@wp.func
def neighbor_offset(ray: wp.vec3, step: wp.vec3, depth: float, normal: wp.vec3) -> wp.vec3:
    """Return the offset from a hit to the intersection of a neighboring pixel's ray with the hit's plane."""
    steepness = wp.dot(normal, ray)
    if wp.abs(steepness) <= 1.0e-4 * wp.length(normal) * wp.length(ray):  # limit for surfaces seen edge-on
        steepness = wp.where(steepness < 0.0, -1.0, 1.0) * 1.0e-4 * wp.length(normal) * wp.length(ray)
    return (step - ray * (wp.dot(normal, step) / steepness)) * depth


@wp.func
def to_bytes(color: wp.vec3) -> wp.vec3ub:
    return wp.vec3ub(
        wp.uint8(wp.clamp(color[0], 0.0, 1.0) * 255.0 + 0.5),
        wp.uint8(wp.clamp(color[1], 0.0, 1.0) * 255.0 + 0.5),
        wp.uint8(wp.clamp(color[2], 0.0, 1.0) * 255.0 + 0.5),
    )


@wp.func
def textured(
    appearance: DeviceMaterials,
    material: DeviceMaterial,
    footprint: Footprint,
    camera: wp.transform,
    frame: wp.transform,
    uv_row: int,
    triangle: SurfaceTriangle,
    has_plane: bool,
    hit_point: wp.vec3,
) -> wp.vec4:
    """Return the texture's color at a hit point of the world, filtered over the pixel's footprint."""
    texture = appearance.textures[material.texture]
    point = wp.transform_point(wp.transform_inverse(frame), hit_point)
    eye = wp.transform_point(wp.transform_inverse(frame), wp.transform_get_translation(camera))
    rotation = wp.quat_inverse(wp.transform_get_rotation(frame)) * wp.transform_get_rotation(camera)
    forward = wp.quat_rotate(rotation, wp.vec3(0.0, 0.0, 1.0))
    ray, depth = point - eye, float(1.0)
    if footprint.kind == FOOTPRINT_PINHOLE:
        depth = wp.max(wp.dot(ray, forward), 1.0e-12)
        ray = ray / depth
    elif footprint.kind == FOOTPRINT_PARALLEL:
        ray = forward
    else:
        depth = wp.max(wp.length(ray), 1.0e-12)
        ray = ray / depth
    right, down = wp.quat_rotate(rotation, wp.vec3(1.0, 0.0, 0.0)), wp.quat_rotate(rotation, wp.vec3(0.0, 1.0, 0.0))
    if footprint.kind == FOOTPRINT_CONE:  # any two axes perpendicular to the ray
        right = wp.normalize(wp.cross(ray, wp.where(wp.abs(wp.dot(ray, down)) < 0.9, down, right)))
        down = wp.cross(ray, right)
    normal = wp.where(has_plane, triangle.normal, ray)
    side = int(-1)
    if material.projection == PROJECTION_CUBE:
        side = cube_side(wp.cw_mul(point, material.scale))
    across = point + neighbor_offset(ray, right * footprint.size[0], depth, normal)
    below = point + neighbor_offset(ray, down * footprint.size[1], depth, normal)
    return sample(
        appearance.texels,
        texture,
        texture_coordinates(appearance, material, uv_row, triangle, point, side),
        texture_coordinates(appearance, material, uv_row, triangle, across, side),
        texture_coordinates(appearance, material, uv_row, triangle, below, side),
        material.is_linear,
    )


@wp.func
def material_of(appearance: DeviceMaterials, index: int, face: int) -> int:
    """Return the material of an object's triangle, or the object's default material for face -1."""
    rows = appearance.object_rows[index, 3]
    if face < 0 or rows < 0:
        return appearance.object_material[index]
    return appearance.face_material[rows + face]


@wp.func
def frame_of(appearance: DeviceMaterials, worlds: Worlds, view: int, index: int) -> wp.transform:
    """Return the transform from an object's frame to the world of a view."""
    column = appearance.object_column[index]
    if column < 0:
        return appearance.object_pose[index]
    return worlds.object_poses[world_of(worlds, view), column] * appearance.object_pose[index]


@wp.func
def factors_of(appearance: DeviceMaterials, worlds: Worlds, view: int, index: int) -> wp.vec3:
    """Return the scale factors of an object's mesh along the axes of its frame."""
    column = appearance.object_column[index]
    if column < 0 or not worlds.object_sizes:
        return wp.vec3(1.0, 1.0, 1.0)
    size = worlds.object_sizes[world_of(worlds, view), column]
    return wp.vec3(size[0], size[1], size[2])


@wp.struct
class SurfaceColor:
    """A surface's color and its texture's color, in the color space of its material."""

    color: wp.vec4
    texel: wp.vec4
    is_linear: bool


@wp.func
def surface_color(
    appearance: DeviceMaterials,
    footprint: Footprint,
    camera: wp.transform,
    worlds: Worlds,
    view: int,
    hit_point: wp.vec3,
    index: int,
    face: int,
) -> SurfaceColor:
    """Return the color of an object's surface at a point of the world."""
    frame, factors = frame_of(appearance, worlds, view, index), factors_of(appearance, worlds, view, index)
    corner_row, uv_row, color_row = int(-1), int(-1), int(-1)
    if face >= 0:
        if appearance.object_rows[index, 0] >= 0:
            corner_row = appearance.object_rows[index, 0] + face
        if appearance.object_rows[index, 1] >= 0:
            uv_row = appearance.object_rows[index, 1] + face
        if appearance.object_rows[index, 2] >= 0:
            color_row = appearance.object_rows[index, 2] + face
    material = appearance.materials[material_of(appearance, index, face)]
    triangle = scaled_triangle(appearance, corner_row, factors)
    found = SurfaceColor()
    found.color = 1.0 * material.color
    found.texel = wp.vec4(1.0, 1.0, 1.0, 1.0)
    found.is_linear = material.is_linear
    if color_row >= 0:
        w = weights(triangle, wp.transform_point(wp.transform_inverse(frame), hit_point))
        found.color = wp.cw_mul(
            material.color,
            w[0] * appearance.colors[color_row, 0]
            + w[1] * appearance.colors[color_row, 1]
            + w[2] * appearance.colors[color_row, 2],
        )
    if material.texture >= 0 and (uv_row >= 0 or material.projection != PROJECTION_UV):
        found.texel = textured(
            appearance, material, footprint, camera, frame, uv_row, triangle, corner_row >= 0, hit_point
        )
    return found


@wp.func
def screen_color(surface: SurfaceColor) -> wp.vec3:
    """Return a surface's color times its texture's, in display color space."""
    color = wp.cw_mul(surface.color, surface.texel)
    if surface.is_linear:
        color = to_screen_color(color)
    return wp.vec3(color[0], color[1], color[2])


@wp.kernel
def shade_base_colors(
    # Scene:
    appearance: DeviceMaterials,
    # Cameras:
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    # Out:
    albedo_out: wp.array3d[wp.vec3ub],
):
    """Write unlit base colors of visible surfaces, and the background elsewhere."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    index = segmentation_in[view, y, x]
    color = 1.0 * appearance.background
    if index >= 0:
        face, hit_point = faces_in[view, y, x], points_in[view, y, x]
        color = screen_color(
            surface_color(appearance, footprint, camera_to_world[view], worlds, view, hit_point, index, face)
        )
    albedo_out[view, y, x] = to_bytes(color)
