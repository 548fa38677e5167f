// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The packet caster on CUDA: a warp takes a packet, PACKET_WIDTH x PACKET_HEIGHT pixels of a view, down the cluster tree.
//
// Space is the camera's, with x and y scaled by the focal lengths: the ray of a pixel is (u, v, 1), where u and v are
// its distances in pixels from the principal point. On which side of a triangle's edge the ray passes, and w = 1 / z of
// the triangle's plane, are then linear in u and v.
//
// A pixel gets the same value of an edge and of w wherever they are computed, and whatever the packet: two triangles
// that share an edge get exactly opposite values there, so that no ray slips between them, and an image does not depend
// on the packets' size.

enum {
    LANES = 32,
    LEAF_WORDS = 9 * LANES,    // ax ay az bx by bz cx cy cz
    NODE_WORDS = 10 * LANES,   // least x y z, greatest x y z, cone's axis x y z and cutoff
    BLOCK_COLUMNS = PACKET_WIDTH / 8,  // a block is 8 x 4 pixels
    BLOCKS = BLOCK_COLUMNS * (PACKET_HEIGHT / 4),  // at most LANES: lane b keeps what is known of block b
};

struct Tree {
    const float* leaves;  // [leaf][9][32]
    const int* owners;    // [leaf][32]: object of a triangle; its complement where the object is closed
    const float* nodes;   // [node][10][32]
    const int* children;  // [node][32]: a node, or the complement of a leaf
    bool all_closed;      // whether every object is

    static inline int object_of(int owner) { return owner < 0 ? ~owner : owner; }
    // A triangle's nine coordinates, every 32nd number from here; its id is its leaf and its lane there.
    inline const float* corners(unsigned id) const { return leaves + (long long)(id / LANES) * LEAF_WORDS + id % LANES; }
};

// Where the camera is and how the world turns into its space. In shared memory: all lanes read the same.
struct Eye {
    Vec origin;
    Vec to_camera[3];     // rows: x scaled by fx, y scaled by fy, z
    float first_u, first_v;  // u and v of the view's first pixel
    float last_x, last_y;    // the view's last column and row
    float far;
    float blur;              // how far rounding may move a corner, in pixels
    bool skip_back_faces;    // of objects that are closed, since the camera is outside them all
    bool cull_back_faces;    // of all objects
    double exact_rays[3][3]; // a ray is u times the first, plus v times the second, plus the third, in the world

    static inline Vec turn(const Eye& eye, Vec p) {
        return Vec{Vec::dot(eye.to_camera[0], p), Vec::dot(eye.to_camera[1], p), Vec::dot(eye.to_camera[2], p)};
    }
};

// A value that is linear in u and v.
struct Linear {
    float u, v, one;

    inline float at(float at_u, float at_v) const { return __fmaf_rn(u, at_u, __fmaf_rn(v, at_v, one)); }
};

// One triangle in double precision: its first corner seen from the camera, and its normal, of any length.
struct ExactTriangle {
    double a[3], normal[3];

    static inline ExactTriangle of(const Eye& eye, const float* corners) {
        ExactTriangle t;
        const float* origin = &eye.origin.x;
        double ab[3], ac[3];
        for (int k = 0; k < 3; ++k) {
            const double corner = corners[k * LANES];
            t.a[k] = corner - origin[k];
            ab[k] = corners[(k + 3) * LANES] - corner;
            ac[k] = corners[(k + 6) * LANES] - corner;
        }
        t.normal[0] = ab[1] * ac[2] - ab[2] * ac[1];
        t.normal[1] = ab[2] * ac[0] - ab[0] * ac[2];
        t.normal[2] = ab[0] * ac[1] - ab[1] * ac[0];
        return t;
    }
    // Negative where the camera sees the front.
    inline double volume() const { return normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2]; }
};

// The plane of one triangle in double precision: w is linear in u and v.
struct ExactPlane {
    double u, v, one;

    static inline ExactPlane of(const Eye& eye, const float* corners) {
        const ExactTriangle t = ExactTriangle::of(eye, corners);
        const double scale = 1.0 / t.volume();
        return ExactPlane{along(t, eye.exact_rays[0]) * scale, along(t, eye.exact_rays[1]) * scale,
                          along(t, eye.exact_rays[2]) * scale};
    }
    static inline double along(const ExactTriangle& t, const double* ray) {
        return t.normal[0] * ray[0] + t.normal[1] * ray[1] + t.normal[2] * ray[2];
    }
    inline float at(float at_u, float at_v) const { return (float)(u * at_u + (v * at_v + one)); }
};

// One triangle, set up for the image.
struct alignas(16) Triangle {
    Linear edge[3];           // not negative inside
    float slope_u, slope_v;   // of w
    float u, v, w;            // where w is known: at a corner
    float least_w, most_w;    // at the corners: no point of a triangle is nearer or farther
    int x0, x1, y0, y1;       // pixels of the packet whose centres may be inside
    bool exact;               // single precision is not enough for w
    bool shown;               // may cover a pixel's centre

    inline bool covers(float at_u, float at_v) const {
        return Three::least(edge[0].at(at_u, at_v), edge[1].at(at_u, at_v), edge[2].at(at_u, at_v)) >= 0.0f;
    }
    inline float clamp(float at_w) const { return fmaxf(fminf(at_w, most_w), least_w); }
    inline float w_at(float at_u, float at_v) const {
        return clamp(__fmaf_rn(slope_u, at_u - u, __fmaf_rn(slope_v, at_v - v, w)));
    }
};

struct Setup {
    static inline Vec corner(const Eye& eye, const float* leaf, int k) {
        const float* at = leaf + 3 * k * LANES + Warp::lane();
        return Eye::turn(eye, Vec::minus(Vec{__ldg(at), __ldg(at + LANES), __ldg(at + 2 * LANES)}, eye.origin));
    }

    // cross(a - b, a + b) is 2 a x b, and exactly its negative when a and b change places.
    static inline Linear edge(Vec a, Vec b, float sign) {
        const Vec product = Vec::cross(Vec::minus(a, b), Vec::plus(a, b));
        return Linear{product.x * sign, product.y * sign, product.z * sign};
    }

    // Corners in the image: where they are, in pixels from the principal point, and 1 / z.
    struct Projection {
        float u[3], v[3], w[3];
        float u0, u1, v0, v1;  // bounds
        float zmax;
        bool crossing;         // reaches behind the camera: it may be anywhere in the image

        static inline Projection of(Vec a, Vec b, Vec c) {
            Projection p;
            const float zmin = Three::least(a.z, b.z, c.z);
            p.zmax = Three::most(a.z, b.z, c.z);
            p.crossing = zmin <= 1e-6f * p.zmax + 1e-30f;
            p.w[0] = 1.0f / a.z, p.w[1] = __fdividef(1.0f, b.z), p.w[2] = __fdividef(1.0f, c.z);
            p.u[0] = a.x * p.w[0], p.u[1] = b.x * p.w[1], p.u[2] = c.x * p.w[2];
            p.v[0] = a.y * p.w[0], p.v[1] = b.y * p.w[1], p.v[2] = c.y * p.w[2];
            p.u0 = Three::least(p.u[0], p.u[1], p.u[2]), p.u1 = Three::most(p.u[0], p.u[1], p.u[2]);
            p.v0 = Three::least(p.v[0], p.v[1], p.v[2]), p.v1 = Three::most(p.v[0], p.v[1], p.v[2]);
            return p;
        }
    };

    // Pixels of the view whose centres may be inside a triangle: a little more than rounding can be wrong.
    struct Bounds {
        float left, right, top, bottom;

        static inline Bounds of(const Eye& eye, const Projection& p) {
            const float slack = 0.002f + 4.0f * eye.blur;
            Bounds b;
            b.left = fmaxf(p.crossing ? 0.0f : ceilf(p.u0 - eye.first_u - slack), 0.0f);
            b.right = fminf(p.crossing ? eye.last_x : floorf(p.u1 - eye.first_u + slack), eye.last_x);
            b.top = fmaxf(p.crossing ? 0.0f : ceilf(p.v0 - eye.first_v - slack), 0.0f);
            b.bottom = fminf(p.crossing ? eye.last_y : floorf(p.v1 - eye.first_v + slack), eye.last_y);
            return b;
        }
        // The part in the packet that begins at a pixel; false if there is none.
        inline bool cut(int first_x, int first_y, Triangle& t) const {
            const float x0 = fmaxf(left - (float)first_x, 0.0f), x1 = fminf(right - (float)first_x, PACKET_WIDTH - 1.0f);
            const float y0 = fmaxf(top - (float)first_y, 0.0f), y1 = fminf(bottom - (float)first_y, PACKET_HEIGHT - 1.0f);
            const bool some = x0 <= x1 && y0 <= y1;
            t.x0 = some ? (int)x0 : 0, t.x1 = some ? (int)x1 : -1;
            t.y0 = some ? (int)y0 : 0, t.y1 = some ? (int)y1 : -1;
            return some;
        }
    };

    // Whether w may be wrong by more than a little: by rounding of its terms, by that of the corners' places, and by that
    // of the slopes, which is great where the triangle is a sliver in the image. Judged by the whole view, so that a
    // pixel's w is the same in every packet.
    static inline bool loses_digits(const Eye& eye, const Projection& p, const Bounds& b, const Triangle& t, float scale) {
        const float du = fmaxf(fabsf(b.left + eye.first_u - t.u), fabsf(b.right + eye.first_u - t.u));
        const float dv = fmaxf(fabsf(b.top + eye.first_v - t.v), fabsf(b.bottom + eye.first_v - t.v));
        const float change = fabsf(t.slope_u) * du + fabsf(t.slope_v) * dv;
        const float sliver = eye.blur * ((p.u1 - p.u0) + (p.v1 - p.v0)) * (p.zmax * p.zmax * p.zmax) * fabsf(scale);
        const float error = 2e-7f * (change + t.w) + eye.blur * (fabsf(t.slope_u) + fabsf(t.slope_v)) + sliver * change;
        return p.crossing || !(error <= 6e-6f * t.least_w);
    }

    // The triangle of this lane.
    static inline Triangle triangle(const Tree& tree, const Eye& eye, int first_x, int first_y, int leaf) {
        const float* corners = tree.leaves + (long long)leaf * LEAF_WORDS;
        const Vec a = corner(eye, corners, 0), b = corner(eye, corners, 1), c = corner(eye, corners, 2);
        const Vec normal = Vec::cross(Vec::minus(b, a), Vec::minus(c, a));
        const float volume = Vec::dot(normal, a);  // negative where the camera sees the front
        Triangle t;
        t.shown = volume != 0.0f && fabsf(volume) <= 3e38f;
        if (eye.cull_back_faces)
            t.shown &= volume < 0.0f;
        else if (eye.skip_back_faces)
            t.shown &= volume < 0.0f || __ldg(tree.owners + (long long)leaf * LANES + Warp::lane()) >= 0;
        const Projection p = Projection::of(a, b, c);
        const Bounds bounds = Bounds::of(eye, p);
        t.shown &= bounds.cut(first_x, first_y, t) && p.zmax > 0.0f;
        if (!Warp::any(t.shown)) return t;

        const float sign = volume < 0.0f ? -1.0f : 1.0f, scale = 1.0f / volume;
        t.edge[0] = edge(b, c, sign);
        t.edge[1] = edge(c, a, sign);
        t.edge[2] = edge(a, b, sign);
        t.slope_u = normal.x * scale;
        t.slope_v = normal.y * scale;
        t.u = p.u[0], t.v = p.v[0], t.w = p.w[0];
        t.least_w = p.crossing ? 1.0f / p.zmax : Three::least(p.w[0], p.w[1], p.w[2]);
        t.most_w = p.crossing ? 3e37f : Three::most(p.w[0], p.w[1], p.w[2]);
        t.exact = loses_digits(eye, p, bounds, t, scale);
        return t;
    }
};
