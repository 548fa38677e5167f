# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What trimesh's reader of PLY files takes amiss, put right in the bytes before it reads them."""

from __future__ import annotations

_END = b"\rend_header\r"


def straighten_ply(file: bytes) -> bytes:
    """Return a PLY file with line ends of Unix in its header, for those of a Mac of old, which Rhino writes."""
    if not file.startswith(b"ply\r") or file.startswith(b"ply\r\n"):
        return file
    head, end, body = file.partition(_END)
    return (head + end).replace(b"\r", b"\n") + body if end else file
