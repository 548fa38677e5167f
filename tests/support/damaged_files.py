# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small files for tests to damage."""

import numpy as np


def ply(order, faces, *, more="", after="", tail=b""):
    """Return a binary PLY file of polygons with optional extra face properties, such as a color or a list."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [2, 2, 0]], order + "f4")
    kind = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {kind} 1.0\ncomment of a test\nelement vertex 6\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + f"element face {len(faces)}\n"
    head += f"property list uchar uint vertex_indices\n{more}{after}end_header\n"
    body = b"".join(bytes([len(face)]) + np.array(face, order + "u4").tobytes() + tail for face in faces)
    return head.encode() + corners.tobytes() + body
