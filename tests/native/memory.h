// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Memory of exact size, and the data of a tree.

#pragma once

#include <cstring>
#include <memory>

#include "scenes.h"

// An array of exact size, so that the address sanitizer detects accesses beyond it; null if empty.
template <class T>
struct Exact {
    T* data = nullptr;
    size_t count = 0;
    char* memory = nullptr;

    // `shift` is the offset from a multiple of 64 bytes, in elements.
    explicit Exact(size_t n = 0, T value = T(), size_t shift = 0) : count(n) {
        if (!n) return;
        memory = (char*)operator new((n + shift) * sizeof(T), std::align_val_t(64));
        data = (T*)memory + shift;
        std::fill(data, data + n, value);
    }
    explicit Exact(const std::vector<T>& from) : Exact(from.size()) { std::copy(from.begin(), from.end(), data); }
    Exact(Exact&& other) noexcept { swap(other); }
    Exact& operator=(Exact&& other) noexcept {
        swap(other);
        return *this;
    }
    ~Exact() {
        if (memory) operator delete(memory, std::align_val_t(64));
    }
    void swap(Exact& other) {
        std::swap(data, other.data);
        std::swap(count, other.count);
        std::swap(memory, other.memory);
    }
    T& operator[](size_t i) { return data[i]; }
    const T& operator[](size_t i) const { return data[i]; }
};

// A tree of one mesh, as built by warpvis.scene with kernels/bvh/build.py.
struct BuiltTree {
    int lanes = 0, nodes = 0, leaves = 0, levels = 0;
    Exact<float> leaf_rows, node_rows;
    Exact<int> children, triangles, owners;
    bool exact_areas = true;  // whether the stored areas of the parts' boxes are exact for all splits
};
