# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mirror images of flat surfaces: the scene as seen by a camera behind the plane.

The reflection of a camera with the rotation R in a plane with the unit normal n has the axes ``(I - 2 n n^T) R``, which
are left-handed. With its x axis flipped, it is a camera whose image is the mirror image from right to left.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.rays import CUDA_REGISTERS, RayRange, trace_ray, write_images
from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds, is_excluded, row_of, world_of
from warpvis.kernels.pinhole import Window, forward_axis, frame_of, locate
from warpvis.kernels.shading.base_colors import DeviceMaterials
from warpvis.kernels.shading.lighting import DeviceLight, Lights

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

LIGHT_DIRECTIONAL, LIGHT_HEADLIGHT = wp.constant(1), wp.constant(4)
FACE_MATERIAL = wp.constant(3)
"""Column of `DeviceMaterials.object_rows`."""

FLATNESS = wp.constant(wp.float64(4.0e-6))
"""Maximum distance of a visible point from the plane that it is on, relative to its distances from the origin and from
the camera."""


@wp.struct
class Mirror:
    """A plane of an object, in the frame of a movable object, or in the world."""

    index: int
    column: int  # index of the movable object; -1 for the world
    point: wp.vec3d
    normal: wp.vec3d


@wp.func
def factors_in(worlds: Worlds, world: int, column: int) -> wp.vec3d:
    """Return the scale factors of a movable mesh."""
    factors = wp.vec3d(wp.float64(1.0))
    if worlds.object_sizes:
        size = worlds.object_sizes[world, column]
        factors = wp.vec3d(wp.float64(size[0]), wp.float64(size[1]), wp.float64(size[2]))
    return factors


@wp.func
def plane_of(mirror: Mirror, worlds: Worlds, view: int, eye: wp.vec3d) -> wp.vec4d:
    """Return the plane of a mirror in the world of a view: its normal toward the camera, and its offset."""
    point = wp.vec3d() + mirror.point
    normal = wp.vec3d() + mirror.normal
    if mirror.column >= 0:
        world = world_of(worlds, view)
        if world >= 0:
            frame = frame_of(worlds.object_poses[world, mirror.column])
            factors = factors_in(worlds, world, mirror.column)
            point = wp.quat_rotate(frame.rotation, wp.cw_mul(point, factors)) + frame.origin
            normal = wp.quat_rotate(frame.rotation, wp.normalize(wp.cw_div(normal, factors)))
    offset = wp.dot(normal, point)
    if wp.dot(normal, eye) < offset:
        normal = -normal
        offset = -offset
    return wp.vec4d(normal[0], normal[1], normal[2], offset)


@wp.func
def height_above(plane: wp.vec4d, point: wp.vec3d) -> wp.float64:
    """Return the distance of a point from a plane, positive on the side of the camera."""
    return plane[0] * point[0] + plane[1] * point[1] + plane[2] * point[2] - plane[3]


@wp.kernel
def mirror_views(
    # Scene:
    mirror: Mirror,
    columns_in: wp.array[wp.int32],
    centers_in: wp.array[wp.vec3d],
    halves_in: wp.array[wp.vec3d],
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    # In:
    worlds: Worlds,
    # Out:
    planes_out: wp.array[wp.vec4d],
    poses_out: wp.array[wp.transform],
    excluded_out: wp.array2d[wp.uint8],
):
    """Write the plane of a mirror in each view, the pose of the mirrored camera, and the objects that it excludes.

    Excluded are the mirror's object, objects whose boxes are behind the plane, and those that the view excludes. The
    image of the mirrored camera is flipped: see the module. A rotation by half a turn about the axis n is
    ``2 n n^T - I``, so that the rotation of the mirrored camera is the product of one about the normal, the camera's,
    and one about x.
    """
    view, index = wp.tid()
    eye = frame_of(camera_to_world[view])
    plane = plane_of(mirror, worlds, view, eye.origin)
    normal, zero = wp.vec3d(plane[0], plane[1], plane[2]), wp.float64(0.0)
    if index == 0:
        position = eye.origin - normal * (wp.float64(2.0) * height_above(plane, eye.origin))
        rotation = (
            wp.quatd(normal[0], normal[1], normal[2], zero) * eye.rotation * wp.quatd(wp.float64(1.0), zero, zero, zero)
        )
        planes_out[view] = plane
        turned = wp.quat(float(rotation[0]), float(rotation[1]), float(rotation[2]), float(rotation[3]))
        poses_out[view] = wp.transform(wp.vec3(position), turned)
    column = columns_in[index]
    center = wp.vec3d() + centers_in[index]
    along = wp.vec3d() + normal
    half = wp.vec3d() + halves_in[index]
    if column >= 0:
        world = world_of(worlds, view)
        if world >= 0:
            frame = frame_of(worlds.object_poses[world, column])
            center = wp.quat_rotate(frame.rotation, center) + frame.origin
            along = wp.quat_rotate_inv(frame.rotation, normal)
        if worlds.object_sizes:  # sizes of solids are absolute: their boxes are not known
            half = wp.vec3d(wp.float64(wp.inf))
    reach = zero
    for k in range(3):
        if along[k] != zero:
            reach += wp.abs(along[k]) * half[k]
    is_behind = height_above(plane, center) + reach <= zero
    is_hidden = is_behind or index == mirror.index or is_excluded(worlds, view, index)
    excluded_out[view, index] = wp.uint8(wp.where(is_hidden, 1, 0))


@wp.kernel
def mirror_lights(
    # Scene:
    lights: Lights,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    # In:
    worlds: Worlds,
    # Out:
    lights_out: wp.array2d[DeviceLight],
):
    """Write the lights of each view, with headlights as directional lights along the axis of its camera."""
    view, number = wp.tid()
    light = lights.all[row_of(worlds, view, lights.all.shape[0]), number]
    if light.kind == LIGHT_HEADLIGHT:
        light.kind = LIGHT_DIRECTIONAL
        light.direction = wp.vec3(forward_axis(frame_of(camera_to_world[view]).rotation))
    lights_out[view, number] = light


@wp.kernel
def flip_points(
    # In:
    width: float,
    pixels_in: wp.array3d[wp.vec2],
    # Out:
    pixels_out: wp.array3d[wp.vec2],
):
    """Write image points [px] of an image that is flipped from right to left."""
    view, y, x = wp.tid()
    pixel = pixels_in[view, y, x]
    pixels_out[view, y, x] = wp.vec2(width - pixel[0], pixel[1])


@wp.func
def is_on_plane(plane: wp.vec4d, point: wp.vec3, eye: wp.vec3d) -> bool:
    """Return whether a visible point is on a plane, except for rounding."""
    at = wp.vec3d(point)
    size = wp.abs(at[0]) + wp.abs(at[1]) + wp.abs(at[2]) + wp.length(at - eye)
    return wp.abs(height_above(plane, at)) <= FLATNESS * size


@wp.func
def reflectance_of(appearance: DeviceMaterials, worlds: Worlds, view: int, seen: int, face: int) -> float:
    """Return the reflectance of a face of an object in the world of a view."""
    entry = seen
    if appearance.world_entry:
        entry = appearance.world_entry[row_of(worlds, view, appearance.world_entry.shape[0]), seen]
    material = appearance.object_material[entry]
    first = appearance.object_rows[entry, FACE_MATERIAL]
    if first >= 0 and face >= 0:
        material = appearance.face_material[first + face]
    return appearance.materials[material].reflectance


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_beyond_mirror(
    # Scene:
    scene: TriangleScene,
    planes: wp.array[wp.vec4d],
    # Cameras:
    camera: RayRange,
    is_parallel: bool,
    origins_in: wp.array2d[wp.vec3d],
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    cull_backfaces: bool,
    span: int,
    # Out:
    images_out: Images,
):
    """Replace surfaces that a mirrored camera sees behind the plane by those that it sees beyond it.

    Rays are the camera's, as in `cast_layer`. A thread processes `span` pixels of a row.
    """
    view, y, part = wp.tid()
    view, y = locate(window, view, y)
    plane = planes[view]
    width = images_out.points.shape[2]
    for x in range(part * span, wp.min(span, width - part * span) + part * span):
        if images_out.segmentation[view, y, x] < 0:
            continue
        point = wp.vec3d(images_out.points[view, y, x])
        height = height_above(plane, point)
        if height > wp.float64(0.0):
            continue
        eye = frame_of(camera_to_world[view])
        local = wp.quat_rotate_inv(eye.rotation, point - eye.origin)
        if is_parallel:
            aside = wp.vec3d(local[0], local[1], wp.float64(0.0))
            eye.origin = eye.origin + wp.quat_rotate(eye.rotation, aside)
            local = local - aside
        elif origins_in:
            local = local - origins_in[y, x]
            eye.origin = eye.origin + wp.quat_rotate(eye.rotation, origins_in[y, x])
        depth = wp.length(local)
        if camera.is_planar:
            depth = local[2]
        start = height_above(plane, eye.origin)
        if height <= start:  # away from the plane
            images_out.segmentation[view, y, x] = -1
            continue
        ray = local / wp.max(depth, wp.float64(1.0e-30))
        beyond = camera
        beyond.near = float(0.0)
        beyond.clip = float(depth * start / (start - height))
        hit = trace_ray(scene, beyond, eye, worlds, worlds, view, ray, cull_backfaces)
        write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, x, images_out)


@wp.struct
class MirrorImage:
    """The mirror image of a plane in each view."""

    index: int  # of the object of the plane
    planes: wp.array[wp.vec4d]
    scale: float  # factor of the reflectance
    is_flipped: bool  # whether the image is flipped from right to left
    segmentation: wp.array3d[wp.int32]
    color: wp.array3d[wp.vec3ub]


@wp.kernel
def hide_unmirrored(
    # Scene:
    appearance: DeviceMaterials,
    image: MirrorImage,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    span: int,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    # Out:
    segmentation_out: wp.array3d[wp.int32],
):
    """Write -1 to mirror images where the camera does not see the mirror, so that they are not shaded."""
    view, y, part = wp.tid()
    view, y = locate(window, view, y)
    width = points_in.shape[2]
    plane, eye = image.planes[view], wp.vec3d(wp.transform_get_translation(camera_to_world[view]))
    for x in range(part * span, wp.min(span, width - part * span) + part * span):
        column = wp.where(image.is_flipped, width - 1 - x, x)
        if segmentation_out[view, y, column] < 0:
            continue
        share = float(0.0)
        if segmentation_in[view, y, x] == image.index:
            if is_on_plane(plane, points_in[view, y, x], eye):
                share = reflectance_of(appearance, worlds, view, image.index, faces_in[view, y, x])
        if share == 0.0:
            segmentation_out[view, y, column] = -1


@wp.kernel
def add_mirror_image(
    # Scene:
    appearance: DeviceMaterials,
    image: MirrorImage,
    # Cameras:
    window: Window,
    # In:
    worlds: Worlds,
    span: int,
    faces_in: wp.array3d[wp.int32],
    # Out:
    color_out: wp.array3d[wp.vec3ub],
):
    """Add the mirror image, times the reflectance, where there is one: colors saturate, as in MuJoCo."""
    view, y, part = wp.tid()
    view, y = locate(window, view, y)
    width = color_out.shape[2]
    for x in range(part * span, wp.min(span, width - part * span) + part * span):
        column = wp.where(image.is_flipped, width - 1 - x, x)
        if image.segmentation[view, y, column] >= 0:
            share = image.scale * reflectance_of(appearance, worlds, view, image.index, faces_in[view, y, x])
            color, added = color_out[view, y, x], image.color[view, y, column]
            sums = wp.vec3ub()
            for k in range(3):
                sums[k] = wp.uint8(wp.min(float(color[k]) + share * float(added[k]) + 0.5, 255.0))
            color_out[view, y, x] = sums
