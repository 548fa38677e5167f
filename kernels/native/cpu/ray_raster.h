// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rasterization of a leaf's triangles, or of a solid, to the rays of a `RayTree`. The result does not depend on the
// method: a triangle and a ray are intersected by the same sums, whether for many rays of one triangle or many
// triangles of one ray.
//
// With distinct origins (`RayOrigins`), a ray (p, q, 0) + z (u, v, 1) has Plücker coordinates with direction d = (u, v,
// 1) and moment m = (-q, p, u q - v p) about the eye. The edge function of an edge from a to b is their side product (a
// x b) . d + (a - b) . m: its sign gives the side on which the ray passes, and its first term is the edge function of a
// ray from the eye. If N . d is 1 / z of a plane for a ray from the eye, N . d / (1 - N . (p, q, 0)) is 1 / z for this
// ray. If that denominator is not well above 0 for the whole bundle, a ray may see the other side of the plane than the
// eye does: such triangles are tested in double precision, ray by ray.

#pragma once

#include "cpu/ray_leaf.h"
#include "cpu/scene.h"

// The way from a leaf's triangles to the rays that they may cover.
template <RayKind KIND>
struct RayRaster {
    // Up to this many rays and packets are tested before triangles are culled.
    enum { FEW_RAYS = 4, FEW_PACKETS = 3 };
    // From this number of tiny triangles on, all are tested at once.
    enum { FEW_TINY = 3 };

    static inline __attribute__((always_inline)) void rasterize(const Camera& camera, const Image& image,
                                                                const Triangles& triangles, const Visit& visit,
                                                                Mode mode) {
        RayLeaf<KIND> leaf(camera, image, triangles, visit);
        image.tree->all_tiles(image, leaf.box, leaf.nearest, [&](int tile) __attribute__((always_inline)) {
            rasterize_tile(camera, image, leaf, tile, mode);
            return true;
        });
    }

    static inline __attribute__((always_inline)) void rasterize_tile(const Camera& camera, const Image& image,
                                                                     RayLeaf<KIND>& leaf, int tile, Mode mode) {
        leaf.set_tile(image.tree->origins, tile);
        unsigned candidates = Lanes::bits(leaf.triangles.shown);
        if (leaf.min_size < RayColumns::SMALL_SIDE * image.tree->fit[tile].spacing) {
            const RayColumns columns(image, leaf, tile);
            const unsigned small = columns.small & ~leaf.uncertain_side;
            if (small) rasterize_small(camera, image, leaf, columns, small, mode);
            candidates = columns.larger | (columns.small & leaf.uncertain_side);
        }
        if (candidates) rasterize_in_tile(camera, image, leaf, tile, candidates, mode);
    }

    // Rasterize triangles in a tile: triangle by triangle if there are fewer of them than packets, else packet by
    // packet.
    static inline __attribute__((always_inline)) void rasterize_in_tile(const Camera& camera, const Image& image,
                                                                        RayLeaf<KIND>& leaf, int tile,
                                                                        unsigned candidates, Mode mode) {
        const RayTree& tree = *image.tree;
        const unsigned packets = tree.packets_in(image, tile, leaf.box, leaf.nearest);
        const int count = __builtin_popcount(packets);
        if (count > FEW_PACKETS) {
            RayTree::refresh(image, tile);
            const RayBox bounds = RayTree::box_of(tree.bounds_of_tiles(tile / LANES), tile % LANES);
            candidates &= leaf.touching(bounds, image.tile_min[tile]);
        }
        if (count <= FEW_PACKETS || __builtin_popcount(candidates) > count)
            for (const int k : Lanes::each(packets))
                rasterize_packet(camera, image, leaf, tile * LANES + k, candidates, mode);
        else
            for (const int k : Lanes::each(candidates)) rasterize_in_packets(camera, image, leaf, k, tile, mode);
    }

    // Rasterize triangles in one packet: ray by ray if there are few rays, or fewer rays than triangles.
    static inline __attribute__((always_inline)) void rasterize_packet(const Camera& camera, const Image& image,
                                                                       RayLeaf<KIND>& leaf, int packet,
                                                                       unsigned candidates, Mode mode) {
        const RayTree& tree = *image.tree;
        const unsigned rays = tree.rays_in(image, packet, leaf.box, leaf.nearest);
        if (!rays) return;
        const int count = __builtin_popcount(rays);
        if (count > FEW_RAYS) {
            const RayBox bounds = RayTree::box_of(tree.bounds_of_packets(packet / LANES), packet % LANES);
            candidates &= leaf.touching(bounds, image.block_min[packet]);
        }
        if (count <= FEW_RAYS || count < __builtin_popcount(candidates))
            for (const int k : Lanes::each(rays))
                rasterize_ray(camera, image, leaf, packet * LANES + k, candidates, mode);
        else
            for (const int k : Lanes::each(candidates)) rasterize_rays(camera, image, leaf, k, packet, mode);
    }

    // Rasterize one triangle in a tile's packets.
    static inline __attribute__((always_inline)) void rasterize_in_packets(const Camera& camera, const Image& image,
                                                                           RayLeaf<KIND>& leaf, int k, int tile,
                                                                           Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const int first = tile * LANES;
        unsigned touched = tree.packets_in(image, tile, leaf.box_of(k), t.max_inv_z[k]);
        if (__builtin_popcount(touched) <= FEW_PACKETS || leaf.is_uncertain_side(k)) {
            for (const int child : Lanes::each(touched)) rasterize_rays(camera, image, leaf, k, first + child, mode);
            return;
        }
        const float* bounds = tree.bounds_of_packets(tile);
        const TouchedPackets of = TouchedPackets::of(leaf, k, bounds);
        touched &= of.touched;
        const Floats hiding = Lanes::load(image.block_min + first);
        if (KIND == ORIGIN_RAYS || leaf.is_inexact(k)) {
            PacketPlanes planes;
            planes.set(camera, leaf.plane(camera, k), bounds);
            touched &= Lanes::bits(hiding <= nearest_of(tree, planes));
            for (const int child : Lanes::each(touched)) {
                const PacketPlane near = planes.of(child);
                rasterize_rays(camera, image, leaf, k, first + child, mode, (of.covered >> child) & 1, &near);
            }
            return;
        }
        touched &= Lanes::bits(hiding <= of.nearest);
        for (const int child : Lanes::each(touched)) {
            rasterize_rays(camera, image, leaf, k, first + child, mode, (of.covered >> child) & 1);
        }
    }
    // Upper bound of inv_z of a plane in each packet.
    static inline Floats nearest_of(const RayTree& tree, const PacketPlanes& planes) {
        if constexpr (KIND != ORIGIN_RAYS) return planes.nearest;
        const RayOrigins& origins = tree.origins;
        const float aside = __builtin_fabsf(planes.u) * origins.max_p + __builtin_fabsf(planes.v) * origins.max_q;
        // `aside` is below 0.5 unless the triangle is in `uncertain_side`: see Setup::find_uncertain_sides.
        const float nearer = 1.0001f / (1.0f - (aside < 0.5f ? aside : 0.5f));
        return Lanes::max(planes.nearest, Lanes::all(0.0f)) * nearer;
    }

    // Rasterize small triangles: one register holds all rays that a triangle may touch.
    static inline __attribute__((always_inline)) void rasterize_small(const Camera& camera, const Image& image,
                                                                      RayLeaf<KIND>& leaf, const RayColumns& columns,
                                                                      unsigned small, Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const RayFit fit = columns.fit;  // a copy, which no store may change
        const int width = fit.last_column() + 1;
        int column[LANES], row[LANES];
        RayColumns::begin(columns.first_column, fit.last_column(), column);
        RayColumns::begin(columns.first_row, fit.last_row(), row);
        TinyHits tiny_hits;
        const unsigned tiny = KIND == TABLE_RAYS ? small & columns.tiny : 0;
        const bool has_tiny = __builtin_popcount(tiny) >= FEW_TINY;
        if (has_tiny) {
            find_tiny(tree, leaf, columns, fit, tiny_hits);
            small &= ~tiny | tiny_hits.any();
        }
        for (const int k : Lanes::each(small)) {
            if (has_tiny && (tiny >> k & 1)) {
                put_tiny(camera, image, leaf, columns, fit, tiny_hits, k, mode);
                continue;
            }
            const auto rays = RayLanes<KIND>::window(tree, columns.first_ray + row[k] * width + column[k], width);
            const float error_bound = t.error_bound[k], max_inv_z = t.max_inv_z[k];
            const Floats inner = rays.inner(t, k);
            unsigned hits = Lanes::bits(inner >= Lanes::all(-error_bound));
            if (!hits) continue;
            const unsigned certain = Lanes::bits(inner > Lanes::all(error_bound));
            float inv_z[LANES];
            Lanes::store(inv_z, within(t, k, rays.inv_z(Linear::of_lane(t.inv_z, k))));
            for (const int lane : Lanes::each(hits)) {
                const int ray = columns.first_ray + fit.slot(column[k] + (lane & (RayColumns::SMALL_SIDE - 1)),
                                                             row[k] + lane / RayColumns::SMALL_SIDE);
                if (max_inv_z < image.inv_z[ray]) continue;
                put(camera, image, leaf, k, ray, (certain >> lane) & 1, inv_z[lane], mode);
            }
        }
    }
    // Find the rays that tiny triangles hit, for all lanes at once.
    static inline __attribute__((always_inline)) void find_tiny(const RayTree& tree, const RayLeaf<KIND>& leaf,
                                                                const RayColumns& columns, const RayFit& fit,
                                                                TinyHits& found) {
        const Triangles& t = leaf.triangles;
        const int width = fit.last_column() + 1;
        const Ints column = TinyHits::begin(columns.first_column, fit.last_column());
        const Ints row = TinyHits::begin(columns.first_row, fit.last_row());
        Lanes::store(found.column, column);
        Lanes::store(found.row, row);
        const LanePlaces places(columns.first_ray + (row * width + column));
        for (int y = 0; y < TinyHits::SIDE; ++y) {
            Floats u[TinyHits::SIDE], v[TinyHits::SIDE];
            places.pairs(tree.row_u + y * width, 1, u);
            places.pairs(tree.row_v + y * width, 1, v);
            for (int x = 0; x < TinyHits::SIDE; ++x) {
                const RayLanes<KIND> rays = {.u = u[x], .v = v[x]};
                const int ray = y * TinyHits::SIDE + x;
                const Floats inner = rays.inner(t);
                found.hits[ray] = Lanes::bits(inner >= -t.error_bound);
                found.certain[ray] = Lanes::bits(inner > t.error_bound);
                Lanes::store(found.inv_z[ray], Lanes::max(Lanes::min(rays.inv_z(t.inv_z), t.max_inv_z), t.min_inv_z));
            }
        }
    }
    static inline __attribute__((always_inline)) void put_tiny(const Camera& camera, const Image& image,
                                                               RayLeaf<KIND>& leaf, const RayColumns& columns,
                                                               const RayFit& fit, const TinyHits& found, int k,
                                                               Mode mode) {
        for (const int i : Lanes::each(found.rays_of(k))) {
            const int ray =
                columns.first_ray + fit.slot(found.column[k] + i % TinyHits::SIDE, found.row[k] + i / TinyHits::SIDE);
            if (leaf.triangles.max_inv_z[k] < image.inv_z[ray]) continue;
            put(camera, image, leaf, k, ray, (found.certain[i] >> k) & 1, found.inv_z[i][k], mode);
        }
    }
    static inline Floats within(const Triangles& t, int k, Floats inv_z) {
        return Lanes::max(Lanes::min(inv_z, Lanes::all(t.max_inv_z[k])), Lanes::all(t.min_inv_z[k]));
    }

    // Store a triangle at one of its rays, given 1 / z in single precision, and whether the ray certainly hits it.
    static inline __attribute__((always_inline)) void put(const Camera& camera, const Image& image, RayLeaf<KIND>& leaf,
                                                          int k, int ray, bool certain, float inv_z, Mode mode) {
        if (!certain && !covers(camera, *image.tree, leaf.triangles, k, ray)) return;
        const float value = leaf.is_inexact(k) ? exact_inv_z(camera, *image.tree, leaf, k, ray) : inv_z;
        if (value <= clip_inv_z(*image.tree, ray))
            Raster::put(image, ray, value, Raster::id_of(leaf.triangles, k, mode), mode);
    }

    // Rasterize all triangles for one ray.
    static inline __attribute__((always_inline)) void rasterize_ray(const Camera& camera, const Image& image,
                                                                    RayLeaf<KIND>& leaf, int ray, unsigned candidates,
                                                                    Mode mode) {
        const Triangles& t = leaf.triangles;
        const auto rays = RayLanes<KIND>::ray(*image.tree, ray);
        const Floats inner = rays.inner(t);
        unsigned hits = (Lanes::bits(inner >= -t.error_bound) | leaf.uncertain_side) & candidates;
        if (!hits) return;
        const unsigned certain = Lanes::bits(inner > t.error_bound) & ~leaf.uncertain_side;
        const Floats inv_z = Lanes::max(Lanes::min(rays.inv_z(t.inv_z), t.max_inv_z), t.min_inv_z);
        for (const int k : Lanes::each(hits)) {
            put(camera, image, leaf, k, ray, (certain >> k) & 1, inv_z[k], mode);
        }
    }

    // Rasterize one triangle for all rays of a packet. `covered` is true if it certainly covers them; `near` is its
    // plane, if it has been computed.
    static inline __attribute__((always_inline)) void rasterize_rays(const Camera& camera, const Image& image,
                                                                     RayLeaf<KIND>& leaf, int k, int packet, Mode mode,
                                                                     bool covered = false,
                                                                     const PacketPlane* near = nullptr) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        Ints inside = Lanes::load(image.inv_z + packet * LANES) <= Lanes::all(t.max_inv_z[k]);
        if (__builtin_expect(leaf.is_uncertain_side(k), 0)) {
            for (const int lane : Lanes::each(inside))
                put(camera, image, leaf, k, packet * LANES + lane, false, 0.0f, mode);
            return;
        }
        const auto rays = RayLanes<KIND>::packet(tree, packet);
        if (!covered) {
            const Floats inner = rays.inner(t, k);
            const Ints uncertain = inside & Raster::find_uncertain(inner, t.error_bound[k]);
            inside &= inner > Lanes::all(t.error_bound[k]);
            if (__builtin_expect(Lanes::any(uncertain), 0))
                inside |= covered_lanes(camera, tree, t, k, packet, Lanes::bits(uncertain));
        }
        if ((KIND == ORIGIN_RAYS || leaf.is_inexact(k)) && !Lanes::any(inside)) return;
        const Floats inv_z =
            within(t, k,
                   leaf.is_inexact(k) ? exact_inv_z(camera, tree, leaf.plane(camera, k), packet, rays, near)
                                      : rays.inv_z(Linear::of_lane(t.inv_z, k)));
        if (KIND == ORIGIN_RAYS || tree.clip_inv_z < NOWHERE) inside &= inv_z <= clip_inv_z_of(tree, packet);
        Raster::blend(image, packet, packet, inside, inv_z, Raster::id_of(t, k, mode), mode);
    }

    // Surfaces that are nearer are clipped.
    static inline float clip_inv_z(const RayTree& tree, int ray) {
        if constexpr (KIND == ORIGIN_RAYS) return tree.origins.clip_inv_z[ray];
        return tree.scale ? tree.clip_inv_z * tree.scale[ray] : tree.clip_inv_z;
    }
    static inline Floats clip_inv_z_of(const RayTree& tree, int packet) {
        if constexpr (KIND == ORIGIN_RAYS) return Lanes::load(tree.origins.clip_inv_z + packet * LANES);
        return tree.scale ? tree.clip_inv_z * Lanes::load(tree.scale + packet * LANES) : Lanes::all(tree.clip_inv_z);
    }

    // inv_z where single precision does not suffice for the plane: of a packet's rays, or of one ray.
    static inline Floats exact_inv_z(const Camera& camera, const RayTree& tree, const ExactPlane& plane, int packet,
                                     const RayLanes<KIND>& rays, const PacketPlane* computed) {
        if constexpr (KIND == TABLE_RAYS) {
            const PacketPlane near = computed ? *computed : PacketPlane::of(camera, tree, plane, packet);
            if (!near.steep) return near.at(rays.u, rays.v);
        }
        return exact_inv_z(tree, plane, packet);
    }
    static __attribute__((noinline, cold)) Floats exact_inv_z(const RayTree& tree, const ExactPlane& plane,
                                                              int packet) {
        const Doubles inv_z = plane.u * tree.exact_us(packet) + (plane.v * tree.exact_vs(packet) + plane.one);
        if constexpr (KIND == TABLE_RAYS) return __builtin_convertvector(inv_z, Floats);
        const Doubles p = RayTree::widen(tree.origins.p, packet), q = RayTree::widen(tree.origins.q, packet);
        return __builtin_convertvector(inv_z / (1.0 - (plane.u * p + plane.v * q)), Floats);
    }
    static inline float exact_inv_z(const Camera& camera, const RayTree& tree, RayLeaf<KIND>& leaf, int k, int ray) {
        float inv_z;
        if constexpr (KIND == ORIGIN_RAYS) {
            inv_z = inv_z_of_origin(camera, tree, leaf.triangles, k, ray);
        } else {
            const ExactPlane& plane = leaf.plane(camera, k);
            const PacketPlane near = PacketPlane::of(camera, tree, plane, ray / LANES);
            inv_z = near.at(tree.u[ray], tree.v[ray]);
            if (near.steep) inv_z = (float)(plane.u * tree.exact_u(ray) + (plane.v * tree.exact_v(ray) + plane.one));
        }
        const float min_inv_z = leaf.triangles.min_inv_z[k], max_inv_z = leaf.triangles.max_inv_z[k];
        return inv_z < min_inv_z ? min_inv_z : inv_z > max_inv_z ? max_inv_z : inv_z;
    }

    // Decide coverage in double precision if an edge function leaves it uncertain.
    static __attribute__((noinline, cold)) bool covers(const Camera& camera, const RayTree& tree, const Triangles& t,
                                                       int k, int ray) {
        const double u = tree.exact_u(ray), v = tree.exact_v(ray);
        if constexpr (KIND == TABLE_RAYS) return Exactly::covers(camera, t.corners, k, u, v);
        tree.origins.count_exact_test();
        double along[3];
        camera.ray_at(u, v, along);
        const ExactCorners seen = corners_of_origin(camera, tree, t, k, ray);
        const double volume = seen.volume();
        return !(camera.cull_back_faces && volume > 0.0) && seen.meet(along, volume);
    }
    static __attribute__((noinline, cold)) Ints covered_lanes(const Camera& camera, const RayTree& tree,
                                                              const Triangles& t, int k, int packet,
                                                              unsigned uncertain) {
        Ints inside = Lanes::all_ints(0);
        for (const int lane : Lanes::each(uncertain)) {
            if (covers(camera, tree, t, k, packet * LANES + lane)) inside[lane] = -1;
        }
        return inside;
    }

    // A triangle's corners relative to a ray's intersection with the plane of the eye, and 1 / z at the ray.
    static inline ExactCorners corners_of_origin(const Camera& camera, const RayTree& tree, const Triangles& t, int k,
                                                 int ray) {
        ExactCorners seen = Exactly::corners(camera, t.corners, k);
        const ExactRow* m = camera.exact_to_camera;
        for (int i = 0; i < 3; ++i) {
            const double offset = tree.origins.p[ray] * m[0][i] + tree.origins.q[ray] * m[1][i];
            for (int c = 0; c < 3; ++c) seen.corner[c][i] -= offset;
        }
        return seen;
    }
    static __attribute__((noinline, cold)) float inv_z_of_origin(const Camera& camera, const RayTree& tree,
                                                                 const Triangles& t, int k, int ray) {
        double along[3], normal[3];
        camera.ray_at(tree.exact_u(ray), tree.exact_v(ray), along);
        const ExactCorners seen = corners_of_origin(camera, tree, t, k, ray);
        seen.normal(normal);
        return (float)(ExactCorners::dot(normal, along) / ExactCorners::dot(normal, seen.corner[0]));
    }

    // Render the analytic surface of a solid.
    static __attribute__((noinline)) void render_solid(const Solid& solid, const View& view, const Camera& camera,
                                                       const Image& image, const Visit& visit, int id, Mode mode) {
        const SolidSetup setup = SolidSetup::of(solid, camera, image, view.job.center);
        const RayTree& tree = *image.tree;
        const RayBox box = RayBox::of_pixels(image, visit.x0, visit.y0, visit.x1, visit.y1);
        const float nearest = visit.nearest_inv_z;
        tree.all_tiles(image, box, nearest, [&](int tile) {
            for (const int child : Lanes::each(tree.packets_in(image, tile, box, nearest))) {
                const int packet = tile * LANES + child;
                const auto rays = RayLanes<KIND>::packet(tree, packet);
                Solids::store(setup.at(rays.u, rays.v), image, packet, packet, id, mode);
            }
            return true;
        });
    }
};
