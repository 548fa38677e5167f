# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where a person can walk: a grid of the floor as bits of one integer, which makes flood fills fast."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from warpvis.situations.rooms._boxes import Box
from warpvis.situations.rooms._outline import Outline

CELL = 0.1
"""Size of a cell [m]."""
BODY_HEIGHT = 1.9
"""Boxes that begin above this height are no obstacle [m]."""
STEP_HEIGHT = 0.02
"""Boxes that end below this height are no obstacle [m]: rugs."""


class WalkGrid:
    """Cells whose center is at least `radius` from walls and obstacles."""

    def __init__(self, outline: Outline, radius: float) -> None:
        """Create the grid of an empty room."""
        x0, y0, x1, y1 = outline.bounds
        self.radius = radius
        self.x0, self.y0 = x0 + CELL / 2, y0 + CELL / 2
        self.columns, self.rows = math.ceil((x1 - x0) / CELL - 1e-9), math.ceil((y1 - y0) / CELL - 1e-9)
        self.xs = self.x0 + CELL * np.arange(self.columns)
        self.ys = self.y0 + CELL * np.arange(self.rows)
        across = np.minimum(self.xs - x0, x1 - self.xs) >= radius - 1e-9
        along = np.minimum(self.ys - y0, y1 - self.ys) >= radius - 1e-9
        self.free: NDArray[np.bool_] = along[:, None] & across[None]
        if outline.notch is not None:
            self.block([outline.notch])

    def copy(self) -> WalkGrid:
        """Return a copy with separate cells."""
        new = object.__new__(WalkGrid)
        new.__dict__ = {**self.__dict__, "free": self.free.copy()}
        return new

    def block(self, boxes: Iterable[Box]) -> None:
        """Mark cells near boxes as not free."""
        for box in boxes:
            if box.low >= BODY_HEIGHT or box.high <= STEP_HEIGHT:
                continue
            x, y, c, s, a, b = box[:6]
            r = self.radius
            dx, dy = abs(c) * a + abs(s) * b + r, abs(s) * a + abs(c) * b + r
            left, right = max(int((x - dx - self.x0) / CELL), 0), int((x + dx - self.x0) / CELL) + 1
            low, high = max(int((y - dy - self.y0) / CELL), 0), int((y + dy - self.y0) / CELL) + 1
            if right <= 0 or high <= 0:
                continue
            u, v = self.xs[None, left:right] - x, self.ys[low:high, None] - y
            gap_x = np.maximum(np.abs(u * c + v * s) - a, 0.0)
            gap_y = np.maximum(np.abs(v * c - u * s) - b, 0.0)
            self.free[low:high, left:right] &= gap_x * gap_x + gap_y * gap_y >= r * r - 1e-9

    def reachable(self, x: float, y: float) -> NDArray[np.bool_]:
        """Return the free cells that are connected to the free cell nearest to a point, shape ``(rows, columns)``."""
        start = self.nearest(x, y)
        if start is None:
            return np.zeros_like(self.free)
        width = self.columns + 1
        found = _flood(1 << (start[0] * width + start[1]), _as_bits(self.free), width, self.rows)
        return _as_cells(found, self.free.shape)

    def nearest(self, x: float, y: float, distance: float = 0.5) -> tuple[int, int] | None:
        """Return the row and column of the free cell nearest to a point; None if it is farther than `distance` [m]."""
        reach = int(distance / CELL) + 1
        column, row = round((x - self.x0) / CELL), round((y - self.y0) / CELL)
        left, low = max(column - reach, 0), max(row - reach, 0)
        free = self.free[low : max(row + reach + 1, 0), left : max(column + reach + 1, 0)]
        if not free.any():
            return None
        xs, ys = self.xs[left : left + free.shape[1]] - x, self.ys[low : low + free.shape[0]] - y
        squared = np.where(free, ys[:, None] ** 2 + xs[None] ** 2, np.inf)
        number, offset = divmod(int(squared.argmin()), free.shape[1])
        return (low + number, left + offset) if squared[number, offset] <= distance**2 else None


def largest_area(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells of the largest connected area of free cells, shape ``(rows, columns)``; none if none is free."""
    rows, columns = free.shape
    rest, largest = _as_bits(free), 0
    while rest.bit_count() > largest.bit_count():
        found = _flood(rest & -rest, rest, columns + 1, rows)
        rest ^= found
        largest = max(largest, found, key=int.bit_count)
    return _as_cells(largest, free.shape)


def _as_bits(cells: NDArray[np.bool_]) -> int:
    """Return cells as bits of a number; a column that is not set separates rows."""
    padded = np.pad(cells, ((0, 0), (0, 1)))
    return int.from_bytes(np.packbits(padded.ravel(), bitorder="little").tobytes(), "little")


def _as_cells(bits: int, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the cells of a number of `_as_bits`."""
    rows, width = shape[0], shape[1] + 1
    data = np.frombuffer(bits.to_bytes((rows * width + 7) // 8, "little"), dtype=np.uint8)
    return np.unpackbits(data, bitorder="little")[: rows * width].reshape(rows, width)[:, :-1].astype(bool)


def _flood(start: int, free: int, width: int, rows: int) -> int:
    """Return the set bits of `free` that are connected to those of `start`; rows have `width` bits.

    Runs along a direction are filled in a logarithmic number of steps (Kogge-Stone occluded fill).
    """
    found = start & free
    while True:
        grown = found
        for step, count in ((1, width), (width, rows)):
            up = down = grown
            up_free = down_free = free
            while count > 0:
                up |= up_free & (up << step)
                down |= down_free & (down >> step)
                up_free &= up_free << step
                down_free &= down_free >> step
                step, count = 2 * step, count // 2
            grown = up | down
        if grown == found:
            return found
        found = grown


def door_fronts(outline: Outline) -> list[tuple[float, float]]:
    """Return the points 0.45 m in front of the doors."""
    doors = [opening for opening in outline.openings if opening.kind == "door"]
    return [outline.walls[door.wall].point(door.start + door.width / 2, 0.45) for door in doors]


def reached_area(grid: WalkGrid, outline: Outline) -> tuple[NDArray[np.bool_], bool]:
    """Return the cells that are reachable from the first door, and whether all other doors are."""
    fronts = door_fronts(outline)
    if not fronts:
        return grid.free, True
    found = grid.reachable(*fronts[0])
    cells = [grid.nearest(x, y) for x, y in fronts[1:]]
    return found, bool(found.any()) and all(cell is not None and bool(found[cell]) for cell in cells)
