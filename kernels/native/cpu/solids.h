// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Analytic intersection of rays and solids seen from outside.
//
// Coordinates are the object's, divided by the solid's factors along x, y and z: there it is a unit ball, or a unit
// cylinder with flat ends or hemispheres. A ray is camera + z * d, where z is the depth and d is linear in u and v. Let
// C be the square of the camera's distance from a ball's center minus 1, and p and s the components of d toward the
// center and perpendicular to it: then inv_z (w here) solves C w^2 - 2 sqrt(C + 1) p w + p^2 + s^2 = 0. The same holds
// for a cylinder, without the z coordinate.

#pragma once

#include "cpu/raster.h"

// Points in double precision, one per lane.
struct ExactPoints {
    Doubles x, y, z;

    static inline Doubles dot(ExactPoints a, ExactPoints b) { return a.x * b.x + (a.y * b.y + a.z * b.z); }
    static inline ExactPoints cross(ExactPoints a, ExactPoints b) {
        return ExactPoints{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    }
};

// A solid and a camera in double precision: decides whether the camera is outside, and computes normals.
struct Solid {
    double inverse[3], half;  // scale of the object's frame; half length of the straight part after scaling
    double viewpoint[3];
    double ray[3][3];  // d is the linear combination of these with coefficients u, v and 1
    int kind;

    static inline Solid none() {
        Solid solid;
        solid.kind = SOLID_NONE;
        return solid;
    }
    static inline Solid of(int kind, const float* size, const Camera& camera) {
        Solid solid;
        solid.kind = kind;
        solid.half = size[3];
        for (int k = 0; k < 3; ++k) {
            solid.inverse[k] = 1.0 / size[k];
            solid.viewpoint[k] = camera.exact_origin[k] * solid.inverse[k];
            for (int i = 0; i < 3; ++i) solid.ray[i][k] = camera.exact_to_camera[i][k] * solid.inverse[k];
        }
        return solid;
    }

    // Distance of the camera beyond the straight part, along the axis; negative if it is alongside.
    inline double beyond() const { return __builtin_fabs(viewpoint[2]) - half; }
    inline double end_ahead() const { return viewpoint[2] < 0 ? -half : half; }

    // Computed by the same sums as the quadrics: if this is true, one of them has a positive C.
    inline bool outside() const {
        const double along = beyond() > 0 ? beyond() : 0.0,
                     from[3] = {viewpoint[0], viewpoint[1], kind == SOLID_CYLINDER ? 0.0 : along};
        return dot(from, from) > 1.0 || (kind == SOLID_CYLINDER && along > 0);
    }

    // Height of the center of the ball that a part belongs to.
    inline double height(int part) const {
        return kind != SOLID_CAPSULE || part == PART_SIDE ? 0.0 : part == PART_UPPER ? half : -half;
    }
    // Whether a part is a cylinder: PART_SIDE except that of a ball. PART_UPPER of a cylinder is its visible end; all
    // other parts are balls.
    inline bool is_side(int part) const { return kind != SOLID_BALL && part == PART_SIDE; }

    // The camera relative to the center of a part's quadric.
    inline void from_middle(int part, double* from) const {
        from[0] = viewpoint[0];
        from[1] = viewpoint[1];
        from[2] = is_side(part) ? 0.0 : viewpoint[2] - height(part);
    }

    // Unit normals of the parts at rays, in the object's frame: the gradient at the intersection, times 1 / z, which
    // stays exact if the camera is far away.
    inline ExactPoints normals(Ints part, Doubles u, Doubles v) const {
        const Doubles one = (Doubles)(1.0), none = (Doubles)(0.0), above = flag(part == (int)PART_UPPER),
                      below = flag(part == (int)PART_LOWER);
        const Doubles side = kind == SOLID_BALL ? none : flag(part == (int)PART_SIDE),
                      end = kind == SOLID_CYLINDER ? above : none;
        const ExactPoints d = {ray[0][0] * u + (ray[1][0] * v + ray[2][0]), ray[0][1] * u + (ray[1][1] * v + ray[2][1]),
                               (one - side) * (ray[0][2] * u + (ray[1][2] * v + ray[2][2]))};
        const ExactPoints c = {viewpoint[0] + none, viewpoint[1] + none,
                               (one - side) * (viewpoint[2] - half * (above - below))};
        const ExactPoints e = ExactPoints::cross(c, d);
        const Doubles square = ExactPoints::dot(d, d) - ExactPoints::dot(e, e);
        const Doubles reach = __builtin_elementwise_sqrt(square > none ? square : none) - ExactPoints::dot(c, d);
        const Doubles power = ExactPoints::dot(c, c) - one;
        const double facing = viewpoint[2] < 0 ? -1.0 : 1.0;
        ExactPoints n = {(one - end) * (c.x * reach + power * d.x) * inverse[0],
                         (one - end) * (c.y * reach + power * d.y) * inverse[1],
                         (one - end) * (c.z * reach + power * d.z) * inverse[2] + end * facing};
        const Doubles scale = one / __builtin_elementwise_sqrt(ExactPoints::dot(n, n));
        return ExactPoints{n.x * scale, n.y * scale, n.z * scale};
    }
    static inline Doubles flag(Ints mask) { return __builtin_convertvector(-mask, Doubles); }

    static inline double dot(const double* a, const double* b) { return a[0] * b[0] + (a[1] * b[1] + a[2] * b[2]); }
};

// Image point about which linear forms are expanded, near the projection of the solid, so that single precision
// suffices. It depends only on the view and the object, so that results do not depend on strips or packets.
struct Expansion {
    double u, v;
    float x, y;  // the same in the coordinates of the lanes: pixel indices in the view, or u and v of points

    // Projection of the point at height `z` on the solid's axis, clamped to the image.
    static inline Expansion of(const Solid& solid, double z, const Camera& camera, const Image& image,
                               const double* center) {
        const ExactRow* m = camera.exact_to_camera;
        const double* o = camera.exact_origin;
        const double to[3] = {-o[0], -o[1], z / solid.inverse[2] - o[2]}, depth = Solid::dot(m[2], to);
        double u = 0.0, v = 0.0;
        if (depth > 0) {
            u = Solid::dot(m[0], to) / (Solid::dot(m[0], m[0]) * depth);
            v = Solid::dot(m[1], to) / (Solid::dot(m[1], m[1]) * depth);
        }
        Expansion local;
        const int x = pixel(u + center[0], image.width), y = pixel(v + center[1], image.view_height);
        local.u = x + 0.5 - center[0];
        local.v = y + 0.5 - center[1];
        local.x = (float)x;
        local.y = (float)y;
        if (image.first_packet) {
            local.u = local.x = (float)local.u;
            local.v = local.y = (float)local.v;
        }
        return local;
    }
    static inline int pixel(double place, int count) { return place > 0 ? place < count ? (int)place : count - 1 : 0; }
};

// A linear function of u and v, expanded about an image point, for cases in which single precision does not suffice
// even there: w of a plane at a grazing angle is a small difference of large terms.
struct ExactLinearForm {
    double u, v, one;

    // The component of d along a direction.
    static inline ExactLinearForm of(const double* along, const Solid& solid, const Expansion& center) {
        const double du = Solid::dot(along, solid.ray[0]), dv = Solid::dot(along, solid.ray[1]);
        return ExactLinearForm{du, dv, Solid::dot(along, solid.ray[2]) + du * center.u + dv * center.v};
    }
    inline Floats at(Floats from_x, Floats from_y) const {
        const Doubles x = __builtin_convertvector(from_x, Doubles), y = __builtin_convertvector(from_y, Doubles);
        return __builtin_convertvector(u * x + (v * y + one), Floats);
    }
};

// The same in single precision.
struct LinearForm {
    float u, v, one;

    static inline LinearForm of(const double* along, const Solid& solid, const Expansion& center) {
        const ExactLinearForm exact = ExactLinearForm::of(along, solid, center);
        return LinearForm{(float)exact.u, (float)exact.v, (float)exact.one};
    }
    inline Floats at(Floats from_x, Floats from_y) const { return u * from_x + (v * from_y + one); }
    // Greatest change within a distance along x and y.
    inline float change(float away) const { return away * (__builtin_fabsf(u) + __builtin_fabsf(v)); }
};

// A unit ball or an infinite cylinder: w = (distance * p + sqrt(p^2 - t^2)) / C, where t = sqrt(C) s.
struct Quadric {
    Expansion local;
    LinearForm toward, across[2];  // p, and the two components of t
    float distance, inverse;  // sqrt(C + 1), 1 / C

    // All zero, which no ray hits, for the side of a solid if the camera is inside the infinite cylinder, beyond an
    // end.
    static inline Quadric of(const Solid& solid, int part, const Expansion& local) {
        Quadric q = {local, {0, 0, 0}, {{0, 0, 0}, {0, 0, 0}}, 0.0f, 0.0f};
        double o[3];
        solid.from_middle(part, o);
        const double square = Solid::dot(o, o), power = square - 1.0;
        if (!(power > 0)) return q;
        const double distance = __builtin_sqrt(square), scale = 1.0 / distance, stretch = __builtin_sqrt(power);
        const double n[3] = {-o[0] * scale, -o[1] * scale, -o[2] * scale};
        q.distance = (float)distance;
        q.inverse = (float)(1.0 / power);
        q.toward = LinearForm::of(n, solid, local);
        // Two directions perpendicular to n (Duff et al. 2017); of a cylinder, only the one perpendicular to its axis.
        const double sign = n[2] < 0 ? -1.0 : 1.0, a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
        if (solid.is_side(part)) {
            const double right[3] = {-n[1] * stretch, n[0] * stretch, 0.0};
            q.across[0] = LinearForm::of(right, solid, local);
        } else {
            const double right[3] = {(1.0 + sign * n[0] * n[0] * a) * stretch, sign * b * stretch,
                                     -sign * n[0] * stretch};
            const double down[3] = {b * stretch, (sign + n[1] * n[1] * a) * stretch, -n[1] * stretch};
            q.across[0] = LinearForm::of(right, solid, local);
            q.across[1] = LinearForm::of(down, solid, local);
        }
        return q;
    }
};

// Intersections of rays: 1 / z, 0 if a ray misses, and the part of the solid.
struct SolidHit {
    Floats inv_z;
    Ints part;
};

// A solid, set up for an image.
struct SolidSetup {
    int kind;
    Quadric quadric[SOLID_PARTS];  // of the parts that are quadrics
    LinearForm along;  // C * inv_z * (mean of both roots' coordinates along the axis)
    float camera_z, half;
    Expansion end_local;  // of the end of a cylinder that the camera sees, if any
    ExactLinearForm end_inv_z;  // inv_z times the camera's distance from the plane of that end
    LinearForm end_x, end_y;  // intersections with that plane, times the same factor
    float end_inverse, end_slack;

    static inline SolidSetup of(const Solid& solid, const Camera& camera, const Image& image, const double* center) {
        SolidSetup setup;
        setup.kind = solid.kind;
        setup.half = (float)solid.half;
        setup.camera_z = (float)solid.viewpoint[2];
        const Expansion middle = Expansion::of(solid, 0.0, camera, image, center);
        setup.quadric[PART_SIDE] = Quadric::of(solid, PART_SIDE, middle);
        if (solid.kind == SOLID_BALL) return setup;
        const double *o = solid.viewpoint, power = o[0] * o[0] + o[1] * o[1] - 1.0;
        const double along[3] = {-o[2] * o[0], -o[2] * o[1], power};
        setup.along = LinearForm::of(along, solid, middle);
        if (solid.kind == SOLID_CAPSULE)
            for (int part = PART_UPPER; part < SOLID_PARTS; ++part)
                setup.quadric[part] =
                    Quadric::of(solid, part, Expansion::of(solid, solid.height(part), camera, image, center));
        else
            setup.set_end(solid, Expansion::of(solid, solid.end_ahead(), camera, image, center));
        return setup;
    }

    inline void set_end(const Solid& solid, const Expansion& local) {
        end_local = local;
        end_inv_z = ExactLinearForm{0, 0, 0};  // which no ray hits
        end_x = end_y = LinearForm{0, 0, 0};
        end_inverse = 0.0f;
        end_slack = (float)(1e-5 * (1.0 + solid.half + __builtin_fabs(solid.viewpoint[2])));
        const double distance = solid.beyond(), down = solid.viewpoint[2] < 0 ? 1.0 : -1.0;
        if (!(distance > 0)) return;
        const double toward[3] = {0.0, 0.0, down}, x[3] = {distance, 0.0, solid.viewpoint[0] * down},
                     y[3] = {0.0, distance, solid.viewpoint[1] * down};
        end_inv_z = ExactLinearForm::of(toward, solid, local);
        end_x = LinearForm::of(x, solid, local);
        end_y = LinearForm::of(y, solid, local);
        end_inverse = (float)(1.0 / distance);
    }

    inline SolidHit at(Floats x, Floats y) const {
        if (kind == SOLID_BALL) return SolidHit{ball(quadric[PART_SIDE], x, y), Lanes::all_ints(PART_SIDE)};
        return kind == SOLID_CAPSULE ? capsule(x, y) : cylinder(x, y);
    }

    // The balls are complete, so that no ray slips between them and the side. They touch the side from inside: if both
    // are hit, the side counts, even at equal w.
    inline SolidHit capsule(Floats x, Floats y) const {
        const Side side = Side::of(*this, x, y);
        const Ints straight = side.hit & side.within(half);
        const Floats above = ball(quadric[PART_UPPER], x, y), below = ball(quadric[PART_LOWER], x, y);
        const Ints part = above >= below ? Lanes::all_ints(PART_UPPER) : Lanes::all_ints(PART_LOWER);
        return SolidHit{straight ? side.inv_z : Lanes::max(above, below), straight ? Lanes::all_ints(PART_SIDE) : part};
    }

    // Whether rays within a distance along x and y may hit the solid. All of it is inside the ball or infinite cylinder
    // of PART_SIDE, which excludes nothing if the camera is inside too.
    inline Ints near(Floats x, Floats y, float away) const {
        const Quadric& q = quadric[PART_SIDE];
        if (!(q.distance > 0)) return Lanes::all_ints(-1);
        const Floats dx = x - q.local.x, dy = y - q.local.y, none = Lanes::all(0.0f);
        const Floats p = q.toward.at(dx, dy) + q.toward.change(away);
        const Floats right = Lanes::max(Lanes::abs(q.across[0].at(dx, dy)) - q.across[0].change(away), none);
        const Floats down = Lanes::max(Lanes::abs(q.across[1].at(dx, dy)) - q.across[1].change(away), none);
        return (p > none) & (p * p >= right * right + down * down);
    }

    static inline Floats ball(const Quadric& q, Floats x, Floats y) {
        const Floats dx = x - q.local.x, dy = y - q.local.y, none = Lanes::all(0.0f);
        const Floats p = q.toward.at(dx, dy), right = q.across[0].at(dx, dy), down = q.across[1].at(dx, dy);
        const Floats square = p * p - (right * right + down * down);
        const Floats inv_z = (q.distance * p + __builtin_elementwise_sqrt(Lanes::max(square, none))) * q.inverse;
        return ((square >= none) & (p > none)) ? inv_z : none;
    }

    // Intersections with the infinite cylinder. The coordinate along the axis, times `reach`, is computed from the mean
    // of the roots, a separate linear form: the sum of the camera's coordinate and the distance from there would lose
    // digits.
    struct Side {
        Floats inv_z, along, reach;
        Ints hit;

        static inline Side of(const SolidSetup& setup, Floats x, Floats y) {
            const Quadric& q = setup.quadric[PART_SIDE];
            const Floats dx = x - q.local.x, dy = y - q.local.y, none = Lanes::all(0.0f);
            const Floats p = q.toward.at(dx, dy), across = q.across[0].at(dx, dy);
            const Floats square = p * p - across * across;
            const Floats root = __builtin_elementwise_sqrt(Lanes::max(square, none));
            const Floats reach = q.distance * p + root;
            return Side{reach * q.inverse, setup.along.at(dx, dy) + setup.camera_z * root, reach,
                        (square >= none) & (p > none)};
        }
        inline Ints within(float half_length) const { return Lanes::abs(along) <= half_length * reach; }
    };

    // A ray that misses both the side and the end by no more than rounding passes through the rim between them, and
    // counts as a hit.
    inline SolidHit cylinder(Floats x, Floats y) const {
        const Side side = Side::of(*this, x, y);
        const Floats dx = x - end_local.x, dy = y - end_local.y, none = Lanes::all(0.0f);
        const Floats inv_z = end_inv_z.at(dx, dy), end_u = end_x.at(dx, dy), end_v = end_y.at(dx, dy);
        const Floats square = end_u * end_u + end_v * end_v;
        const Ints ahead = inv_z > none, end = ahead & (square <= inv_z * inv_z);
        const Ints rim = ahead & (square <= 1.00001f * inv_z * inv_z) & side.within(half + end_slack);
        const Ints hit = side.hit & (side.within(half) | rim);
        return SolidHit{end ? inv_z * end_inverse : (hit ? side.inv_z : none),
                        end ? Lanes::all_ints(PART_UPPER) : Lanes::all_ints(PART_SIDE)};
    }
};

struct Solids {
    // The ids from `id` on stand for the solid's parts, in order. Not inlined, so that the caller stays as small and
    // fast as without solids.
    static __attribute__((noinline)) void render(const Solid& solid, const Camera& camera, const Image& image,
                                                 const double* center, const Visit& visit, int id, Mode mode) {
        const SolidSetup setup = SolidSetup::of(solid, camera, image, center);
        const int ty1 = visit.y1 >> TILE_SHIFT, tx1 = visit.x1 >> TILE_SHIFT;
        for (int ty = visit.y0 >> TILE_SHIFT; ty <= ty1; ++ty)
            for (int tx = visit.x0 >> TILE_SHIFT; tx <= tx1; ++tx) {
                const int tile = ty * image.tiles_x + tx;
                for (const int b : Lanes::each(blocks(setup, camera, image, visit, tx, ty))) {
                    const int block = tile * TILE_BLOCKS + b;
                    if (image.min_of_block(block) > visit.nearest_inv_z) continue;
                    if (image.first_packet) {
                        render_cell(setup, image, block, id, mode);
                        continue;
                    }
                    const int first_x = tx * TILE_SIDE + (b & (BLOCKS_ACROSS - 1)) * BLOCK_SIDE;
                    const int first_y = ty * TILE_SIDE + (b / BLOCKS_ACROSS) * BLOCK_SIDE;
                    const Floats x = Grid::column_floats() + (float)first_x;
                    const Floats y = Grid::row_floats() + (float)(first_y + image.first_row);
                    store(setup.at(x, y), image, block, block, id, mode);
                }
            }
    }

    // Bit mask of a tile's blocks that may show the solid.
    static inline unsigned blocks(const SolidSetup& setup, const Camera& camera, const Image& image, const Visit& visit,
                                  int tx, int ty) {
        const int last = BLOCK_SIDE - 1;
        const Ints x = Grid::block_x() + tx * TILE_SIDE, y = Grid::block_y() + ty * TILE_SIDE;
        const Ints inside = (x + last >= visit.x0) & (x <= visit.x1) & (y + last >= visit.y0) & (y <= visit.y1);
        // Distance from a block's middle to its outermost pixel centers, or to its edges, and a margin for rounding.
        const float to_centers = 0.5f * last, to_edges = 0.5f * BLOCK_SIDE, rounding = 0.05f;
        Floats u = __builtin_convertvector(x, Floats) + to_centers;
        Floats v = __builtin_convertvector(y + image.first_row, Floats) + to_centers;
        if (image.first_packet) {
            u += camera.first_u;
            v += camera.first_v;
        }
        return Lanes::bits(inside & setup.near(u, v, (image.first_packet ? to_edges : to_centers) + rounding));
    }

    static inline void render_cell(const SolidSetup& setup, const Image& image, int cell, int id, Mode mode) {
        for (int packet = image.first_packet[cell]; packet < image.first_packet[cell + 1]; ++packet) {
            const Floats u = Lanes::load(image.point_u + packet * LANES),
                         v = Lanes::load(image.point_v + packet * LANES);
            SolidHit met = setup.at(u, v);
            if (image.limit) skip_nearer(image, packet, met);
            store(met, image, packet, cell, id, mode);
        }
    }
    // Skip fronts of solids that are nearer than the limits of points.
    static inline void skip_nearer(const Image& image, int packet, SolidHit& met) {
        int* passed = image.passed + packet * LANES;
        const Ints nearer = met.inv_z > Lanes::load(image.limit + packet * LANES);
        Lanes::store(passed, Lanes::load(passed) | nearer);
        met.inv_z = nearer ? Lanes::all(0.0f) : met.inv_z;
    }

    static inline void store(const SolidHit& met, const Image& image, int packet, int block, int id, Mode mode) {
        const Ints hit = met.inv_z > Lanes::all(0.0f);
        if (mode != MODE_TRIANGLES) {
            Raster::blend(image, packet, block, hit, met.inv_z, id, mode);
            return;
        }
        for (int part = 0; part < SOLID_PARTS; ++part) {
            const Ints on_part = hit & (met.part == Lanes::all_ints(part));
            Raster::blend(image, packet, block, on_part, met.inv_z, id + part, MODE_TRIANGLES);
        }
    }
};
