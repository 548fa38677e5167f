# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The next surfaces behind listed pixels, in packets on CPU cores; see ``native/cpu/layer_packets.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene, PacketJob, WorkerMemory, make_packet_kernel
from warpvis.kernels.casting.worlds import Worlds

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class LayerCall:
    """The arguments of a launch, as of `casting.packets.PacketCall`, and the surfaces in front.

    Images are those of a list of pixels (`kernels.shading.layer_rows.PixelList`), whose image points are `job.pixels`.
    """

    scene: BvhScene
    job: PacketJob
    workers: WorkerMemory
    poses: wp.array[wp.transform]
    worlds: Worlds
    gap: wp.float64  # `layers.GAP`
    points: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]
    is_back: wp.array3d[wp.uint8]  # written: 1 where triangles are seen from behind
    is_left: wp.array3d[wp.uint8]  # written: 1 where the ray needs `layer_rows.cast_layer_rows`
    left: wp.array[wp.int32]  # becomes 1 if there is such a ray


cast_layer_packets = make_packet_kernel("cpu/layer_packets.h", "LayerStrips", LayerCall)
