// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Scenes and jobs in the casters' structs, in memory of exact size. No other file of the checks uses these structs.

#include "cast.h"

#include <thread>

#include "headers.h"

BuiltTree build_tree(int lanes, const Mesh& mesh, const std::vector<int>& owner,
                     const std::vector<unsigned char>& closed, bool evenly, int depth) {
    return lanes == 16 ? warpvis::build<16>(mesh, owner, closed, evenly, depth)
                       : warpvis::build<32>(mesh, owner, closed, evenly, depth);
}

unsigned turned_away(const BuiltTree& tree, int node, const float* camera) {
    using warpvis::Lanes;
    const float* rows = tree.node_rows.data + (size_t)node * 160;
    warpvis::Points box[2];
    for (int k = 0; k < 2; ++k)
        box[k] = {Lanes::load(rows + 48 * k) - camera[0], Lanes::load(rows + 48 * k + 16) - camera[1],
                  Lanes::load(rows + 48 * k + 32) - camera[2]};
    return Lanes::bits(warpvis::Walk<warpvis::PIXEL_RAYS>::faces_away(rows, box[0], box[1], 0.0f));
}

static warpvis::Linear edge_of(const float* edge) {
    using warpvis::Lanes;
    return {Lanes::all(edge[0]), Lanes::all(edge[1]), Lanes::all(edge[2])};
}

void narrow_columns(const float* edge, float error_bound, float first_u, float v0, float v1, float& left,
                    float& right) {
    using warpvis::Lanes;
    warpvis::Camera camera = warpvis::Camera();
    camera.first_u = first_u;
    warpvis::Floats from = Lanes::all(left), to = Lanes::all(right);
    warpvis::Raster::narrow(camera, edge_of(edge), error_bound, Lanes::all(v0), Lanes::all(v1), from, to);
    left = from[0], right = to[0];
}

bool is_inside(const float* edge, float error_bound, float u, float v) {
    using warpvis::Lanes;
    const warpvis::Linear linear = edge_of(edge);
    return linear.at(Lanes::all(u), linear.row(Lanes::all(v)))[0] >= -error_bound;
}

// Concatenates the trees of several meshes.
struct Joiner {
    std::vector<float> leaves, nodes, boxes, size, closed_boxes;
    std::vector<int> owners, children, object, root, first_leaf, first_id, closed, solid, closed_object, still;
    int levels = 0, ids = 0;

    // Add a mesh; returns its first node. `ids` grows by the number of its slots.
    int add(const Mesh& mesh, const std::vector<int>& owner, const std::vector<unsigned char>& closed_of) {
        const BuiltTree tree = warpvis::build<16>(mesh, owner, closed_of, false, 0);
        const int first_node = (int)children.size() / 16, leaf = (int)owners.size() / 16;
        for (size_t i = 0; i < tree.children.count; ++i) {
            const int child = tree.children[i];
            children.push_back(child > 0 ? child + first_node : child < 0 ? child - leaf : 0);
        }
        for (size_t i = 0; i < tree.owners.count; ++i) {
            const int of = tree.owners[i];
            owners.push_back(closed_of[of] ? ~of : of);
        }
        leaves.insert(leaves.end(), tree.leaf_rows.data, tree.leaf_rows.data + tree.leaf_rows.count);
        nodes.insert(nodes.end(), tree.node_rows.data, tree.node_rows.data + tree.node_rows.count);
        levels = std::max(levels, tree.levels);
        ids += tree.leaves * 16;
        return first_node;
    }
};

static void append(Mesh& mesh, const Mesh& part) {
    const int first = (int)mesh.vertices.size() / 3;
    mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
    for (int index : part.faces) mesh.faces.push_back(first + index);
}

static void box_of(const Mesh& mesh, std::vector<float>& boxes) {
    float box[6] = {INFINITY, INFINITY, INFINITY, -INFINITY, -INFINITY, -INFINITY};
    for (int index : mesh.faces)
        for (int k = 0; k < 3; ++k) {
            box[k] = std::min(box[k], mesh.vertices[3 * index + k]);
            box[3 + k] = std::max(box[3 + k], mesh.vertices[3 * index + k]);
        }
    boxes.insert(boxes.end(), box, box + 6);
}

static void add_movable_tree(Joiner& joiner, const Scene& scene, const Movable& movable) {
    Mesh mesh;
    std::vector<int> owner;
    std::vector<unsigned char> closed(scene.objects.size(), 0);
    const bool alone = movable.objects.size() == 1;
    bool all_closed = true;
    for (int index : movable.objects) {
        const Mesh& part = scene.objects[index].mesh;
        append(mesh, part);
        owner.insert(owner.end(), part.count(), alone ? 0 : index);
        closed[alone ? 0 : index] = part.closed;
        all_closed &= part.closed;
    }
    joiner.first_leaf.push_back((int)joiner.owners.size() / 16);
    joiner.first_id.push_back(joiner.ids);
    joiner.object.push_back(alone ? movable.objects[0] : -1);
    joiner.closed.push_back(all_closed);
    joiner.solid.push_back(movable.solid);
    joiner.size.insert(joiner.size.end(), movable.size, movable.size + 4);
    box_of(mesh, joiner.boxes);
    if (movable.solid) {
        float* box = &joiner.boxes[joiner.boxes.size() - 6];
        for (int k = 0; k < 3; ++k) {
            const bool along = k == 2 && movable.solid != BALL;
            const float straight = along ? movable.size[3] + (movable.solid == CAPSULE) : 1.0f;
            const float reach = std::nextafter(movable.size[k] * straight, INFINITY);
            box[k] = std::min(box[k], -reach), box[3 + k] = std::max(box[3 + k], reach);
        }
    }
    joiner.root.push_back(joiner.add(mesh, owner, closed));
}

SceneBvh cluster(const Scene& scene) {
    Joiner joiner;
    SceneBvh clusters;
    Mesh still;
    std::vector<int> owner;
    std::vector<unsigned char> closed(scene.objects.size(), 0), labels;
    for (int i = 0; i < (int)scene.objects.size(); ++i) {
        const Object& object = scene.objects[i];
        labels.push_back(object.label);
        if (object.movable >= 0) continue;
        append(still, object.mesh);
        owner.insert(owner.end(), object.mesh.count(), i);
        joiner.still.push_back(i);
        closed[i] = object.mesh.closed;
        clusters.all_closed &= object.mesh.closed;
        if (!object.mesh.closed) continue;
        joiner.closed_object.push_back(i);
        box_of(object.mesh, joiner.closed_boxes);
    }
    if (still.count()) clusters.static_root = joiner.add(still, owner, closed);
    for (const Movable& movable : scene.movables) add_movable_tree(joiner, scene, movable);
    clusters.leaves = Exact<float>(joiner.leaves), clusters.nodes = Exact<float>(joiner.nodes);
    clusters.owners = Exact<int>(joiner.owners), clusters.children = Exact<int>(joiner.children);
    clusters.closed_boxes = Exact<float>(joiner.closed_boxes);
    clusters.closed_object = Exact<int>(joiner.closed_object), clusters.still = Exact<int>(joiner.still);
    clusters.object = Exact<int>(joiner.object), clusters.root = Exact<int>(joiner.root);
    clusters.first_leaf = Exact<int>(joiner.first_leaf), clusters.first_id = Exact<int>(joiner.first_id);
    clusters.closed = Exact<int>(joiner.closed), clusters.solid = Exact<int>(joiner.solid);
    clusters.boxes = Exact<float>(joiner.boxes), clusters.size = Exact<float>(joiner.size);
    clusters.labels = Exact<unsigned char>(labels);
    clusters.levels = joiner.levels;
    return clusters;
}

static warpvis::Scene scene_of(const SceneBvh& c, const Worlds& worlds) {
    return {.bvh = {.leaves = c.leaves.data,
                    .owners = c.owners.data,
                    .nodes = c.nodes.data,
                    .children = c.children.data,
                    .root = c.static_root,
                    .all_closed = c.all_closed,
                    .closed_boxes = c.closed_boxes.data,
                    .closed_object = c.closed_object.data,
                    .closed_count = (int)c.closed_object.count},
            .movables = {.count = (int)c.object.count,
                         .moving = worlds.moving,
                         .object = c.object.data,
                         .root = c.root.data,
                         .first_leaf = c.first_leaf.data,
                         .first_id = c.first_id.data,
                         .closed = c.closed.data,
                         .boxes = c.boxes.data,
                         .solid = c.solid.data,
                         .size = c.size.data,
                         .instance_poses = worlds.instances.data,
                         .poses = worlds.poses.data,
                         .sizes = nullptr,
                         .worlds = worlds.worlds,
                         .world = worlds.world.data,
                         .excluded = worlds.excluded.data,
                         .excluded_views = worlds.excluded_views,
                         .objects = (int)c.labels.count,
                         .static_object = c.still.data,
                         .static_count = (int)c.still.count}};
}

static warpvis::Job job_of(const Worlds& worlds, const Lens& lens) {
    warpvis::Job job = warpvis::Job();
    job.views = worlds.views, job.height = lens.height, job.width = lens.width;
    job.focal[0] = lens.fx, job.focal[1] = lens.fy, job.center[0] = lens.cx, job.center[1] = lens.cy;
    job.near = lens.near, job.far = lens.far;
    job.poses = worlds.cameras.data;
    return job;
}

// Greatest 1 / z whose reciprocal, as rounded, is at least `near`.
static float clip_inv_z(float near) {
    float most = 1.0f / near;
    while (1.0f / most < near) most = std::nextafter(most, 0.0f);
    return most;
}

// Number of bytes that `carve` takes from an arena.
template <class Carve>
static size_t measure(Carve carve) {
    warpvis::Arena arena = warpvis::Arena::at(nullptr);
    carve(arena);
    return (size_t)arena.used;
}

// Run a job's workers, each in its own memory, which is zeroed first.
template <class Run>
static void run_workers(const Shares& shares, size_t bytes, int* counter, Run run) {
    std::vector<Exact<char>> memory;
    std::vector<std::thread> threads;
    Exact<int> taken(shares.workers);
    for (int i = 0; i < shares.workers; ++i) memory.emplace_back(bytes);
    const auto work = [&] {
        warpvis::Workers::enter(counter);
        const int slot = warpvis::Workers::take_memory(taken.data);
        warpvis::Arena arena = warpvis::Arena::at(memory[slot].data);
        run(arena);
        warpvis::Workers::give_back_memory(taken.data, slot);
    };
    for (int i = 1; i < shares.workers; ++i) threads.emplace_back(work);
    work();
    for (std::thread& thread : threads) thread.join();
}

Pictures cast(const SceneBvh& c, const Worlds& worlds, const Lens& lens, const Shares& shares, bool cull,
              unsigned outputs, const Exact<float>& at, int points) {
    warpvis::Job job = job_of(worlds, lens);
    const Exact<int> rows(shares.strip_rows);
    job.strips = (int)rows.count - 1, job.strip_rows = rows.data;
    for (int i = 0; i < job.strips; ++i) job.max_rows = std::max(job.max_rows, rows[i + 1] - rows[i]);
    job.cull_back_faces = cull;
    job.clip_inv_z = lens.clips ? clip_inv_z(lens.near) : INFINITY;
    job.clip_reach = lens.clips ? (float)lens.near_reach() : 0.0f;
    job.points = points, job.pixels = at.data;
    const size_t pixels = (size_t)job.views * (points ? points : job.height * job.width);
    Pictures made;
    if (outputs & DEPTH) made.depth = Exact<float>(pixels, -7.0f, shares.shift);
    if (outputs & POINTS) made.points = Exact<float>(pixels * 3, -7.0f, shares.shift);
    if (outputs & NORMALS) made.normals = Exact<float>(pixels * 3, -7.0f, shares.shift);
    if (outputs & LABELS) made.labels = Exact<unsigned char>(pixels, 77, shares.shift);
    if (outputs & OBJECTS) made.objects = Exact<int>(pixels, -7, shares.shift);
    const warpvis::Images out = {.depth = made.depth.data,
                                 .points = made.points.data,
                                 .normals = made.normals.data,
                                 .labels = made.labels.data,
                                 .segmentation = made.objects.data,
                                 .faces = nullptr,
                                 .object_label = c.labels.data,
                                 .slot_face = nullptr};
    const warpvis::Scene scene = scene_of(c, worlds);
    const auto carve = [&](warpvis::Arena& arena) {
        return warpvis::StripMemory::carve(arena, job, scene.movables.count, c.levels);
    };
    Exact<int> counter(warpvis::JOB_COUNTERS, 0);
    run_workers(shares, measure(carve), counter.data, [&](warpvis::Arena& arena) {
        const warpvis::StripMemory memory = carve(arena);
        warpvis::Launch::run<warpvis::Strips>(scene, job, out, memory, counter.data);
    });
    return made;
}

Statuses judge_points(const SceneBvh& c, const Worlds& worlds, const Lens& lens, const Shares& shares,
                      const Layout& layout, const Exact<float>& places) {
    warpvis::Job job = job_of(worlds, lens);
    const double width = lens.width * layout.scale, height = lens.height * layout.scale;
    job.width = (int)std::ceil(width), job.height = (int)std::ceil(height);
    for (int k = 0; k < 2; ++k) job.focal[k] *= layout.scale, job.center[k] *= layout.scale;
    const int count = (int)places.count / 3;
    Statuses made;
    made.status = Exact<unsigned char>((size_t)job.views * count, 77, shares.shift);
    if (layout.occluders) made.occluders = Exact<int>((size_t)job.views * count, -7, shares.shift);
    const warpvis::PointJob points = {.place = places.data,
                                      .count = count,
                                      .batch = layout.batch,
                                      .strip_tiles = layout.strip_tiles,
                                      .views_are_units = layout.whole,
                                      .with_id = layout.with_id,
                                      .width = width,
                                      .height = height,
                                      .tolerance = layout.tolerance,
                                      .status = made.status.data,
                                      .occluders = made.occluders.data};
    const int tiles_x = warpvis::Grid::tiles(job.width), tiles_y = warpvis::Grid::tiles(job.height);
    const warpvis::Scene scene = scene_of(c, worlds);
    const auto carve_bins = [&](warpvis::Arena& arena) {
        return warpvis::PointBins::carve(arena, points, tiles_x, tiles_y);
    };
    const auto carve = [&](warpvis::Arena& arena) {
        return warpvis::PointMemory::carve(arena, points, tiles_x, scene.movables.count, c.levels);
    };
    Exact<int> counter(warpvis::JOB_COUNTERS, 0);
    Exact<char> shared(measure(carve_bins));
    const int chunks = points.chunks(), strips = points.strips(tiles_y);
    const int units = job.views * points.batches() * (layout.whole ? 1 : chunks + strips);
    run_workers(shares, measure(carve), counter.data, [&](warpvis::Arena& arena) {
        const warpvis::PointMemory memory = carve(arena);
        Exact<char> own(layout.whole ? measure(carve_bins) : 0);
        warpvis::Arena place = warpvis::Arena::at(layout.whole ? own.data : shared.data);
        const warpvis::PointBins bins = carve_bins(place);
        const warpvis::PointWork work = {scene, job, points, bins};
        const warpvis::PointPackets packets = warpvis::PointPackets::of(work, memory);
        packets.run(counter.data);
        while (__atomic_load_n(counter.data + warpvis::COUNTER_NEXT_UNIT, __ATOMIC_SEQ_CST) < units) {
            std::this_thread::yield();  // this worker had to wait for others
            warpvis::Workers::enter(counter.data);
            packets.run(counter.data);
        }
    });
    return made;
}

Counts count_objects(const SceneBvh& c, const Worlds& worlds, const Lens& lens, const Shares& shares,
                     const Compared& with) {
    warpvis::Job job = job_of(worlds, lens);
    job.far = INFINITY;
    const int chosen = (int)with.chosen.size(), objects = (int)c.labels.count, pairs = job.views * chosen;
    const Exact<int> indices(with.chosen);
    Counts made;
    made.counts = Exact<int>((size_t)COUNTERS * pairs, 0);
    made.hidden_by = Exact<int>((size_t)pairs * objects, 0);
    if (with.masks) made.masks = Exact<unsigned char>((size_t)pairs * lens.height * lens.width, 0);
    const warpvis::SilhouetteJob request = {.count = chosen,
                                            .chosen = indices.data,
                                            .objects = objects,
                                            .canvas = {with.canvas[0], with.canvas[1], with.canvas[2], with.canvas[3]},
                                            .seen_only = with.seen_only,
                                            .near = lens.near,
                                            .far = lens.far,
                                            .seen = with.seen.data,
                                            .depth = with.depth.data,
                                            .delta = with.delta,
                                            .counts = (char*)made.counts.data,
                                            .count_stride = pairs * 4LL,
                                            .view_stride = chosen * 4LL,
                                            .hidden_by = made.hidden_by.data,
                                            .masks = made.masks.data};
    const warpvis::Scene scene = scene_of(c, worlds);
    const auto carve = [&](warpvis::Arena& arena) {
        return warpvis::SilhouetteMemory::carve(arena, request, scene.movables.count, c.levels);
    };
    Exact<int> counter(warpvis::JOB_COUNTERS, 0);
    run_workers(shares, measure(carve), counter.data, [&](warpvis::Arena& arena) {
        const warpvis::SilhouetteMemory memory = carve(arena);
        warpvis::Silhouettes{scene, job, request, memory}.run(counter.data);
    });
    return made;
}
