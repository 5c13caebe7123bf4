#!/usr/bin/env python3
"""Are our STAR keypoints and BRIEF bits those of OpenCV, on every image of a folder?

Our loader decodes, crops, scales and greys each image; the same grey bytes go to OpenCV. Compared are
the set of keypoints before any cut, their sizes and responses, and all descriptors: every number must
be equal. What the two image decoders make of the same file is a separate table, because there
differences of a grey level are normal (JPEG).

Usage: parity.py DATA_DIR [DUMP_FEATURES]      (scripts/parity.sh builds and installs what it needs)
Every folder under DATA_DIR with an index.csv is one row; without any, every folder with images is.
Exits with 0 if everything is equal, 1 if anything differs or cannot be read, 2 if nothing could be compared.
"""

import csv
import json
import os
import pathlib
import struct
import subprocess
import sys
import threading
import time

import cv2
import numpy as np

SUFFIXES = {".bmp", ".jpg", ".jpeg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"}


def files_below(root):
    """Every file below root, also through symbolic links, in order."""
    for folder, folders, files in os.walk(root, followlinks=True):
        folders.sort()
        yield from (pathlib.Path(folder, file) for file in sorted(files))


def jobs_of(root):
    """{folder: [job]} of all indices below root, else of all folders with images."""
    sets = {}
    for index in (path for path in files_below(root) if path.name == "index.csv"):
        jobs = []
        with index.open(newline="") as rows:
            for row in csv.DictReader(rows):
                if not row.get("path"):
                    break
                job, options = {"path": str(index.parent / row["path"])}, {}
                if row.get("crop_w"):
                    options["crop"] = {
                        "x": int(row["crop_x"]),
                        "y": int(row["crop_y"]),
                        "width": int(row["crop_w"]),
                        "height": int(row["crop_h"]),
                    }
                if row.get("scale"):
                    options["scale"] = float(row["scale"])
                jobs.append(job | {"options": options})
        if jobs:
            sets[index.parent] = jobs
    if not sets:
        for path in files_below(root):
            if path.suffix.lower() in SUFFIXES:
                sets.setdefault(path.parent, []).append({"path": str(path), "options": {}})
    return sets


def records(dump, jobs):
    """What our side answers to each job: (grey, keypoints, described, descriptors) or an error text."""
    process = subprocess.Popen([dump], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def feed():
        for job in jobs:
            process.stdin.write(json.dumps(job).encode() + b"\n")
        process.stdin.close()

    threading.Thread(target=feed, daemon=True).start()

    def number():
        return struct.unpack("<I", read(4))[0]

    def read(count):
        data = process.stdout.read(count)
        if len(data) != count:
            raise SystemExit(f"{dump} stopped early (exit code {process.wait()})")
        return data

    for _ in jobs:
        if number():
            yield read(number()).decode()
            continue
        width, height = number(), number()
        grey = np.frombuffer(read(width * height), np.uint8).reshape(height, width)
        keypoints = np.frombuffer(read(16 * (n := number())), "<f4").reshape(n, 4)
        features = np.frombuffer(read(36 * (n := number())), np.uint8).reshape(n, 36)
        yield grey, keypoints, features[:, :4].copy().view("<u4")[:, 0], features[:, 4:]
    process.wait()


def opencv_features(grey, star, brief):
    """Sorted keypoints (x, y, size, response), which are described, their bits; and two durations."""
    start = time.perf_counter()
    found = star.detect(grey)
    middle = time.perf_counter()
    found = sorted(found, key=lambda k: (-k.response, k.pt[1], k.pt[0]))
    for i, keypoint in enumerate(found):
        keypoint.class_id = i
    keypoints = np.array([(*k.pt, k.size, k.response) for k in found], np.float32).reshape(-1, 4)
    before = time.perf_counter()
    kept, bits = brief.compute(grey, found)
    brief_s = time.perf_counter() - before
    described = np.array([k.class_id for k in kept], np.uint32)
    bits = np.zeros((0, 32), np.uint8) if bits is None else bits
    return (keypoints, described, bits), (middle - start, brief_s)


def opencv_grey(job, cache):
    """The same region as OpenCV's own decoder and resize make it."""
    if cache.get("path") != job["path"]:
        cache.update(path=job["path"], image=cv2.imread(job["path"], cv2.IMREAD_GRAYSCALE))
    grey, options = cache["image"], job["options"]
    if grey is not None and "crop" in options:
        c = options["crop"]
        grey = grey[c["y"] : c["y"] + c["height"], c["x"] : c["x"] + c["width"]]
    if grey is not None and options.get("scale", 1) != 1:
        grey = cv2.resize(grey, None, fx=options["scale"], fy=options["scale"], interpolation=cv2.INTER_LINEAR)
    return grey


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    root = pathlib.Path(sys.argv[1])
    dump = sys.argv[2] if len(sys.argv) == 3 else "target/release/examples/dump_features"
    sets = jobs_of(root)
    if not sets:
        print(f"no index.csv and no images under {root}", file=sys.stderr)
        sys.exit(2)
    cv2.setNumThreads(1)
    star = cv2.xfeatures2d.StarDetector_create(45, 0, 10, 8, 5)
    brief = cv2.xfeatures2d.BriefDescriptorExtractor_create(32, False)
    print(f"OpenCV {cv2.__version__}, STAR(45, 0, 10, 8, 5) + BRIEF-32, one thread\n")
    head = ["set", "images", "unreadable", "keypoints", "descriptors", "images that differ in:"]
    print(f"{head[0]:<28}{head[1]:>8}{head[2]:>12}{head[3]:>12}{head[4]:>13}  {head[5]} "
          "points, sizes, responses, described, bits | OpenCV ms STAR + BRIEF")
    differing, compared, decoders, failures = 0, 0, [], []
    for folder, jobs in sets.items():
        counts = dict.fromkeys(["points", "sizes", "responses", "described", "bits"], 0)
        num_keypoints = num_descriptors = unreadable = 0
        times, cache = [], {}
        grey_counts = dict(images=0, equal=0, undecoded=0, pixels=0, differing=0, largest=0)
        for job, record in zip(jobs, records(dump, jobs)):
            if isinstance(record, str):
                unreadable += 1
                failures.append(f"{record}")
                continue
            grey, *ours = record
            theirs, durations = opencv_features(grey, star, brief)
            times.append(durations)
            compared += 1
            num_keypoints += len(theirs[0])
            num_descriptors += len(theirs[2])
            same = {
                "points": np.array_equal(ours[0][:, :2], theirs[0][:, :2]),
                "sizes": np.array_equal(ours[0][:, 2], theirs[0][:, 2]),
                "responses": np.array_equal(ours[0][:, 3], theirs[0][:, 3]),
                "described": np.array_equal(ours[1], theirs[1]),
                "bits": np.array_equal(ours[2], theirs[2]),
            }
            for what, equal in same.items():
                counts[what] += not equal
            if not all(same.values()):
                differing += 1
                failures.append(f"{job['path']}: differs in {', '.join(w for w, e in same.items() if not e)}")
            other = opencv_grey(job, cache)
            if other is None or other.shape != grey.shape:
                grey_counts["undecoded"] += 1
            else:
                difference = cv2.absdiff(grey, other)
                changed = int(np.count_nonzero(difference))
                grey_counts["images"] += 1
                grey_counts["equal"] += changed == 0
                grey_counts["pixels"] += grey.size
                grey_counts["differing"] += changed
                grey_counts["largest"] = max(grey_counts["largest"], int(difference.max(initial=0)))
        name = str(folder.relative_to(root)) if folder != root else folder.name
        decoders.append((name, grey_counts))
        ms = np.median(times, 0) * 1000 if times else (0, 0)
        print(f"{name:<28}{len(jobs):>8}{unreadable:>12}{num_keypoints:>12}{num_descriptors:>13}  "
              f"{', '.join(str(n) for n in counts.values())} | {ms[0]:.1f} + {ms[1]:.1f}", flush=True)
    print("\nDecoders: our grey bytes against cv2.imread(GRAYSCALE), crop and cv2.resize (differences are no failure)\n")
    print(f"{'set':<28}{'compared':>9}{'equal':>7}{'not read':>9}{'pixels that differ':>20}{'largest':>9}")
    for name, g in decoders:
        share = g["differing"] / max(g["pixels"], 1)
        print(f"{name:<28}{g['images']:>9}{g['equal']:>7}{g['undecoded']:>9}{share:>19.4%}{g['largest']:>10}")
    if failures:
        print(f"\n{len(failures)} failures, the first ones:", *failures[:20], sep="\n  ")
    verdict = "EQUAL on every image" if differing == 0 and compared else f"{differing} images DIFFER"
    print(f"\n{compared} images compared: {verdict}")
    sys.exit(2 if compared == 0 else 1 if failures else 0)


if __name__ == "__main__":
    main()
