// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Memory of the exact size, and what a tree is made of.

#pragma once

#include <cstring>
#include <memory>

#include "scenes.h"

// Memory of exactly so many, so that the address sanitizer sees what is read or written beyond; null for none.
template <class T>
struct Exact {
    T* data = nullptr;
    size_t count = 0;
    char* memory = nullptr;

    // `shift`: how many of them after a multiple of 64 bytes it begins.
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

// A tree of one mesh, as warpvis.scene makes it of kernels/bvh.py.
struct BuiltTree {
    int lanes = 0, nodes = 0, leaves = 0, levels = 0;
    Exact<float> leaf_rows, node_rows;
    Exact<int> children, triangles, owners;
    bool exact_areas = true;  // whether all splits say how large their parts' boxes are, to the last bit
};
