// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rows of pixels through the model of shared/stereo.h: as many at a time as Real holds.

// Images of all views, [view][y][x]; null where the model does without. In Python, StereoViews of kernels/stereo.py.
struct StereoImages {
    int height, width;
    const float* depth;  // of the first surface
    const float* other_depth;  // what the other eye sees there
    const float* normals;  // xyz in the world
    const int* segmentation;
    const float* reflectivity;  // [object]
    const float* nodes;  // of noise, [view][node_rows][node_columns]
    int node_rows, node_columns;
    const float* weights;  // of the two nodes beside a pixel, by its place between them
    const int* column_nodes;  // the node on the left of a column, and the weights of both
    const float* left_weights;
    const float* right_weights;
    const float* column_slopes;  // of rays, (x - cx) / fz
    const float* row_slopes;
    float* depth_out;
    unsigned char* reasons_out;
};

// A view: what its random numbers follow from, and its other eye.
struct StereoView {
    long long index;
    RandomKey key;
    float axes[9];  // from the camera's frame to the world's
    float forward;  // how far the other eye is before the first one, by rounding [m]
};

// How much of the window of pixels is of their surface.
struct StereoWindow {
    const Stereo& stereo;
    const StereoImages& images;
    Real depth;
    Real in_row, of_row, in_column, of_column;

    inline void look_across(const float* row, int x, int lag) {
        const int from = x + lag;
        const Real column = Numbers::columns(from);
        const Real inside = select((column >= 0.0f) & (column < (float)images.width));
        if (from >= 0 && from + Numbers::PIXELS <= images.width) {
            in_row += same(Numbers::load(row + from, Numbers::PIXELS));
        } else {
            // Where the row ends, the pixels beside the end are of no surface.
            float some[Numbers::PIXELS];
            for (int k = 0; k < Numbers::PIXELS; ++k)
                some[k] = from + k >= 0 && from + k < images.width ? row[from + k] : Numbers::endless();
            in_row += same(Numbers::load(some, Numbers::PIXELS));
        }
        of_row += inside;
    }
    inline void look_down(const float* row, int y, int x, int lag) {
        if (y + lag < 0 || y + lag >= images.height) return;
        in_column += same(Numbers::load(row + (long long)lag * images.width + x, images.width - x));
        of_column += 1.0f;
    }
    inline Real same(Real other) const {
        return select(stereo.disparity_scale * Numbers::abs(depth - other) < stereo.edge_step * depth * other);
    }
    static inline Real select(Whole which) { return which ? Numbers::real(1.0f) : Numbers::real(0.0f); }

    static inline Real support(const Stereo& stereo, const StereoImages& images, const float* row, int y, int x) {
        const Real none = Numbers::real(0.0f);
        StereoWindow window = {stereo, images, Numbers::load(row + x, images.width - x), none, none, none, none};
        for (int lag = -stereo.window; lag <= stereo.window; ++lag) {
            window.look_across(row, x, lag);
            window.look_down(row, y, x, lag);
        }
        return (window.in_row / window.of_row) * (window.in_column / window.of_column);
    }
};

struct StereoRows {
    // The cosine between the rays of pixels and the normals of what they meet.
    static inline Real cosine(const StereoImages& images, const StereoView& view, long long place, int y, int x) {
        const int count = images.width - x;
        const Real across = Numbers::load(images.column_slopes + x, count);
        const float down = images.row_slopes[y];
        Real normal[3];
        Numbers::load_triples(images.normals + place * 3, normal, count);
        Real along = Numbers::real(0.0f);
        for (int k = 0; k < 3; ++k) {
            const Real ray = across * view.axes[k * 3] + (down * view.axes[k * 3 + 1] + view.axes[k * 3 + 2]);
            along = along + ray * normal[k];
        }
        return Numbers::abs(along) / Numbers::root(across * across + (down * down + 1.0f));
    }
    static inline Real reflectivity(const StereoImages& images, long long place, int x) {
        float found[Numbers::PIXELS];
        for (int k = 0; k < Numbers::PIXELS; ++k) {
            const int hit = x + k < images.width ? images.segmentation[place + k] : -1;
            found[k] = hit < 0 ? 1.0f : images.reflectivity[hit];
        }
        return Numbers::load(found, Numbers::PIXELS);
    }
    // Noise between nodes, by weights whose squares add up to one. Pixels of a register are between a few of these.
    static inline Real smooth_noise(const StereoImages& images, const StereoView& view, int spacing, int y, int x) {
        const int row = y / spacing, column = images.column_nodes[x], count = images.node_columns - column;
        const float* above = images.nodes + (view.index * images.node_rows + row) * images.node_columns + column;
        const float* below = above + images.node_columns;
        const float* down = images.weights + (y - row * spacing) * 2;
        float nodes[2][Numbers::PIXELS], beside[2][Numbers::PIXELS] = {};
        for (int side = 0; side < 2; ++side) {
            const Real upper = Numbers::load(above + side, count - side);
            const Real lower = Numbers::load(below + side, count - side);
            Numbers::store(nodes[side], upper * down[0] + lower * down[1], Numbers::PIXELS);
        }
        for (int k = 0; k < Numbers::PIXELS && x + k < images.width; ++k) {
            const int node = images.column_nodes[x + k] - column;
            beside[0][k] = nodes[0][node];
            beside[1][k] = nodes[1][node];
        }
        const Real left = Numbers::load(images.left_weights + x, images.width - x);
        const Real right = Numbers::load(images.right_weights + x, images.width - x);
        return left * Numbers::load(beside[0], Numbers::PIXELS) + right * Numbers::load(beside[1], Numbers::PIXELS);
    }

    // Pixels of a row from x on.
    static inline void measure(const Stereo& stereo, const StereoImages& images, const StereoView& view, int y, int x) {
        PixelWords noise, chance;
        const bool white = stereo.sigma > 0.0f && !images.nodes, by_chance = images.normals || stereo.kept < 1.0f;
        if (white) noise = PixelWords::draw(view.key, STREAM_DISPARITY, y, x);
        if (by_chance) chance = PixelWords::draw(view.key, STREAM_DROPOUT, y, x);
        for (int k = 0; k < PixelWords::PIXELS / Numbers::PIXELS; ++k, x += Numbers::PIXELS) {
            if (x >= images.width) return;
            StereoPixel pixel = look(stereo, images, view, y, x);
            if (white) pixel.noise = Random::normal(noise.block[k]);
            if (by_chance) pixel.chance = Random::uniform(chance.block[k]);
            say(stereo, images, pixel, (view.index * images.height + y) * images.width + x, images.width - x);
        }
    }
    static inline StereoPixel look(const Stereo& stereo, const StereoImages& images, const StereoView& view, int y,
                                   int x) {
        const long long first = (view.index * images.height + y) * images.width, place = first + x;
        const int count = images.width - x;
        const Real one = Numbers::real(1.0f), none = Numbers::real(0.0f);
        StereoPixel pixel;
        pixel.depth = Numbers::load(images.depth + place, count);
        pixel.far_depth = pixel.depth - view.forward;
        pixel.other_depth =
            images.other_depth ? Numbers::load(images.other_depth + place, count) : Numbers::real(Numbers::endless());
        pixel.column = Numbers::columns(x) + 0.5f;
        pixel.support = stereo.window ? StereoWindow::support(stereo, images, images.depth + first, y, x) : one;
        pixel.cosine = images.normals ? cosine(images, view, place, y, x) : one;
        pixel.reflectivity = images.segmentation ? reflectivity(images, place, x) : one;
        pixel.noise = images.nodes ? smooth_noise(images, view, stereo.spacing, y, x) : none;
        pixel.chance = none;
        return pixel;
    }
    static inline void say(const Stereo& stereo, const StereoImages& images, const StereoPixel& pixel, long long place,
                           int count) {
        Real depth;
        Whole reason;
        stereo.measure(pixel, depth, reason);
        Numbers::store(images.depth_out + place, depth, count);
        if (images.reasons_out) Numbers::store(images.reasons_out + place, reason, count);
    }
};

// The other eye of a view: where it is in the first one's frame [m], and its image.
struct OtherImage {
    float place[3];
    float focal[2];
    float added_columns;  // of its image, on the left of the first one's
    float width, height;
    float least_depth;  // nearer points are not looked for

    // Where the points of pixels from x on are in its image, x y x y ... [px]; NaN where they are not in it.
    inline void show(const StereoImages& images, long long index, int y, int x, float* points) const {
        for (int k = 0; k < PixelWords::PIXELS && x < images.width; k += Numbers::PIXELS, x += Numbers::PIXELS)
            show_some(images, index, y, x, points);
    }
    inline void show_some(const StereoImages& images, long long index, int y, int x, float* points) const {
        const int count = images.width - x;
        const long long at = (index * images.height + y) * images.width + x;
        const Real depth = Numbers::load(images.depth + at, count);
        const Real across = Numbers::load(images.column_slopes + x, count);
        const Real nearness = 1.0f / (depth - place[2]);
        const Real shift = (across * place[2] - place[0]) * focal[0] * nearness;
        const Real column = Numbers::columns(x) + (added_columns + 0.5f) + shift;
        const Real row = (images.row_slopes[y] * place[2] - place[1]) * focal[1] * nearness + ((float)y + 0.5f);
        const Whole there = (depth >= least_depth) & (depth < Numbers::endless()) & (column >= 0.0f) & (column < width);
        const Real none = Numbers::real(Numbers::no_number());
        Numbers::store_pairs(points + at * 2, there ? column : none, there ? inside(row) : none, count);
    }
    // What rounding puts beyond the upper or the lower edge: rows of both eyes are the same.
    inline Real inside(Real row) const {
        const Real least = Numbers::real(0.0f), most = Numbers::real(height * 0.99999994f);
        const Real low = row > least ? row : least;
        return low < most ? low : most;
    }
};
