// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Arrays with a row for each world; `Worlds` is a struct of kernels/casting/worlds.py.

#pragma once

// The row of a view in an array with one row for all worlds or one for each.
template <class Worlds>
inline int world_row(const Worlds& worlds, int view, int rows) {
    const int world = rows == 1 ? 0 : (worlds.world.data ? worlds.world.data[view] : view);
    return world < 0 ? 0 : (world < rows ? world : rows - 1);
}

// The numbers of an object in the world of a view, in an array that may be null; null if they are NaN.
template <class Array, class Worlds>
inline const float* world_numbers(const Array& array, const Worlds& worlds, int view, int object) {
    if (!array.data) return nullptr;
    const long long row = world_row(worlds, view, array.shape[0]);
    const float* numbers = (const float*)(array.data + row * array.shape[1] + object);
    return numbers[0] == numbers[0] ? numbers : nullptr;
}
