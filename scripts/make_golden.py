#!/usr/bin/env python3
"""Writes tests/data/features/star_brief.txt: what OpenCV finds in pictures that the test draws again.

The pictures come from an integer generator that tests/it/feature.rs has too, so that no image files
are needed; the SHA-256 of width, height and pixels proves that both drew the same.

Needs: pip install opencv-contrib-python-headless==5.0.0.93
Usage: scripts/make_golden.py > tests/data/features/star_brief.txt

    image KIND WIDTH HEIGHT SEED SHA256 max_size response projected binarized nonmax
    x y size response_bits descriptor        (one line a keypoint, by response descending, y, x)

`response_bits` is the IEEE 754 single in hexadecimal; a keypoint too near to the edge to be described
has `-` as its descriptor.
"""

import hashlib
import struct

import cv2
import numpy as np

MASK = (1 << 64) - 1


class Xorshift:
    def __init__(self, seed):
        self.state = seed

    def below(self, limit):
        s = self.state
        s ^= s << 13 & MASK
        s ^= s >> 7
        s ^= s << 17 & MASK
        self.state = s
        return (s >> 33) % limit


def draw(kind, width, height, seed):
    """Overlapping rectangles; then `noise`: added noise, `smooth`: low contrast over a ramp, `binary`:
    black and white, where many responses are equal."""
    random = Xorshift(seed)
    image = np.full((height, width), 110, np.uint8)
    for _ in range(width * height // 150):
        w, h = 2 + random.below(26), 2 + random.below(26)
        x, y, level = random.below(width - w), random.below(height - h), random.below(256)
        image[y : y + h, x : x + w] = level
    for y in range(height):
        for x in range(width):
            pixel = int(image[y, x])
            if kind == "noise":
                pixel = min(255, pixel + random.below(12))
            elif kind == "smooth":
                pixel = pixel // 8 + (x + 2 * y) // 6 % 200
            else:
                pixel = 255 if pixel >= 128 else 0
            image[y, x] = pixel
    return image


def main():
    default = (45, 0, 10, 8, 5)
    cases = [
        ("noise", 320, 240, 1, default),
        ("smooth", 231, 187, 2, default),
        ("binary", 240, 200, 3, default),
        ("noise", 160, 300, 4, (16, 5, 10, 8, 9)),
        ("binary", 101, 97, 5, (22, 30, 20, 12, 3)),
        ("smooth", 130, 124, 6, (32, 0, 12, 14, 1)),
        ("noise", 300, 290, 7, (64, 2, 15, 10, 4)),
        ("binary", 440, 430, 8, (128, 0, 10, 8, 5)),
    ]
    brief = cv2.xfeatures2d.BriefDescriptorExtractor_create(32, False)
    print(f"# Written by scripts/make_golden.py with OpenCV {cv2.__version__}; do not edit.")
    for kind, width, height, seed, star in cases:
        image = draw(kind, width, height, seed)
        digest = hashlib.sha256(struct.pack("<QQ", width, height) + image.tobytes()).hexdigest()
        print("image", kind, width, height, seed, digest, *star)
        found = cv2.xfeatures2d.StarDetector_create(*star).detect(image)
        found = sorted(found, key=lambda k: (-k.response, k.pt[1], k.pt[0]))
        for i, keypoint in enumerate(found):
            keypoint.class_id = i
        kept, bits = brief.compute(image, found)
        described = {k.class_id: row.tobytes().hex() for k, row in zip(kept, bits if kept else [])}
        for i, k in enumerate(found):
            response = struct.pack(">f", k.response).hex()
            print(f"{k.pt[0]:g} {k.pt[1]:g} {k.size:g} {response} {described.get(i, '-')}")


if __name__ == "__main__":
    main()
