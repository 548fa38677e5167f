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

// A warp's shared memory.
struct Workplace {
    Eye eye;
    Triangle triangle;
    Walk::Level levels[LEVELS - 1];
    Key nearest[BLOCKS * 32];
};

struct Packets {
    static inline Eye eye(const View& view) {
        double q[4], length = 0.0;
        for (int k = 0; k < 4; ++k) length += (double)__ldg(view.pose + 3 + k) * __ldg(view.pose + 3 + k);
        length = 1.0 / sqrt(length);
        for (int k = 0; k < 4; ++k) q[k] = __ldg(view.pose + 3 + k) * length;
        const double x = q[0], y = q[1], z = q[2], w = q[3];
        // Right, down and forward in the world.
        const double axis[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)},
                                   {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)},
                                   {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)}};
        Eye eye;
        eye.origin = Vec{__ldg(view.pose), __ldg(view.pose + 1), __ldg(view.pose + 2)};
        for (int i = 0; i < 3; ++i) {
            const double f = i < 2 ? view.focal[i] : 1.0;
            eye.to_camera[i] = Vec{(float)(axis[i][0] * f), (float)(axis[i][1] * f), (float)(axis[i][2] * f)};
            for (int k = 0; k < 3; ++k) eye.exact_rays[i][k] = axis[i][k] / f;
        }
        eye.first_u = (float)(0.5 - view.center[0]);
        eye.first_v = (float)(0.5 - view.center[1]);
        eye.last_x = (float)(view.width - 1);
        eye.last_y = (float)(view.height - 1);
        eye.far = view.far * 1.00001f;
        eye.blur = 6e-8f * ((float)(view.focal[0] + view.focal[1]) + eye.last_x + eye.last_y);
        return eye;
    }

    // Whether the camera is outside the boxes of all closed objects, so that their back faces are hidden behind their
    // front faces.
    static inline bool outside_all(const float* boxes, int count, const Vec& origin) {
        bool inside = false;
        for (int i = Warp::lane(); i < count; i += LANES) {
            const float* box = boxes + 6 * i;
            inside |= origin.x >= __ldg(box) && origin.x <= __ldg(box + 3) && origin.y >= __ldg(box + 1) &&
                      origin.y <= __ldg(box + 4) && origin.z >= __ldg(box + 2) && origin.z <= __ldg(box + 5);
        }
        return !Warp::any(inside);
    }

    static inline void cast(const Tree& tree, const View& view, const Outputs& out, const float* closed_boxes,
                            int closed_count, bool cull, int view_index, int packet_x, int packet_y, Workplace& place) {
        {
            Eye eye = Packets::eye(view);
            eye.skip_back_faces = outside_all(closed_boxes, closed_count, eye.origin);
            // Where that means all back faces, it need not be looked up whose they are.
            eye.cull_back_faces = cull || (eye.skip_back_faces && tree.all_closed);
            if (Warp::lane() == 0) place.eye = eye;
        }
        Packet packet;
        packet.nearest = place.nearest;
        packet.first_x = packet_x * PACKET_WIDTH;
        packet.first_y = packet_y * PACKET_HEIGHT;
        packet.begin(view.width - packet.first_x, view.height - packet.first_y);
        Walk::draw(tree, place.eye, packet, place.levels, &place.triangle);
        Warp::sync();
        Write::images(tree, place.eye, packet, out, view_index, view.width, view.height, view.near, view.far);
    }
};
