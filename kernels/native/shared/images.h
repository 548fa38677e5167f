// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// The images of all views, [view][y][x]; null where nobody asks. In Python, kernels/images.py.
struct Images {
    float* depth;
    float* points;  // xyz in the world
    float* normals;  // xyz in the world
    unsigned char* labels;
    int* segmentation;  // an index of an object
    int* faces;  // an index of a triangle in the object's own mesh
    const unsigned char* object_label;  // [object]: what labels are made of
    const int* slot_face;  // [leaf][lane]: what faces are made of; null where nobody asks

    // Whether a pixel has to know its triangle, and not only its object.
    inline bool of_triangles() const { return normals || faces; }
};
static_assert(sizeof(Images) == 8 * sizeof(void*), "kernels/images.py fills it in this order");
