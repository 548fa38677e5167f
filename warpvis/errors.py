# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the exceptions and the warning of warpvis. A message states what was given and what is expected."""


class WarpvisError(ValueError):
    """Base class of all errors that warpvis raises for invalid input."""


class ArrayError(WarpvisError):
    """An array has the wrong shape, dtype, device or values."""


class CameraError(WarpvisError):
    """Intrinsics, image size or depth range do not define a valid camera."""


class PoseError(WarpvisError):
    """Poses have the wrong shape, are not finite, or are not rotations."""


class SceneError(WarpvisError):
    """Geometry, names, labels or indices do not define a valid scene."""


class FileFormatError(WarpvisError):
    """A file is missing, cannot be parsed, or its format cannot store the requested content."""


class MessageError(WarpvisError):
    """A ROS message does not match its definition, or the ROS message classes are not available."""


class ShortcutError(WarpvisError):
    """Questions of a dataset can be answered without looking at who sees what."""


class IntrinsicsWarning(UserWarning):
    """Intrinsics define a valid camera, but are probably a mistake."""
