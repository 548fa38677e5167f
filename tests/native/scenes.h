// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Random scenes, with degenerate geometry.

#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

struct Random {
    std::mt19937_64 engine;

    explicit Random(uint64_t seed) : engine(seed * 0x9E3779B97F4A7C15ull + 1) {}
    double real(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
    int whole(int low, int high) { return std::uniform_int_distribution<int>(low, high)(engine); }
    bool chance(double p) { return real(0, 1) < p; }
    template <class T>
    T pick(std::initializer_list<T> of) {
        return of.begin()[whole(0, (int)of.size() - 1)];
    }
};

enum SolidKind { MESH, BALL, CYLINDER, CAPSULE };  // same values as warpvis.solids.SolidKind

struct Mesh {
    std::vector<float> vertices;
    std::vector<int> faces;
    bool closed = false;  // watertight, convex, and with outward normals

    int count() const { return (int)faces.size() / 3; }
    int add(double x, double y, double z) {
        for (double value : {x, y, z}) vertices.push_back((float)value);
        return (int)vertices.size() / 3 - 1;
    }
    void face(int a, int b, int c) {
        for (int corner : {a, b, c}) faces.push_back(corner);
    }
};

struct Object {
    Mesh mesh;
    int movable = -1;  // index of its movable; -1 for a static object
    unsigned char label = 0;
};

struct Movable {
    std::vector<int> objects;
    int solid = MESH;
    float size[4] = {1, 1, 1, 1};
};

struct Scene {
    std::vector<Object> objects;
    std::vector<Movable> movables;
    double scale = 1, offset[3] = {0, 0, 0};
    bool is_room = false;  // a closed mesh surrounds all cameras
    bool has_floor = false;  // seen at grazing angles
};

namespace meshes {

// Random triangles, including degenerate ones, duplicates, slivers, tiny and huge ones.
inline Mesh soup(Random& random, int count, double size) {
    Mesh mesh;
    for (int i = 0; i < count; ++i) {
        const double reach = size * random.pick({0.02, 0.3, 0.3, 1.0, 4.0});
        const double x = random.real(-size, size), y = random.real(-size, size), z = random.real(-size, size);
        int corner[3];
        for (int& c : corner)
            c = mesh.add(x + random.real(-reach, reach), y + random.real(-reach, reach),
                         z + random.real(-reach, reach));
        const int kind = random.whole(0, 11);
        if (kind == 0) corner[2] = corner[random.whole(0, 1)];
        if (kind == 1)  // collinear corners
            for (int k = 0; k < 3; ++k)
                mesh.vertices[3 * corner[2] + k] =
                    (mesh.vertices[3 * corner[0] + k] + mesh.vertices[3 * corner[1] + k]) / 2;
        const double thin = size * random.pick({1e-3, 1e-4, 1e-2});
        if (kind == 2 || kind == 5)  // a sliver
            for (int k = 0; k < 3; ++k)
                mesh.vertices[3 * corner[2] + k] = mesh.vertices[3 * corner[0] + k] + (float)random.real(0, thin);
        if (kind == 3 && mesh.count() > 0)  // shares an edge with the previous triangle
            corner[0] = mesh.faces[mesh.faces.size() - 1], corner[1] = mesh.faces[mesh.faces.size() - 2];
        mesh.face(corner[0], corner[1], corner[2]);
        if (kind == 4) mesh.face(corner[1], corner[0], corner[2]);  // the same triangle with the opposite orientation
    }
    return mesh;
}

// A box with n x n squares per face: rays from its center pass through many edges and corners.
inline Mesh box(double x, double y, double z, int n) {
    Mesh mesh;
    mesh.closed = true;
    const double half[3] = {x, y, z};
    for (int axis = 0; axis < 3; ++axis)
        for (int side = -1; side <= 1; side += 2) {
            const int first = (int)mesh.vertices.size() / 3;
            for (int i = 0; i <= n; ++i)
                for (int j = 0; j <= n; ++j) {
                    double p[3];
                    p[axis] = side * half[axis];
                    p[(axis + 1) % 3] = (2.0 * i / n - 1) * half[(axis + 1) % 3];
                    p[(axis + 2) % 3] = (2.0 * j / n - 1) * half[(axis + 2) % 3];
                    mesh.add(p[0], p[1], p[2]);
                }
            for (int i = 0; i < n; ++i)
                for (int j = 0; j < n; ++j) {
                    const int a = first + i * (n + 1) + j, b = a + n + 1;
                    if (side > 0) mesh.face(a, b, b + 1), mesh.face(a, b + 1, a + 1);
                    if (side < 0) mesh.face(a, b + 1, b), mesh.face(a, a + 1, b + 1);
                }
        }
    return mesh;
}

// Surface of revolution about z of a profile that begins and ends on the axis.
inline Mesh revolved(const std::vector<double>& ring, const std::vector<double>& height, int slices,
                     const float* size) {
    Mesh mesh;
    mesh.closed = true;
    const int rings = (int)ring.size();
    for (int r = 1; r + 1 < rings; ++r)
        for (int s = 0; s < slices; ++s) {
            const double angle = 2 * M_PI * s / slices;
            mesh.add(ring[r] * std::cos(angle) * size[0], ring[r] * std::sin(angle) * size[1], height[r] * size[2]);
        }
    const int bottom = mesh.add(0, 0, height[0] * size[2]), top = mesh.add(0, 0, height[rings - 1] * size[2]);
    for (int s = 0; s < slices; ++s) {
        const int next = (s + 1) % slices, last = (rings - 3) * slices;
        mesh.face(next, s, bottom);
        mesh.face(last + s, last + next, top);
        for (int r = 0; r + 3 < rings; ++r) {
            const int a = r * slices + s, b = r * slices + next;
            mesh.face(a, b, b + slices), mesh.face(a, b + slices, a + slices);
        }
    }
    return mesh;
}

inline Mesh of_solid(int kind, const float* size, int stacks = 8, int slices = 10) {
    std::vector<double> ring, height;
    if (kind == CYLINDER) {
        ring = {0, 1, 1, 0};
        height = {-size[3], -size[3], size[3], size[3]};
    } else {
        const double half = kind == CAPSULE ? size[3] : 0.0;
        for (int i = 0; i <= stacks; ++i) {
            const double angle = M_PI * (i / (double)stacks - 0.5);
            ring.push_back(std::cos(angle));
            height.push_back(std::sin(angle) + (i < stacks / 2 ? -half : half));
            if (i == stacks / 2 && half > 0) ring.push_back(1.0), height.insert(height.end() - 1, -half);
        }
    }
    return revolved(ring, height, slices, size);
}

// A wavy surface facing along z, of squares whose corners are at multiples of `step`.
inline Mesh grid(Random& random, int n, double step, double waves) {
    Mesh mesh;
    for (int i = 0; i <= n; ++i)
        for (int j = 0; j <= n; ++j)
            mesh.add((i - n / 2) * step, (j - n / 2) * step, waves > 0 ? random.real(-waves, waves) : 0.0);
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const int a = i * (n + 1) + j, b = a + n + 1;
            mesh.face(a, b, b + 1), mesh.face(a, b + 1, a + 1);
        }
    return mesh;
}

inline Mesh any(Random& random, double size) {
    switch (random.whole(0, 6)) {
        case 0:
            return soup(random, random.whole(1, 3), size);
        case 1:
            return soup(random, random.whole(14, 18), size);
        case 2:
            return soup(random, random.whole(60, 250), size);
        case 3:
            return box(random.real(0.1, 1) * size, random.real(0.1, 1) * size, random.real(0.1, 1) * size, 1);
        case 4: {
            const float ball[3] = {(float)(0.5 * size), (float)(0.7 * size), (float)(0.4 * size)};
            return random.chance(0.5) ? of_solid(BALL, ball) : of_solid(BALL, ball, 20, 40);
        }
        case 5:
            return grid(random, random.whole(2, 9), 0.25 * size, random.pick({0.0, 0.2}) * size);
        default:
            return box(0.5 * size, 0.5 * size, 0.25 * size, random.whole(2, 4));
    }
}

inline void shift(Mesh& mesh, const double* by) {
    for (size_t i = 0; i < mesh.vertices.size(); ++i) mesh.vertices[i] = (float)(mesh.vertices[i] + by[i % 3]);
}

}  // namespace meshes

// Add a movable: a solid, one object, or several objects that move together.
inline void add_movable(Random& random, Scene& scene) {
    Movable movable;
    const double size = 0.5 * scene.scale;
    if (random.chance(0.35)) {
        movable.solid = random.pick({BALL, CYLINDER, CAPSULE});
        const double radius = random.real(0.2, 1.0) * size;
        for (int k = 0; k < 3; ++k) movable.size[k] = (float)radius;
        if (movable.solid == BALL)
            for (int k = 0; k < 3; ++k) movable.size[k] = (float)(random.real(0.2, 1.0) * size);
        movable.size[3] = movable.solid == BALL ? 0.0f : (float)random.real(0.2, 2.0);
    }
    const int parts = movable.solid || random.chance(0.7) ? 1 : random.whole(2, 3);
    for (int part = 0; part < parts; ++part) {
        Object object;
        object.mesh = movable.solid ? meshes::of_solid(movable.solid, movable.size) : meshes::any(random, size);
        object.movable = (int)scene.movables.size();
        object.label = (unsigned char)random.whole(1, 5);
        const double away[3] = {part * 0.6 * size, part * random.real(-0.5, 0.5) * size, 0.0};
        if (part > 0) meshes::shift(object.mesh, away);
        movable.objects.push_back((int)scene.objects.size());
        scene.objects.push_back(object);
    }
    scene.movables.push_back(movable);
}

inline Scene random_scene(Random& random) {
    Scene scene;
    scene.scale = random.pick({1.0, 1.0, 1.0, 1e-3, 1e3});
    if (random.chance(0.25))
        for (double& o : scene.offset) o = random.real(-1e4, 1e4) * scene.scale;
    scene.is_room = random.chance(0.2);
    scene.has_floor = !scene.is_room && random.chance(0.25);
    const int movables = random.pick({0, 0, 1, 3, 15, 16, 17, 35});
    const int still = scene.is_room || scene.has_floor ? 1 : random.whole(movables ? 0 : 1, 3);
    for (int i = 0; i < still; ++i) {
        Object object;
        object.mesh = meshes::any(random, 1.5 * scene.scale);
        if (scene.is_room && i == 0) {
            object.mesh = meshes::box(4 * scene.scale, 4 * scene.scale, 4 * scene.scale, random.pick({1, 2, 8}));
        } else if (scene.has_floor && i == 0) {
            object.mesh = meshes::grid(random, 12, 0.25 * scene.scale, random.pick({0.0, 1e-3, 1e-2}) * scene.scale);
        } else {
            const double away[3] = {random.real(-2, 2) * scene.scale, random.real(-2, 2) * scene.scale,
                                    random.real(-2, 2) * scene.scale};
            meshes::shift(object.mesh, away);
        }
        meshes::shift(object.mesh, scene.offset);
        object.label = (unsigned char)random.whole(1, 5);
        scene.objects.push_back(object);
    }
    for (int i = 0; i < movables; ++i) add_movable(random, scene);
    return scene;
}

// Random pose x y z qx qy qz qw in the scene.
inline void random_pose(Random& random, const Scene& scene, float* row) {
    for (int k = 0; k < 3; ++k) row[k] = (float)(scene.offset[k] + random.real(-2.5, 2.5) * scene.scale);
    const int kind = random.whole(0, 4);
    if (kind == 0)  // aligned with the axes, so that rays are parallel to them
        for (int k = 0; k < 3; ++k) row[k] = (float)(scene.offset[k] + random.whole(-2, 2) * scene.scale);
    for (int k = 3; k < 7; ++k) row[k] = kind == 0 ? (k == 6) : (float)random.real(-1, 1);
    if (kind == 1) row[3] = row[4] = 0.0f, row[5] = row[6] = 0.7f;
    if (scene.has_floor && random.chance(0.7)) {  // close above the floor, looking along it
        const float rotation[4] = {0.5f, -0.5f, 0.5f, -0.5f};
        row[2] = (float)(scene.offset[2] + random.pick({1e-4, 1e-3, 1e-2, 0.1, -0.01}) * scene.scale);
        for (int k = 3; k < 7; ++k) row[k] = rotation[k - 3] + (float)random.real(-0.02, 0.02);
    }
    double length = 0;
    for (int k = 3; k < 7; ++k) length += (double)row[k] * row[k];
    if (length < 0.01) row[6] += 1.0f;
}
