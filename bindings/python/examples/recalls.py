"""Recalls as hloc and VPR-methods-evaluation count them, of a folder of queries.

A query is right at N if one of its first N places is its own. Prints ``R@1: 98.3, R@5: 100.0, ...`` and
writes, with ``--predictions``, the first places of every query: an image name and the ranked places, one
pair a line, as hloc keeps its retrieval pairs.

python examples/recalls.py MAP QUERIES [--method fremen] [--predictions pairs.txt]
"""

from __future__ import annotations

import argparse
import csv
import pathlib

import numpy as np

import chronotope

RECALLS = (1, 5, 10, 20)


def read_index(folder: pathlib.Path) -> list[pathlib.Path]:
    """The images that an index.csv lists, in its order, each once."""
    with open(folder / "index.csv", newline="", encoding="utf-8") as file:
        paths = [folder / row["path"] for row in csv.DictReader(file)]
    return list(dict.fromkeys(paths))


def recalls(ranks: list[int | None], at: tuple[int, ...] = RECALLS) -> dict[int, float]:
    """The share of queries, in %, whose place is among the first N."""
    found = np.array([np.inf if rank is None else rank for rank in ranks])
    return {n: float(100 * (found < n).mean()) for n in at}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=pathlib.Path)
    parser.add_argument("queries", type=pathlib.Path)
    parser.add_argument("--method", default=None)
    parser.add_argument("--predictions", type=pathlib.Path)
    options = parser.parse_args()

    localizer = chronotope.Localizer(options.map, method=options.method)
    ranks: list[int | None] = []
    pairs: list[str] = []
    for path in read_index(options.queries):
        for answer in localizer.localize_file(path):
            places = answer.places
            ranks.append(places.index(answer.truth) if answer.truth in places else None)
            pairs += [f"{path.name} {place}" for place in places[: max(RECALLS)]]
    print(", ".join(f"R@{n}: {share:.1f}" for n, share in recalls(ranks).items()))
    if options.predictions is not None:
        options.predictions.write_text("\n".join(pairs) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
