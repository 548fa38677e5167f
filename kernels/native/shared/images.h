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

    // The images of an `Images` of kernels/casting/images.py, and arrays of a `BvhScene` of kernels/casting/packets.py.
    template <class Outputs, class BvhScene>
    static inline Images of(const Outputs& images, const BvhScene& scene) {
        Images out;
        out.depth = images.depth.data;
        out.points = (float*)images.points.data;
        out.normals = (float*)images.normals.data;
        out.labels = images.labels.data;
        out.segmentation = images.segmentation.data;
        out.faces = images.faces.data;
        out.object_label = scene.object_label.data;
        out.slot_face = scene.slot_face.data;
        return out;
    }
    // Whether the z-buffer must store the triangle of a pixel, not only its object.
    inline bool of_triangles() const { return normals || faces; }
};
