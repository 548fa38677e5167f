// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Scenes and jobs as the casters take them, in memory of the exact size: the one place that knows the casters' structs.

#include "cast.h"

#include <thread>

#include "headers.h"

BuiltTree build_tree(int lanes, const Mesh& mesh, const std::vector<int>& owner,
                     const std::vector<unsigned char>& closed, bool evenly, int depth) {
    return lanes == 16 ? building_16::build(mesh, owner, closed, evenly, depth)
                       : building_32::build(mesh, owner, closed, evenly, depth);
}

unsigned turned_away(const BuiltTree& tree, int node, const float* camera) {
    using casting::Lanes;
    const float* rows = tree.node_rows.data + (size_t)node * 160;
    casting::Points box[2];
    for (int k = 0; k < 2; ++k)
        box[k] = {Lanes::load(rows + 48 * k) - camera[0], Lanes::load(rows + 48 * k + 16) - camera[1],
                  Lanes::load(rows + 48 * k + 32) - camera[2]};
    return Lanes::bits(casting::Walk::faces_away(rows, box[0], box[1]));
}

// Joins trees of many meshes into the same arrays.
struct Joiner {
    std::vector<float> leaves, nodes, boxes, size, closed_boxes;
    std::vector<int> owners, children, object, root, first_leaf, first_id, closed, solid, closed_object, still;
    int levels = 0, ids = 0;

    // The mesh's first node; `ids` grows by its places.
    int add(const Mesh& mesh, const std::vector<int>& owner, const std::vector<unsigned char>& closed_of) {
        const BuiltTree tree = building_16::build(mesh, owner, closed_of, false, 0);
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

Clusters cluster(const Scene& scene) {
    Joiner joiner;
    Clusters clusters;
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

static casting::Tree tree_of(const Clusters& c) {
    return {c.leaves.data, c.owners.data, c.nodes.data, c.children.data, c.static_root, c.all_closed};
}

static casting::Movables movables_of(const Clusters& c, const Worlds& worlds) {
    return {(int)c.object.count, c.object.data,     c.root.data,          c.first_leaf.data,     c.first_id.data,
            c.closed.data,       c.boxes.data,      c.solid.data,         c.size.data,           worlds.poses.data,
            worlds.worlds,       worlds.world.data, worlds.excluded.data, worlds.excluded_views, (int)c.labels.count,
            c.still.data,        (int)c.still.count};
}

static casting::Job job_of(const Clusters& c, const Worlds& worlds, const Lens& lens) {
    casting::Job job = casting::Job();
    job.views = worlds.views, job.height = lens.height, job.width = lens.width;
    job.focal[0] = lens.fx, job.focal[1] = lens.fy, job.center[0] = lens.cx, job.center[1] = lens.cy;
    job.near = lens.near, job.far = lens.far;
    job.poses = worlds.cameras.data;
    job.closed_boxes = c.closed_boxes.data, job.closed_object = c.closed_object.data;
    job.closed_count = (int)c.closed_object.count;
    return job;
}

// Words of memory that warpvis.casters gives to a thread.
static size_t cast_words(const casting::Job& job, const Clusters& c) {
    const size_t tiles_x = (job.width + 15) / 16, tiles_y = (job.most_rows + 15) / 16, points = job.points;
    size_t words = tiles_x * tiles_y * (2 * 256 + 16 + 1 + 4 + 1) + tiles_x * 128 + (c.levels + 1) * 16 * 6 + 64;
    words += c.object.count * 65;
    const size_t cells = tiles_x * tiles_y * 16;
    if (points) words += cells + 32 + 5 * (points + 15 * std::min(cells, points) + 16);
    return words;
}

// Run a job's workers, each in memory of its own, which holds zeros at first.
template <class Run>
static void run_workers(const Shares& shares, size_t words, int* counter, Run run) {
    std::vector<Exact<float>> memory;
    std::vector<std::thread> threads;
    for (int i = 0; i < shares.workers; ++i) memory.emplace_back(words, 0.0f, shares.shift);
    const auto work = [&](int i) {
        __atomic_fetch_add(counter + casting::Packets::entered, 1, __ATOMIC_SEQ_CST);
        run(memory[i].data);
    };
    for (int i = 1; i < shares.workers; ++i) threads.emplace_back(work, i);
    work(0);
    for (std::thread& thread : threads) thread.join();
}

Pictures cast(const Clusters& c, const Worlds& worlds, const Lens& lens, const Shares& shares, bool cull,
              unsigned outputs, const Exact<float>& at, int points) {
    casting::Job job = job_of(c, worlds, lens);
    const Exact<int> rows(shares.strip_rows);
    job.strips = (int)rows.count - 1, job.strip_rows = rows.data;
    for (int i = 0; i < job.strips; ++i) job.most_rows = std::max(job.most_rows, rows[i + 1] - rows[i]);
    job.cull_back_faces = cull;
    job.points = points, job.at = at.data;
    const size_t pixels = (size_t)job.views * (points ? points : job.height * job.width);
    Pictures made;
    if (outputs & DEPTH) made.depth = Exact<float>(pixels, -7.0f, shares.shift);
    if (outputs & POINTS) made.points = Exact<float>(pixels * 3, -7.0f, shares.shift);
    if (outputs & NORMALS) made.normals = Exact<float>(pixels * 3, -7.0f, shares.shift);
    if (outputs & LABELS) made.labels = Exact<unsigned char>(pixels, 77, shares.shift);
    if (outputs & OBJECTS) made.objects = Exact<int>(pixels, -7, shares.shift);
    const casting::Images out = {made.depth.data,  made.points.data,  made.normals.data,
                                 made.labels.data, made.objects.data, c.labels.data};
    const casting::Tree tree = tree_of(c);
    const casting::Movables movables = movables_of(c, worlds);
    Exact<int> counter(3, 0);
    run_workers(shares, cast_words(job, c), counter.data,
                [&](float* memory) { casting::Packets::run(tree, movables, job, out, memory, counter.data); });
    return made;
}

Statuses judge_points(const Clusters& c, const Worlds& worlds, const Lens& lens, const Shares& shares,
                      const Layout& layout, const Exact<float>& places) {
    casting::Job job = job_of(c, worlds, lens);
    const double width = lens.width * layout.scale, height = lens.height * layout.scale;
    job.width = (int)std::ceil(width), job.height = (int)std::ceil(height);
    for (int k = 0; k < 2; ++k) job.focal[k] *= layout.scale, job.center[k] *= layout.scale;
    const int count = (int)places.count / 3;
    Statuses made;
    made.status = Exact<unsigned char>((size_t)job.views * count, 77, shares.shift);
    if (layout.occluders) made.occluders = Exact<int>((size_t)job.views * count, -7, shares.shift);
    const casting::PointJob points = {places.data, count,  layout.batch,     layout.strip_tiles, layout.whole,
                                      width,       height, layout.tolerance, made.status.data,   made.occluders.data};
    const size_t tiles_x = (job.width + 15) / 16, tiles_y = (job.height + 15) / 16, chunks = points.chunks();
    const size_t strips = (tiles_y + layout.strip_tiles - 1) / layout.strip_tiles, tiles = tiles_x * layout.strip_tiles;
    const size_t lanes = layout.batch + 15 * std::min<size_t>(tiles * strips * 16, layout.batch);
    size_t desk_words =
        (chunks * tiles_y + 15) / 16 * 16 + chunks * points.chunk * 4 + lanes * (layout.with_id ? 5 : 4);
    desk_words = (desk_words + 15) / 16 * 16;
    size_t words = (layout.batch + 16) * 4 + tiles * (16 + 16 + 1 + 4 + 1) + 16 + tiles_x * 16;
    words += c.object.count * 65 + (c.levels + 1) * 16 * 6 + 2 * 16;
    words = (words + 15) / 16 * 16;
    const casting::Tree tree = tree_of(c);
    const casting::Movables movables = movables_of(c, worlds);
    Exact<int> counter(4, 0);
    Exact<float> shared(desk_words, 0.0f);
    run_workers(shares, words, counter.data, [&](float* memory) {
        Exact<float> own(layout.whole ? desk_words : 0, 0.0f);
        const casting::Desk desk = casting::Desk::carve(layout.whole ? own.data : shared.data, points, (int)tiles_y,
                                                        (long long)lanes, layout.with_id);
        casting::PointPackets::run(tree, movables, job, points, desk, memory, counter.data);
    });
    return made;
}

Counts count_objects(const Clusters& c, const Worlds& worlds, const Lens& lens, const Shares& shares,
                     const Compared& with) {
    casting::Job job = job_of(c, worlds, lens);
    job.far = INFINITY;
    const int chosen = (int)with.chosen.size(), objects = (int)c.labels.count, pairs = job.views * chosen;
    const Exact<int> indices(with.chosen);
    Counts made;
    made.counts = Exact<int>((size_t)COUNTERS * pairs, 0);
    made.hidden_by = Exact<int>((size_t)pairs * objects, 0);
    if (with.masks) made.masks = Exact<unsigned char>((size_t)pairs * lens.height * lens.width, 0);
    const casting::Survey survey = {chosen,
                                    indices.data,
                                    objects,
                                    {with.canvas[0], with.canvas[1], with.canvas[2], with.canvas[3]},
                                    with.seen_only,
                                    lens.near,
                                    lens.far,
                                    with.seen.data,
                                    with.depth.data,
                                    with.delta,
                                    (char*)made.counts.data,
                                    pairs * 4LL,
                                    chosen * 4LL,
                                    made.hidden_by.data,
                                    made.masks.data};
    const size_t tiles = std::max(512, (with.canvas[2] - with.canvas[0] + 16 + 15) / 16);
    const size_t words = tiles * (256 + 16 + 1 + 4 + 1) + (c.levels + 1) * 16 * 6 + c.object.count * 65 + 64;
    const casting::Tree tree = tree_of(c);
    const casting::Movables movables = movables_of(c, worlds);
    Exact<int> counter(3, 0);
    run_workers(shares, words, counter.data,
                [&](float* memory) { casting::Silhouettes::run(tree, movables, job, survey, memory, counter.data); });
    return made;
}
