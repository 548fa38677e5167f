# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images as files: 16-bit PNG in millimetres, and ``.npz`` in metres."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.errors import ArrayError, FileFormatError

_MOST_MILLIMETRES = 65_535


def depth_to_millimetres(depth: ArrayLike) -> NDArray[np.uint16]:
    """Depth as most 16-bit depth images hold it: whole millimetres, 0 where there is none.

    Depth that 16 bits cannot hold (beyond 65.535 m) becomes 0 as well, not the greatest value: to a reader, 0 is no
    depth, and any other number is a distance.

    Args:
        depth: Depth [m], any shape.

    Returns:
        Millimetres, the same shape.
    """
    millimetres = np.rint(np.asarray(depth, dtype=np.float64) * 1000)
    fits = (millimetres > 0) & (millimetres <= _MOST_MILLIMETRES)
    return np.where(fits, millimetres, 0).astype(np.uint16)


def too_far_for_millimetres(depth: ArrayLike) -> int:
    """How many finite depths 16 bits of millimetres cannot hold."""
    depth = np.asarray(depth)
    return int(np.count_nonzero(np.isfinite(depth) & (np.rint(depth * 1000.0) > _MOST_MILLIMETRES)))


def save_depth_png(depth: ArrayLike, path: str | os.PathLike[str]) -> None:
    """Write one depth image [m], shape ``(H, W)``, as 16-bit PNG in millimetres; see `depth_to_millimetres`."""
    from PIL import Image

    millimetres = depth_to_millimetres(depth)
    if millimetres.ndim != 2:
        raise ArrayError(f"depth must have shape (H, W), got {millimetres.shape}")
    try:
        Image.fromarray(millimetres).save(Path(path), format="PNG")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from None


class DepthArchive:
    """A NumPy ``.npz`` file whose ``depth`` is written in parts, so that it need not fit into memory.

    Example:
        >>> with DepthArchive("depth.npz", (1000, 240, 320), K=camera.to_K()) as archive:
        ...     for poses in batches:
        ...         archive.append(renderer.render(poses).depth.numpy())
    """

    def __init__(self, path: str | os.PathLike[str], shape: tuple[int, int, int], **arrays: ArrayLike) -> None:
        """Open the file.

        Args:
            path: File to write.
            shape: ``(V, H, W)`` of the whole depth array [m].
            **arrays: Smaller arrays to store beside it.

        Raises:
            FileFormatError: The file cannot be written.
        """
        self.path = Path(path)
        self.shape = shape
        self._written = 0
        # Under another name until it is whole: what is called depth.npz can be trusted.
        self._partial = self.path.with_name(self.path.name + ".part")
        try:
            self._zip = zipfile.ZipFile(self._partial, "w")
        except OSError as error:
            raise FileFormatError(f"{path}: cannot be written: {error.strerror}") from None
        for name, array in arrays.items():
            with self._zip.open(f"{name}.npy", "w") as stream:
                np.lib.format.write_array(stream, np.asarray(array), allow_pickle=False)
        self._stream: Any = self._zip.open("depth.npy", "w", force_zip64=True)
        header = {"descr": "<f4", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(self._stream, header)

    def append(self, depth: NDArray[np.float32]) -> None:
        """Write the next views, shape ``(n, H, W)``."""
        if depth.shape[1:] != self.shape[1:] or self._written + len(depth) > self.shape[0]:
            raise ArrayError(f"depth of shape {depth.shape} does not continue {self._written} views of {self.shape}")
        try:
            self._stream.write(np.ascontiguousarray(depth, dtype="<f4").tobytes())
        except OSError as error:
            raise FileFormatError(f"{self.path}: cannot be written: {error.strerror}") from None
        self._written += len(depth)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        whole = kind is None and self._written == self.shape[0]
        try:
            self._stream.close()
            self._zip.close()
            if whole:
                self._partial.replace(self.path)
        except OSError as failure:
            whole = False
            if kind is None:
                raise FileFormatError(f"{self.path}: cannot be written: {failure.strerror}") from None
        finally:
            if not whole:
                self._partial.unlink(missing_ok=True)
        if kind is None and not whole:
            raise ArrayError(f"{self.path}: {self._written} of {self.shape[0]} views were written")
