# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the exceptions of warpvis, and its warning. Messages say in a sentence what was given and what is wanted."""


class WarpvisError(ValueError):
    """Base of every error that warpvis raises for bad input."""


class ArrayError(WarpvisError):
    """An array has the wrong shape, dtype, device or values."""


class CameraError(WarpvisError):
    """Intrinsics, image size or depth range do not make a camera."""


class PoseError(WarpvisError):
    """Poses have the wrong shape, are not finite, or are not rotations."""


class SceneError(WarpvisError):
    """Geometry, names, labels or indices do not make a scene."""


class FileFormatError(WarpvisError):
    """A file is missing, does not parse, or cannot hold what is asked of it."""


class MessageError(WarpvisError):
    """A message of ROS does not hold what its definition says, or there is nothing to make one with."""


class IntrinsicsWarning(UserWarning):
    """Intrinsics make a camera, though one that is rarely meant."""
