#!/usr/bin/env python3
"""The Python side of `chronotope-eval speed`: OpenCV's extraction and FAISS's binary indexes, timed.

Usage: speed_rivals.py FOLDER      FOLDER/job.json says what to do; the answer is JSON on stdout.
Every rival has one thread. Times are ms of each repetition, without what Python needs to pass data.
"""

import json
import pathlib
import sys
import time

import numpy as np


def repeat(call, at_least=5, enough_s=0.5, at_most=200):
    call()
    ms, start = [], time.perf_counter()
    while len(ms) < at_least or (len(ms) < at_most and time.perf_counter() - start < enough_s):
        before = time.perf_counter()
        call()
        ms.append((time.perf_counter() - before) * 1e3)
    return ms


def extract(folder, job):
    import cv2

    cv2.setNumThreads(1)
    star = cv2.xfeatures2d.StarDetector_create(45, 0, 10, 8, 5)
    brief = cv2.xfeatures2d.BriefDescriptorExtractor_create(32, False)
    data = np.fromfile(folder / "images.bin", np.uint8)
    images = data.reshape(-1, job["height"], job["width"])
    ms, best, checksums = [], [], []
    for image in images:
        found = sorted(star.detect(image), key=lambda k: (-k.response, k.pt[1], k.pt[0]))[: job["num_features"]]

        # Choosing the strongest is left out of OpenCV's time: in Python it would cost more than in C++.
        detect, describe = repeat(lambda: star.detect(image)), repeat(lambda: brief.compute(image, found))
        best.append(min(detect) + min(describe))
        ms += [float(np.median(describe)) + one for one in detect]
        _, bits = brief.compute(image, found)
        flat = np.zeros(0, np.uint64) if bits is None else bits.reshape(-1).astype(np.uint64)
        total = int((flat * np.arange(1, len(flat) + 1, dtype=np.uint64)).sum())
        checksums.append([0 if bits is None else len(bits), total])
    return {"version": cv2.__version__, "ms": ms, "ms_best": sum(best) / len(best), "checksums": checksums}


def opencv_nearest(queries, rows, k=2):
    """What BFMatcher.knnMatch does inside, without the objects that Python would make of its answer."""
    import cv2

    cv2.setNumThreads(1)
    parts = []
    # BFMatcher asserts at 262,144 rows of one matrix.
    for start in range(0, len(rows), 200_000):
        part = rows[start : start + 200_000]
        distances, _ = cv2.batchDistance(queries, part, cv2.CV_32S, None, None, cv2.NORM_HAMMING, k)
        parts.append(distances)
    return parts[0] if len(parts) == 1 else np.sort(np.hstack(parts), axis=1)[:, :k]


def search(folder, job):
    import faiss

    faiss.omp_set_num_threads(1)
    rows = np.fromfile(folder / "rows.bin", np.uint8).reshape(-1, 32)
    queries = np.fromfile(folder / "queries.bin", np.uint8).reshape(-1, 32)
    nearest = np.fromfile(folder / "nearest.bin", np.uint16).reshape(-1, 2).astype(np.int32)
    answers = []

    def answer(name, index, build_s=0.0, k=2):
        distances, _ = index.search(queries, k)
        answers.append(
            {
                "name": name,
                "ms": repeat(lambda: index.search(queries, k)),
                "recall": float((distances[:, 0] == nearest[:, 0]).mean()),
                "is_equal": bool(np.array_equal(distances, nearest[:, :k])),
                "build_s": build_s,
            }
        )

    if job["opencv"]:
        found = opencv_nearest(queries, rows)
        answers.append(
            {
                "name": "OpenCV BFMatcher",
                "ms": repeat(lambda: opencv_nearest(queries, rows), at_least=3),
                "recall": 1.0,
                "is_equal": bool(np.array_equal(found, nearest)),
                "build_s": 0.0,
            }
        )
    flat = faiss.IndexBinaryFlat(256)
    flat.add(rows)
    answer("flat", flat)
    if job["approximate"]:
        lists = job["num_lists"]
        quantizer = faiss.IndexBinaryFlat(256)
        start = time.perf_counter()
        inverted = faiss.IndexBinaryIVF(quantizer, 256, lists)
        inverted.train(rows[:: max(1, len(rows) // (64 * lists))].copy())
        inverted.add(rows)
        build_s = time.perf_counter() - start
        for probes in job["probes"]:
            inverted.nprobe = probes
            answer(f"IVF {lists}, nprobe {probes}", inverted, build_s)
    if job["graph"]:
        start = time.perf_counter()
        graph = faiss.IndexBinaryHNSW(256, 16)
        graph.hnsw.efConstruction = 200
        graph.add(rows)
        build_s = time.perf_counter() - start
        for ef in (16, 64, 128):
            graph.hnsw.efSearch = ef
            answer(f"HNSW 16, ef {ef}", graph, build_s)
    return {"version": faiss.__version__, "answers": answers}


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    job = json.loads((folder / "job.json").read_text())
    json.dump({"extract": extract, "search": search}[job["kind"]](folder, job), sys.stdout)


if __name__ == "__main__":
    main()
