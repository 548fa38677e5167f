// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// The images of all views, [view][y][x]; null where nobody asks. In Python, kernels/images.py.
struct Images {
    float* depth;
    float* points;  // xyz in the world
    float* normals;  // xyz in the world
    unsigned char* labels;
    int* segmentation;  // an index of an object
    const unsigned char* object_label;  // [object]: what labels are made of
};
static_assert(sizeof(Images) == 6 * sizeof(void*), "kernels/images.py fills it in this order");
