// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Ground truth of rays in double precision: every triangle and every solid is tested. If single precision cannot decide
// whether a ray passes an edge, a hit is uncertain: a caster may report it or not.

#pragma once

#include <algorithm>
#include <limits>

#include "scenes.h"

struct Vec {
    double x, y, z;
    Vec operator+(Vec b) const { return {x + b.x, y + b.y, z + b.z}; }
    Vec operator-(Vec b) const { return {x - b.x, y - b.y, z - b.z}; }
    Vec operator*(double s) const { return {x * s, y * s, z * s}; }
    Vec size() const { return {std::fabs(x), std::fabs(y), std::fabs(z)}; }
    double dot(Vec b) const { return x * b.x + y * b.y + z * b.z; }
    double length() const { return std::sqrt(dot(*this)); }
    Vec cross(Vec b) const { return {y * b.z - z * b.y, z * b.x - x * b.z, x * b.y - y * b.x}; }
    // Upper bounds of the terms of a cross product.
    Vec cross_size(Vec b) const {
        const Vec p = size(), q = b.size();
        return {p.y * q.z + p.z * q.y, p.z * q.x + p.x * q.z, p.x * q.y + p.y * q.x};
    }
};

// A position and three axes in the world.
struct Placed {
    Vec at, axis[3];

    static Placed of(const float* row) {
        Placed p;
        const double n = std::sqrt((double)row[3] * row[3] + (double)row[4] * row[4] + (double)row[5] * row[5] +
                                   (double)row[6] * row[6]);
        const Vec q = {row[3] / n, row[4] / n, row[5] / n};
        const double w = row[6] / n;
        p.at = {row[0], row[1], row[2]};
        const Vec unit[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
        for (int k = 0; k < 3; ++k) {
            const Vec t = q.cross(unit[k]) * 2.0;
            p.axis[k] = unit[k] + t * w + q.cross(t);
        }
        return p;
    }
    static Placed nowhere() { return {{0, 0, 0}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}; }
    Vec rotate(Vec v) const { return axis[0] * v.x + axis[1] * v.y + axis[2] * v.z; }
    Vec into(Vec v) const { return {axis[0].dot(v), axis[1].dot(v), axis[2].dot(v)}; }
};

struct Lens {
    int width, height;
    double fx, fy, cx, cy;
    float near, far;
    bool clips = false;  // whether surfaces nearer than `near` are clipped

    // Distance of the corners of the image on the near plane, with a margin, as in Camera._near_reach.
    double near_reach() const {
        const double x = std::max(std::fabs(cx), std::fabs(width - cx)) / fx;
        const double y = std::max(std::fabs(cy), std::fabs(height - cy)) / fy;
        return 1.0001 * near * std::sqrt(1 + x * x + y * y);
    }
};

// A possible intersection of a ray.
struct Hit {
    double low, high;  // range of depth, whatever the rounding
    bool certain;
    int object;
    Vec normal;  // in the world, facing the camera
    double blur;  // error bound of the normal
};

constexpr double EPSILON = 5e-7;  // rounding error of a corner, relative to its distance: eight roundings
constexpr double TOLERANCE = 1e-5;  // relative tolerance of depth
constexpr double ENDLESS = std::numeric_limits<double>::infinity();

struct TrueTriangle {
    Vec c[3], error[3];  // corners in camera space, x and y in pixels times depth; and their error bounds
    Vec normal, to_world;
    double volume, error_bound, x0, x1, y0, y1, nearest, farthest;
    int object;
    bool small;

    void meet(double u, double v, std::vector<Hit>& hits) const {
        if (u < x0 || u > x1 || v < y0 || v > y1) return;
        const Vec r = {u, v, 1};
        double value[3];
        // for either sign of the volume
        bool certain = std::fabs(volume) > error_bound, maybe[2] = {volume > -error_bound, volume < error_bound};
        for (int k = 0; k < 3; ++k) {
            const Vec a = c[(k + 1) % 3], b = c[(k + 2) % 3], ab = a.cross(b);
            value[k] = 2 * ab.dot(r);
            const double slack =
                EPSILON * ((a - b).cross_size(a + b).dot(r.size()) + 2 * (std::fabs(ab.x * u) + std::fabs(ab.y * v))) +
                2 * error[(k + 1) % 3].dot(b.cross(r).size()) + 2 * error[(k + 2) % 3].dot(a.cross(r).size());
            if (value[k] < -slack) maybe[0] = false;
            if (value[k] > slack) maybe[1] = false;
            if (std::fabs(value[k]) <= slack) certain = false;
        }
        if (!maybe[0] && !maybe[1]) return;
        Hit hit = {nearest * (1 - TOLERANCE), farthest * (1 + TOLERANCE), certain, object, to_world, 1e-4};
        if (certain) {
            const double z = normal.dot(c[0]) / normal.dot(r), sum = value[0] + value[1] + value[2];
            double tilt = 0;
            for (int k = 0; k < 3 && small; ++k)
                tilt += value[k] / sum * normal.size().dot(error[k]) / std::fabs(normal.dot(r));
            hit.low = std::max(hit.low, z - z * TOLERANCE - tilt);
            hit.high = std::min(hit.high, z + z * TOLERANCE + tilt);
        }
        hits.push_back(hit);
    }
};

// A round solid, seen from outside, in its own frame, where its radius is 1.
struct TrueSolid {
    int kind, object;
    double half;
    Vec camera, ray[3], inverse;
    Placed place;
    double x0, x1, y0, y1, middle, reach;  // bounds in pixels and depth

    struct Met {
        double z;
        Vec normal;
    };

    static double root(double a, double b, double c) {
        const double square = b * b - a * c;
        if (square < 0 || b >= 0 || c <= 0) return ENDLESS;
        return c / (std::sqrt(square) - b);
    }
    void consider(double z, Vec slope, Met& best) const {
        if (!(z > 0 && z < best.z)) return;
        const Vec n = place.rotate({slope.x * inverse.x, slope.y * inverse.y, slope.z * inverse.z});
        best = {z, n * (1 / n.length())};
    }
    Met meet(double u, double v) const {
        const Vec d = ray[0] * u + ray[1] * v + ray[2], o = camera;
        Met best = {ENDLESS, {0, 0, 0}};
        if (kind != BALL) {
            const double z = root(d.x * d.x + d.y * d.y, o.x * d.x + o.y * d.y, o.x * o.x + o.y * o.y - 1);
            const Vec p = o + d * z;
            if (z < ENDLESS && std::fabs(p.z) <= half) consider(z, {p.x, p.y, 0}, best);
        }
        for (int end = -1; end <= 1; end += 2) {
            const Vec from = o - Vec{0, 0, kind == BALL ? 0 : end * half};
            if (kind == CYLINDER) {
                const double z = -from.z / d.z;
                const Vec p = o + d * z;
                if (z > 0 && z < ENDLESS && p.x * p.x + p.y * p.y <= 1) consider(z, {0, 0, (double)end}, best);
            } else {
                const double z = root(d.dot(d), from.dot(d), from.dot(from) - 1);
                if (z < ENDLESS) consider(z, from + d * z, best);
            }
        }
        return best;
    }
    bool outside() const {
        const double beyond = std::max(std::fabs(camera.z) - half, 0.0);
        if (kind == CYLINDER) return camera.x * camera.x + camera.y * camera.y > 1 || beyond > 0;
        return camera.x * camera.x + camera.y * camera.y + beyond * beyond > 1;
    }
    void meet(double u, double v, std::vector<Hit>& hits) const {
        if (u < x0 || u > x1 || v < y0 || v > y1) return;
        const double away = 4e-3;  // pixels
        const Met here = meet(u, v);
        double low = here.z, high = here.z, blur = 0;
        int met = here.z < ENDLESS;
        for (int k = 0; k < 8; ++k) {
            const Met nearby = meet(u + away * std::cos(k * M_PI / 4), v + away * std::sin(k * M_PI / 4));
            met += nearby.z < ENDLESS;
            low = std::min(low, nearby.z);
            high = std::max(high, nearby.z);
            blur = std::max(blur, (nearby.normal - here.normal).length());
        }
        if (met == 0) return;
        const bool certain = met == 9;
        if (!certain) low = middle - reach, high = middle + reach, blur = 3;
        hits.push_back({low * (1 - TOLERANCE), high * (1 + TOLERANCE), certain, object, here.normal, blur + 1e-3});
    }
};

// Ground truth of one view.
struct Truth {
    std::vector<TrueTriangle> triangles;
    std::vector<TrueSolid> solids;
    Lens lens;
    Placed camera;

    Truth(const Lens& of, const float* pose) : lens(of), camera(Placed::of(pose)) {}

    void add(const Object& object, int index, const Placed& place, bool cull) {
        const Mesh& mesh = object.mesh;
        const double row[3] = {lens.fx, lens.fy, 1};
        for (int face = 0; face < mesh.count(); ++face) {
            TrueTriangle t;
            t.object = index;
            Vec local[3];
            for (int k = 0; k < 3; ++k) {
                const float* p = &mesh.vertices[3 * mesh.faces[3 * face + k]];
                const Vec from = place.rotate({p[0], p[1], p[2]}) + (place.at - camera.at);
                local[k] = camera.into(from);
                t.c[k] = {local[k].x * row[0], local[k].y * row[1], local[k].z};
                t.error[k] = Vec{row[0], row[1], row[2]} * (EPSILON * from.length());
            }
            if (set_up(t, local, cull)) triangles.push_back(t);
        }
    }

    void add_solid(const Movable& movable, const Placed& place, bool cull, const std::vector<Object>& objects) {
        TrueSolid s;
        s.kind = movable.solid;
        s.object = movable.objects[0];
        s.half = movable.size[3];
        s.place = place;
        s.inverse = {1.0 / movable.size[0], 1.0 / movable.size[1], 1.0 / movable.size[2]};
        const auto scaled = [&](Vec v) { return Vec{v.x * s.inverse.x, v.y * s.inverse.y, v.z * s.inverse.z}; };
        s.camera = scaled(place.into(camera.at - place.at));
        s.ray[0] = scaled(place.into(camera.axis[0])) * (1 / lens.fx);
        s.ray[1] = scaled(place.into(camera.axis[1])) * (1 / lens.fy);
        s.ray[2] = scaled(place.into(camera.axis[2]));
        if (!s.outside()) return add(objects[s.object], s.object, place, cull);
        const Vec center = camera.into(place.at - camera.at);
        const double longest = std::max({movable.size[0], movable.size[1], movable.size[2]});
        s.reach = longest * (1 + s.half);
        s.middle = center.z;
        s.x0 = s.y0 = -ENDLESS;
        s.x1 = s.y1 = ENDLESS;
        if (center.z + s.reach < 0) return;
        if (center.z > 2 * s.reach) {
            const double spread_x = 2 * lens.fx * s.reach / (center.z - s.reach) * (1 + std::fabs(center.x / center.z));
            const double spread_y = 2 * lens.fy * s.reach / (center.z - s.reach) * (1 + std::fabs(center.y / center.z));
            s.x0 = lens.fx * center.x / center.z - spread_x, s.x1 = lens.fx * center.x / center.z + spread_x;
            s.y0 = lens.fy * center.y / center.z - spread_y, s.y1 = lens.fy * center.y / center.z + spread_y;
        }
        solids.push_back(s);
    }

    void meet(double u, double v, std::vector<Hit>& hits) const {
        hits.clear();
        for (const TrueTriangle& t : triangles) t.meet(u, v, hits);
        for (const TrueSolid& s : solids) s.meet(u, v, hits);
        if (lens.clips) clip(hits);
    }

  private:
    void clip(std::vector<Hit>& hits) const {
        const double near = lens.near;
        hits.erase(std::remove_if(hits.begin(), hits.end(), [&](const Hit& hit) { return hit.high < near; }),
                   hits.end());
        for (Hit& hit : hits)
            if (hit.low < near) hit.low = near, hit.certain = false;
    }

    // Set up a triangle; returns false if it is invisible whatever the rounding.
    bool set_up(TrueTriangle& t, const Vec* local, bool cull) const {
        t.normal = (t.c[1] - t.c[0]).cross(t.c[2] - t.c[0]);
        t.volume = t.normal.dot(t.c[0]);
        t.error_bound = 0;
        for (int k = 0; k < 3; ++k) t.error_bound += 4 * t.error[k].dot(t.c[(k + 1) % 3].cross_size(t.c[(k + 2) % 3]));
        if (cull && t.volume > t.error_bound) return false;
        Vec n = (local[1] - local[0]).cross(local[2] - local[0]);
        if (n.length() == 0) return false;
        if (n.dot(local[0]) > 0) n = n * -1.0;
        t.to_world = camera.axis[0] * n.x + camera.axis[1] * n.y + camera.axis[2] * n.z;
        t.to_world = t.to_world * (1 / t.to_world.length());
        const double slack = t.error[0].z + t.error[1].z + t.error[2].z;
        t.nearest = std::min({t.c[0].z, t.c[1].z, t.c[2].z}) - slack;
        t.farthest = std::max({t.c[0].z, t.c[1].z, t.c[2].z}) + slack;
        if (t.farthest <= 0) return false;
        t.x0 = t.y0 = -ENDLESS, t.x1 = t.y1 = ENDLESS, t.small = false;
        if (t.nearest <= 1e-3 * t.farthest) {
            t.nearest = 0;
            return true;
        }
        t.x0 = t.y0 = ENDLESS, t.x1 = t.y1 = -ENDLESS;
        for (const Vec& c : t.c) {
            t.x0 = std::min(t.x0, c.x / c.z - 0.1), t.x1 = std::max(t.x1, c.x / c.z + 0.1);
            t.y0 = std::min(t.y0, c.y / c.z - 0.1), t.y1 = std::max(t.y1, c.y / c.z + 0.1);
        }
        t.small = t.x1 - t.x0 < 8 && t.y1 - t.y0 < 8;
        return true;
    }
};
