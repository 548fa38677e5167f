// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rasterization of a leaf's triangles, or of a solid, to the rays of a `RayTree`. The result does not depend on the
// method: a triangle and a ray are intersected by the same sums, whether for many rays of one triangle or many
// triangles of one ray.

#pragma once

#include "cpu/ray_leaf.h"
#include "cpu/scene.h"

// The way from a leaf's triangles to the rays that they may cover. `Drawing` derives from this, and rasterizes in a
// tile, in packets and at rays; `Leaf` is its `RayLeaf`.
template <class Drawing, class Leaf>
struct RayDescent {
    // Up to this many rays and packets are tested before triangles are culled.
    enum { FEW_RAYS = 4, FEW_PACKETS = 3 };

    static inline __attribute__((always_inline)) void rasterize_leaf(const Camera& camera, const Image& image,
                                                                     Leaf& leaf, Mode mode) {
        const RayTree& tree = *image.tree;
        for (unsigned groups = tree.groups_in(leaf.box); groups; groups &= groups - 1) {
            const int group = Lanes::first_lane(groups);
            for (unsigned tiles = tree.tiles_in(image, group, leaf.box, leaf.nearest); tiles; tiles &= tiles - 1)
                Drawing::rasterize_tile(camera, image, leaf, group * LANES + Lanes::first_lane(tiles), mode);
        }
    }

    // Rasterize triangles in a tile: triangle by triangle if there are fewer of them than packets, else packet by
    // packet.
    static inline __attribute__((always_inline)) void rasterize_in_tile(const Camera& camera, const Image& image,
                                                                        Leaf& leaf, int tile, unsigned candidates,
                                                                        Mode mode) {
        const RayTree& tree = *image.tree;
        const unsigned packets = tree.packets_in(image, tile, leaf.box, leaf.nearest);
        const int count = __builtin_popcount(packets);
        if (count > FEW_PACKETS) {
            RayTree::refresh(image, tile);
            const RayBox bounds = RayTree::box_of(tree.bounds_of_tiles(tile / LANES), tile % LANES);
            candidates &= leaf.touching(bounds, image.tile_min[tile]);
        }
        if (count <= FEW_PACKETS || __builtin_popcount(candidates) > count)
            for (unsigned remaining = packets; remaining; remaining &= remaining - 1)
                rasterize_packet(camera, image, leaf, tile * LANES + Lanes::first_lane(remaining), candidates, mode);
        else
            for (; candidates; candidates &= candidates - 1)
                Drawing::rasterize_in_packets(camera, image, leaf, Lanes::first_lane(candidates), tile, mode);
    }

    // Rasterize triangles in one packet: ray by ray if there are few rays, or fewer rays than triangles.
    static inline __attribute__((always_inline)) void rasterize_packet(const Camera& camera, const Image& image,
                                                                       Leaf& leaf, int packet, unsigned candidates,
                                                                       Mode mode) {
        const RayTree& tree = *image.tree;
        const unsigned rays = tree.rays_in(image, packet, leaf.box, leaf.nearest);
        if (!rays) return;
        const int count = __builtin_popcount(rays);
        if (count > FEW_RAYS) {
            const RayBox bounds = RayTree::box_of(tree.bounds_of_packets(packet / LANES), packet % LANES);
            candidates &= leaf.touching(bounds, image.block_min[packet]);
        }
        if (count <= FEW_RAYS || count < __builtin_popcount(candidates))
            for (unsigned remaining = rays; remaining; remaining &= remaining - 1)
                Drawing::rasterize_ray(camera, image, leaf, packet * LANES + Lanes::first_lane(remaining), candidates,
                                       mode);
        else
            for (; candidates; candidates &= candidates - 1)
                Drawing::rasterize_rays(camera, image, leaf, Lanes::first_lane(candidates), packet, mode);
    }
};

struct RayRaster : RayDescent<RayRaster, RayLeaf> {
    static inline __attribute__((always_inline)) void rasterize(const Camera& camera, const Image& image,
                                                                const Triangles& triangles, const Visit& visit,
                                                                Mode mode) {
        RayLeaf leaf(triangles);
        leaf.set(image, visit, Lanes::bits(triangles.inexact | Raster::has_unstable_plane(camera, triangles)));
        rasterize_leaf(camera, image, leaf, mode);
    }

    static inline __attribute__((always_inline)) void rasterize_tile(const Camera& camera, const Image& image,
                                                                     RayLeaf& leaf, int tile, Mode mode) {
        unsigned candidates = Lanes::bits(leaf.triangles.shown);
        if (leaf.min_size < RayColumns::SMALL_SIDE * image.tree->fit[tile].spacing) {
            const RayColumns columns(image, leaf, tile);
            if (columns.small) rasterize_small(camera, image, leaf, columns, mode);
            candidates = columns.larger;
        }
        if (candidates) rasterize_in_tile(camera, image, leaf, tile, candidates, mode);
    }

    // Rasterize one triangle in a tile's packets.
    static inline __attribute__((always_inline)) void rasterize_in_packets(const Camera& camera, const Image& image,
                                                                           RayLeaf& leaf, int k, int tile, Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const int first = tile * LANES;
        unsigned touched = tree.packets_in(image, tile, leaf.box_of(k), t.max_inv_z[k]);
        if (__builtin_popcount(touched) <= FEW_PACKETS) {
            for (; touched; touched &= touched - 1)
                rasterize_rays(camera, image, leaf, k, first + Lanes::first_lane(touched), mode);
            return;
        }
        const float* bounds = tree.bounds_of_packets(tile);
        const TouchedPackets of = TouchedPackets::of(t, k, bounds);
        touched &= of.touched;
        const Floats hiding = Lanes::load(image.block_min + first);
        if ((leaf.inexact >> k) & 1) {
            PacketPlanes planes;
            planes.set(camera, leaf.plane(camera, k), bounds);
            touched &= Lanes::bits(hiding <= planes.nearest);
            for (; touched; touched &= touched - 1) {
                const int child = Lanes::first_lane(touched);
                const PacketPlane near = planes.of(child);
                rasterize_rays(camera, image, leaf, k, first + child, (of.covered >> child) & 1, &near, mode);
            }
            return;
        }
        touched &= Lanes::bits(hiding <= of.nearest);
        for (; touched; touched &= touched - 1) {
            const int child = Lanes::first_lane(touched);
            rasterize_rays(camera, image, leaf, k, first + child, (of.covered >> child) & 1, nullptr, mode);
        }
    }

    // Rasterize small triangles: one register holds all rays that a triangle may touch.
    static inline __attribute__((always_inline)) void rasterize_small(const Camera& camera, const Image& image,
                                                                      RayLeaf& leaf, const RayColumns& columns,
                                                                      Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const int width = columns.fit.last_column() + 1;
        int column[LANES], row[LANES];
        RayColumns::begin(columns.first_column, columns.fit.last_column(), column);
        RayColumns::begin(columns.first_row, columns.fit.last_row(), row);
        for (unsigned small = columns.small; small; small &= small - 1) {
            const int k = Lanes::first_lane(small), corner = columns.first_ray + row[k] * width + column[k];
            const Floats u = RayTree::window(tree.row_u + corner, width),
                         v = RayTree::window(tree.row_v + corner, width);
            const Linear e0 = Linear::of_lane(t.edge[0], k), e1 = Linear::of_lane(t.edge[1], k),
                         e2 = Linear::of_lane(t.edge[2], k), plane = Linear::of_lane(t.inv_z, k);
            const float error_bound = t.error_bound[k], max_inv_z = t.max_inv_z[k], min_inv_z = t.min_inv_z[k];
            const Floats inner = Lanes::min(e0.at(u, e0.row(v)), e1.at(u, e1.row(v)), e2.at(u, e2.row(v)));
            unsigned hits = Lanes::bits(inner >= Lanes::all(-error_bound));
            if (!hits) continue;
            const unsigned certain = Lanes::bits(inner > Lanes::all(error_bound));
            float inv_z[LANES];
            Lanes::store(
                inv_z, Lanes::max(Lanes::min(plane.at(u, plane.row(v)), Lanes::all(max_inv_z)), Lanes::all(min_inv_z)));
            for (; hits; hits &= hits - 1) {
                const int lane = Lanes::first_lane(hits);
                const int ray = columns.first_ray + columns.fit.slot(column[k] + (lane & (RayColumns::SMALL_SIDE - 1)),
                                                                     row[k] + lane / RayColumns::SMALL_SIDE);
                if (max_inv_z < image.inv_z[ray]) continue;
                if (((certain >> lane) & 1) || covers(camera, image, t, k, ray))
                    put(camera, image, leaf, k, ray, inv_z[lane], mode);
            }
        }
    }
    // Store a triangle at one of its rays, given 1 / z in single precision.
    static inline __attribute__((always_inline)) void put(const Camera& camera, const Image& image, RayLeaf& leaf,
                                                          int k, int ray, float inv_z, Mode mode) {
        const float value = ((leaf.inexact >> k) & 1) ? exact_inv_z(camera, image, leaf, k, ray) : inv_z;
        if (value <= clip_inv_z(*image.tree, ray))
            Raster::put(image, ray, value, Raster::id_of(leaf.triangles, k, mode), mode);
    }

    // Rasterize all triangles for one ray.
    static inline __attribute__((always_inline)) void rasterize_ray(const Camera& camera, const Image& image,
                                                                    RayLeaf& leaf, int ray, unsigned candidates,
                                                                    Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const Floats u = Lanes::all(tree.u[ray]), v = Lanes::all(tree.v[ray]);
        const Linear* e = t.edge;
        const Floats inner = Lanes::min(e[0].at(u, e[0].row(v)), e[1].at(u, e[1].row(v)), e[2].at(u, e[2].row(v)));
        unsigned hits = Lanes::bits(inner >= -t.error_bound) & candidates;
        if (!hits) return;
        const unsigned certain = Lanes::bits(inner > t.error_bound);
        const Floats inv_z = Lanes::max(Lanes::min(t.inv_z.at(u, t.inv_z.row(v)), t.max_inv_z), t.min_inv_z);
        for (; hits; hits &= hits - 1) {
            const int k = Lanes::first_lane(hits);
            if (((certain >> k) & 1) || covers(camera, image, t, k, ray))
                put(camera, image, leaf, k, ray, inv_z[k], mode);
        }
    }
    static inline float clip_inv_z(const RayTree& tree, int ray) {
        return tree.scale ? tree.clip_inv_z * tree.scale[ray] : tree.clip_inv_z;
    }

    static inline __attribute__((always_inline)) void rasterize_rays(const Camera& camera, const Image& image,
                                                                     RayLeaf& leaf, int k, int packet, Mode mode) {
        rasterize_rays(camera, image, leaf, k, packet, false, nullptr, mode);
    }
    // Rasterize one triangle for all rays of a packet.
    static inline __attribute__((always_inline)) void rasterize_rays(const Camera& camera, const Image& image,
                                                                     RayLeaf& leaf, int k, int packet, bool covered,
                                                                     const PacketPlane* packet_plane, Mode mode) {
        const RayTree& tree = *image.tree;
        const Triangles& t = leaf.triangles;
        const Floats u = Lanes::load(tree.u + packet * LANES), v = Lanes::load(tree.v + packet * LANES);
        Ints inside = Lanes::load(image.inv_z + packet * LANES) <= Lanes::all(t.max_inv_z[k]);
        if (!covered) {
            const Linear e0 = Linear::of_lane(t.edge[0], k), e1 = Linear::of_lane(t.edge[1], k),
                         e2 = Linear::of_lane(t.edge[2], k);
            const Floats inner = Lanes::min(e0.at(u, e0.row(v)), e1.at(u, e1.row(v)), e2.at(u, e2.row(v)));
            const Ints uncertain = inside & Raster::find_uncertain(inner, t.error_bound[k]);
            inside &= inner > Lanes::all(t.error_bound[k]);
            if (__builtin_expect(Lanes::any(uncertain), 0))
                inside |= covered_lanes(camera, image, t, k, packet, Lanes::bits(uncertain));
        }
        Floats inv_z;
        if ((leaf.inexact >> k) & 1) {
            if (!Lanes::any(inside)) return;
            const ExactPlane& plane = leaf.plane(camera, k);
            const PacketPlane near = packet_plane ? *packet_plane : PacketPlane::of(camera, tree, plane, packet);
            inv_z = near.steep ? exact_inv_z(tree, plane, packet) : near.at(u, v);
        } else {
            const Linear plane = Linear::of_lane(t.inv_z, k);
            inv_z = plane.at(u, plane.row(v));
        }
        inv_z = Lanes::max(Lanes::min(inv_z, Lanes::all(t.max_inv_z[k])), Lanes::all(t.min_inv_z[k]));
        if (tree.clip_inv_z < NOWHERE) inside &= inv_z <= clip_inv_z_of(tree, packet);
        Raster::blend(image, packet, packet, inside, inv_z, Raster::id_of(t, k, mode), mode);
    }
    static inline Floats clip_inv_z_of(const RayTree& tree, int packet) {
        return tree.scale ? tree.clip_inv_z * Lanes::load(tree.scale + packet * LANES) : Lanes::all(tree.clip_inv_z);
    }

    // Unrounded u and v of a packet's rays, and 1 / z at them.
    static inline Doubles exact_u(const RayTree& tree, int packet) { return exact(tree.u, tree.rest_u, packet); }
    static inline Doubles exact_v(const RayTree& tree, int packet) { return exact(tree.v, tree.rest_v, packet); }
    static inline Doubles exact(const float* value, const float* error, int packet) {
        return __builtin_convertvector(Lanes::load(value + packet * LANES), Doubles) +
               __builtin_convertvector(Lanes::load(error + packet * LANES), Doubles);
    }
    static __attribute__((noinline, cold)) Floats exact_inv_z(const RayTree& tree, const ExactPlane& plane,
                                                              int packet) {
        const Doubles inv_z = plane.u * exact_u(tree, packet) + (plane.v * exact_v(tree, packet) + plane.one);
        return __builtin_convertvector(inv_z, Floats);
    }
    static inline float exact_inv_z(const Camera& camera, const Image& image, RayLeaf& leaf, int k, int ray) {
        const RayTree& tree = *image.tree;
        const ExactPlane& plane = leaf.plane(camera, k);
        const PacketPlane near = PacketPlane::of(camera, tree, plane, ray / LANES);
        float inv_z = near.at(tree.u[ray], tree.v[ray]);
        if (near.steep) {
            const double u = (double)tree.u[ray] + tree.rest_u[ray], v = (double)tree.v[ray] + tree.rest_v[ray];
            inv_z = (float)(plane.u * u + (plane.v * v + plane.one));
        }
        const float min_inv_z = leaf.triangles.min_inv_z[k], max_inv_z = leaf.triangles.max_inv_z[k];
        return inv_z < min_inv_z ? min_inv_z : inv_z > max_inv_z ? max_inv_z : inv_z;
    }

    // Decide coverage in double precision if an edge function leaves it uncertain.
    static __attribute__((noinline, cold)) bool covers(const Camera& camera, const Image& image, const Triangles& t,
                                                       int k, int ray) {
        const RayTree& tree = *image.tree;
        const double u = (double)tree.u[ray] + tree.rest_u[ray], v = (double)tree.v[ray] + tree.rest_v[ray];
        return Exactly::covers(camera, t.corners, k, u, v);
    }
    static __attribute__((noinline, cold)) Ints covered_lanes(const Camera& camera, const Image& image,
                                                              const Triangles& t, int k, int packet,
                                                              unsigned uncertain) {
        Ints inside = Lanes::all_ints(0);
        for (; uncertain; uncertain &= uncertain - 1) {
            const int lane = Lanes::first_lane(uncertain);
            if (covers(camera, image, t, k, packet * LANES + lane)) inside[lane] = -1;
        }
        return inside;
    }

    // Render the analytic surface of a solid.
    static __attribute__((noinline)) void render_solid(const Solid& solid, const View& view, const Camera& camera,
                                                       const Image& image, const Visit& visit, int id, Mode mode) {
        const SolidSetup setup = SolidSetup::of(solid, camera, image, view.job.center);
        const RayTree& tree = *image.tree;
        const RayBox box = RayBox::of_pixels(image, visit.x0, visit.y0, visit.x1, visit.y1);
        const float nearest = visit.nearest_inv_z;
        for (unsigned groups = tree.groups_in(box); groups; groups &= groups - 1) {
            const int group = Lanes::first_lane(groups);
            for (unsigned tiles = tree.tiles_in(image, group, box, nearest); tiles; tiles &= tiles - 1) {
                const int tile = group * LANES + Lanes::first_lane(tiles);
                for (unsigned remaining = tree.packets_in(image, tile, box, nearest); remaining;
                     remaining &= remaining - 1) {
                    const int packet = tile * LANES + Lanes::first_lane(remaining);
                    const Floats u = Lanes::load(tree.u + packet * LANES), v = Lanes::load(tree.v + packet * LANES);
                    Solids::store(setup.at(u, v), image, packet, packet, id, mode);
                }
            }
        }
    }
};
