// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// One packet, from its view's pose to its part of the images.

struct View {
    int width, height;
    double focal[2], center[2];
    float near, far;
    const float* pose;  // x y z qx qy qz qw
};

// What stays, where its objects are that are closed, and what each is.
struct Still {
    const float* closed_boxes;
    const int* closed_object;
    int closed_count;
};

// A warp's shared memory.
struct Workplace {
    Eye world;
    Triangle triangle;
    union {  // of a tree, or of solids
        Walk::Level levels[LEVELS - 1];
        Solid solids[Objects::SOLIDS];
    };
    unsigned queue[2 * LANES];
    Key nearest[BLOCKS * 32];
    Eye moved[1];
    Objects::List list;
};

struct Packets {
    static inline Eye eye(const View& view) {
        Exact axis[3];  // right, down and forward in the world
        Pose::axes(view.pose, axis);
        Eye eye;
        eye.exact_origin = Pose::position(view.pose);
        eye.origin = eye.exact_origin.rounded();
        eye.rest = Vec{0.0f, 0.0f, 0.0f};
        for (int i = 0; i < 3; ++i) {
            const double f = i < 2 ? view.focal[i] : 1.0;
            eye.exact_rays[i] = Exact::times(axis[i], 1.0 / f);
            eye.to_camera[i] = Exact::times(axis[i], f).rounded();
            eye.focal_squared[i] = f * f;
        }
        eye.first_u = (float)(0.5 - view.center[0]);
        eye.first_v = (float)(0.5 - view.center[1]);
        eye.last_x = (float)(view.width - 1);
        eye.last_y = (float)(view.height - 1);
        eye.far = view.far * 1.00001f;
        eye.blur = 6e-8f * ((float)(view.focal[0] + view.focal[1]) + eye.last_x + eye.last_y);
        return eye;
    }

    // Whether the camera is outside the boxes of all closed objects that it sees, so that their back faces are hidden
    // behind their front faces.
    static inline bool outside_all(const Still& still, const unsigned char* excluded, const Vec& origin) {
        bool inside = false;
        for (int i = Warp::lane(); i < still.closed_count; i += LANES)
            inside |= Box::holds(still.closed_boxes + 6 * i, origin) &&
                      !(excluded && excluded[__ldg(still.closed_object + i)]);
        return !Warp::any(inside);
    }

    // Where a view's world does not exist, `movables.poses` is null and nothing is seen.
    static inline void cast(const Tree& tree, const Still& still, const Movables& movables, const View& view,
                            const Outputs& out, bool cull, int view_index, int packet_x, int packet_y,
                            Workplace& place) {
        {
            Eye eye = Packets::eye(view);
            eye.skip_back_faces = outside_all(still, tree.excluded, eye.origin);
            // Where that means all back faces, it need not be looked up whose they are.
            eye.cull_back_faces = cull || (eye.skip_back_faces && tree.all_closed);
            if (Warp::lane() == 0) place.world = eye;
        }
        Packet packet;
        packet.nearest = place.nearest;
        packet.first_x = packet_x * PACKET_WIDTH;
        packet.first_y = packet_y * PACKET_HEIGHT;
        packet.begin(view.width - packet.first_x, view.height - packet.first_y);
        const bool exists = !MOVABLE || movables.poses;
        const Queue queue = {place.queue, 0};
        if (MOVABLE && exists)
            Objects::draw(tree, place.world, packet, movables, cull, place.moved, &place.list, place.solids,
                          place.levels, queue, &place.triangle);
        else if (tree.root >= 0 && exists)
            Walk::draw(tree, place.world, packet, place.levels, queue, &place.triangle);
        Warp::sync();
        Write::images(tree, place.world, packet, movables, out, view_index, view.width, view.height, view.near,
                      view.far);
    }
};
