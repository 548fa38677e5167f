// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// All rays start at the eye. See ray_origins.h for the other kind.

typedef ImagePoint RayPlace;
typedef ExactImagePoint ExactRayPlace;

// Edge function of a triangle: positive where rays pass inside the edge.
struct Edge : Linear {
    static inline Edge of(Vec3 product, Vec3) {
        Edge edge;
        edge.u = product.x, edge.v = product.y, edge.one = product.z;
        return edge;
    }
    inline float of_ray(RayPlace p) const { return at(p.u, p.v); }
};

// Bounds on the ray origins of a packet.
struct Origins {
    static inline float max_edge(const Edge& edge, float u, float v) { return edge.at(u, v); }
    static inline float min_edge(const Edge& edge, float u, float v) { return edge.at(u, v); }
    static inline ImagePoint aside() { return ImagePoint{0.0f, 0.0f}; }
    static inline ImagePoint aside_at(float) { return ImagePoint{0.0f, 0.0f}; }
    static inline ImagePoint seen(RayPlace p, float) { return p; }
    static inline float past(float along) { return along; }
    static inline float corner_distance(float farthest) { return farthest; }
    static inline float error(float of_inv_z) { return of_inv_z; }
    static inline float volume(float rounding, Vec3) { return rounding; }
    static inline bool is_side_uncertain(float, float, Vec3) { return false; }
    static inline float nearest(float inv_z, float, float) { return inv_z; }
    static inline bool may_hide(float) { return false; }
    static inline float along(float inv_z, float, float, RayPlace) { return inv_z; }
    static inline double along(double inv_z, double, double, ExactRayPlace) { return inv_z; }
    static inline Vec3d start(ExactRayPlace, Vec3d eye, const Vec3d*) { return eye; }
    static inline Vec3 start(RayPlace, Vec3 eye, Vec3, Vec3) { return eye; }
};

// Ray origins of a ray table.
struct RayStarts {
    static inline RayPlace of(ImagePoint p, int) { return p; }
    static inline ExactRayPlace of(ExactImagePoint p, int) { return p; }
    static inline float from_start(float z, int) { return z; }
    static inline bool is_behind(float, int) { return false; }
};

// The eye of a table's packet: the position of its camera.
struct TableEye {
    static inline Vec3d place(Vec3d camera, const Vec3d*) { return camera; }
    static inline Origins origins() { return Origins{}; }
    static inline float farthest(float z) { return z; }
    static inline float reach(float of_near_plane) { return of_near_plane; }
};
