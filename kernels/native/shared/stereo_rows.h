// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The model of shared/stereo.h applied to rows of pixels, as many at a time as Real holds.

// Images of all views, [view][y][x]; null if the model does not use them. The Python counterpart is StereoViews of
// kernels/sensors/stereo.py.
struct StereoImages {
    int height, width;
    const float* depth;  // of the first surface
    const float* other_depth;  // depth that the other eye measures there
    const float* normals;  // xyz in the world
    const int* segmentation;
    const float* reflectivity;  // [object]
    const float* nodes;  // noise nodes, [view][node_rows][node_columns]
    int node_rows, node_columns;
    const float* weights;  // weights of the nodes above and below a pixel, by its offset from the upper one
    const int* column_nodes;  // [column]: the node on its left, and the weights of the left and the right node
    const float* left_weights;
    const float* right_weights;
    const float* column_slopes;  // slopes of rays, (x - cx) / fx
    const float* row_slopes;
    float* depth_out;
    unsigned char* reasons_out;
};

// A view: the key of its random numbers, and its other eye.
struct StereoView {
    long long index;
    RandomKey key;
    float axes[9];  // rotation from the camera frame to the world
    float forward;  // how far the other eye is in front of the first one, due to rounding [m]
};

// Fraction of the window of each pixel that shows the pixel's surface.
struct StereoWindow {
    const Stereo& stereo;
    const StereoImages& images;
    Real depth;
    Real in_row, in_column;

    inline void count_row(const float* row, int x, int lag) {
        const int column = x + lag;
        if (column >= 0 && column + Numbers::PIXELS <= images.width) {
            count(Numbers::load(row + column, Numbers::PIXELS), in_row);
        } else {
            // Pixels beyond the end of the row belong to no surface.
            float values[Numbers::PIXELS];
            for (int k = 0; k < Numbers::PIXELS; ++k)
                values[k] = column + k >= 0 && column + k < images.width ? row[column + k] : Numbers::endless();
            count(Numbers::load(values, Numbers::PIXELS), in_row);
        }
    }
    inline void count_column(const float* row, int y, int x, int lag) {
        if (y + lag < 0 || y + lag >= images.height) return;
        count(Numbers::load(row + (long long)lag * images.width + x, images.width - x), in_column);
    }
    inline void count(Real other, Real& number) const {
        const Whole same = stereo.disparity_scale * Numbers::abs(depth - other) < stereo.edge_step * depth * other;
        number = same ? number + 1.0f : number;
    }
    // Number of image pixels in the window, horizontally and vertically.
    inline Real of_row(int x) const {
        const Real first = Numbers::columns(x) - (float)stereo.window, last = first + (float)(2 * stereo.window);
        const Real first_column = Numbers::real(0.0f), last_column = Numbers::real((float)(images.width - 1));
        return (last < last_column ? last : last_column) - (first > first_column ? first : first_column) + 1.0f;
    }
    inline float of_column(int y) const {
        const int first = y - stereo.window, last = y + stereo.window, last_row = images.height - 1;
        return (float)((last < last_row ? last : last_row) - (first > 0 ? first : 0) + 1);
    }

    // Whether all pixels of the windows belong to one surface, by their least and greatest depth: true in most of an
    // image, and faster than counting. Uncertain cases, within the rounding error, return false and are counted.
    static inline bool even(const Stereo& stereo, const StereoImages& images, const float* row, int y, int x) {
        const int reach = stereo.window, end = x + Numbers::PIXELS;
        if (Numbers::PIXELS == 1 || x < reach || end + reach > images.width) return false;
        const int up = y < reach ? y : reach, down = images.height - 1 - y < reach ? images.height - 1 - y : reach;
        Real min_depth = Numbers::load(row + x, Numbers::PIXELS), max_depth = min_depth;
        for (int lag = -reach; lag <= reach; ++lag) widen(row + x + lag, min_depth, max_depth);
        for (int lag = -up; lag <= down; ++lag) widen(row + x + (long long)lag * images.width, min_depth, max_depth);
        const float margin = 0.99999f;
        return Numbers::all(stereo.disparity_scale * (max_depth - min_depth) <
                            margin * stereo.edge_step * (min_depth * max_depth));
    }
    static inline void widen(const float* from, Real& min_depth, Real& max_depth) {
        const Real depth = Numbers::load(from, Numbers::PIXELS);
        min_depth = depth < min_depth ? depth : min_depth;
        max_depth = depth > max_depth ? depth : max_depth;
    }

    static inline Real support(const Stereo& stereo, const StereoImages& images, const float* row, int y, int x) {
        const Real none = Numbers::real(0.0f);
        if (even(stereo, images, row, y, x)) return Numbers::real(1.0f);
        StereoWindow window = {stereo, images, Numbers::load(row + x, images.width - x), none, none};
        for (int lag = -stereo.window; lag <= stereo.window; ++lag) {
            window.count_row(row, x, lag);
            window.count_column(row, y, x, lag);
        }
        return (window.in_row / window.of_row(x)) * (window.in_column / window.of_column(y));
    }
};

struct StereoRows {
    // Angle between the rays of pixels and the normals of the surfaces: its cosine is `along` divided by the root of
    // `square`.
    struct Incidence {
        Real along, square;

        static inline Incidence of(const StereoImages& images, const StereoView& view, long long place, int y, int x) {
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
            return Incidence{Numbers::abs(along), across * across + (down * down + 1.0f)};
        }
        inline Real cosine() const { return along / Numbers::root(square); }
        // Whether the signal of every pixel with a surface exceeds full detection by more than the rounding error: then
        // neither the cosine nor a random number is needed.
        inline bool suffices(const Stereo& stereo, Real depth, Real reflectivity) const {
            if (Numbers::PIXELS == 1 || stereo.detection_rate < 1.0f) return false;
            const float full = (stereo.min_signal + 1.0f / stereo.signal_slope) * 1.0001f;
            const Real signal = reflectivity * along;
            return Numbers::all((signal * signal >= (full * full) * square) | (depth == Numbers::endless()));
        }
    };
    static inline Real reflectivity(const StereoImages& images, long long place, int x) {
        float found[Numbers::PIXELS];
        for (int k = 0; k < Numbers::PIXELS; ++k) {
            const int hit = x + k < images.width ? images.segmentation[place + k] : -1;
            found[k] = hit < 0 ? 1.0f : images.reflectivity[hit];
        }
        return Numbers::load(found, Numbers::PIXELS);
    }
    // Noise interpolated between nodes, with weights whose squares sum to 1. The pixels of a register lie between a few
    // adjacent nodes.
    static inline Real smooth_noise(const StereoImages& images, const StereoView& view, int spacing, int y, int x) {
        const int row = y / spacing, column = images.column_nodes[x], count = images.node_columns - column;
        const float* above = images.nodes + (view.index * images.node_rows + row) * images.node_columns + column;
        const float* below = above + images.node_columns;
        const float* down = images.weights + (y - row * spacing) * 2;
        Real between[2];
        for (int side = 0; side < 2; ++side) {
            const Real upper = Numbers::load(above + side, count - side);
            const Real lower = Numbers::load(below + side, count - side);
            between[side] = upper * down[0] + lower * down[1];
        }
        const Real left = Numbers::load(images.left_weights + x, images.width - x);
        const Real right = Numbers::load(images.right_weights + x, images.width - x);
        if (Numbers::repeats(spacing))
            return left * Numbers::repeated(between[0], spacing) + right * Numbers::repeated(between[1], spacing);
        float nodes[2][Numbers::PIXELS], at_pixels[2][Numbers::PIXELS] = {};
        for (int side = 0; side < 2; ++side) Numbers::store(nodes[side], between[side], Numbers::PIXELS);
        for (int k = 0; k < Numbers::PIXELS && x + k < images.width; ++k) {
            const int node = images.column_nodes[x + k] - column;
            at_pixels[0][k] = nodes[0][node];
            at_pixels[1][k] = nodes[1][node];
        }
        return left * Numbers::load(at_pixels[0], Numbers::PIXELS) +
               right * Numbers::load(at_pixels[1], Numbers::PIXELS);
    }

    // Measure the pixels from x on that share random words.
    static inline void measure(const Stereo& stereo, const StereoImages& images, const StereoView& view, int y, int x) {
        PixelWords noise, chance;
        const bool white = stereo.sigma > 0.0f && !images.nodes;
        bool has_chance = false;
        if (white) noise = PixelWords::draw(view.key, STREAM_DISPARITY, y, x);
        const int first = x;
        for (int k = 0; k < PixelWords::PIXELS / Numbers::PIXELS; ++k, x += Numbers::PIXELS) {
            if (x >= images.width) return;
            if (empty(images, view, y, x)) continue;
            StereoPixel pixel = load_pixel(stereo, images, view, y, x);
            if (white) pixel.noise = Random::normal(noise.block[k]);
            const long long place = (view.index * images.height + y) * images.width + x;
            if (by_chance(stereo, images, view, place, y, x, pixel)) {
                if (!has_chance) chance = PixelWords::draw(view.key, STREAM_DROPOUT, y, first);
                has_chance = true;
                pixel.chance = Random::uniform(chance.block[k]);
            }
            write(stereo, images, pixel, place, images.width - x);
        }
    }
    // Whether all pixels of a register are empty; if so, write them. This is common in many images.
    static inline bool empty(const StereoImages& images, const StereoView& view, int y, int x) {
        const long long place = (view.index * images.height + y) * images.width + x;
        const Real depth = Numbers::load(images.depth + place, images.width - x);
        if (Numbers::PIXELS == 1 || !Numbers::all(depth == Numbers::endless())) return false;
        Numbers::store(images.depth_out + place, depth, Numbers::PIXELS);
        if (images.reasons_out)
            Numbers::store(images.reasons_out + place, Numbers::whole(REASON_EMPTY), Numbers::PIXELS);
        return true;
    }
    // Compute the light that comes back. Returns whether detection depends on chance.
    static inline bool by_chance(const Stereo& stereo, const StereoImages& images, const StereoView& view,
                                 long long place, int y, int x, StereoPixel& pixel) {
        if (images.segmentation) pixel.reflectivity = reflectivity(images, place, x);
        if (!images.normals) return stereo.detection_rate < 1.0f;
        const Incidence light = Incidence::of(images, view, place, y, x);
        if (light.suffices(stereo, pixel.depth, pixel.reflectivity)) return false;
        pixel.cosine = light.cosine();
        return true;
    }
    static inline StereoPixel load_pixel(const Stereo& stereo, const StereoImages& images, const StereoView& view,
                                         int y, int x) {
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
        pixel.cosine = one;
        pixel.reflectivity = one;
        pixel.noise = images.nodes ? smooth_noise(images, view, stereo.spacing, y, x) : none;
        pixel.chance = none;
        return pixel;
    }
    static inline void write(const Stereo& stereo, const StereoImages& images, const StereoPixel& pixel,
                             long long place, int count) {
        Real depth;
        Whole reason;
        stereo.measure(pixel, depth, reason);
        Numbers::store(images.depth_out + place, depth, count);
        if (images.reasons_out) Numbers::store(images.reasons_out + place, reason, count);
    }
};

// The other eye of a view: its position in the frame of the first one [m], and its image.
struct OtherImage {
    float place[3];
    float focal[2];
    float added_columns;  // columns of its image to the left of the first one's
    float width, height;
    float min_depth;  // nearer points are not projected

    // Project the points of pixels from x on into its image, x y x y ... [px]; NaN if they lie outside.
    inline void project(const StereoImages& images, long long index, int y, int x, float* points) const {
        for (int k = 0; k < PixelWords::PIXELS && x < images.width; k += Numbers::PIXELS, x += Numbers::PIXELS)
            project_lanes(images, index, y, x, points);
    }
    inline void project_lanes(const StereoImages& images, long long index, int y, int x, float* points) const {
        const int count = images.width - x;
        const long long offset = (index * images.height + y) * images.width + x;
        const Real depth = Numbers::load(images.depth + offset, count);
        const Real across = Numbers::load(images.column_slopes + x, count);
        const Real nearness = 1.0f / (depth - place[2]);
        const Real shift = (across * place[2] - place[0]) * focal[0] * nearness;
        const Real column = Numbers::columns(x) + (added_columns + 0.5f) + shift;
        const Real row = (images.row_slopes[y] * place[2] - place[1]) * focal[1] * nearness + ((float)y + 0.5f);
        const Whole is_inside =
            (depth >= min_depth) & (depth < Numbers::endless()) & (column >= 0.0f) & (column < width);
        const Real none = Numbers::real(Numbers::no_number());
        Numbers::store_pairs(points + offset * 2, is_inside ? column : none, is_inside ? inside(row) : none, count);
    }
    // Clamp rows that rounding moved beyond the upper or lower edge: both eyes share their rows.
    inline Real inside(Real row) const {
        const Real min_row = Numbers::real(0.0f), max_row = Numbers::real(height * 0.99999994f);
        const Real low = row > min_row ? row : min_row;
        return low < max_row ? low : max_row;
    }
};
