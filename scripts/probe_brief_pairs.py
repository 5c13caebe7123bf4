#!/usr/bin/env python3
"""Recovers the 256 point pairs of BRIEF-32 by observing OpenCV's extractor from outside.

Bit i of BRIEF is `mean of a 9x9 box A_i < mean of a 9x9 box B_i`. On a black image with a single
white dot the bit is set exactly where the dot lies in B_i but not in A_i; on a white image with a
single black dot, where it lies in A_i but not in B_i. Moving the dot over the whole patch therefore
draws both difference sets, and the two boxes follow from their extents, also where they overlap.

Needs: pip install opencv-contrib-python-headless==5.0.0.93
Usage: scripts/probe_brief_pairs.py > src/feature/brief_pairs.rs
"""

import sys

import cv2
import numpy as np

REACH = 28  # half of the 48 px patch plus half of the 9 px box
BOX = 9
SIDE = 2 * REACH + 1


def probe(background, dot):
    """(SIDE, SIDE, 256) booleans: is the bit set with the dot at (row, column)?"""
    extractor = cv2.xfeatures2d.BriefDescriptorExtractor_create(32, False)
    keypoint = cv2.KeyPoint(float(REACH), float(REACH), 7.0)
    bits = np.zeros((SIDE, SIDE, 256), bool)
    image = np.full((SIDE, SIDE), background, np.uint8)
    for row in range(SIDE):
        for column in range(SIDE):
            image[row, column] = dot
            kept, descriptors = extractor.compute(image, [keypoint])
            assert len(kept) == 1
            bits[row, column] = np.unpackbits(descriptors[0])  # most significant bit first
            image[row, column] = background
    return bits


def extent(mask):
    """First and last index with a dot, along rows and columns."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (rows[0], rows[-1]), (columns[0], columns[-1])


def centres(only_a, only_b):
    """Centre offsets of A and B along one axis from the extents of A without B and B without A."""

    def centre(own, other):
        if own[1] - own[0] + 1 == BOX:
            return own[0] + BOX // 2 - REACH
        # The boxes differ along this axis alone: the strip is the end that lies away from the other.
        low = own[0] if own[0] < other[0] else own[1] - BOX + 1
        return low + BOX // 2 - REACH

    return centre(only_a, only_b), centre(only_b, only_a)


def main():
    only_b, only_a = probe(0, 255), probe(255, 0)
    pairs, overlapping = [], 0
    for bit in range(256):
        (rows_a, columns_a), (rows_b, columns_b) = extent(only_a[:, :, bit]), extent(only_b[:, :, bit])
        y_a, y_b = centres(rows_a, rows_b)
        x_a, x_b = centres(columns_a, columns_b)
        # Proof: the boxes found explain every single observation.
        box = np.zeros((2, SIDE, SIDE), bool)
        for which, (y, x) in enumerate([(y_a, x_a), (y_b, x_b)]):
            top, left = y + REACH - BOX // 2, x + REACH - BOX // 2
            box[which, top : top + BOX, left : left + BOX] = True
        assert np.array_equal(only_a[:, :, bit], box[0] & ~box[1]), bit
        assert np.array_equal(only_b[:, :, bit], box[1] & ~box[0]), bit
        overlapping += bool((box[0] & box[1]).any())
        pairs.append((int(x_a), int(y_a), int(x_b), int(y_b)))
    print("//! Which points does each bit of BRIEF-32 compare?")
    print("//!")
    print("//! The fixed pairs of BRIEF-32 (Calonder, Lepetit, Strecha, Fua: BRIEF, ECCV 2010) as OpenCV")
    print("//! uses them. `scripts/probe_brief_pairs.py` wrote this file from observations of single-dot")
    print(f"//! images; {overlapping} pairs have overlapping 9x9 boxes.")
    print()
    print("/// `(xa, ya, xb, yb)` of bit `i`, px from the keypoint: the bit is set where the box mean at `a` is")
    print("/// below the one at `b`.")
    print("#[rustfmt::skip]")
    print("pub(super) const PAIRS: [(i8, i8, i8, i8); 256] = [")
    for start in range(0, 256, 4):
        print("    " + " ".join(f"({a}, {b}, {c}, {d})," for a, b, c, d in pairs[start : start + 4]))
    print("];")
    print(f"{overlapping} overlapping pairs", file=sys.stderr)


if __name__ == "__main__":
    main()
