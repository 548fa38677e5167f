// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays through any points of the image instead of the pixels' centres. The image's blocks of 4 x 4 pixels become cells
// that hold the points inside them, in packets of sixteen: each lane has its own u and v. A cell without points hides
// everything, so that the walk passes over what no point can see.

// Points of the world, in double precision: for where single precision does not tell whether a surface hides them.
struct Judge {
    const float* place;  // [point]: x y z
    Pose camera;
    double focal[2], tolerance;

    // Whether a point is farther along its ray, by more than the tolerance, than where that meets a triangle's plane.
    inline bool hides(const Eye& eye, const float* corners, int lane, int point) const {
        const double at[3] = {place[point * 3LL], place[point * 3LL + 1], place[point * 3LL + 2]};
        double seen[3], ray[3];  // in the camera's frame, and in that of the triangle
        camera.move_into(at, seen);
        const double way = __builtin_sqrt(seen[0] * seen[0] + (seen[1] * seen[1] + seen[2] * seen[2]));
        const ExactRow* m = eye.exact_to_camera;
        for (int k = 0; k < 3; ++k)
            ray[k] = seen[0] * focal[0] * m[0][k] + (seen[1] * focal[1] * m[1][k] + seen[2] * m[2][k]);
        const ExactTriangle t = ExactTriangle::of(eye.exact_origin, corners, lane);
        const double* n = t.normal;
        return t.volume() / (n[0] * ray[0] + (n[1] * ray[1] + n[2] * ray[2])) < 1.0 - tolerance / way;
    }
};

struct Sparse {
    // Sort the points of a strip into cells: count, sum up, place. `at` is x y x y ... in pixels of the view.
    static inline void place(const Image& image, const float* at, int count, double center_x, double center_y) {
        const int cells = image.tiles_x * image.tiles_y * 16;
        for (int c = 0; c <= cells; ++c) image.first_packet[c] = 0;
        for (int i = 0; i < count; ++i) {
            const int cell = cell_of(image, at + 2 * i);
            if (cell >= 0) image.first_packet[cell + 1] += 1;
        }
        for (int c = 0; c < cells; ++c)
            image.first_packet[c + 1] = image.first_packet[c] + ((image.first_packet[c + 1] + 15) >> 4);
        const int lanes = image.first_packet[cells] * 16;
        for (int i = 0; i < lanes; ++i) {
            image.point_index[i] = -1;
            image.w[i] = 3e38f;  // a lane without a point hides, and never shows
            image.point_u[i] = image.point_v[i] = 0.0f;
        }
        for (int i = 0; i < count; ++i) {
            const int cell = cell_of(image, at + 2 * i);
            if (cell < 0) continue;
            int lane = image.first_packet[cell] * 16;
            if (image.point_index[lane] >= 0) lane = next_lane(image, lane);
            image.point_index[lane] = i;
            image.point_u[lane] = (float)(at[2 * i] - center_x);
            image.point_v[lane] = (float)(at[2 * i + 1] - center_y);
            image.w[lane] = 0.0f;
        }
        for (int c = 0; c < cells; ++c)
            image.block_least[c] = image.first_packet[c] < image.first_packet[c + 1] ? 0.0f : 3e38f;
        for (int tile = 0; tile < cells / 16; ++tile) {
            image.tile_least[tile] = Lanes::least_of(Lanes::load(image.block_least + tile * 16));
            image.tile_stale[tile] = 0;
        }
        __builtin_memset(image.block_stale, 0, cells);
    }

    // The first lane of a cell counts those that are taken, in its id, which nobody needs before drawing begins.
    static inline int next_lane(const Image& image, int first) {
        image.id[first] = image.w[first + 1] == 3e38f ? 1 : image.id[first] + 1;
        return first + image.id[first];
    }

    // -1 for points outside the strip, and for those that are no numbers.
    static inline int cell_of(const Image& image, const float* at) {
        const float x = at[0], y = at[1] - (float)image.first_row;
        if (!(x >= 0.0f && x < (float)image.width && y >= 0.0f && y < (float)image.height)) return -1;
        return (Image::column_part((int)x) + image.row_part((int)y)) >> 4;
    }

    static inline void draw(const Eye& eye, const Image& image, const Cluster& cluster, Ints inexact, bool owner_id) {
        const unsigned rounded = Lanes::bits(inexact);
        for (unsigned left = Lanes::bits(cluster.shown); left; left &= left - 1) {
            const int k = Lanes::first_lane(left);
            Linear edge[3];
            for (int e = 0; e < 3; ++e) edge[e] = Linear::of_lane(cluster.edge[e], k);
            for (int ty = cluster.y0[k] >> 4; ty <= cluster.y1[k] >> 4; ++ty)
                for (int tx = cluster.x0[k] >> 4; tx <= cluster.x1[k] >> 4; ++tx)
                    if (image.least_of_tile(ty * image.tiles_x + tx) <= cluster.most_w[k])
                        draw_tile(eye, image, cluster, edge, k, tx, ty, (rounded >> k) & 1, owner_id);
        }
    }

    // The cells of a tile that the triangle touches: an edge's value is greatest at one of a cell's corners.
    static inline void draw_tile(const Eye& eye, const Image& image, const Cluster& t, const Linear* edge, int k,
                                 int tx, int ty, bool rounded, bool owner_id) {
        const Floats cell_x = {0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12};
        const Floats cell_y = {0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12};
        const Floats u0 = (cell_x + (float)(tx * 16)) + (eye.first_u - 0.501f), u1 = u0 + 4.002f;
        const Floats v0 = (cell_y + (float)(ty * 16 + image.first_row)) + (eye.first_v - 0.501f), v1 = v0 + 4.002f;
        const int tile = ty * image.tiles_x + tx;
        Ints touched = Lanes::load(image.block_least + tile * 16) <= Lanes::all(t.most_w[k]);
        for (int e = 0; e < 3; ++e) {
            const Floats u = edge[e].u >= Lanes::all(0.0f) ? u1 : u0, v = edge[e].v >= Lanes::all(0.0f) ? v1 : v0;
            touched &= edge[e].at(u, edge[e].row(v)) >= Lanes::all(0.0f);
        }
        for (unsigned left = Lanes::bits(touched); left; left &= left - 1) {
            const int cell = tile * 16 + Lanes::first_lane(left);
            for (int packet = image.first_packet[cell]; packet < image.first_packet[cell + 1]; ++packet)
                draw_packet(eye, image, t, edge, k, cell, packet, rounded, owner_id);
        }
    }

    static inline void draw_packet(const Eye& eye, const Image& image, const Cluster& t, const Linear* e, int k,
                                   int cell, int packet, bool rounded, bool owner_id) {
        const Floats u = Lanes::load(image.point_u + packet * 16), v = Lanes::load(image.point_v + packet * 16);
        const Floats old = Lanes::load(image.w + packet * 16), most_w = Lanes::all(t.most_w[k]);
        Ints inside = (old <= most_w) & (Lanes::least(e[0].at(u, e[0].row(v)), e[1].at(u, e[1].row(v)),
                                                      e[2].at(u, e[2].row(v))) >= Lanes::all(0.0f));
        if (!Lanes::any(inside)) return;
        const Linear plane = Linear::of_lane(t.w, k);
        const Floats least_w = Lanes::all(t.least_w[k]);
        Floats w = Lanes::most(Lanes::least(plane.at(u, plane.row(v)), most_w), least_w);
        if (rounded && image.id)
            for (unsigned left = Lanes::bits(inside); left; left &= left - 1) {
                const int lane = Lanes::first_lane(left);
                w[lane] = Raster::exact_w(eye, t, k, u[lane], v[lane]);
            }
        if (image.judge) inside = judge(eye, image, t, k, packet, inside, rounded, w);
        if (image.id)
            Raster::blend(image, packet, cell, inside, w, Raster::id_of(t, k, owner_id), true);
        else
            settle(image, packet, cell, inside & (w > old));
    }

    // Of the lanes that a triangle covers, without those whose points it does not hide though rounding may say that it
    // does; and w where it is the other way round. What is hidden already need not be looked at.
    static inline Ints judge(const Eye& eye, const Image& image, const Cluster& t, int k, int packet, Ints inside,
                             bool rounded, Floats& w) {
        const Floats limit = Lanes::load(image.w + packet * 16);
        Ints unsure = inside & (limit >= 0.999999f * t.least_w[k]);
        if (image.id) unsure &= Lanes::load(image.id + packet * 16) < Lanes::all_ints(0);
        if (!rounded) unsure &= Lanes::size(w - limit) <= 5e-6f * w;
        for (unsigned left = Lanes::bits(unsure); left; left &= left - 1) {
            const int lane = Lanes::first_lane(left);
            const bool hides = image.judge->hides(eye, t.corners, k, image.point_index[packet * 16 + lane]);
            inside[lane] = hides ? -1 : 0;
            if (hides && w[lane] <= limit[lane]) w[lane] = limit[lane] * 1.000001f;
        }
        return inside;
    }

    // Something hides these points: now their lanes hide all that comes.
    static inline void settle(const Image& image, int packet, int cell, Ints hit) {
        if (!Lanes::any(hit)) return;
        const Floats old = Lanes::load(image.w + packet * 16);
        Lanes::store(image.w + packet * 16, hit ? Lanes::all(3e38f) : old);
        image.touch(cell);
    }

    // Each point's results, to its place among the view's.
    static inline void write(Lookup& lookup, const Eye& eye, const Rays& rays, const Image& image, const Job& job,
                             const Images& out, long long view, bool owner_id) {
        const int lanes = image.first_packet[image.tiles_x * image.tiles_y * 16] * 16;
        for (int i = 0; i < lanes; ++i)
            if (image.point_index[i] >= 0)
                write_point(lookup, eye, rays, job, out, view * job.points + image.point_index[i], image.w[i],
                            image.id[i], image.point_u[i], image.point_v[i], owner_id);
        if (image.first_row > 0) return;
        // Points outside the image belong to no strip; the first one answers for them.
        const float* at = job.at + view * job.points * 2;
        for (int i = 0; i < job.points; ++i)
            if (!(at[2 * i] >= 0.0f && at[2 * i] < (float)job.width && at[2 * i + 1] >= 0.0f &&
                  at[2 * i + 1] < (float)job.height))
                write_point(lookup, eye, rays, job, out, view * job.points + i, 0.0f, -1, 0.0f, 0.0f, owner_id);
    }

    static inline void point_normal(Lookup& lookup, int id, float u, float v, float* normal) {
        Points round;
        const Doubles at_u = (Doubles)((double)u), at_v = (Doubles)((double)v);
        if (lookup.moving &&
            Lanes::any(lookup.solid_normals(Lanes::all_ints(id), Lanes::all_ints(-1), at_u, at_v, round))) {
            normal[0] = round.x[0];
            normal[1] = round.y[0];
            normal[2] = round.z[0];
        } else {
            lookup.normal_of(id, normal);
        }
    }

    static inline void write_point(Lookup& lookup, const Eye& eye, const Rays& rays, const Job& job, const Images& out,
                                   long long place, float w, int id, float u, float v, bool owner_id) {
        const float z = 1.0f / w, nothing = __builtin_nanf("");
        const bool near = w > 0.0f && z < job.near, seen = w > 0.0f && !near && z <= job.far;
        if (out.depth) out.depth[place] = seen ? z : near ? -__builtin_inff() : __builtin_inff();
        for (int c = 0; c < 3 && out.points; ++c)
            out.points[place * 3 + c] =
                seen ? z * (u * rays.right[c] + (v * rays.down[c] + rays.forward[c])) + eye.origin[c] : nothing;
        if (out.normals) {
            float normal[3] = {nothing, nothing, nothing};
            if (seen) point_normal(lookup, id, u, v, normal);
            for (int c = 0; c < 3; ++c) out.normals[place * 3 + c] = normal[c];
        }
        const int object = !seen ? -1 : owner_id ? id : lookup.object_of(id);
        if (out.segmentation) out.segmentation[place] = object;
        if (out.labels) out.labels[place] = object < 0 ? 0 : out.object_label[object];
    }
};
