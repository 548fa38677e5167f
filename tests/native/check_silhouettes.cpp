// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Check the visible fraction of each object on a canvas against ground truth.

#include "check.h"

// Number of certain pixels and greatest possible number, and their boxes.
struct Tally {
    int certain = 0, most = 0;
    int certain_box[4], possible_box[4];  // codes: maxima of -x, -y, x, y

    Tally() {
        for (int k = 0; k < 4; ++k) certain_box[k] = possible_box[k] = INT32_MIN;
    }
    void add(int x, int y, bool is_certain) {
        const int code[4] = {-x, -y, x, y};
        most += 1;
        certain += is_certain;
        for (int k = 0; k < 4; ++k) {
            possible_box[k] = std::max(possible_box[k], code[k]);
            if (is_certain) certain_box[k] = std::max(certain_box[k], code[k]);
        }
    }
    bool holds(int count) const { return certain <= count && count <= most; }
    bool holds_box(const int* code) const {
        for (int k = 0; k < 4; ++k) {
            const int value = code[k] == 0 ? INT32_MIN : code[k] - (1 << 24);
            if (value < certain_box[k] || value > possible_box[k]) return false;
        }
        return true;
    }
};

struct Expected {
    Tally silhouette, image, visible, near, far;
    std::vector<Tally> hidden_by;
    std::vector<int> mask;  // -1 if uncertain
};

// The scene in which each object is a separate movable, as in warpvis.scene.Scene.apart.
static Scene separate(const Scene& scene) {
    Scene result = scene;
    result.movables.clear();
    for (int i = 0; i < (int)scene.objects.size(); ++i) {
        Movable movable;
        if (scene.objects[i].movable >= 0) movable = scene.movables[scene.objects[i].movable];
        movable.objects = {i};
        result.objects[i].movable = i;
        result.movables.push_back(movable);
    }
    return result;
}

// Set the pose of every object in every world: that of its movable, or the identity.
static void spread(const Scene& scene, Worlds& worlds) {
    const int objects = (int)scene.objects.size();
    Exact<float> poses((size_t)worlds.worlds * objects * 7, 0.0f);
    for (int world = 0; world < worlds.worlds; ++world)
        for (int i = 0; i < objects; ++i) {
            float* row = &poses[7 * (world * objects + i)];
            row[6] = 1;
            const int movable = scene.objects[i].movable;
            if (movable >= 0) std::copy_n(worlds.place(world, movable), 7, row);
        }
    worlds.poses = std::move(poses);
    worlds.moving = objects;
}

static Compared random_comparison(Random& random, const Scene& scene, const Lens& lens, int views) {
    Compared with;
    const int objects = (int)scene.objects.size();
    for (int i = 0; i < objects && (int)with.chosen.size() < 6; ++i)
        if (random.chance(0.6) || i + 1 == objects) with.chosen.push_back(random.chance(0.2) ? i : objects - 1 - i);
    const bool wider = random.chance(0.6);
    const int limits[4] = {0, 0, lens.width, lens.height};
    for (int k = 0; k < 4; ++k)
        with.canvas[k] = limits[k] + (wider ? (k < 2 ? -1 : 1) * random.pick({0, 1, 16, 33, 70}) : 0);
    with.seen_only = wider && random.chance(0.4);
    with.masks = random.chance(0.5);
    with.delta = random.pick({0.0f, 0.01f, 0.5f}) * (float)scene.scale;
    const size_t pixels = (size_t)views * lens.width * lens.height;
    with.seen = Exact<int>(pixels, -1);
    if (with.delta > 0) with.depth = Exact<float>(pixels, INFINITY);
    int object = -1, left = 0;
    double depth = 1;
    for (size_t i = 0; i < pixels; ++i) {
        if (left-- == 0) {
            object = random.chance(0.3) ? -1 : random.chance(0.5) ? with.chosen[0] : random.whole(0, objects - 1);
            left = random.whole(0, 40);
            depth = random.real(0.1, 4) * scene.scale;
        }
        with.seen[i] = object;
        if (with.depth.data && object >= 0) with.depth[i] = (float)depth;
    }
    return with;
}

// Add a pixel that an object covers, with its range of depth.
static void add_pixel(Expected& e, const Compared& with, const Lens& lens, int view, int index, int x, int y,
                      const Hit& hit) {
    e.silhouette.add(x, y, hit.certain);
    if (x < 0 || y < 0 || x >= lens.width || y >= lens.height) return;
    e.image.add(x, y, hit.certain);
    const size_t pixel = ((size_t)view * lens.height + y) * lens.width + x;
    const Vec ray = {(x + 0.5 - lens.cx) / lens.fx, (y + 0.5 - lens.cy) / lens.fy, 1};
    const bool may_near = hit.low < lens.near, is_near = hit.certain && hit.high < lens.near;
    const bool may_far = hit.high > lens.far, is_far = hit.certain && hit.low > lens.far;
    bool is_seen = with.seen[pixel] == index, may_see = is_seen;
    if (with.depth.data) {
        const double length = ray.length(), delta = with.delta, slack = 1e-5 * (hit.high + delta);
        is_seen |= (hit.high - with.depth[pixel]) * length < delta - slack;
        may_see |= (hit.low - with.depth[pixel]) * length < delta + slack;
    }
    if (may_near) e.near.add(x, y, is_near);
    if (may_far) e.far.add(x, y, is_far);
    const bool in_range = hit.certain && !may_near && !may_far;
    if (may_see && !is_near && !is_far) e.visible.add(x, y, is_seen && in_range);
    if (!is_seen && !is_near && !is_far && with.seen[pixel] >= 0)
        e.hidden_by[with.seen[pixel]].add(x, y, !may_see && in_range);
    const bool is_known = hit.certain && is_seen == may_see && is_near == may_near && is_far == may_far;
    e.mask[y * lens.width + x] = !is_known ? -1 : is_seen && in_range ? 2 : 1;
}

static Expected expect(const Scene& scene, const Worlds& worlds, const Lens& lens, const Compared& with, int view,
                       int index) {
    Expected e;
    e.hidden_by.resize(scene.objects.size());
    e.mask.assign((size_t)lens.width * lens.height, 0);
    const int world = worlds.of(view);
    if (world < 0 || is_excluded(worlds, scene, view, index)) return e;
    Truth truth(lens, &worlds.cameras[7 * view]);
    const Movable& movable = scene.movables[index];
    const Placed place = Placed::of(worlds.place(world, index));
    if (movable.solid)
        truth.add_solid(movable, place, false, scene.objects);
    else
        truth.add(scene.objects[index], index, place, false);
    std::vector<Hit> hits;
    for (int y = with.canvas[1]; y < with.canvas[3]; ++y)
        for (int x = with.canvas[0]; x < with.canvas[2]; ++x) {
            truth.meet(x + 0.5 - lens.cx, y + 0.5 - lens.cy, hits);
            if (hits.empty()) continue;
            Hit nearest = {ENDLESS, ENDLESS, false, index, {0, 0, 0}, 0};
            for (const Hit& hit : hits) {
                nearest.certain |= hit.certain;
                nearest.low = std::min(nearest.low, hit.low);
                if (hit.certain) nearest.high = std::min(nearest.high, hit.high);
            }
            if (!nearest.certain)
                for (const Hit& hit : hits) nearest.high = std::min(nearest.high, hit.high);
            if (!nearest.certain && hits.size() > 1) nearest.high = ENDLESS;
            add_pixel(e, with, lens, view, index, x, y, nearest);
        }
    return e;
}

struct Found {
    const Counts& counts;
    const Compared& with;
    int views, view, place, objects;

    int value(int counter) const {
        return counts.counts[((size_t)counter * views + view) * with.chosen.size() + place];
    }
    bool box_fits(int counter, const Tally& tally) const {
        int codes[4];
        for (int k = 0; k < 4; ++k) codes[k] = value(counter + k);
        return tally.holds_box(codes);
    }

    const char* fault(const Expected& e, const Lens& lens) const {
        if (with.seen_only && e.visible.certain == 0 && value(VISIBLE) == 0) return fault_of_unseen(e);
        if (!e.silhouette.holds(value(SILHOUETTE))) return "silhouette";
        if (!box_fits(SILHOUETTE_BOX, e.silhouette)) return "silhouette box";
        return fault_in_image(e, lens);
    }

  private:
    // Pixels outside the image need not be counted in this case.
    const char* fault_of_unseen(const Expected& e) const {
        const int silhouette = value(SILHOUETTE);
        if (silhouette > e.silhouette.most || silhouette < e.image.certain) return "silhouette of an invisible object";
        return e.image.holds(value(IMAGE)) ? nullptr : "image of an invisible object";
    }

    const char* fault_in_image(const Expected& e, const Lens& lens) const {
        if (!e.image.holds(value(IMAGE))) return "image";
        if (!e.visible.holds(value(VISIBLE))) return "visible";
        if (!box_fits(VISIBLE_BOX, e.visible)) return "visible box";
        if (!e.near.holds(value(TOO_NEAR)) || !e.far.holds(value(TOO_FAR))) return "out of range";
        const size_t pair = (size_t)view * with.chosen.size() + place;
        for (int object = 0; object < objects; ++object) {
            const int by = counts.hidden_by[pair * objects + object];
            const Tally& tally = e.hidden_by[object];
            // With `seen_only`, occluders are counted for the image and again for the canvas.
            if (!with.seen_only && !tally.holds(by)) return "hidden by";
            if (with.seen_only && (by < 2 * tally.certain || by > 2 * tally.most)) return "hidden by";
        }
        for (size_t i = 0; i < e.mask.size() && with.masks; ++i) {
            const int mask = counts.masks[pair * lens.width * lens.height + i];
            if (e.mask[i] >= 0 && mask != e.mask[i]) return "mask";
        }
        return nullptr;
    }
};

static void check_scene(uint64_t seed) {
    Random random(seed);
    const Scene given = random_scene(random);
    Worlds worlds = random_worlds(random, given);
    const Scene scene = separate(given);
    spread(given, worlds);
    const SceneBvh clusters = cluster(scene);
    const Lens lens = random_lens(random, scene.scale);
    const Compared with = random_comparison(random, scene, lens, worlds.views);
    Shares shares;
    shares.workers = random.pick({1, 2});
    shares.shift = random.whole(0, 15);
    const Counts made = count_objects(clusters, worlds, lens, shares, with);
    for (int view = 0; view < worlds.views; ++view)
        for (int place = 0; place < (int)with.chosen.size(); ++place) {
            const Expected expected = expect(scene, worlds, lens, with, view, with.chosen[place]);
            const Found found = {made, with, worlds.views, view, place, (int)scene.objects.size()};
            const char* fault = found.fault(expected, lens);
            if (fault)
                fail(seed, view, fault, "of object %d: %d to %d, %d to %d in the image, %d to %d visible, not %d %d %d",
                     with.chosen[place], expected.silhouette.certain, expected.silhouette.most, expected.image.certain,
                     expected.image.most, expected.visible.certain, expected.visible.most, found.value(SILHOUETTE),
                     found.value(IMAGE), found.value(VISIBLE));
        }
}

int main(int count, char** arguments) { return check_all(count, arguments, check_scene); }
