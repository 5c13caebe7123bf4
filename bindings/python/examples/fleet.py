"""Observations of a fleet learnt on Spark, or with pandas, and what each takes.

    python fleet.py spark OBSERVATIONS MODELS --workers 2
    python fleet.py pandas OBSERVATIONS

prints one line of JSON: seconds, peak memory of all its processes, rows, models. `make fleet` runs it.
"""

from __future__ import annotations

import argparse
import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np


def tree_mb() -> float:
    """Memory of this process and its descendants, in MB; what processes share counts in each."""
    parents, sizes = {}, {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parents[int(folder.name)] = int(
                    (folder / "stat").read_text().rsplit(") ", 1)[1].split()[1]
                )
                sizes[int(folder.name)] = int((folder / "statm").read_text().split()[1])
            except (OSError, IndexError):
                continue
    ours = {os.getpid()}
    found = set(ours)
    while found:
        found = {pid for pid, parent in parents.items() if parent in ours} - ours
        ours |= found
    pages = sum(sizes.get(pid, 0) for pid in ours)
    return pages * os.sysconf("SC_PAGESIZE") / 1e6


class Peak(threading.Thread):
    """The most memory that was in use at one time, looked at five times a second."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.mb = 0.0
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.wait(0.2):
            self.mb = max(self.mb, tree_mb())


def on_spark(observations: str, models: str, workers: int, peak: Peak) -> dict[str, Any]:
    from pyspark.sql import SparkSession

    from chronotope import spark as fleet

    session = (
        SparkSession.builder.master(f"local-cluster[{workers},1,1536]")
        .appName("fleet")
        .config("spark.executor.memory", "1024m")
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .config("spark.ui.enabled", "false")
        .config("spark.sql.shuffle.partitions", str(4 * workers))
        .config("spark.sql.execution.arrow.maxRecordsPerBatch", "100000")
        .getOrCreate()
    )
    session.sparkContext.setLogLevel("ERROR")
    # Until the workers are there: a cluster runs already when a job comes.
    session.range(0, 100, 1, 4).mapInArrow(lambda it: it, "id long").count()
    begin = time.monotonic()
    table = fleet.read_observations(session, observations)
    fleet.learn_series(table).write.parquet(models)
    total_s = time.monotonic() - begin
    num_rows = table.count()
    num_models = session.read.parquet(models).count()
    found = {"rows": num_rows, "models": num_models, "total_s": total_s, "peak_mb": peak.mb}
    peak.ended.set()
    session.stop()
    return found


def with_pandas(observations: str, peak: Peak) -> dict[str, Any]:
    """The same sums as floating-point numbers, as one would write them with pandas."""
    import pandas as pd
    import pyarrow.parquet as pq

    begin = time.monotonic()
    # Dictionaries: as plain objects, identities alone would take 50 bytes a row.
    frame = pq.read_table(observations, read_dictionary=["place", "visit"]).to_pandas()
    frame = frame.drop_duplicates(["place", "visit", "feature"])
    visits = frame.drop_duplicates(["place", "visit"])[["place", "visit", "time"]].copy()
    us = visits["time"].to_numpy().astype("datetime64[us]").astype(np.int64)
    names = []
    for k, period_s in enumerate([31_556_952, 604_800, 86_400, 43_200, 28_800, 21_600]):
        phase = us % (period_s * 1_000_000) * (2 * np.pi / (period_s * 1e6))
        visits[f"cos{k}"], visits[f"sin{k}"] = np.cos(phase), np.sin(phase)
        names += [f"cos{k}", f"sin{k}"]
    models = []
    # Place by place: all phasors of all rows at once would be 100 bytes a row more.
    for _, rows in frame.groupby("place", observed=True):
        rows = rows.merge(visits.drop(columns=["place", "time"]), on="visit")
        observed = rows.groupby("feature")[names].sum()
        seen = rows[rows["state"]].groupby("feature")[names].sum().reindex(observed.index)
        num = rows.groupby("feature")["state"].agg(["size", "sum"])
        mean = num["sum"] / num["size"]
        balanced = seen.fillna(0.0).sub(observed.mul(mean, axis=0)).div(num["size"], axis=0)
        power = np.stack([np.hypot(balanced[f"cos{k}"], balanced[f"sin{k}"]) for k in range(6)])
        models.append(pd.DataFrame({"mean": mean, "best": power.argmax(axis=0)}))
    total_s = time.monotonic() - begin
    peak.ended.set()
    num_models = sum(len(it) for it in models)
    return {"rows": len(frame), "models": num_models, "total_s": total_s, "peak_mb": peak.mb}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("engine", choices=["spark", "pandas"])
    parser.add_argument("observations")
    parser.add_argument("models", nargs="?", default="models")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    peak = Peak()
    peak.start()
    if args.engine == "spark":
        found = on_spark(args.observations, args.models, args.workers, peak)
    else:
        found = with_pandas(args.observations, peak)
    print(json.dumps({"engine": args.engine, "workers": args.workers, **found}))


if __name__ == "__main__":
    main()
