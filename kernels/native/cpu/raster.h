// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// From sixteen triangles to pixels: small ones a pixel of each at a time, large ones block by block, slivers by
// rows.

struct Raster {
    // Triangles of at most this many pixels a side are drawn together, a lane each.
    enum { small_side = 6 };
    // Triangles that touch at most this many blocks are drawn block by block without looking at tiles first.
    enum { most_blocks = 20 };
    // Larger ones that cover less than a pixel of so many rows are drawn row by row.
    enum { rows_of_pixel = 2 };

    static inline void draw(const Eye& eye, const Image& image, const Cluster& cluster, bool with_id, bool owner_id) {
        // By their size in the whole view: how a triangle is drawn must not depend on where a strip cuts it.
        const Ints small = cluster.shown & (cluster.x1 - cluster.x0 < Lanes::all_ints(small_side)) &
                           (cluster.view_y1 - cluster.view_y0 < Lanes::all_ints(small_side));
        Ints inexact = loses_digits(eye, cluster);
        if (Lanes::any(small)) draw_small(eye, image, cluster, small, inexact, with_id, owner_id);
        const Ints larger = cluster.shown & ~small;
        if (!Lanes::any(larger)) return;
        inexact |= turns(eye, cluster);
        const Ints blocks =
            ((cluster.x1 >> 2) - (cluster.x0 >> 2) + 1) * ((cluster.view_y1 >> 2) - (cluster.view_y0 >> 2) + 1);
        const Ints medium = larger & ~inexact & (blocks <= Lanes::all_ints(most_blocks));
        for (unsigned left = Lanes::bits(medium); left; left &= left - 1)
            draw_medium(eye, image, cluster, Lanes::first_lane(left), with_id, owner_id);
        const Floats rows = __builtin_convertvector(cluster.view_y1 - cluster.view_y0 + 1, Floats);
        const Ints thin = larger & ~medium & (cluster.area * (float)rows_of_pixel <= rows);
        for (unsigned left = Lanes::bits(thin); left; left &= left - 1)
            draw_thin(eye, image, cluster, Lanes::first_lane(left), with_id, owner_id);
        for (unsigned left = Lanes::bits(larger & ~medium & ~thin); left; left &= left - 1)
            draw_large(eye, image, cluster, Lanes::first_lane(left), with_id, owner_id);
    }

    // Seen at a grazing angle, w is a small difference of large terms, and single precision is not enough.
    static inline Ints loses_digits(const Eye& eye, const Cluster& t) {
        const Floats u0 = __builtin_convertvector(t.x0, Floats) + eye.first_u;
        const Floats u1 = __builtin_convertvector(t.x1, Floats) + eye.first_u;
        const Floats v0 = __builtin_convertvector(t.view_y0, Floats) + eye.first_v;
        const Floats v1 = __builtin_convertvector(t.view_y1, Floats) + eye.first_v;
        const Floats u = Lanes::most(Lanes::size(u0), Lanes::size(u1)),
                     v = Lanes::most(Lanes::size(v0), Lanes::size(v1));
        return Lanes::size(t.w.u) * u + (Lanes::size(t.w.v) * v + Lanes::size(t.w.one)) > 16.0f * t.least_w;
    }

    // Nor is it where the rounding of corners turns the plane of a sliver.
    static inline Ints turns(const Eye& eye, const Cluster& t) {
        const Floats width = __builtin_convertvector(t.x1 - t.x0, Floats);
        const Floats height = __builtin_convertvector(t.view_y1 - t.view_y0, Floats);
        const Floats change = Lanes::size(t.w.u) * width + Lanes::size(t.w.v) * height;
        return eye.blur * (width + height) * change > 6e-6f * t.least_w * t.area;
    }

    static inline int id_of(const Cluster& cluster, int lane, bool owner_id) {
        if (!owner_id) return cluster.first_id + lane;
        return Tree::object_of(cluster.owners[lane]);
    }

    // Of two surfaces at one depth, that of the lesser id is seen, whichever comes first.
    static inline void put(const Image& image, int pixel, float w, int id, bool with_id) {
        float& old = image.w[pixel];
        if (with_id) {
            if (w < old || (w == old && id >= image.id[pixel])) return;
            image.id[pixel] = id;
        } else if (w <= old) {
            return;
        }
        old = w;
        image.touch(pixel >> 4);
    }

    static inline float exact_w(const Eye& eye, const Cluster& t, int k, float u, float v) {
        const ExactPlane plane = ExactPlane::of(eye, t.corners, k);
        const float w = (float)(plane.u * u + (plane.v * v + plane.one));
        return w < t.least_w[k] ? t.least_w[k] : w > t.most_w[k] ? t.most_w[k] : w;
    }

    // Lane k looks at the pixel (x, y) of its own triangle's bounds; all lanes step through x and y together.
    static inline void draw_small(const Eye& eye, const Image& image, const Cluster& t, Ints small, Ints inexact,
                                  bool with_id, bool owner_id) {
        const Floats none = Lanes::all(0.0f);
        const Ints last_x = small ? t.x1 : Lanes::all_ints(-1), last_y = small ? t.y1 : Lanes::all_ints(-1);
        const unsigned rounded = Lanes::bits(inexact);
        const int steps_x = __builtin_reduce_max(small ? t.x1 - t.x0 : Lanes::all_ints(0));
        const int steps_y = __builtin_reduce_max(small ? t.y1 - t.y0 : Lanes::all_ints(0));
        for (int dy = 0; dy <= steps_y; ++dy) {
            const Ints y = t.y0 + dy;
            const Floats v = __builtin_convertvector(y + image.first_row, Floats) + eye.first_v;
            const Floats row0 = t.edge[0].row(v), row1 = t.edge[1].row(v), row2 = t.edge[2].row(v);
            const Floats row_w = t.w.row(v);
            for (int dx = 0; dx <= steps_x; ++dx) {
                const Ints x = t.x0 + dx;
                const Floats u = __builtin_convertvector(x, Floats) + eye.first_u;
                const Floats inner = Lanes::least(t.edge[0].at(u, row0), t.edge[1].at(u, row1), t.edge[2].at(u, row2));
                const unsigned hits = Lanes::bits((inner >= none) & (x <= last_x) & (y <= last_y));
                if (!hits) continue;
                const Floats w = Lanes::most(Lanes::least(t.w.at(u, row_w), t.most_w), t.least_w);
                float value[16];
                int at_x[16], at_y[16];
                Lanes::store(value, w);
                Lanes::store(at_x, x);
                Lanes::store(at_y, y);
                for (unsigned left = hits & rounded; left; left &= left - 1) {
                    const int k = Lanes::first_lane(left);
                    value[k] = exact_w(eye, t, k, u[k], v[k]);
                }
                for (unsigned left = hits; left; left &= left - 1) {
                    const int k = Lanes::first_lane(left);
                    const int pixel = Image::column_part(at_x[k]) + image.row_part(at_y[k]);
                    put(image, pixel, value[k], with_id ? id_of(t, k, owner_id) : 0, with_id);
                }
            }
        }
    }

    // A triangle of a few blocks.
    static inline void draw_medium(const Eye& eye, const Image& image, const Cluster& t, int k, bool with_id,
                                   bool owner_id) {
        const Linear e0 = Linear::of_lane(t.edge[0], k), e1 = Linear::of_lane(t.edge[1], k),
                     e2 = Linear::of_lane(t.edge[2], k);
        const Linear plane = Linear::of_lane(t.w, k);
        const Floats least_w = Lanes::all(t.least_w[k]), most_w = Lanes::all(t.most_w[k]);
        const int id = with_id ? id_of(t, k, owner_id) : 0;
        const int bx0 = t.x0[k] >> 2, bx1 = t.x1[k] >> 2, by0 = t.y0[k] >> 2, by1 = t.y1[k] >> 2;
        for (int by = by0; by <= by1; ++by) {
            const Floats v = (pixel_row() + (float)(by * 4 + image.first_row)) + eye.first_v;
            const Floats row0 = e0.row(v), row1 = e1.row(v), row2 = e2.row(v), row_w = plane.row(v);
            for (int bx = bx0; bx <= bx1; ++bx) {
                const Floats u = (pixel_column() + (float)(bx * 4)) + eye.first_u;
                const Floats w = Lanes::most(Lanes::least(plane.at(u, row_w), most_w), least_w);
                const Ints inside = Lanes::least(e0.at(u, row0), e1.at(u, row1), e2.at(u, row2)) >= Lanes::all(0.0f);
                const int block = image.block_at(bx, by);
                blend(image, block, block, inside, w, id, with_id);
            }
        }
    }

    // Where the pixels of a block are in it. Whole numbers: sums of them are exact, in whatever order.
    static inline Floats pixel_column() { return Floats{0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3}; }
    static inline Floats pixel_row() { return Floats{0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3}; }

    // Keep the nearer surface in each pixel of a block, or in each point of a packet in it.
    static inline void blend(const Image& image, int packet, int block, Ints inside, Floats w, int id, bool with_id) {
        float* at = image.w + packet * 16;
        const Floats old = Lanes::load(at);
        if (!with_id) {
            const Ints hit = inside & (w > old);
            if (!Lanes::any(hit)) return;
            Lanes::store(at, hit ? w : old);
        } else {
            int* id_at = image.id + packet * 16;
            const Ints old_id = Lanes::load(id_at), new_id = Lanes::all_ints(id);
            const Ints hit = inside & ((w > old) | ((w == old) & (new_id < old_id)));
            if (!Lanes::any(hit)) return;
            Lanes::store(at, hit ? w : old);
            Lanes::store(id_at, hit ? new_id : old_id);
        }
        image.touch(block);
    }

    // A sliver, by sixteen rows of pixels at a time: most of them it passes between two pixels' centres.
    static inline void draw_thin(const Eye& eye, const Image& image, const Cluster& t, int k, bool with_id,
                                 bool owner_id) {
        const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        const int id = with_id ? id_of(t, k, owner_id) : 0;
        Linear edge[3];
        for (int e = 0; e < 3; ++e) edge[e] = Linear::of_lane(t.edge[e], k);
        for (int first = t.y0[k]; first <= t.y1[k]; first += 16) {
            const Ints y = lane + first;
            const Floats v = __builtin_convertvector(y + image.first_row, Floats) + eye.first_v;
            Floats left = Lanes::all((float)t.x0[k]), right = Lanes::all((float)t.x1[k]);
            for (int e = 0; e < 3; ++e) narrow(eye, edge[e], v, v, left, right);
            Ints here = y <= Lanes::all_ints(t.y1[k]);
            for (Floats x = __builtin_elementwise_ceil(left);; x += 1.0f) {
                here &= x <= right;
                if (!Lanes::any(here)) break;
                const Floats u = x + eye.first_u;
                const Floats inner = Lanes::least(edge[0].at(u, edge[0].row(v)), edge[1].at(u, edge[1].row(v)),
                                                  edge[2].at(u, edge[2].row(v)));
                for (unsigned hits = Lanes::bits(here & (inner >= Lanes::all(0.0f))); hits; hits &= hits - 1) {
                    const int r = Lanes::first_lane(hits);
                    const int pixel = Image::column_part((int)x[r]) + image.row_part(first + r);
                    put(image, pixel, exact_w(eye, t, k, u[r], v[r]), id, with_id);
                }
            }
        }
    }

    // Rows from `left` to `right`, between v0 and v1 in the image, without what lies beyond an edge by more than rounding
    // can be wrong.
    static inline void narrow(const Eye& eye, const Linear& edge, Floats v0, Floats v1, Floats& left, Floats& right) {
        const float by = -1.0f / edge.u[0];
        if (!(__builtin_fabsf(by) < 1e30f)) return;  // it runs along the rows
        const Floats x0 = edge.row(v0) * by - eye.first_u, x1 = edge.row(v1) * by - eye.first_u;
        const Floats size = Lanes::size(edge.v) * Lanes::most(Lanes::size(v0), Lanes::size(v1)) + Lanes::size(edge.one);
        const Floats slack = 0.01f + 4e-7f * __builtin_fabsf(by) * size;
        if (edge.u[0] > 0.0f)
            left = Lanes::most(left, Lanes::least(x0, x1) - slack);
        else
            right = Lanes::least(right, Lanes::most(x0, x1) + slack);
    }

    // A triangle of many pixels, in scalars, for sixteen pixels or blocks at a time.
    struct Large {
        Linear edge[3];
        ExactPlane plane;
        Floats slope;  // w in a block, less w at its first pixel
        float least_w, most_w;
        int id;
    };

    static inline void draw_large(const Eye& eye, const Image& image, const Cluster& t, int k, bool with_id,
                                  bool owner_id) {
        Large one;
        for (int e = 0; e < 3; ++e) one.edge[e] = Linear::of_lane(t.edge[e], k);
        one.plane = ExactPlane::of(eye, t.corners, k);
        one.slope = (float)one.plane.u * pixel_column() + (float)one.plane.v * pixel_row();
        one.least_w = t.least_w[k];
        one.most_w = t.most_w[k];
        one.id = with_id ? id_of(t, k, owner_id) : 0;
        const int x0 = t.x0[k], x1 = t.x1[k], y0 = t.y0[k], y1 = t.y1[k];
        const int tx0 = x0 >> 4, tx1 = x1 >> 4, ty0 = y0 >> 4, ty1 = y1 >> 4;
        int from[16], to[16];  // tiles of a row
        for (int ty = ty0; ty <= ty1; ++ty) {
            const int row = (ty - ty0) & 15;
            if (row == 0) touched_tiles(eye, image, t, k, ty, tx0, tx1, from, to);
            for (int tx = from[row]; tx <= to[row]; ++tx) draw_tile(eye, image, one, tx, ty, x0, x1, y0, y1, with_id);
        }
    }

    // What of sixteen rows of tiles is between a triangle's edges; all of it where there is too little to gain.
    static inline void touched_tiles(const Eye& eye, const Image& image, const Cluster& t, int k, int first, int tx0,
                                     int tx1, int* from, int* to) {
        Ints begin = Lanes::all_ints(tx0), end = Lanes::all_ints(tx1);
        if (tx1 - tx0 > 2) {
            const Ints lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
            const Floats top = __builtin_convertvector((lane + first) * 16 + image.first_row, Floats) + eye.first_v;
            Floats left = Lanes::all((float)(tx0 * 16)), right = Lanes::all((float)(tx1 * 16 + 15));
            for (int e = 0; e < 3; ++e) narrow(eye, Linear::of_lane(t.edge[e], k), top, top + 15.0f, left, right);
            const Ints some = left <= right;
            begin = __builtin_convertvector(some ? left : Lanes::all(16.0f), Ints) >> 4;
            end = __builtin_convertvector(some ? Lanes::most(right, Lanes::all(0.0f)) : Lanes::all(0.0f), Ints) >> 4;
        }
        Lanes::store(from, begin);
        Lanes::store(to, end);
    }

    // An edge's value is greatest, and least, at corners of a block: rounding does not change the order, so that the
    // test of the corner pixel never contradicts that of another pixel.
    static inline void draw_tile(const Eye& eye, const Image& image, const Large& t, int tx, int ty, int x0, int x1,
                                 int y0, int y1, bool with_id) {
        const Ints block_x = {0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12};
        const Ints block_y = {0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12};
        const Ints x = block_x + tx * 16, y = block_y + ty * 16;
        const Floats none = Lanes::all(0.0f);
        const Floats u0 = __builtin_convertvector(x, Floats) + eye.first_u;
        const Floats u1 = __builtin_convertvector(x + 3, Floats) + eye.first_u;
        const Floats v0 = __builtin_convertvector(y + image.first_row, Floats) + eye.first_v;
        const Floats v1 = __builtin_convertvector(y + 3 + image.first_row, Floats) + eye.first_v;
        Ints touched = (x + 3 >= x0) & (x <= x1) & (y + 3 >= y0) & (y <= y1);
        Ints covered = touched;
        for (int e = 0; e < 3; ++e) {
            const Linear& edge = t.edge[e];
            const Ints right = edge.u >= none, down = edge.v >= none;
            touched &= edge.at(right ? u1 : u0, edge.row(down ? v1 : v0)) >= none;
            covered &= edge.at(right ? u0 : u1, edge.row(down ? v0 : v1)) >= none;
        }
        if (!Lanes::any(touched)) return;

        // The nearest the plane gets in a block, and a little nearer.
        const int tile = ty * image.tiles_x + tx;
        const float pu = (float)t.plane.u, pv = (float)t.plane.v;
        const double base = t.plane.one + t.plane.u * u0[0] + t.plane.v * v0[0];
        const Floats offset_x = __builtin_convertvector(block_x, Floats),
                     offset_y = __builtin_convertvector(block_y, Floats);
        const float reach = 3.0f * ((pu > 0 ? pu : 0) + (pv > 0 ? pv : 0));
        Floats nearest = (pu * offset_x + pv * offset_y) + ((float)base + reach);
        nearest = Lanes::least(nearest * 1.00001f + 1e-30f, Lanes::all(t.most_w));
        touched &= ~(Lanes::load(image.block_least + tile * 16) > nearest);

        const unsigned whole = Lanes::bits(covered);
        for (unsigned left = Lanes::bits(touched); left; left &= left - 1) {
            const int b = Lanes::first_lane(left);
            const double at_block = base + t.plane.u * block_x[b] + t.plane.v * block_y[b];
            draw_block(eye, image, t, tile * 16 + b, x[b], y[b], (float)at_block, (whole >> b) & 1, with_id);
        }
    }

    static inline void draw_block(const Eye& eye, const Image& image, const Large& t, int block, int x, int y,
                                  float w_of_first, bool covered, bool with_id) {
        const Floats w = Lanes::most(Lanes::least(t.slope + w_of_first, Lanes::all(t.most_w)), Lanes::all(t.least_w));
        Ints inside = Lanes::all_ints(-1);
        if (!covered) {
            const Floats u = (pixel_column() + (float)x) + eye.first_u;
            const Floats v = (pixel_row() + (float)(y + image.first_row)) + eye.first_v;
            const Linear* e = t.edge;
            inside = Lanes::least(e[0].at(u, e[0].row(v)), e[1].at(u, e[1].row(v)), e[2].at(u, e[2].row(v))) >=
                     Lanes::all(0.0f);
        }
        blend(image, block, block, inside, w, t.id, with_id);
    }
};
