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
    LEAF_WORDS = 9 * LANES,  // ax ay az bx by bz cx cy cz
    NODE_WORDS = 10 * LANES,  // least x y z, greatest x y z, cone's axis x y z and cutoff
    BLOCK_COLUMNS = PACKET_WIDTH / 8,  // a block is 8 x 4 pixels
    BLOCKS = BLOCK_COLUMNS * (PACKET_HEIGHT / 4),  // at most LANES: lane b keeps what is known of block b
};

struct Tree {
    const float* leaves;  // [leaf][9][32]
    const int* owners;  // [leaf][32]: object of a triangle; its complement where the object is closed
    const float* nodes;  // [node][10][32]
    const int* children;  // [node][32]: a node, or the complement of a leaf
    int root;
    int first_id;  // what the number of a triangle is more than its place in the leaves
    bool all_closed;  // whether every object is
    const unsigned char* excluded;  // [object]: whether the view must not see it; null where it sees them all

    static inline int object_of(int owner) { return owner < 0 ? ~owner : owner; }
    // The nine coordinates of the triangle in a leaf's lane, every 32nd number from here.
    inline const float* corners(unsigned place) const {
        return leaves + (long long)(place / LANES) * LEAF_WORDS + place % LANES;
    }
};

struct Box {
    // Whether a place is in a box: least and greatest corner.
    static inline bool holds(const float* box, Vec p) {
        return p.x >= __ldg(box) && p.x <= __ldg(box + 3) && p.y >= __ldg(box + 1) && p.y <= __ldg(box + 4) &&
               p.z >= __ldg(box + 2) && p.z <= __ldg(box + 5);
    }
};

// A value that is linear in u and v.
struct Linear {
    float u, v, one;

    inline float at(float at_u, float at_v) const { return __fmaf_rn(u, at_u, __fmaf_rn(v, at_v, one)); }
};

// Three coordinates in double precision.
struct Exact {
    double x, y, z;

    static inline Exact of(const float* p, int stride) { return Exact{p[0], p[stride], p[2 * stride]}; }
    static inline Exact minus(Exact a, Exact b) { return Exact{a.x - b.x, a.y - b.y, a.z - b.z}; }
    static inline double dot(Exact a, Exact b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
    static inline Exact cross(Exact a, Exact b) {
        return Exact{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    }
    static inline Exact times(Exact a, double by) { return Exact{a.x * by, a.y * by, a.z * by}; }
    inline Vec rounded() const { return Vec{(float)x, (float)y, (float)z}; }

    // Of a triangle, of any length.
    static inline Exact normal(const float* corners) {
        const Exact a = of(corners, LANES);
        return cross(minus(of(corners + 3 * LANES, LANES), a), minus(of(corners + 6 * LANES, LANES), a));
    }
};

struct Pose {
    // The axes of a pose x y z qx qy qz qw, in double precision: what its x, y and z axis are outside of its frame.
    static inline void axes(const float* pose, Exact* axis) {
        const double x = __ldg(pose + 3), y = __ldg(pose + 4), z = __ldg(pose + 5), w = __ldg(pose + 6);
        const double two = 2.0 / (x * x + y * y + z * z + w * w);  // which normalises the quaternion
        axis[0] = Exact{1 - two * (y * y + z * z), two * (x * y + z * w), two * (x * z - y * w)};
        axis[1] = Exact{two * (x * y - z * w), 1 - two * (x * x + z * z), two * (y * z + x * w)};
        axis[2] = Exact{two * (x * z + y * w), two * (y * z - x * w), 1 - two * (x * x + y * y)};
    }
    static inline Exact position(const float* pose) { return Exact{__ldg(pose), __ldg(pose + 1), __ldg(pose + 2)}; }
    // A direction out of its frame.
    static inline Exact outside(const Exact* axis, Exact v) {
        return Exact{axis[0].x * v.x + axis[1].x * v.y + axis[2].x * v.z,
                     axis[0].y * v.x + axis[1].y * v.y + axis[2].y * v.z,
                     axis[0].z * v.x + axis[1].z * v.y + axis[2].z * v.z};
    }
};

// Where the camera is, in the world or in the frame of an object that moves, and how that turns into its space. In shared
// memory: all lanes read the same.
struct Eye {
    Vec origin, rest;  // their sum is the origin: in an object's frame, single precision need not be enough for it
    Vec to_camera[3];  // rows: x scaled by fx, y scaled by fy, z
    double focal_squared[3];  // rows of to_camera, divided by the exact rays
    float first_u, first_v;  // u and v of the view's first pixel
    float last_x, last_y;  // the view's last column and row
    float far;
    float blur;  // how far rounding may move a corner, in pixels
    bool skip_back_faces;  // of objects that are closed, since the camera is outside them all
    bool cull_back_faces;  // of all objects
    Exact exact_origin;
    Exact exact_rays[3];  // a ray is u times the first, plus v times the second, plus the third

    static inline Vec relative(const Eye& eye, Vec p) {
        const Vec from = Vec::minus(p, eye.origin);
        return MOVABLE ? Vec::minus(from, eye.rest) : from;
    }
    static inline Vec turn(const Eye& eye, Vec p) {
        return Vec{Vec::dot(eye.to_camera[0], p), Vec::dot(eye.to_camera[1], p), Vec::dot(eye.to_camera[2], p)};
    }
};

// The plane of one triangle in double precision: w is linear in u and v.
struct ExactPlane {
    double u, v, one;

    static inline ExactPlane of(const Eye& eye, const float* corners) {
        const Exact normal = Exact::normal(corners);
        const double scale = 1.0 / Exact::dot(normal, Exact::minus(Exact::of(corners, LANES), eye.exact_origin));
        return ExactPlane{Exact::dot(normal, eye.exact_rays[0]) * scale, Exact::dot(normal, eye.exact_rays[1]) * scale,
                          Exact::dot(normal, eye.exact_rays[2]) * scale};
    }
    inline float at(float at_u, float at_v) const { return (float)(u * at_u + (v * at_v + one)); }
};

// One triangle, set up for the image.
struct alignas(16) Triangle {
    Linear edge[3];  // not negative inside
    float slope_u, slope_v;  // of w
    float u, v, w;  // where w is known: at a corner
    float least_w, most_w;  // at the corners: no point of a triangle is nearer or farther
    int x0, x1, y0, y1;  // pixels of the packet whose centres may be inside
    bool exact;  // single precision is not enough for w
    unsigned place;  // in the leaves

    inline bool covers(float at_u, float at_v) const {
        return Three::least(edge[0].at(at_u, at_v), edge[1].at(at_u, at_v), edge[2].at(at_u, at_v)) >= 0.0f;
    }
    inline float clamp(float at_w) const { return fmaxf(fminf(at_w, most_w), least_w); }
    inline float w_at(float at_u, float at_v) const {
        return clamp(__fmaf_rn(slope_u, at_u - u, __fmaf_rn(slope_v, at_v - v, w)));
    }
};

struct Setup {
    enum { LARGE = 64 };  // pixels of the bounds, from which a triangle is worth a look at its edges

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
        bool crossing;  // reaches behind the camera: it may be anywhere in the image

        // Its area, in pixels.
        inline float area() const {
            return 0.5f * fabsf((u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0]));
        }
        // About how many are inside of so many in its bounds.
        inline int cover(int bounds) const {
            return crossing || !(area() < (float)bounds) ? bounds : min(bounds, (int)area() + 1);
        }

        static inline Projection of(Vec a, Vec b, Vec c) {
            Projection p;
            const float zmin = Three::least(a.z, b.z, c.z);
            p.zmax = Three::most(a.z, b.z, c.z);
            p.crossing = zmin <= 1e-6f * p.zmax + 1e-30f;
            p.w[0] = 1.0f / a.z, p.w[1] = __fdividef(1.0f, b.z), p.w[2] = __fdividef(1.0f, c.z);
            // Rounded here, though the compiler would rather fuse them with what they are subtracted from.
            p.u[0] = __fmul_rn(a.x, p.w[0]), p.u[1] = __fmul_rn(b.x, p.w[1]), p.u[2] = __fmul_rn(c.x, p.w[2]);
            p.v[0] = __fmul_rn(a.y, p.w[0]), p.v[1] = __fmul_rn(b.y, p.w[1]), p.v[2] = __fmul_rn(c.y, p.w[2]);
            p.u0 = Three::least(p.u[0], p.u[1], p.u[2]), p.u1 = Three::most(p.u[0], p.u[1], p.u[2]);
            p.v0 = Three::least(p.v[0], p.v[1], p.v[2]), p.v1 = Three::most(p.v[0], p.v[1], p.v[2]);
            return p;
        }
    };

    // How much wider than rounding can be wrong the bounds of a triangle are, in pixels.
    static inline float slack_of(const Eye& eye) { return 0.002f + 4.0f * eye.blur; }

    // Pixels of the view whose centres may be inside a triangle.
    struct Bounds {
        float left, right, top, bottom;

        static inline Bounds of(const Eye& eye, const Projection& p) {
            const float slack = slack_of(eye);
            Bounds b;
            b.left = fmaxf(p.crossing ? 0.0f : ceilf(p.u0 - eye.first_u - slack), 0.0f);
            b.right = fminf(p.crossing ? eye.last_x : floorf(p.u1 - eye.first_u + slack), eye.last_x);
            b.top = fmaxf(p.crossing ? 0.0f : ceilf(p.v0 - eye.first_v - slack), 0.0f);
            b.bottom = fminf(p.crossing ? eye.last_y : floorf(p.v1 - eye.first_v + slack), eye.last_y);
            return b;
        }
        // The part in the packet that begins at a pixel; false if there is none.
        inline bool cut(int first_x, int first_y, Triangle& t) const {
            const float x0 = fmaxf(left - (float)first_x, 0.0f),
                        x1 = fminf(right - (float)first_x, PACKET_WIDTH - 1.0f);
            const float y0 = fmaxf(top - (float)first_y, 0.0f),
                        y1 = fminf(bottom - (float)first_y, PACKET_HEIGHT - 1.0f);
            const bool some = x0 <= x1 && y0 <= y1;
            t.x0 = some ? (int)x0 : 0, t.x1 = some ? (int)x1 : -1;
            t.y0 = some ? (int)y0 : 0, t.y1 = some ? (int)y1 : -1;
            return some;
        }
    };

    // Whether w may be wrong by more than a little: by rounding of its terms, by that of the corners' places, and by that
    // of the slopes, which is great where the triangle is a sliver in the image. Judged by the whole view, so that a
    // pixel's w is the same in every packet.
    static inline bool loses_digits(const Eye& eye, const Projection& p, const Bounds& b, const Triangle& t,
                                    float scale) {
        const float du = fmaxf(fabsf(b.left + eye.first_u - t.u), fabsf(b.right + eye.first_u - t.u));
        const float dv = fmaxf(fabsf(b.top + eye.first_v - t.v), fabsf(b.bottom + eye.first_v - t.v));
        const float change = __fmaf_rn(fabsf(t.slope_u), du, __fmul_rn(fabsf(t.slope_v), dv));
        const float sliver = eye.blur * ((p.u1 - p.u0) + (p.v1 - p.v0)) * (p.zmax * p.zmax * p.zmax) * fabsf(scale);
        const float slopes = __fmul_rn(eye.blur, fabsf(t.slope_u) + fabsf(t.slope_v));
        const float error = __fmaf_rn(2e-7f, change + t.w, __fmaf_rn(sliver, change, slopes));
        return p.crossing || !(error <= 6e-6f * t.least_w);
    }

    // A triangle in camera space.
    struct Corners {
        Vec a, b, c, normal;
        float volume;  // negative where the camera sees the front

        static inline Corners of(const Eye& eye, const float* first) {
            Corners t;
            t.a = corner(eye, first), t.b = corner(eye, first + 3 * LANES), t.c = corner(eye, first + 6 * LANES);
            t.normal = Vec::cross(Vec::minus(t.b, t.a), Vec::minus(t.c, t.a));
            t.volume = Vec::dot(t.normal, t.a);
            return t;
        }
        static inline Vec corner(const Eye& eye, const float* at) {
            return Eye::turn(eye, Eye::relative(eye, Vec{__ldg(at), __ldg(at + LANES), __ldg(at + 2 * LANES)}));
        }
    };

    // Whether this lane's triangle of a leaf may cover a pixel's centre of the packet that begins at a pixel, and if so,
    // about how many.
    static inline int area(const Tree& tree, const Eye& eye, int first_x, int first_y, int leaf) {
        const unsigned place = leaf * LANES + Warp::lane();
        const Corners c = Corners::of(eye, tree.corners(place));
        bool shown = c.volume != 0.0f && fabsf(c.volume) <= 3e38f;
        if (eye.cull_back_faces)
            shown &= c.volume < 0.0f;
        else if (eye.skip_back_faces)
            shown &= c.volume < 0.0f || __ldg(tree.owners + place) >= 0;
        if (tree.excluded) shown &= !tree.excluded[Tree::object_of(__ldg(tree.owners + place))];
        if (!Warp::any(shown)) return 0;
        const Projection p = Projection::of(c.a, c.b, c.c);
        if (!(p.zmax > 0.0f)) shown = false;
        if (!MOVABLE && p.crossing) return shown ? PACKET_WIDTH * PACKET_HEIGHT : 0;
        const float slack = slack_of(eye);
        const float to_x = eye.first_u + (float)first_x, to_y = eye.first_v + (float)first_y;
        const int x0 = p.crossing ? 0 : max(__float2int_ru(p.u0 - to_x - slack), 0);
        const int y0 = p.crossing ? 0 : max(__float2int_ru(p.v0 - to_y - slack), 0);
        const int x1 = p.crossing ? PACKET_WIDTH - 1 : min(__float2int_rd(p.u1 - to_x + slack), PACKET_WIDTH - 1);
        const int y1 = p.crossing ? PACKET_HEIGHT - 1 : min(__float2int_rd(p.v1 - to_y + slack), PACKET_HEIGHT - 1);
        const int count = shown && x0 <= x1 && y0 <= y1 ? (x1 - x0 + 1) * (y1 - y0 + 1) : 0;
        // Worth it where a packet meets much that is near: static scenes of small triangles are slower with it.
        const bool large = MOVABLE && count > LARGE;
        if (large && passes_by(c, Whole::of(first_x + x0) + eye.first_u, Whole::of(first_x + x1) + eye.first_u,
                               Whole::of(first_y + y0) + eye.first_v, Whole::of(first_y + y1) + eye.first_v))
            return 0;
        return p.cover(count);
    }

    // Whether a triangle is outside of a rectangle of the image, judged by its edges.
    static inline bool passes_by(const Corners& c, float u0, float u1, float v0, float v1) {
        const float sign = c.volume < 0.0f ? -1.0f : 1.0f;
        return beyond(edge(c.b, c.c, sign), u0, u1, v0, v1) || beyond(edge(c.c, c.a, sign), u0, u1, v0, v1) ||
               beyond(edge(c.a, c.b, sign), u0, u1, v0, v1);
    }
    // An edge's value is greatest at a corner. Rounding keeps the order: no pixel of the rectangle contradicts the corner.
    static inline bool beyond(const Linear& edge, float u0, float u1, float v0, float v1) {
        return edge.at(edge.u >= 0.0f ? u1 : u0, edge.v >= 0.0f ? v1 : v0) < 0.0f;
    }

    // A triangle that has an area.
    static inline Triangle triangle(const Tree& tree, const Eye& eye, int first_x, int first_y, unsigned place) {
        const Corners c = Corners::of(eye, tree.corners(place));
        const Projection p = Projection::of(c.a, c.b, c.c);
        const Bounds bounds = Bounds::of(eye, p);
        const float sign = c.volume < 0.0f ? -1.0f : 1.0f, scale = 1.0f / c.volume;
        Triangle t;
        t.place = place;
        bounds.cut(first_x, first_y, t);
        t.edge[0] = edge(c.b, c.c, sign);
        t.edge[1] = edge(c.c, c.a, sign);
        t.edge[2] = edge(c.a, c.b, sign);
        t.slope_u = c.normal.x * scale;
        t.slope_v = c.normal.y * scale;
        t.u = p.u[0], t.v = p.v[0], t.w = p.w[0];
        t.least_w = p.crossing ? 1.0f / p.zmax : Three::least(p.w[0], p.w[1], p.w[2]);
        t.most_w = p.crossing ? 3e37f : Three::most(p.w[0], p.w[1], p.w[2]);
        t.exact = loses_digits(eye, p, bounds, t, scale);
        return t;
    }
};
