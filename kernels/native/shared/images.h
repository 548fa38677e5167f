// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

// Output images of all views, [view][y][x]; null if not requested. Python: kernels/casting/images.py.
struct Images {
    float* depth;
    float* points;  // xyz in the world
    float* normals;  // xyz in the world
    unsigned char* labels;
    int* segmentation;  // object index
    int* faces;  // index of a triangle in the object's own mesh
    const unsigned char* object_label;  // [object]: label of each object
    const int* slot_face;  // [leaf][lane]: face index of each triangle; null if faces are not requested

    // Whether the z-buffer must store the triangle of a pixel, not only its object.
    inline bool of_triangles() const { return normals || faces; }
};
static_assert(sizeof(Images) == 8 * sizeof(void*), "kernels/casting/images.py fills the members in this order");
