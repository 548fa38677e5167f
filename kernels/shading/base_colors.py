# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of visible surfaces: base colors with textures, from objects, triangles and hit points."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.textures import DeviceTexture

wp.set_module_options(pixel_options("shared/lighting.h", fused=True))  # colors are rounded to 8 bits

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
    reflectance: float
    scale: wp.vec3  # for cube projection: factors applied to coordinates of the object's frame
    alpha_mode: int  # opaque, mask, blend
    alpha_cutoff: float
    is_double_sided: bool
    blends_twice: bool
    is_unlit: bool  # whether its color is its base color under any lights


@wp.struct
class PbrMaterial:
    """What a material has in addition for its model of shading; see `warpvis.scene.materials.Material`."""

    shading: int  # phong, pbr, webots
    tone_mapped: bool
    metallic: float
    roughness: float
    ambient_strength: float
    normal_scale: float
    occlusion_strength: float
    maps: wp.vec4i  # indices of the textures of metallic and roughness, normals, occlusion, emission; -1 without


@wp.struct
class DeviceVertexGrid:
    """Cells at whose corners light is computed if it is computed per vertex; see `warpvis.scene.vertex_grids`."""

    kind: int  # as `CornerFinder` of native/shared/vertex_grids.h numbers them
    place: wp.transform  # of the grid in the frame of the entry
    half: wp.vec3  # half sizes, or the radii of a solid
    straight: float  # half the length of a solid before scaling
    count: wp.vec3i
    first: wp.vec3
    step: wp.vec3
    period: wp.vec3


@wp.struct
class DeviceMaterials:
    """The appearance of all objects of a scene; see `warpvis.scene._device_materials`.

    Arrays over entries have one for each object, in their order, and then one for each alternative appearance of an
    object that some worlds show.
    """

    object_material: wp.array[wp.int32]
    """(entry): its default material."""
    object_column: wp.array[wp.int32]
    """(entry): index of the movable object whose pose it follows; -1 for static objects."""
    object_pose: wp.array[wp.transform]
    """(entry): transform from the object's frame to that of its movable object, or to the world if static."""
    object_rows: wp.array2d[wp.int32]
    """(entry, 9): first rows in planes, uv, colors, face_material and normals, and those in uv of the four maps of
    `PbrMaterial`; -1 if it has none."""
    planes: wp.array2d[float]
    """(row, 9): a triangle's corner a in the object's frame [m], and the gradients of the barycentric weights of its
    corners b and c."""
    uv: wp.array2d[wp.vec2]
    """(row, corner)"""
    colors: wp.array2d[wp.vec4]
    normals: wp.array2d[wp.vec3]
    face_material: wp.array[wp.int32]
    materials: wp.array[DeviceMaterial]
    textures: wp.array[DeviceTexture]
    texels: wp.array[wp.uint32]
    """RGBA bytes; red is the lowest byte."""
    level_first: wp.array[wp.int32]
    """Index of the first texel of each level of each texture."""
    linear_of: wp.array[float]
    """Linear light of the 256 display values."""
    vertex_grids: wp.array[DeviceVertexGrid]
    """(entry)"""
    background: wp.vec3
    """Color where no surface is visible, in display color space, from 0 to 1."""
    is_layered: bool
    """Whether surfaces may show what is behind them."""
    pbr: wp.array[PbrMaterial]
    """(material); None if all have the shading "phong"."""
    reflectances: wp.array2d[wp.vec2]
    """(cosine, roughness): specular reflection of uniform light, of `warpvis.scene._reflectances`; None as `pbr`."""
    world_entry: wp.array2d[wp.int32]
    """(1 or world, object): the entry that a world shows; None if every object has its own."""
    world_color: wp.array2d[wp.vec4]
    """(1 or world, object): base color in display color space, which replaces the material's; NaN keeps it.
    None if no world has other colors."""
    world_emission: wp.array2d[wp.vec3]
    """(1 or world, object): emission that replaces the material's, in its color space; NaN keeps it."""
    world_background: wp.array[wp.vec3]
    """(1 or world): color where no surface is visible; None for `background`."""


@wp.struct
class Footprint:
    """The size of a pixel on a surface."""

    kind: int
    size: wp.vec2
    """Pixel size: at depth 1 for a pinhole, at range 1 for a cone, at any depth for parallel rays [m]."""


@wp.func_native(
    """
const auto images = warpvis::surface_images(points_in, segmentation_in, faces_in, &points_in, view, y);
auto row = warpvis::color_row(appearance, worlds, images, footprint, camera_to_world, albedo_out);
row.base_colors(x);
"""
)
def shade_base_color_row(
    appearance: DeviceMaterials,
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    view: int,
    y: int,
    x: int,
    albedo_out: wp.array3d[wp.vec3ub],
): ...


@wp.kernel(cuda_max_registers=96)  # more leave room for fewer blocks, and fewer are spilled (H100)
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
    """Write unlit base colors of visible surfaces on a GPU, and the background elsewhere; see `color_rows`."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    shade_base_color_row(
        appearance, footprint, camera_to_world, worlds, points_in, segmentation_in, faces_in, view, y, x, albedo_out
    )
