// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Check the visibility of world points against ground truth.

#include "check.h"

enum Status { OUT_OF_VIEW, NEARER, FARTHER, OCCLUDED, SEEN };  // same values as warpvis.Visibility

// Projection of a point into a view.
struct Aim {
    double u, v, z, x, y;  // pixels from the principal point, depth, and pixels of the image

    Aim(const Truth& truth, const float* point) {
        const Vec local = truth.camera.into(Vec{point[0], point[1], point[2]} - truth.camera.at);
        z = local.z;
        u = local.x * truth.lens.fx / z, v = local.y * truth.lens.fy / z;
        x = u + truth.lens.cx, y = v + truth.lens.cy;
    }
    // Distance of the point from the border of the image, in pixels; negative outside.
    double margin(const Lens& lens) const { return z > 0 ? std::min({x, y, lens.width - x, lens.height - y}) : -1.0; }
};

// Random points: anywhere, on surfaces, on the borders of the image, at the camera.
static std::vector<float> random_places(Random& random, const Scene& scene, const Worlds& worlds, int count) {
    std::vector<float> places;
    for (int i = 0; i < count; ++i) {
        const int kind = random.whole(0, 9);
        double p[3];
        for (int k = 0; k < 3; ++k) p[k] = scene.offset[k] + random.real(-2.5, 2.5) * scene.scale;
        if (kind > 4) {  // in front of a camera
            const Placed camera = Placed::of(&worlds.cameras[7 * random.whole(0, worlds.views - 1)]);
            const double z = random.real(0.01, 4) * scene.scale, wide = random.pick({0.01, 0.2, 1.0}) * z;
            const Vec at = camera.at + camera.rotate({random.real(-wide, wide), random.real(-wide, wide), z});
            p[0] = at.x, p[1] = at.y, p[2] = at.z;
        }
        const Object& object = scene.objects[random.whole(0, (int)scene.objects.size() - 1)];
        if (kind > 7 && object.movable < 0) {
            const int* face = &object.mesh.faces[3 * random.whole(0, object.mesh.count() - 1)];
            const double s = random.real(0, 1), t = random.real(0, 1 - s);
            for (int k = 0; k < 3; ++k)
                p[k] = object.mesh.vertices[3 * face[0] + k] * (1 - s - t) + object.mesh.vertices[3 * face[1] + k] * s +
                       object.mesh.vertices[3 * face[2] + k] * t;
        }
        if (kind == 0) p[0] = worlds.cameras[0], p[1] = worlds.cameras[1], p[2] = worlds.cameras[2];
        for (double value : p) places.push_back((float)value);
    }
    return places;
}

// Set a camera and points that are barely inside its image: their rounded columns and rows are one past the last.
static void put_on_borders(Random& random, Lens& lens, Worlds& worlds, std::vector<float>& places) {
    static const float nowhere[7] = {0, 0, 0, 0, 0, 0, 1};
    for (int view = 0; view < worlds.views; ++view) std::copy_n(nowhere, 7, &worlds.cameras[7 * view]);
    const double depth = random.pick({3.0, 5.0, 7.0, 10.0, 19.0, 25.0, 100.0});
    lens.cx = lens.cy = 0;
    lens.fx = std::nextafter(lens.width * depth, 0.0);
    lens.fy = std::nextafter(lens.height * depth, 0.0);
    for (size_t i = 0; i < places.size(); i += 3) {
        places[i] = random.pick({1.0f, 1.0f, 0.5f, 0.0f});
        places[i + 1] = random.pick({1.0f, 1.0f, 0.5f, 0.0f});
        places[i + 2] = (float)depth;
    }
}

// Describe a fault in a point's status; null if there is none.
static const char* fault_of(const Truth& truth, const Aim& aim, float tolerance, int status, const int* occluder,
                            std::vector<Hit>& hits) {
    const double margin = aim.margin(truth.lens), slack = 1e-6, z = aim.z;
    if (occluder && (*occluder >= 0) != (status == OCCLUDED)) return "occluder and status disagree";
    if (margin < -slack) return status == OUT_OF_VIEW ? nullptr : "out of view";
    if (status == OUT_OF_VIEW) return margin > slack ? "in view" : nullptr;
    if (status == NEARER) return z < truth.lens.near * (1 + slack) ? nullptr : "not too near";
    if (status == FARTHER) return z > truth.lens.far * (1 - slack) ? nullptr : "not too far";
    if (z < truth.lens.near * (1 - slack) || z > truth.lens.far * (1 + slack)) return "out of range";
    hits.clear();
    truth.meet(aim.u, aim.v, hits);
    const Vec ray = {aim.u / truth.lens.fx, aim.v / truth.lens.fy, 1};
    const double needed = tolerance / ray.length();
    double first = ENDLESS;
    bool certainly_hidden = false;
    for (const Hit& hit : hits) {
        if (hit.certain) first = std::min(first, hit.high);
        certainly_hidden |= hit.certain && z - hit.high > needed * (1 + 1e-5);
    }
    if (status == SEEN) return certainly_hidden ? "hidden" : nullptr;
    if (status != OCCLUDED) return "no such status";
    for (const Hit& hit : hits)
        if (z - hit.low >= needed * (1 - 1e-5) && hit.low <= first && (!occluder || *occluder == hit.object))
            return nullptr;
    return "not occluded, or by another object";
}

static void check_scene(uint64_t seed) {
    Random random(seed);
    const Scene scene = random_scene(random);
    const SceneBvh clusters = cluster(scene);
    Lens lens = random_lens(random, scene.scale);
    Worlds worlds = random_worlds(random, scene);
    const int count = random.pick({1, 15, 16, 17, 300, 300, 8192, 8193});
    std::vector<float> places = random_places(random, scene, worlds, count);
    if (random.chance(0.1)) put_on_borders(random, lens, worlds, places);
    Layout layout;
    layout.scale = random.pick({1.0, 0.25, 0.0625, 2.0, 4.0});
    layout.batch = random.chance(0.5) ? (count + 15) / 16 * 16 : random.pick({16, 64, 8192});
    layout.strip_tiles = random.whole(1, 3);
    layout.whole = random.chance(0.5);
    layout.tolerance = random.pick({0.0f, 1e-4f, 0.05f, 1e3f}) * (float)scene.scale;
    bool solids = false;
    for (const Movable& movable : scene.movables) solids |= movable.solid != MESH;
    layout.occluders = random.chance(0.5);
    layout.with_id = solids || layout.occluders;
    Shares shares;
    shares.workers = random.pick({1, 2});
    const Exact<float> exact(places);
    const Statuses made = judge_points(clusters, worlds, lens, shares, layout, exact);
    std::vector<Hit> hits;
    for (int view = 0; view < worlds.views; ++view) {
        const Truth truth = truth_of(scene, worlds, lens, view, false);
        for (int i = 0; i < count; ++i) {
            const Aim aim(truth, &places[3 * i]);
            const size_t at = (size_t)view * count + i;
            const int* occluder = made.occluders.data ? &made.occluders[at] : nullptr;
            const char* fault = fault_of(truth, aim, layout.tolerance, made.status[at], occluder, hits);
            if (fault)
                fail(seed, view, fault, "point %d at (%g, %g), %g away, status %d, occluder %d", i, aim.x, aim.y, aim.z,
                     made.status[at], occluder ? *occluder : -2);
        }
    }
}

int main(int count, char** arguments) { return check_all(count, arguments, check_scene); }
