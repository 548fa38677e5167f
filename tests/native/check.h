// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Common parts of the checks: random cameras and worlds, their ground truth, and reports of faults.

#pragma once

#include <cstdarg>
#include <cstdio>
#include <cstdlib>

#include "cast.h"

static int faults = 0;

__attribute__((format(printf, 4, 5))) inline void fail(uint64_t seed, int view, const char* what, const char* format,
                                                       ...) {
    va_list values;
    va_start(values, format);
    if (faults++ < 20) {
        std::printf("seed %llu, view %d: %s ", (unsigned long long)seed, view, what);
        std::vprintf(format, values);
        std::printf("\n");
    }
    va_end(values);
}

inline Lens random_lens(Random& random, double scale) {
    static const int sizes[][2] = {{1, 1}, {1, 37}, {37, 1}, {17, 5}, {16, 16}, {32, 48}, {33, 31}, {64, 20}, {90, 40}};
    const int* size = sizes[random.whole(0, 8)];
    Lens lens;
    lens.width = size[0], lens.height = size[1];
    const double wide = random.pick({0.3, 0.5, 0.8, 1.5, 12.0, 60.0}) * std::max(size[0], size[1]);
    lens.fx = wide;
    lens.fy = wide * random.pick({1.0, 1.0, 0.7});
    lens.cx = size[0] * 0.5, lens.cy = size[1] * 0.5;
    if (random.chance(0.3)) lens.cx = random.real(-1, 2) * size[0], lens.cy = random.real(-0.2, 1.2) * size[1];
    lens.near = random.chance(0.3) ? (float)(random.real(0.05, 1.5) * scale) : 0.0f;
    lens.far = random.chance(0.3) ? (float)(random.real(2, 4) * scale) : INFINITY;
    return lens;
}

inline Worlds random_worlds(Random& random, const Scene& scene) {
    Worlds worlds;
    const int movables = (int)scene.movables.size(), objects = (int)scene.objects.size();
    worlds.views = random.whole(1, 3);
    const int moving = worlds.moving = random.chance(0.3) ? random.whole(0, movables) : movables;
    const bool by_index = moving && random.chance(0.4);
    worlds.worlds = by_index ? random.whole(1, 4) : moving && random.chance(0.5) ? worlds.views : 1;
    worlds.cameras = Exact<float>((size_t)worlds.views * 7);
    for (int view = 0; view < worlds.views; ++view) random_pose(random, scene, &worlds.cameras[7 * view]);
    worlds.poses = Exact<float>((size_t)worlds.worlds * moving * 7);
    for (int i = 0; i < worlds.worlds * moving; ++i) random_pose(random, scene, &worlds.poses[7 * i]);
    worlds.instances = Exact<float>((size_t)(movables - moving) * 7);
    for (int i = 0; i < movables - moving; ++i) random_pose(random, scene, &worlds.instances[7 * i]);
    if (by_index) {
        worlds.world = Exact<int>(worlds.views);
        for (int view = 0; view < worlds.views; ++view)
            worlds.world[view] =
                random.chance(0.1) ? random.pick({-1, worlds.worlds}) : random.whole(0, worlds.worlds - 1);
    }
    if (random.chance(0.25)) {
        worlds.excluded_views = random.chance(0.5) ? 1 : worlds.views;
        worlds.excluded = Exact<unsigned char>((size_t)worlds.excluded_views * objects);
        for (size_t i = 0; i < worlds.excluded.count; ++i) worlds.excluded[i] = random.chance(0.3);
    }
    return worlds;
}

inline bool is_excluded(const Worlds& worlds, const Scene& scene, int view, int object) {
    if (!worlds.excluded.data) return false;
    return worlds.excluded[std::min(view, worlds.excluded_views - 1) * scene.objects.size() + object] != 0;
}

inline Truth truth_of(const Scene& scene, const Worlds& worlds, const Lens& lens, int view, bool cull) {
    Truth truth(lens, &worlds.cameras[7 * view]);
    const int world = worlds.of(view);
    if (worlds.moving && world < 0) return truth;
    for (int index = 0; index < (int)scene.objects.size(); ++index) {
        const Object& object = scene.objects[index];
        if (is_excluded(worlds, scene, view, index)) continue;
        if (object.movable < 0) {
            truth.add(object, index, Placed::nowhere(), cull);
            continue;
        }
        const Movable& movable = scene.movables[object.movable];
        const Placed place = Placed::of(worlds.place(world, object.movable));
        if (movable.solid)
            truth.add_solid(movable, place, cull, scene.objects);
        else
            truth.add(object, index, place, cull);
    }
    return truth;
}

// Check COUNT scenes from the first seed on; returns 1 if there was a fault.
template <class Check>
int check_all(int count, char** arguments, Check check) {
    if (count != 3) {
        std::printf("usage: %s FIRST_SEED COUNT\n", arguments[0]);
        return 2;
    }
    const uint64_t first = std::strtoull(arguments[1], nullptr, 10), scenes = std::strtoull(arguments[2], nullptr, 10);
    for (uint64_t seed = first; seed < first + scenes && faults < 20; ++seed) check(seed);
    std::printf("%d faults in %llu scenes\n", faults, (unsigned long long)scenes);
    return faults ? 1 : 0;
}
