// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The packet caster on CPU cores: all rays of a view, or of a strip of it, walk the cluster tree together.
//
// Space is the camera's, with x and y scaled by the focal lengths: the ray of a pixel is (u, v, 1), where u and v are
// its distances in pixels from the principal point. All that is needed is then linear in u and v: on which side of a
// triangle's edge the ray passes, and w = 1 / z of the triangle's plane. The image keeps the greatest w of every pixel, in blocks of 4 x 4 pixels, one to a register, in tiles of 4 x 4 blocks.
//
// The same expressions in the same order give the value of an edge at a pixel wherever it is needed: two triangles
// that share an edge get exactly opposite values there, so that no ray slips between them.

struct Tree {
    const float* leaves;  // [leaf][9][16]: corners a, b, c of sixteen triangles
    const int* owners;  // [leaf][16]: object of a triangle; its complement where the object is closed
    const float* nodes;  // [node][10][16]: least and greatest corner, axis and cutoff of the normals' cone
    const int* children;  // [node][16]: a node, or the complement of a leaf
    int root;  // node of what stays where it is, -1 if nothing does
    bool all_closed;  // whether every object that stays is

    static inline int object_of(int owner) { return owner < 0 ? ~owner : owner; }
};

struct Judge;

struct Image {
    int width, height;  // of this strip, in pixels
    int first_row;  // of the strip in the view; a multiple of 16
    int view_height;
    int tiles_x, tiles_y;
    int* empty;  // whether w is zero everywhere
    float* w;  // [tile][block][pixel]: greatest 1 / z so far
    int* id;  // the same for the triangle or object that it belongs to; null if nobody asks
    int* first_packet;  // [block]: first of the packets of points in it, and one more; null for pixels
    int* point_index;  // [packet][lane]: which point, -1 for none
    float* point_u;  // [packet][lane]
    float* point_v;
    float* rows;  // four rows of w on their way out
    int* id_rows;
    float* block_least;  // [tile][block]: least w of a block, as far as it is known
    float* tile_least;  // [tile]
    unsigned char* block_stale;
    unsigned char* tile_stale;
    const Judge* judge;  // of points whose lanes begin with the greatest w that does not hide them; null for others

    // The index of a pixel is the sum of a part for its column and a part for its row.
    static inline int column_part(int x) { return ((x >> 4) << 8) + (((x >> 2) & 3) << 4) + (x & 3); }
    inline int row_part(int y) const { return (((y >> 4) * tiles_x) << 8) + (((y >> 2) & 3) << 6) + ((y & 3) << 2); }

    // The index of the block in a column and a row of blocks.
    inline int block_at(int bx, int by) const {
        return (((by >> 2) * tiles_x + (bx >> 2)) << 4) + ((by & 3) << 2) + (bx & 3);
    }

    inline void touch(int block) const {
        block_stale[block] = 1;
        tile_stale[block >> 4] = 1;
    }
    inline float least_of_block(int block) const {
        if (block_stale[block]) {
            block_least[block] = first_packet ? least_of_packets(block) : Lanes::least_of(Lanes::load(w + block * 16));
            block_stale[block] = 0;
        }
        return block_least[block];
    }
    inline float least_of_packets(int block) const {
        Floats least = Lanes::all(3e38f);
        for (int packet = first_packet[block]; packet < first_packet[block + 1]; ++packet)
            least = Lanes::least(least, Lanes::load(w + packet * 16));
        return Lanes::least_of(least);
    }
    inline float least_of_tile(int tile) const {
        if (tile_stale[tile]) {
            for (int block = tile * 16; block < tile * 16 + 16; ++block) least_of_block(block);
            tile_least[tile] = Lanes::least_of(Lanes::load(block_least + tile * 16));
            tile_stale[tile] = 0;
        }
        return tile_least[tile];
    }

    // Whether everything in a rectangle of pixels is nearer than w. A large one is judged by whole tiles.
    inline bool hides(int x0, int y0, int x1, int y1, float nearest_w) const {
        const int bx0 = x0 >> 2, bx1 = x1 >> 2, by0 = y0 >> 2, by1 = y1 >> 2;
        if ((bx1 - bx0 + 1) * (by1 - by0 + 1) > 32) return tiles_hide(x0 >> 4, y0 >> 4, x1 >> 4, y1 >> 4, nearest_w);
        for (int by = by0; by <= by1; ++by)
            for (int bx = bx0; bx <= bx1; ++bx)
                if (least_of_block(block_at(bx, by)) <= nearest_w) return false;
        return true;
    }
    inline bool tiles_hide(int tx0, int ty0, int tx1, int ty1, float nearest_w) const {
        for (int ty = ty0; ty <= ty1; ++ty)
            for (int tx = tx0; tx <= tx1; ++tx)
                if (least_of_tile(ty * tiles_x + tx) <= nearest_w) return false;
        return true;
    }

    // Nothing seen yet.
    inline void begin() const {
        const int tiles = tiles_x * tiles_y;
        __builtin_memset(block_least, 0, tiles * 16 * sizeof(float));
        __builtin_memset(tile_least, 0, tiles * sizeof(float));
        __builtin_memset(block_stale, 0, tiles * 16);
        __builtin_memset(tile_stale, 0, tiles);
        // Writing an image out leaves it empty, but for what was put outside of it.
        if (!*empty)
            for (int block = 0; block < tiles * 16; ++block) Lanes::store(w + block * 16, Lanes::all(0.0f));
        *empty = width == tiles_x * 16 && height == tiles_y * 16;
        if (!*empty) hide_outside();
    }

    // What lies outside the image counts as infinitely near, so that it hides and never shows.
    inline void hide_outside() const {
        for (int y = 0; y < tiles_y * 16; ++y)
            for (int x = y < height ? width : 0; x < tiles_x * 16; ++x) {
                const int pixel = column_part(x) + row_part(y);
                w[pixel] = 3e38f;
                touch(pixel >> 4);
            }
    }
};

typedef float Row[3];
typedef double ExactRow[3];

// Where the camera is in the frame of a tree, the world's or an object's, and how that turns into its space.
struct Eye {
    float origin[3];
    float to_camera[3][3];  // rows: x scaled by fx, y scaled by fy, z
    double exact_origin[3];
    double exact_to_camera[3][3];  // rows: x and y divided by the focal lengths, z: a ray is their sum by u, v and 1
    float rest[3];  // what rounding took from the origin, in camera space: 0 in the world's frame
    float first_u, first_v;  // u and v of pixel (0, 0) of the view
    float far;
    float blur;  // how far rounding may move a corner, in pixels
    bool skip_back_faces;  // of objects that are closed, since the camera is outside them all
    bool cull_back_faces;  // of all objects, because the caller wants it
    const unsigned char* excluded;  // [object]: not 0 for what is not seen; null if all that is drawn may be

    static inline Points relative(const Eye& eye, Floats x, Floats y, Floats z) {
        return Points{x - eye.origin[0], y - eye.origin[1], z - eye.origin[2]};
    }
    // Into camera space, from places relative to the rounded origin.
    static inline Points turn(const Eye& eye, Points p) {
        const Row* m = eye.to_camera;
        return Points{m[0][0] * p.x + (m[0][1] * p.y + (m[0][2] * p.z - eye.rest[0])),
                      m[1][0] * p.x + (m[1][1] * p.y + (m[1][2] * p.z - eye.rest[1])),
                      m[2][0] * p.x + (m[2][1] * p.y + (m[2][2] * p.z - eye.rest[2]))};
    }
};

// A value that is linear in u and v, of sixteen triangles.
struct Linear {
    Floats u, v, one;

    inline Floats row(Floats at_v) const { return v * at_v + one; }
    inline Floats at(Floats at_u, Floats row) const { return u * at_u + row; }
    static inline Linear of_lane(const Linear& all, int k) {
        return Linear{Lanes::all(all.u[k]), Lanes::all(all.v[k]), Lanes::all(all.one[k])};
    }
};

// Sixteen triangles, set up for the image.
struct Cluster {
    const float* corners;  // [9][16] in the frame of the tree
    int first_id;
    const int* owners;
    Linear edge[3];  // positive inside
    Linear w;
    Floats least_w, most_w;  // at the corners: no point of a triangle is nearer or farther
    Floats area;  // in pixels, of the whole triangle; endless where it reaches behind the camera
    Ints shown;  // lanes that may cover a pixel
    Ints x0, x1, y0, y1;  // pixels of the strip whose centres may be inside
    Ints view_y0, view_y1;  // the same rows in the whole view, counted from the view's first
};

struct Setup {
    // cross(a - b, a + b) is 2 a x b, and exactly its negative when a and b change places.
    static inline Linear edge(Points a, Points b, Floats sign) {
        const Points product = Points::cross(Points::minus(a, b), Points::plus(a, b));
        return Linear{product.x * sign, product.y * sign, product.z * sign};
    }

    // Triangles that the view must not see.
    static inline Ints excluded_lanes(const unsigned char* excluded, const int* owners) {
        Ints mask;
        for (int k = 0; k < 16; ++k) mask[k] = excluded[Tree::object_of(owners[k])] ? -1 : 0;
        return mask;
    }

    // False if no lane can show: all face away, or none reaches a pixel's centre.
    static inline bool cluster(const Eye& eye, const Image& image, float center_x, float center_y, Cluster& out) {
        const float* p = out.corners;
        Points c[3];
        for (int k = 0; k < 3; ++k)
            c[k] = Eye::turn(eye, Eye::relative(eye, Lanes::load(p + 48 * k), Lanes::load(p + 48 * k + 16),
                                                Lanes::load(p + 48 * k + 32)));
        const Points normal = Points::cross(Points::minus(c[1], c[0]), Points::minus(c[2], c[0]));
        const Floats volume = Points::dot(normal, c[0]);  // negative where the camera sees the front
        Ints shown = volume != Lanes::all(0.0f);
        if (eye.cull_back_faces)
            shown &= volume < Lanes::all(0.0f);
        else if (eye.skip_back_faces)
            shown &= (volume < Lanes::all(0.0f)) | (Lanes::load(out.owners) >= Lanes::all_ints(0));
        if (eye.excluded) shown &= ~excluded_lanes(eye.excluded, out.owners);
        if (!Lanes::any(shown)) return false;

        const Floats zmin = Lanes::least(c[0].z, c[1].z, c[2].z), zmax = Lanes::most(c[0].z, c[1].z, c[2].z);
        const Floats one = Lanes::all(1.0f), none = Lanes::all(0.0f);
        const Floats i0 = one / c[0].z, i1 = one / c[1].z, i2 = one / c[2].z;
        const Floats px0 = c[0].x * i0, px1 = c[1].x * i1, px2 = c[2].x * i2;
        const Floats py0 = c[0].y * i0, py1 = c[1].y * i1, py2 = c[2].y * i2;
        // Triangles that reach behind the camera may be anywhere in the image.
        const Ints crossing = zmin <= 1e-6f * zmax + Lanes::all(1e-30f);
        // Bounds in pixels, a little wider than rounding can be wrong.
        const float slack = 0.004f + 2e-6f * (float)(image.width + image.height);
        const Floats wide = Lanes::all((float)image.width), tall = Lanes::all((float)image.height);
        Floats left = Lanes::least(px0, px1, px2) + (center_x - 0.5f - slack);
        Floats right = Lanes::most(px0, px1, px2) + (center_x - 0.5f + slack);
        Floats top = Lanes::least(py0, py1, py2) + (center_y - 0.5f - slack);
        Floats bottom = Lanes::most(py0, py1, py2) + (center_y - 0.5f + slack);
        // Pixels whose centres may be inside; for points anywhere, all that may be touched.
        if (image.first_packet) {
            left = __builtin_elementwise_floor(left + 0.5f);
            top = __builtin_elementwise_floor(top + 0.5f);
            right += 0.5f;
            bottom += 0.5f;
        }
        left = Lanes::most(crossing ? none : __builtin_elementwise_ceil(left), none);
        const float first = (float)image.first_row, last = (float)(image.view_height - 1);
        const Floats view_top = Lanes::most(crossing ? none : __builtin_elementwise_ceil(top) + first, none);
        const Floats view_bottom =
            Lanes::least(crossing ? Lanes::all(last) : __builtin_elementwise_floor(bottom) + first, Lanes::all(last));
        top = Lanes::most(view_top - first, none);
        right = Lanes::least(crossing ? wide : __builtin_elementwise_floor(right), wide - one);
        bottom = Lanes::least(view_bottom - first, tall - one);
        shown &= (zmax > none) & (left <= right) & (top <= bottom);
        if (!Lanes::any(shown)) return false;

        out.shown = shown;
        out.x0 = __builtin_convertvector(shown ? left : none, Ints);
        out.x1 = __builtin_convertvector(shown ? right : -one, Ints);
        out.y0 = __builtin_convertvector(shown ? top : none, Ints);
        out.y1 = __builtin_convertvector(shown ? bottom : -one, Ints);
        out.view_y0 = __builtin_convertvector(shown ? view_top : none, Ints);
        out.view_y1 = __builtin_convertvector(shown ? view_bottom : -one, Ints);
        const Floats sign = volume < none ? -one : one;
        out.edge[0] = edge(c[1], c[2], sign);
        out.edge[1] = edge(c[2], c[0], sign);
        out.edge[2] = edge(c[0], c[1], sign);
        const Floats scale = one / volume;
        out.w = Linear{normal.x * scale, normal.y * scale, normal.z * scale};
        out.least_w = crossing ? one / zmax : Lanes::least(i0, i1, i2);
        out.most_w = crossing ? Lanes::all(3e37f) : Lanes::most(i0, i1, i2);
        out.area = crossing ? Lanes::all(3e38f) : 0.5f * Lanes::size(volume) * (i0 * i1 * i2);
        return true;
    }
};

// One triangle in double precision: its first corner seen from the camera, and its normal, of any length.
struct ExactTriangle {
    double a[3], normal[3];

    static inline ExactTriangle of(const double* eye, const float* corners, int lane) {
        ExactTriangle t;
        double ab[3], ac[3];
        for (int k = 0; k < 3; ++k) {
            t.a[k] = corners[k * 16 + lane] - eye[k];
            ab[k] = (double)corners[(k + 3) * 16 + lane] - corners[k * 16 + lane];
            ac[k] = (double)corners[(k + 6) * 16 + lane] - corners[k * 16 + lane];
        }
        t.normal[0] = ab[1] * ac[2] - ab[2] * ac[1];
        t.normal[1] = ab[2] * ac[0] - ab[0] * ac[2];
        t.normal[2] = ab[0] * ac[1] - ab[1] * ac[0];
        return t;
    }
    // Negative where the camera sees the front.
    inline double volume() const { return normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2]; }
};

// The plane of one triangle in double precision. In single precision, w loses its digits where a plane is seen at a
// grazing angle: it is a small difference of large terms.
struct ExactPlane {
    double u, v, one;

    static inline ExactPlane of(const Eye& eye, const float* corners, int lane) {
        const ExactTriangle t = ExactTriangle::of(eye.exact_origin, corners, lane);
        const double* n = t.normal;
        const double scale = 1.0 / t.volume();
        const ExactRow* m = eye.exact_to_camera;
        return ExactPlane{(n[0] * m[0][0] + n[1] * m[0][1] + n[2] * m[0][2]) * scale,
                          (n[0] * m[1][0] + n[1] * m[1][1] + n[2] * m[1][2]) * scale,
                          (n[0] * m[2][0] + n[1] * m[2][1] + n[2] * m[2][2]) * scale};
    }
};
