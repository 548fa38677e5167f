// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Read a launch of the packet caster from standard input, run it with lanes in every order, and write the images to
// standard output.

#include <stdio.h>
#include <stdlib.h>

#include "cuda_launch.h"

namespace {

void require(bool condition, const char* what) {
    if (condition) return;
    fprintf(stderr, "emulator: %s\n", what);
    exit(2);
}

}  // namespace

void Reader::bytes(void* to, size_t count) {
    require(fread(to, 1, count, stdin) == count, "unexpected end of the launch");
}

// Each array has a separate allocation of exact size, so that the address sanitizer detects accesses beyond it.
void* Reader::array(int* shape) {
    int32_t kind;
    int64_t count;
    bytes(&kind, sizeof(kind));
    bytes(shape, DIMENSIONS * sizeof(int));
    bytes(&count, sizeof(count));
    if (kind == ABSENT) return nullptr;
    char* data = (char*)malloc((size_t)count);
    if (kind == IMAGE) {
        require(image_count < MAX_IMAGES, "too many images");
        images[image_count].data = data;
        images[image_count++].bytes = (size_t)count;
    } else {
        bytes(data, (size_t)count);
    }
    return data;
}

int main() {
    static Reader reader;
    static Arguments arguments;
    int32_t size[3];
    reader.bytes(size, sizeof(size));
    read(reader, arguments);
    const emulator::Launch launch = {packet_function, &arguments, size[0], size[1], size[2]};
    char* expected[Reader::MAX_IMAGES];
    for (int order = 0; order < emulator::ORDERS; ++order) {
        // Bytes that are not written differ between orders.
        for (int i = 0; i < reader.image_count; ++i)
            memset(reader.images[i].data, 0x51 + order, reader.images[i].bytes);
        emulator::run(launch, (emulator::Order)order);
        for (int i = 0; i < reader.image_count; ++i) {
            const Reader::Image& image = reader.images[i];
            if (order == 0) {
                expected[i] = (char*)malloc(image.bytes);
                memcpy(expected[i], image.data, image.bytes);
            }
            require(memcmp(expected[i], image.data, image.bytes) == 0, "an image depends on the order of the lanes");
        }
    }
    for (int i = 0; i < reader.image_count; ++i) {
        fwrite(expected[i], 1, reader.images[i].bytes, stdout);
        free(expected[i]);
    }
    return 0;
}
