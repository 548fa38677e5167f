// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Round solids seen from outside: rays meet the true surface instead of triangles.
//
// The frame is the object's, divided by the solid's factors along x, y and z: there it is a unit ball, or a unit cylinder
// with flat ends or half balls. A ray is camera + z * d, where z is the depth and d is linear in u and v. With C the
// square of the camera's distance from a ball's centre less 1, and with p and s the parts of d towards the centre and
// across, w = 1 / z solves C w^2 - 2 sqrt(C + 1) p w + p^2 + s^2 = 0. The same holds for a cylinder, without z.

typedef double Doubles __attribute__((ext_vector_type(16)));

// Three coordinates of sixteen points, where single precision is not enough.
struct ExactPoints {
    Doubles x, y, z;

    static inline Doubles dot(ExactPoints a, ExactPoints b) { return a.x * b.x + (a.y * b.y + a.z * b.z); }
    static inline ExactPoints cross(ExactPoints a, ExactPoints b) {
        return ExactPoints{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    }
};

// A solid and a camera in double precision: whether it is seen from outside, and how it faces.
struct Solid {
    enum Kind { none, ball, cylinder, capsule };
    double inverse[3], half;  // what the object's frame is scaled by; half length of the straight part after that
    double camera[3];
    double ray[3][3];  // d is the sum of these by u, v and 1
    int kind;

    static inline Solid of(int kind, const float* size, const Eye& eye) {
        Solid solid;
        solid.kind = kind;
        solid.half = size[3];
        for (int k = 0; k < 3; ++k) {
            solid.inverse[k] = 1.0 / size[k];
            solid.camera[k] = eye.exact_origin[k] * solid.inverse[k];
            for (int i = 0; i < 3; ++i) solid.ray[i][k] = eye.exact_to_camera[i][k] * solid.inverse[k];
        }
        return solid;
    }

    // How far beyond the straight part the camera is, along it; negative for alongside.
    inline double beyond() const { return __builtin_fabs(camera[2]) - half; }
    inline double end_ahead() const { return camera[2] < 0 ? -half : half; }

    // By the very sums that the quadrics begin with: outside, one of them can be hit.
    inline bool outside() const {
        const double along = beyond() > 0 ? beyond() : 0.0,
                     from[3] = {camera[0], camera[1], kind == cylinder ? 0.0 : along};
        return dot(from, from) > 1.0 || (kind == cylinder && along > 0);
    }

    // Height of the ball that a part belongs to.
    inline double height(int part) const { return kind != capsule || part == 0 ? 0.0 : part == 1 ? half : -half; }
    // Parts 0 but of a ball are cylinders, parts 1 of a cylinder the end ahead, and all others balls.
    inline bool is_side(int part) const { return kind != ball && part == 0; }

    // What a quadric is solved for: a camera and a ray as seen from its middle.
    inline void from_middle(int part, double* from) const {
        from[0] = camera[0];
        from[1] = camera[1];
        from[2] = is_side(part) ? 0.0 : camera[2] - height(part);
    }

    // Unit normals of the parts that sixteen rays show, in the object's frame: the gradient there, times 1 / z, which stays
    // exact where the camera is far away.
    inline ExactPoints normals(Ints part, Doubles u, Doubles v) const {
        const Doubles one = (Doubles)(1.0), none = (Doubles)(0.0), above = flag(part == 1), below = flag(part == 2);
        const Doubles side = kind == ball ? none : flag(part == 0), end = kind == cylinder ? above : none;
        const ExactPoints d = {ray[0][0] * u + (ray[1][0] * v + ray[2][0]), ray[0][1] * u + (ray[1][1] * v + ray[2][1]),
                               (one - side) * (ray[0][2] * u + (ray[1][2] * v + ray[2][2]))};
        const ExactPoints c = {camera[0] + none, camera[1] + none, (one - side) * (camera[2] - half * (above - below))};
        const ExactPoints e = ExactPoints::cross(c, d);
        const Doubles square = ExactPoints::dot(d, d) - ExactPoints::dot(e, e);
        const Doubles reach = __builtin_elementwise_sqrt(square > none ? square : none) - ExactPoints::dot(c, d);
        const Doubles rest = ExactPoints::dot(c, c) - one;
        const double facing = camera[2] < 0 ? -1.0 : 1.0;
        ExactPoints n = {(one - end) * (c.x * reach + rest * d.x) * inverse[0],
                         (one - end) * (c.y * reach + rest * d.y) * inverse[1],
                         (one - end) * (c.z * reach + rest * d.z) * inverse[2] + end * facing};
        const Doubles scale = one / __builtin_elementwise_sqrt(ExactPoints::dot(n, n));
        return ExactPoints{n.x * scale, n.y * scale, n.z * scale};
    }
    static inline Doubles flag(Ints mask) { return __builtin_convertvector(-mask, Doubles); }

    static inline double dot(const double* a, const double* b) { return a[0] * b[0] + (a[1] * b[1] + a[2] * b[2]); }
};

// Where linear forms are expanded, a place in the image near what they are of: single precision is enough from there.
// It depends on the view and the object alone, so that a strip or a packet changes no digit.
struct Local {
    double u, v;
    float x, y;  // the same in the coordinates that lanes come in: pixels' indices in the view, or points' u and v

    // Where the height `z` of the solid's axis is in the image, or what of the image is nearest to that.
    static inline Local of(const Solid& solid, double z, const Eye& eye, const Image& image, const double* center) {
        const ExactRow* m = eye.exact_to_camera;
        const double* o = eye.exact_origin;
        const double to[3] = {-o[0], -o[1], z / solid.inverse[2] - o[2]}, depth = Solid::dot(m[2], to);
        double u = 0.0, v = 0.0;
        if (depth > 0) {
            u = Solid::dot(m[0], to) / (Solid::dot(m[0], m[0]) * depth);
            v = Solid::dot(m[1], to) / (Solid::dot(m[1], m[1]) * depth);
        }
        Local local;
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

// A value that is linear in u and v, about a place; for where single precision is not enough even from there: w of a plane
// at a grazing angle is a small difference of large terms.
struct ExactForm {
    double u, v, one;

    // The part of d along a direction.
    static inline ExactForm of(const double* along, const Solid& solid, const Local& at) {
        const double du = Solid::dot(along, solid.ray[0]), dv = Solid::dot(along, solid.ray[1]);
        return ExactForm{du, dv, Solid::dot(along, solid.ray[2]) + du * at.u + dv * at.v};
    }
    inline Floats at(Floats from_x, Floats from_y) const {
        const Doubles x = __builtin_convertvector(from_x, Doubles), y = __builtin_convertvector(from_y, Doubles);
        return __builtin_convertvector(u * x + (v * y + one), Floats);
    }
};

// The same where it is enough.
struct Form {
    float u, v, one;

    static inline Form of(const double* along, const Solid& solid, const Local& at) {
        const ExactForm exact = ExactForm::of(along, solid, at);
        return Form{(float)exact.u, (float)exact.v, (float)exact.one};
    }
    inline Floats at(Floats from_x, Floats from_y) const { return u * from_x + (v * from_y + one); }
    // The most by which it changes as far away along x and y.
    inline float change(float away) const { return away * (__builtin_fabsf(u) + __builtin_fabsf(v)); }
};

// A unit ball or an endless cylinder: w = (distance * p + sqrt(p^2 - t^2)) / C, where t = sqrt(C) s.
struct Quadric {
    Local local;
    Form towards, across[2];  // p, and the two parts of t
    float distance, inverse;  // sqrt(C + 1), 1 / C

    // All zero, which no ray hits, for the side of a solid where the camera is between its ends' balls or beyond its end.
    static inline Quadric of(const Solid& solid, int part, const Local& local) {
        Quadric q = {local, {0, 0, 0}, {{0, 0, 0}, {0, 0, 0}}, 0.0f, 0.0f};
        double o[3];
        solid.from_middle(part, o);
        const double square = Solid::dot(o, o), rest = square - 1.0;
        if (!(rest > 0)) return q;
        const double distance = __builtin_sqrt(square), scale = 1.0 / distance, stretch = __builtin_sqrt(rest);
        const double n[3] = {-o[0] * scale, -o[1] * scale, -o[2] * scale};
        q.distance = (float)distance;
        q.inverse = (float)(1.0 / rest);
        q.towards = Form::of(n, solid, local);
        // Two directions at right angles to n (Duff et al. 2017); of a cylinder, only the one across its axis.
        const double sign = n[2] < 0 ? -1.0 : 1.0, a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
        if (solid.is_side(part)) {
            const double right[3] = {-n[1] * stretch, n[0] * stretch, 0.0};
            q.across[0] = Form::of(right, solid, local);
        } else {
            const double right[3] = {(1.0 + sign * n[0] * n[0] * a) * stretch, sign * b * stretch,
                                     -sign * n[0] * stretch};
            const double down[3] = {b * stretch, (sign + n[1] * n[1] * a) * stretch, -n[1] * stretch};
            q.across[0] = Form::of(right, solid, local);
            q.across[1] = Form::of(down, solid, local);
        }
        return q;
    }
};

// What sixteen rays meet: 1 / z, 0 where they miss, and the part of the solid.
struct Met {
    Floats w;
    Ints part;
};

// A solid, set up for the image.
struct Round {
    int kind;
    Quadric quadric[3];  // of the parts, where they are such
    Form along;  // C * (half the sum of both roots' places along the axis) * w
    float camera_z, half;
    Local end_local;  // the end of a cylinder that the camera sees, if any does
    ExactForm end_w;  // w, times the camera's distance from that end's plane
    Form end_x, end_y;  // where rays meet the plane, by w and the same
    float end_inverse, end_slack;

    static inline Round of(const Solid& solid, const Eye& eye, const Image& image, const double* center) {
        Round round;
        round.kind = solid.kind;
        round.half = (float)solid.half;
        round.camera_z = (float)solid.camera[2];
        const Local middle = Local::of(solid, 0.0, eye, image, center);
        round.quadric[0] = Quadric::of(solid, 0, middle);
        if (solid.kind == Solid::ball) return round;
        const double *o = solid.camera, rest = o[0] * o[0] + o[1] * o[1] - 1.0;
        const double along[3] = {-o[2] * o[0], -o[2] * o[1], rest};
        round.along = Form::of(along, solid, middle);
        if (solid.kind == Solid::capsule)
            for (int part = 1; part < 3; ++part)
                round.quadric[part] =
                    Quadric::of(solid, part, Local::of(solid, solid.height(part), eye, image, center));
        else
            round.set_end(solid, Local::of(solid, solid.end_ahead(), eye, image, center));
        return round;
    }

    inline void set_end(const Solid& solid, const Local& local) {
        end_local = local;
        end_w = ExactForm{0, 0, 0};  // which no ray hits
        end_x = end_y = Form{0, 0, 0};
        end_inverse = 0.0f;
        end_slack = (float)(1e-5 * (1.0 + solid.half + __builtin_fabs(solid.camera[2])));
        const double distance = solid.beyond(), down = solid.camera[2] < 0 ? 1.0 : -1.0;
        if (!(distance > 0)) return;
        const double w[3] = {0.0, 0.0, down}, x[3] = {distance, 0.0, solid.camera[0] * down},
                     y[3] = {0.0, distance, solid.camera[1] * down};
        end_w = ExactForm::of(w, solid, local);
        end_x = Form::of(x, solid, local);
        end_y = Form::of(y, solid, local);
        end_inverse = (float)(1.0 / distance);
    }

    inline Met at(Floats x, Floats y) const {
        if (kind == Solid::ball) return Met{ball(quadric[0], x, y), Lanes::all_ints(0)};
        return kind == Solid::capsule ? capsule(x, y) : cylinder(x, y);
    }

    // The balls are whole, so that no ray slips between them and the side. They touch it from inside: where both are hit,
    // the side counts, though w may be the same.
    inline Met capsule(Floats x, Floats y) const {
        const Side side = Side::of(*this, x, y);
        const Ints straight = side.hit & side.within(half);
        const Floats above = ball(quadric[1], x, y), below = ball(quadric[2], x, y);
        const Ints part = above >= below ? Lanes::all_ints(1) : Lanes::all_ints(2);
        return Met{straight ? side.w : Lanes::most(above, below), straight ? Lanes::all_ints(0) : part};
    }

    // Whether rays up to this far away along x and y may meet the solid. All of it is in part 0's ball or endless cylinder,
    // which says nothing where the camera is in that too.
    inline Ints near(Floats x, Floats y, float away) const {
        const Quadric& q = quadric[0];
        if (!(q.distance > 0)) return Lanes::all_ints(-1);
        const Floats dx = x - q.local.x, dy = y - q.local.y, none = Lanes::all(0.0f);
        const Floats p = q.towards.at(dx, dy) + q.towards.change(away);
        const Floats right = Lanes::most(Lanes::size(q.across[0].at(dx, dy)) - q.across[0].change(away), none);
        const Floats down = Lanes::most(Lanes::size(q.across[1].at(dx, dy)) - q.across[1].change(away), none);
        return (p > none) & (p * p >= right * right + down * down);
    }

    static inline Floats ball(const Quadric& q, Floats x, Floats y) {
        const Floats dx = x - q.local.x, dy = y - q.local.y, none = Lanes::all(0.0f);
        const Floats p = q.towards.at(dx, dy), right = q.across[0].at(dx, dy), down = q.across[1].at(dx, dy);
        const Floats square = p * p - (right * right + down * down);
        const Floats w = (q.distance * p + __builtin_elementwise_sqrt(Lanes::most(square, none))) * q.inverse;
        return ((square >= none) & (p > none)) ? w : none;
    }

    // Where rays meet the endless cylinder. How far along, by `reach`: from the roots' mean, which is a form of its own,
    // since the sum of the camera's place and the way from there loses digits.
    struct Side {
        Floats w, along, reach;
        Ints hit;

        static inline Side of(const Round& round, Floats x, Floats y) {
            const Quadric& q = round.quadric[0];
            const Floats dx = x - q.local.x, dy = y - q.local.y, none = Lanes::all(0.0f);
            const Floats p = q.towards.at(dx, dy), across = q.across[0].at(dx, dy);
            const Floats square = p * p - across * across;
            const Floats root = __builtin_elementwise_sqrt(Lanes::most(square, none));
            const Floats reach = q.distance * p + root;
            return Side{reach * q.inverse, round.along.at(dx, dy) + round.camera_z * root, reach,
                        (square >= none) & (p > none)};
        }
        inline Ints within(float half_length) const { return Lanes::size(along) <= half_length * reach; }
    };

    // A ray that misses both the side and the end by no more than rounding goes through the rim between them, and hits.
    inline Met cylinder(Floats x, Floats y) const {
        const Side side = Side::of(*this, x, y);
        const Floats dx = x - end_local.x, dy = y - end_local.y, none = Lanes::all(0.0f);
        const Floats w = end_w.at(dx, dy), end_u = end_x.at(dx, dy), end_v = end_y.at(dx, dy);
        const Floats square = end_u * end_u + end_v * end_v;
        const Ints ahead = w > none, end = ahead & (square <= w * w);
        const Ints rim = ahead & (square <= 1.00001f * w * w) & side.within(half + end_slack);
        const Ints hit = side.hit & (side.within(half) | rim);
        return Met{end ? w * end_inverse : (hit ? side.w : none), end ? Lanes::all_ints(1) : Lanes::all_ints(0)};
    }
};

struct Solids {
    // Pixels of the strip that may show the solid, and how near it may be.
    struct Place {
        int x0, y0, x1, y1;
        float nearest_w;
    };

    // `part_ids`: each part has an id of its own, in the parts' order. Not part of what calls it: that stays as small and
    // fast as it is without solids.
    static __attribute__((noinline)) void draw(const Solid& solid, const Eye& eye, const Image& image,
                                               const double* center, Place place, int id, bool with_id, bool part_ids) {
        const Round round = Round::of(solid, eye, image, center);
        for (int ty = place.y0 >> 4; ty <= place.y1 >> 4; ++ty)
            for (int tx = place.x0 >> 4; tx <= place.x1 >> 4; ++tx) {
                const int tile = ty * image.tiles_x + tx;
                for (unsigned left = blocks(round, eye, image, place, tx, ty); left; left &= left - 1) {
                    const int b = Lanes::first_lane(left), block = tile * 16 + b;
                    if (image.least_of_block(block) > place.nearest_w) continue;
                    if (image.first_packet) {
                        draw_cell(round, image, block, id, part_ids);
                        continue;
                    }
                    const Floats x = Raster::pixel_column() + (float)(tx * 16 + (b & 3) * 4);
                    const Floats y = Raster::pixel_row() + (float)(ty * 16 + (b >> 2) * 4 + image.first_row);
                    show(round.at(x, y), image, block, block, id, with_id, part_ids);
                }
            }
    }

    // Those of a tile's blocks that may show the solid.
    static inline unsigned blocks(const Round& round, const Eye& eye, const Image& image, const Place& place, int tx,
                                  int ty) {
        const Ints block_x = {0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12};
        const Ints block_y = {0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12};
        const Ints x = block_x + tx * 16, y = block_y + ty * 16;
        const Ints inside = (x + 3 >= place.x0) & (x <= place.x1) & (y + 3 >= place.y0) & (y <= place.y1);
        // From its middle, a block reaches 1.5 pixels to the outermost centres, 2 to its edges; and a little for rounding.
        Floats u = __builtin_convertvector(x, Floats) + 1.5f;
        Floats v = __builtin_convertvector(y + image.first_row, Floats) + 1.5f;
        if (image.first_packet) {
            u += eye.first_u;
            v += eye.first_v;
        }
        return Lanes::bits(inside & round.near(u, v, image.first_packet ? 2.05f : 1.55f));
    }

    static inline void draw_cell(const Round& round, const Image& image, int cell, int id, bool part_ids) {
        for (int packet = image.first_packet[cell]; packet < image.first_packet[cell + 1]; ++packet) {
            const Floats u = Lanes::load(image.point_u + packet * 16), v = Lanes::load(image.point_v + packet * 16);
            show(round.at(u, v), image, packet, cell, id, true, part_ids);
        }
    }

    static inline void show(const Met& met, const Image& image, int packet, int block, int id, bool with_id,
                            bool part_ids) {
        const Ints hit = met.w > Lanes::all(0.0f);
        if (!part_ids) {
            Raster::blend(image, packet, block, hit, met.w, id, with_id);
            return;
        }
        for (int part = 0; part < 3; ++part)
            Raster::blend(image, packet, block, hit & (met.part == Lanes::all_ints(part)), met.w, id + part, true);
    }
};
