// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "shared/scalar.h"

// A vector or a color per pixel.
template <class Numbers>
struct Triple {
    typedef typename Numbers::Real Real;
    typedef typename Numbers::Whole Whole;
    Real x, y, z;

    static inline Triple of(const float* numbers) {
        return Triple{Numbers::real(numbers[0]), Numbers::real(numbers[1]), Numbers::real(numbers[2])};
    }
    // Of a `wp.vec3`.
    template <class Vec3>
    static inline Triple from(const Vec3& a) {
        return Triple{Numbers::real(a[0]), Numbers::real(a[1]), Numbers::real(a[2])};
    }
    static inline Triple all(float a) { return Triple{Numbers::real(a), Numbers::real(a), Numbers::real(a)}; }
    static inline Triple select(Whole which, const Triple& a, const Triple& b) {
        return Triple{which ? a.x : b.x, which ? a.y : b.y, which ? a.z : b.z};
    }
    template <class Function>
    static inline Triple map(const Triple& a, const Function& function) {
        return Triple{function(a.x), function(a.y), function(a.z)};
    }

    inline Triple operator+(const Triple& b) const { return Triple{x + b.x, y + b.y, z + b.z}; }
    inline Triple operator-(const Triple& b) const { return Triple{x - b.x, y - b.y, z - b.z}; }
    inline Triple operator*(Real factor) const { return Triple{x * factor, y * factor, z * factor}; }
    inline Triple times(const Triple& b) const { return Triple{x * b.x, y * b.y, z * b.z}; }
    inline Triple times(const float* b) const { return Triple{x * b[0], y * b[1], z * b[2]}; }
    inline Triple minus(const float* b) const { return Triple{x - b[0], y - b[1], z - b[2]}; }
    inline Real dot(const Triple& b) const { return x * b.x + y * b.y + z * b.z; }
    inline Real dot(const float* b) const { return x * b[0] + y * b[1] + z * b[2]; }
    // Whether any of its numbers is.
    inline Whole is_positive() const { return (x > 0.0f) | (y > 0.0f) | (z > 0.0f); }
    inline Real length() const { return Numbers::root(dot(*this)); }
    // A vector of length 1; 0 for 0.
    inline Triple direction() const { return *this * (1.0f / Numbers::max(length(), Numbers::real(1e-30f))); }
    inline Triple cross(const Triple& b) const {
        return Triple{y * b.z - z * b.y, z * b.x - x * b.z, x * b.y - y * b.x};
    }
};
