// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Triangles, set up for the image: a leaf's together, one in each lane.

// A value that is linear in u and v, of each lane's triangle.
struct Linear {
    Floats u, v, one;

    inline Floats row(Floats at_v) const { return v * at_v + one; }
    inline Floats at(Floats at_u, Floats row) const { return u * at_u + row; }
    static inline Linear of_lane(const Linear& all, int k) {
        return Linear{Lanes::all(all.u[k]), Lanes::all(all.v[k]), Lanes::all(all.one[k])};
    }
};

// A leaf's triangles in the image.
struct Triangles {
    const float* corners;  // [LEAF_ROWS][lane] in the frame of the tree
    int first_id;
    const int* owners;
    Linear edge[3];  // positive inside
    Linear inv_z;
    Floats min_inv_z, max_inv_z;  // at the corners: no point of a triangle is nearer or farther
    Floats area;  // in pixels, of the whole triangle; endless where it reaches behind the camera
    Ints shown;  // lanes that may cover a pixel
    Ints x0, x1, y0, y1;  // pixels of the strip whose centres may be inside
    Ints view_y0, view_y1;  // the same rows in the whole view, counted from the view's first
};

struct Setup {
    // cross(a - b, a + b) is 2 a x b, and exactly its negative when a and b change places.
    static inline Linear edge(Points a, Points b, Floats sign) {
        const Points product = Points::cross(Points::minus(a, b), Points::plus(a, b));
        return Linear{product.x * sign, product.y * sign, product.z * sign};
    }

    // Triangles that the view must not see.
    static inline Ints excluded_lanes(const unsigned char* excluded, const int* owners) {
        Ints mask;
        for (int k = 0; k < LANES; ++k) mask[k] = excluded[Bvh::object_of(owners[k])] ? -1 : 0;
        return mask;
    }

    // Where a row of x begins, below which are y and z.
    static inline Points corner(const Camera& camera, const float* rows) {
        return camera.relative(Lanes::load(rows), Lanes::load(rows + LANES), Lanes::load(rows + 2 * LANES));
    }

    // False if no lane can show: all face away, or none reaches a pixel's centre.
    static inline bool leaf(const Camera& camera, const Image& image, Triangles& out) {
        const float* p = out.corners;
        Points c[3];
        for (int k = 0; k < 3; ++k) c[k] = camera.turn(corner(camera, p + 3 * LANES * k));
        const Points normal = Points::cross(Points::minus(c[1], c[0]), Points::minus(c[2], c[0]));
        const Floats volume = Points::dot(normal, c[0]);  // negative where the camera sees the front
        Ints shown = volume != Lanes::all(0.0f);
        if (camera.cull_back_faces)
            shown &= volume < Lanes::all(0.0f);
        else if (camera.skip_back_faces)
            shown &= (volume < Lanes::all(0.0f)) | (Lanes::load(out.owners) >= Lanes::all_ints(0));
        if (camera.excluded) shown &= ~excluded_lanes(camera.excluded, out.owners);
        if (!Lanes::any(shown)) return false;

        const Floats zmin = Lanes::min(c[0].z, c[1].z, c[2].z), zmax = Lanes::max(c[0].z, c[1].z, c[2].z);
        const Floats one = Lanes::all(1.0f), none = Lanes::all(0.0f);
        const Floats inverse[3] = {one / c[0].z, one / c[1].z, one / c[2].z};
        // Triangles that reach behind the camera may be anywhere in the image.
        const Ints crossing = zmin <= 1e-6f * zmax + Lanes::all(1e-30f);
        out.shown = shown & (zmax > none);
        if (!bound(image, c, inverse, crossing, out)) return false;

        const Floats sign = volume < none ? -one : one;
        out.edge[0] = edge(c[1], c[2], sign);
        out.edge[1] = edge(c[2], c[0], sign);
        out.edge[2] = edge(c[0], c[1], sign);
        const Floats scale = one / volume;
        out.inv_z = Linear{normal.x * scale, normal.y * scale, normal.z * scale};
        out.min_inv_z = crossing ? one / zmax : Lanes::min(inverse[0], inverse[1], inverse[2]);
        out.max_inv_z = crossing ? Lanes::all(3e37f) : Lanes::max(inverse[0], inverse[1], inverse[2]);
        out.area = crossing ? Lanes::all(NOWHERE) : 0.5f * Lanes::abs(volume) * (inverse[0] * inverse[1] * inverse[2]);
        return true;
    }

    // Bounds in pixels, a little wider than rounding can be wrong; false if no lane that may be shown has any.
    static inline bool bound(const Image& image, const Points* c, const Floats* inverse, Ints crossing,
                             Triangles& out) {
        const Floats one = Lanes::all(1.0f), none = Lanes::all(0.0f);
        const Floats px0 = c[0].x * inverse[0], px1 = c[1].x * inverse[1], px2 = c[2].x * inverse[2];
        const Floats py0 = c[0].y * inverse[0], py1 = c[1].y * inverse[1], py2 = c[2].y * inverse[2];
        const float slack = 0.004f + 2e-6f * (float)(image.width + image.height);
        const Floats wide = Lanes::all((float)image.width), tall = Lanes::all((float)image.height);
        Floats left = Lanes::min(px0, px1, px2) + (image.center_x - 0.5f - slack);
        Floats right = Lanes::max(px0, px1, px2) + (image.center_x - 0.5f + slack);
        Floats top = Lanes::min(py0, py1, py2) + (image.center_y - 0.5f - slack);
        Floats bottom = Lanes::max(py0, py1, py2) + (image.center_y - 0.5f + slack);
        left = Lanes::max(crossing ? none : image.first_pixel(left), none);
        const float first = (float)image.first_row, last = (float)(image.view_height - 1);
        const Floats view_top = Lanes::max(crossing ? none : image.first_pixel(top) + first, none);
        const Floats view_bottom =
            Lanes::min(crossing ? Lanes::all(last) : image.last_pixel(bottom) + first, Lanes::all(last));
        top = Lanes::max(view_top - first, none);
        right = Lanes::min(crossing ? wide : image.last_pixel(right), wide - one);
        bottom = Lanes::min(view_bottom - first, tall - one);
        const Ints shown = out.shown & (left <= right) & (top <= bottom);
        if (!Lanes::any(shown)) return false;
        out.shown = shown;
        out.x0 = __builtin_convertvector(shown ? left : none, Ints);
        out.x1 = __builtin_convertvector(shown ? right : -one, Ints);
        out.y0 = __builtin_convertvector(shown ? top : none, Ints);
        out.y1 = __builtin_convertvector(shown ? bottom : -one, Ints);
        out.view_y0 = __builtin_convertvector(shown ? view_top : none, Ints);
        out.view_y1 = __builtin_convertvector(shown ? view_bottom : -one, Ints);
        return true;
    }
};

// One triangle in double precision: its first corner seen from the camera, and its normal, of any length.
struct ExactTriangle {
    double a[3], normal[3];

    static inline ExactTriangle of(const double* viewpoint, const float* corners, int lane) {
        ExactTriangle t;
        double ab[3], ac[3];
        for (int k = 0; k < 3; ++k) {
            t.a[k] = corners[k * LANES + lane] - viewpoint[k];
            ab[k] = (double)corners[(k + 3) * LANES + lane] - corners[k * LANES + lane];
            ac[k] = (double)corners[(k + 6) * LANES + lane] - corners[k * LANES + lane];
        }
        t.normal[0] = ab[1] * ac[2] - ab[2] * ac[1];
        t.normal[1] = ab[2] * ac[0] - ab[0] * ac[2];
        t.normal[2] = ab[0] * ac[1] - ab[1] * ac[0];
        return t;
    }
    // Negative where the camera sees the front.
    inline double volume() const { return normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2]; }
};

// The plane of one triangle in double precision. In single precision, inv_z loses its digits where a plane is seen at a
// grazing angle: it is a small difference of large terms.
struct ExactPlane {
    double u, v, one;

    static inline ExactPlane of(const Camera& camera, const float* corners, int lane) {
        const ExactTriangle t = ExactTriangle::of(camera.exact_origin, corners, lane);
        const double* n = t.normal;
        const double scale = 1.0 / t.volume();
        const ExactRow* m = camera.exact_to_camera;
        return ExactPlane{(n[0] * m[0][0] + n[1] * m[0][1] + n[2] * m[0][2]) * scale,
                          (n[0] * m[1][0] + n[1] * m[1][1] + n[2] * m[1][2]) * scale,
                          (n[0] * m[2][0] + n[1] * m[2][1] + n[2] * m[2][2]) * scale};
    }
};
