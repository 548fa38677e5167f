// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Check images, and rays through image points, against ground truth.

#include "check.h"

// Ground truth of a ray: the results that are consistent with its hits. Depth is at most that of the first certain hit.
struct Judgment {
    const Truth& truth;
    const std::vector<Hit>& hits;
    double u, v;
    double limit = ENDLESS;

    Judgment(const Truth& of, const std::vector<Hit>& met, double at_u, double at_v)
        : truth(of), hits(met), u(at_u), v(at_v) {
        for (const Hit& hit : hits)
            if (hit.certain) limit = std::min(limit, hit.high);
    }

    bool may_see(const Hit& hit, double depth) const { return hit.low <= std::min(limit, depth) && depth <= hit.high; }

    bool may_be_nothing() const {
        if (!(limit < ENDLESS)) return true;
        return limit > truth.lens.far;
    }
    bool may_be_near() const {
        for (const Hit& hit : hits)
            if (hit.low <= limit && hit.low < truth.lens.near) return true;
        return false;
    }

    // Describe a fault in the outputs of a ray with the given depth; null if there is none.
    const char* fault(const Pictures& made, size_t at, float depth, const Scene& scene) const {
        if (depth != depth) return "depth is NaN";
        if (made.depth.data && made.depth[at] != depth) return "depth depends on the requested outputs";
        if (!std::isfinite(depth)) {
            if (depth > 0 ? !may_be_nothing() : !may_be_near()) return depth > 0 ? "nothing is seen" : "too near";
            return fault_of_nothing(made, at);
        }
        if (depth < truth.lens.near || depth > truth.lens.far) return "depth is out of range";
        const char* fault = "no such surface";
        for (const Hit& hit : hits) {
            if (!may_see(hit, depth) || (made.objects.data && made.objects[at] != hit.object)) continue;
            const bool labeled = !made.labels.data || made.labels[at] == scene.objects[hit.object].label;
            const bool faces = !made.normals.data || faces_as(hit, &made.normals[3 * at]);
            if (labeled && faces) return made.points.data && !is_at(&made.points[3 * at], depth) ? "point" : nullptr;
            fault = labeled ? "normal" : "label";
        }
        return fault;
    }

  private:
    bool is_at(const float* point, double depth) const {
        const Vec ray = {u / truth.lens.fx, v / truth.lens.fy, 1};
        const Vec wanted = truth.camera.at + truth.camera.rotate(ray * depth);
        const Vec off = Vec{point[0], point[1], point[2]} - wanted;
        return off.length() <= 1e-5 * depth * ray.length() + 3e-7 * wanted.length();
    }

    static bool faces_as(const Hit& hit, const float* normal) {
        const Vec n = {normal[0], normal[1], normal[2]};
        return std::fabs(n.length() - 1) < 1e-5 && (n - hit.normal).length() <= hit.blur;
    }

    static const char* fault_of_nothing(const Pictures& made, size_t at) {
        for (int k = 0; k < 3; ++k) {
            if (made.points.data && made.points[3 * at + k] == made.points[3 * at + k]) return "point of nothing";
            if (made.normals.data && made.normals[3 * at + k] == made.normals[3 * at + k]) return "normal of nothing";
        }
        if (made.objects.data && made.objects[at] != -1) return "object of nothing";
        return made.labels.data && made.labels[at] != 0 ? "label of nothing" : nullptr;
    }
};

static Shares random_shares(Random& random, int height) {
    Shares shares;
    shares.workers = random.pick({1, 1, 2});
    shares.shift = random.whole(0, 15);
    for (int row = 0; row < height; row += 16)
        if (row == 0 || random.chance(0.5)) shares.strip_rows.push_back(row);
    shares.strip_rows.push_back(height);
    return shares;
}

// Random image points: on borders, between pixels, outside the image, and not finite.
static std::vector<float> random_points(Random& random, const Lens& lens, int count) {
    std::vector<float> at;
    const float side[2] = {(float)lens.width, (float)lens.height};
    const bool crowded = random.chance(0.3);
    for (int i = 0; i < count * 2; ++i) {
        const float most = side[i & 1];
        const int kind = random.whole(0, 19);
        float value = (float)random.real(0, crowded ? std::min(most, 5.0f) : most);
        if (kind == 0) value = 16.0f * random.whole(0, (int)most / 16);
        if (kind == 1) value = (float)random.whole(0, (int)most);
        if (kind == 2 && !crowded) value = random.pick({most, 0.0f, -0.0f, std::nextafter(most, 0.0f), -1e-30f});
        if (kind == 3 && random.chance(0.3)) value = random.pick({NAN, INFINITY, -INFINITY, -3.0f, 1e30f, most + 1});
        at.push_back(value);
    }
    return at;
}

struct Setting {
    Scene scene;
    SceneBvh clusters;
    Lens lens;
    Worlds worlds;
    bool cull;
    int points;  // 0 for pixel centers
    std::vector<float> places;
};

static void check_rays(const Setting& set, uint64_t seed, const Pictures& made, const Pictures& more) {
    const Lens& lens = set.lens;
    const int count = set.points ? set.points : lens.width * lens.height;
    std::vector<Hit> hits;
    for (int view = 0; view < set.worlds.views; ++view) {
        const Truth truth = truth_of(set.scene, set.worlds, lens, view, set.cull);
        for (int i = 0; i < count; ++i) {
            const size_t at = (size_t)view * count + i;
            const double x = set.points ? set.places[2 * at] : i % lens.width + 0.5;
            const double y = set.points ? set.places[2 * at + 1] : i / lens.width + 0.5;
            const bool inside = x >= 0 && x < lens.width && y >= 0 && y < lens.height;
            hits.clear();
            if (inside) truth.meet(x - lens.cx, y - lens.cy, hits);
            const Judgment judgment(truth, hits, x - lens.cx, y - lens.cy);
            const char* fault = judgment.fault(made, at, made.depth[at], set.scene);
            if (!fault) fault = judgment.fault(more, at, made.depth[at], set.scene);
            if (set.scene.is_room && !lens.clips && inside && !set.worlds.excluded.data && made.depth[at] > lens.far)
                fault = lens.far < INFINITY ? fault : "a ray leaves a closed room";
            if (fault)
                fail(seed, view, fault, "at (%g, %g) of %d x %d: depth %g, object %d", x, y, lens.width, lens.height,
                     made.depth[at], made.objects[at]);
        }
    }
}

static void check_scene(uint64_t seed) {
    Random random(seed);
    Setting set;
    set.scene = random_scene(random);
    set.clusters = cluster(set.scene);
    set.lens = random_lens(random, set.scene.scale);
    set.worlds = random_worlds(random, set.scene);
    set.cull = random.chance(0.2) && !set.scene.is_room;
    set.points = random.chance(0.3) ? random.pick({1, 3, 16, 17, 200, 900}) : 0;
    for (int view = 0; view < set.worlds.views && set.points; ++view) {
        const std::vector<float> chosen = random_points(random, set.lens, set.points);
        set.places.insert(set.places.end(), chosen.begin(), chosen.end());
    }
    // If the near plane cuts a solid, its triangles are visible: see tests/test_near_plane.py.
    bool solids = false;
    for (const Movable& movable : set.scene.movables) solids |= movable.solid != 0;
    set.lens.clips = set.lens.near > 0 && !solids && random.chance(0.5);
    const Exact<float> at(set.places);
    const auto render = [&](unsigned outputs) {
        const Shares shares = random_shares(random, set.lens.height);
        return cast(set.clusters, set.worlds, set.lens, shares, set.cull, outputs, at, set.points);
    };
    const Pictures all = render(ALL_OUTPUTS), chosen = render(random.whole(1, ALL_OUTPUTS));
    check_rays(set, seed, all, chosen);
}

int main(int count, char** arguments) { return check_all(count, arguments, check_scene); }
