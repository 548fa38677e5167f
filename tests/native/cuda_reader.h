// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Arguments of a kernel, as written by tests/cuda_emulator.py.

#pragma once

#include <stddef.h>

enum { DIMENSIONS = 4 };

// The members of Warp's arrays that kernels use.
template <class T>
struct Array {
    T* data;
    int shape[DIMENSIONS];
};

struct Vec2 {
    float value[2];
};
struct Vec3 {
    float value[3];

    float operator[](int k) const { return value[k]; }
};
struct Vec4 {
    float value[4];
};
struct Transform {
    float value[7];
};

struct Reader {
    enum { ABSENT, GIVEN, IMAGE };  // kinds of arrays
    enum { MAX_IMAGES = 8 };
    struct Image {
        char* data;
        size_t bytes;
    };
    Image images[MAX_IMAGES];
    int image_count;

    void bytes(void* to, size_t count);
    void* array(int* shape);
};

template <class T>
static inline void read(Reader& reader, T& value) {
    reader.bytes(&value, sizeof(value));
}
template <class T>
static inline void read(Reader& reader, Array<T>& array) {
    array.data = (T*)reader.array(array.shape);
}
