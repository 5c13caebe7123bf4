"""Does a cluster of two workers learn what one process learns, byte for byte?

Needs PySpark 4 and Java 17 (`scripts/fleet.sh` installs both); skipped without.
"""

from __future__ import annotations

import datetime
import os
import random
import shutil
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyspark")
if shutil.which("java") is None:
    pytest.skip("there is no Java", allow_module_level=True)

import pyarrow as pa
import pyarrow.parquet as pq
from pyspark.sql import SparkSession
from pyspark.sql import functions as sql

import chronotope
from chronotope import Map, Street
from chronotope import _chronotope as engine
from chronotope import spark as fleet

SCHEMA = pa.schema(
    [
        ("place", pa.string()),
        ("visit", pa.binary()),
        ("time", pa.timestamp("us", tz="UTC")),
        ("feature", pa.int32()),
        ("state", pa.bool_()),
    ]
)
Row = tuple[str, bytes, int, int, bool]


@pytest.fixture(scope="module")
def session() -> Any:
    builder = (
        SparkSession.builder.master("local-cluster[2,1,1024]")
        .appName("chronotope")
        .config("spark.ui.enabled", "false")
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .config("spark.sql.session.timeZone", "America/New_York")
        .config("spark.sql.parquet.outputTimestampType", "TIMESTAMP_MICROS")
        .config("spark.sql.shuffle.partitions", "4")
        .config("spark.task.maxFailures", "4")
    )
    session = builder.getOrCreate()
    session.sparkContext.setLogLevel("FATAL")
    yield session
    session.stop()


def observations() -> list[Row]:
    """Half of all visits are of the hall; not every feature is observed at every visit."""
    draw = random.Random(21)
    rows = []
    for visit in range(400):
        place = ("hall", "lab", "hall", "gate")[visit % 4]
        us = 1_767_225_600_000_000 + visit * 7_321_000_123
        is_day = us // 3_600_000_000 % 24 < 12
        id = draw.randbytes(16)
        for feature in range(130):
            if draw.random() < 0.8:
                state = (draw.random() < 0.8) == (is_day ^ (feature % 3 == 0))
                rows.append((place, id, us, feature, state))
    return rows


def table_of(rows: list[Row]) -> pa.Table:
    columns = list(zip(*rows))
    return pa.table([pa.array(it, kind) for it, kind in zip(columns, SCHEMA.types)], schema=SCHEMA)


def write(path: Path, rows: list[Row]) -> str:
    pq.write_table(table_of(rows), path, row_group_size=5_000)
    return str(path)


def in_one_process(rows: list[Row]) -> dict[tuple[str, int], bytes]:
    """The plainest way: the sums of each place, of one table in memory."""
    sums = {}
    for place in sorted({row[0] for row in rows}):
        table = table_of([row for row in rows if row[0] == place])
        _, ids, times, states = engine.compact(
            np.zeros(len(table), np.int32),
            [place],
            np.arange(len(table), dtype=np.int32),
            table["visit"].to_pylist(),
            table["time"].cast(pa.int64()).to_numpy(),
            table["feature"].to_numpy(),
            table["state"].cast(pa.int8()).to_numpy(),
        )
        features, found = engine.sum_visits(place, ids, times, states, engine.calendar())
        sums.update({(place, int(it)): bytes for it, bytes in zip(features, found)})
    return sums


def sums_of(models: Any) -> dict[tuple[str, int], bytes]:
    rows = models.select("place", "feature", "sums").collect()
    found = {(row.place, row.feature): bytes(row.sums) for row in rows}
    assert len(found) == len(rows), "a feature has two rows"
    return found


def executors(session: Any) -> set[int]:
    """The process that each worker's tasks run in."""

    def look(batches: Any) -> Any:
        for batch in batches:
            # Python's daemon is a child of the worker's executor, and this process one of the daemon.
            with open(f"/proc/{os.getppid()}/stat") as stat:
                executor = int(stat.read().rsplit(") ", 1)[1].split()[1])
            time.sleep(0.3)
            yield pa.RecordBatch.from_arrays([pa.array([executor] * batch.num_rows)], ["pid"])

    frame = session.range(0, 16, 1, 8).mapInArrow(look, "pid long")
    return {row.pid for row in frame.collect()}


def test_there_are_two_worker_processes(session: Any) -> None:
    pids = executors(session)
    assert len(pids) == 2 and os.getpid() not in pids


def test_any_order_and_partition_gives_the_same_bytes(session: Any, tmp_path: Path) -> None:
    rows = observations()
    expected = in_one_process(rows)
    shuffled = rows.copy()
    random.Random(1).shuffle(shuffled)
    ordered = fleet.read_observations(session, write(tmp_path / "ordered.parquet", rows))
    mixed = fleet.read_observations(session, write(tmp_path / "mixed.parquet", shuffled))
    assert sums_of(fleet.learn_series(ordered)) == expected
    assert sums_of(fleet.learn_series(mixed.repartition(7))) == expected
    # Rows that came twice, and rows that came late, in a file of their own.
    twice = write(tmp_path / "twice.parquet", shuffled[:20_000] + rows[10_000:25_000])
    late = write(tmp_path / "late.parquet", shuffled[19_000:])
    both = fleet.read_observations(session, twice, late)
    assert sums_of(fleet.learn_series(both)) == expected
    # A hot place in parts: the same, whatever the number of parts.
    for salts in (2, 5):
        assert sums_of(fleet.learn_series(both.repartition(3), salts=salts)) == expected


def test_models_are_those_of_one_process(session: Any, tmp_path: Path) -> None:
    rows = observations()
    path = write(tmp_path / "observations.parquet", rows)
    models = fleet.learn_series(fleet.read_observations(session, path), order=3).collect()
    one = next(row for row in models if (row.place, row.feature) == ("lab", 7))
    ours = [row for row in rows if row[0] == "lab" and row[3] == 7]
    assert (one.num_observed, one.num_seen) == (len(ours), sum(row[4] for row in ours))
    assert one.mean == one.num_seen / one.num_observed
    model = engine.SeriesModel.decode(bytes(one.model))
    rhythms = np.stack([one.period_s, one.amplitude, one.phase_rad], axis=1)
    assert np.array_equal(model.components, rhythms) and len(rhythms) == 3
    assert one.period_s[0] == 86_400.0


def test_days_merge_exactly(session: Any, tmp_path: Path) -> None:
    rows = observations()
    middle = rows[len(rows) // 2][2]
    days = [[row for row in rows if (row[2] < middle) == is_first] for is_first in (True, False)]
    tables = [
        fleet.learn_series(session.read.parquet(write(tmp_path / f"{at}.parquet", day)))
        for at, day in enumerate(days)
    ]
    assert sums_of(fleet.merge_models(*tables)) == in_one_process(rows)


def test_a_worker_that_is_killed_changes_nothing(session: Any, tmp_path: Path) -> None:
    rows = observations()
    frame = fleet.read_observations(session, write(tmp_path / "observations.parquet", rows))
    flags = str(tmp_path)
    before = executors(session)

    def wait_to_be_killed(batches: Any) -> Any:
        """The first partition says who runs it, and waits for the other process to die."""
        from pyspark.taskcontext import TaskContext

        context = TaskContext.get()
        with open(f"/proc/{os.getppid()}/stat") as stat:
            executor = stat.read().rsplit(") ", 1)[1].split()[1]
        for batch in batches:
            yield batch
            # A stage that is repeated counts its attempts from 0 again.
            begun = os.path.join(flags, "begun")
            if context.partitionId() == 0 and not os.path.exists(begun):
                with open(begun + ".new", "w") as out:
                    out.write(executor)
                os.rename(begun + ".new", begun)
                time.sleep(60)
                with open(os.path.join(flags, "survived"), "w"):
                    pass

    def kill() -> None:
        begun = tmp_path / "begun"
        while not begun.exists():
            time.sleep(0.05)
        victims.append(int(begun.read_text()))
        os.kill(victims[0], signal.SIGKILL)

    victims: list[int] = []
    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    slow = frame.repartition(4).mapInArrow(wait_to_be_killed, frame.schema)
    found = sums_of(fleet.learn_series(slow, salts=2))
    killer.join(1)
    assert len(victims) == 1 and victims[0] in before
    assert not (tmp_path / "survived").exists(), "the one that was killed has done the work"
    assert found == in_one_process(rows)
    assert not os.path.exists(f"/proc/{victims[0]}")


def test_predictions_and_scores(session: Any, tmp_path: Path) -> None:
    rows = observations()
    frame = fleet.read_observations(session, write(tmp_path / "observations.parquet", rows))
    models = fleet.learn_series(frame).persist()
    times = ["2026-05-06T08:30:00Z", datetime.datetime(2026, 5, 6, 20, tzinfo=datetime.timezone.utc)]
    predicted = fleet.predict(models, times).collect()
    assert len(predicted) == 2 * models.count()
    known = {
        (it.place, it.feature): engine.SeriesModel.decode(bytes(it.model)) for it in models.collect()
    }
    times_us = np.array([1_778_056_200_000_000, 1_778_097_600_000_000])
    for row in predicted:
        at = int(row.time.timestamp() * 1e6)
        p = known[row.place, row.feature].p(times_us)[list(times_us).index(at)]
        assert row.p == p
    # Two of the places, and one feature that no model knows.
    judged = [row for row in rows if row[0] != "gate"][:9_000]
    extra = ("lab", b"?" * 16, judged[0][2], 999, True)
    test = session.read.parquet(write(tmp_path / "test.parquet", [*judged, *judged[:500], extra]))
    scores = {row.place: row for row in fleet.evaluate(models, test.repartition(5)).collect()}
    assert set(scores) == {"hall", "lab"}
    assert scores["lab"].num_without_model == 1 and scores["hall"].num_without_model == 0
    for place, score in scores.items():
        ours = [row for row in judged if row[0] == place]
        p = [known[place, it[3]].p(np.array([it[2]]))[0] for it in ours]
        of_state = np.array([p if row[4] else 1 - p for p, row in zip(p, ours)])
        assert score.num_observations == len(ours)
        assert score.brier == pytest.approx(np.mean((1 - of_state) ** 2), rel=1e-12)
        assert score.log_loss == pytest.approx(-np.log(np.maximum(of_state, 1e-6)).mean(), rel=1e-12)


def refused(table: pa.Table, session: Any, tmp_path: Path, column: str, says: str) -> None:
    """By its footer, and by its columns where another program reads it."""
    path = str(tmp_path / f"{says.replace(' ', '-').replace('/', '-')}.parquet")
    pq.write_table(table, path)
    with pytest.raises(chronotope.FormatError) as error:
        fleet.read_observations(session, path)
    assert error.value.path == path and f"column `{column}`" in str(error.value), error.value
    assert says in str(error.value) and error.value.help


def test_bad_footers_are_named(session: Any, tmp_path: Path) -> None:
    table = table_of(observations()[:100])

    def replaced(column: str, array: Any) -> pa.Table:
        return table.set_column(table.column_names.index(column), column, array)

    times = table["time"]
    for column, other, says in [
        ("state", table.drop_columns("state"), "has not this column"),
        ("state", replaced("state", table["state"].cast(pa.float64())), "double"),
        ("time", replaced("time", times.cast(pa.int64())), "int64"),
        ("time", replaced("time", times.cast(pa.timestamp("us"))), "timestamp[us]"),
        ("time", replaced("time", times.cast(pa.timestamp("ms", tz="UTC"), safe=False)), "timestamp[ms"),
        ("visit", replaced("visit", pa.array(["a" * 32] * 100)), "string"),
        ("feature", replaced("feature", pa.array([None, *range(99)], pa.int32())), "null"),
    ]:
        refused(other, session, tmp_path, column, says)
    folder = tmp_path / "unfinished"
    folder.mkdir()
    with pytest.raises(chronotope.FormatError, match="_SUCCESS"):
        fleet.read_observations(session, folder)
    (folder / "_SUCCESS").touch()
    with pytest.raises(chronotope.FormatError, match="no .parquet file"):
        fleet.read_observations(session, folder)
    (folder / "place=hall").mkdir()
    with pytest.raises(chronotope.FormatError, match="partitioned"):
        fleet.read_observations(session, folder)
    with pytest.raises(chronotope.NotFoundError, match="no patterns"):
        fleet.read_observations(session, tmp_path / "*.parquet")
    path = str(tmp_path / "newer.parquet")
    pq.write_table(table.replace_schema_metadata({"chronotope.table": "observations/2"}), path)
    with pytest.raises(chronotope.FormatError, match="chronotope.table.*observations/2"):
        fleet.read_observations(session, path)
    wrong = session.createDataFrame([("hall", 1)], "place string, time long")
    with pytest.raises(chronotope.FormatError, match="column `visit`"):
        fleet.learn_series(wrong)
    local = session.read.parquet(write(tmp_path / "sound.parquet", observations()[:100]))
    local = local.withColumn("time", sql.col("time").cast("timestamp_ntz"))
    with pytest.raises(chronotope.FormatError, match="column `time`.*timestamp_ntz"):
        fleet.learn_series(local)


def test_what_parquet_does_not_tell_apart_is_read(session: Any, tmp_path: Path) -> None:
    """As polars and others write it: what their Arrow had in memory stands beside what Parquet says."""
    rows = observations()[:200]
    kinds = [pa.large_string(), pa.large_binary(), pa.timestamp("us", tz="Europe/Prague")]
    kinds = [*kinds, pa.int32(), pa.bool_()]
    table = table_of(rows).cast(pa.schema(list(zip(SCHEMA.names, kinds))))
    path = str(tmp_path / "large.parquet")
    pq.write_table(table, path)
    frame = fleet.read_observations(session, path)
    assert sums_of(fleet.learn_series(frame)) == in_one_process(rows)


def test_bad_rows_stop_the_job_and_leave_nothing(session: Any, tmp_path: Path) -> None:
    rows = observations()[:9_000]
    first = rows[0]
    for bad, says in [
        ((first[0], first[1], first[2], first[3], not first[4]), "both seen and not seen"),
        ((first[0], first[1], first[2] + 1, first[3], first[4]), "two times"),
        ((first[0], first[1][:15], first[2], 0, True), "16 bytes, not 15"),
        (("", first[1], first[2], 0, True), "empty"),
        ((first[0], b"?" * 16, first[2], -1, True), "-1"),
    ]:
        path = write(tmp_path / f"{says.replace(' ', '-')}.parquet", [*rows, bad])
        frame = fleet.read_observations(session, path).repartition(5)
        out = tmp_path / "models"
        with pytest.raises(Exception) as error:
            fleet.learn_series(frame).write.parquet(str(out))
        assert says in str(error.value) and "column `" in str(error.value), str(error.value)[-2_000:]
        assert not (out / "_SUCCESS").exists()
        with pytest.raises(chronotope.Error):
            fleet.read_observations(session, out)
        shutil.rmtree(out, ignore_errors=True)


def file_of(array: Any) -> bytes:
    """As a PGM file, which needs no library."""
    height, width = array.shape
    return b"P5 %d %d 255\n" % (width, height) + array.tobytes()


def array_of(file: bytes) -> Any:
    header, _, pixels = file.partition(b" 255\n")
    width, height = (int(it) for it in header.split()[1:3])
    return np.frombuffer(pixels, np.uint8).reshape(height, width)


def test_maps_of_three_robots(session: Any, tmp_path: Path) -> None:
    street = Street(num_places=3)
    learn, _ = street.schedule(num_learn=9, num_query=1)
    images = []
    for robot in range(3):
        for visit, moment in enumerate(learn[robot::3]):
            for place in street.places:
                when = moment + datetime.timedelta(seconds=31 * len(images))
                image = file_of(street.render(place, when, visit=robot * 100 + visit))
                images.append((f"robot-{robot}", place, f"day-{visit}", when, image))
    # One by one: each robot learns its own images in order of time.
    config = {"guard": {"judge": "never"}}
    own = []
    for robot in range(3):
        path = str(tmp_path / f"robot-{robot}.map")
        Map.create(path, name=f"robot-{robot}").close()
        rows = [row for row in images if row[0] == f"robot-{robot}"]
        for day in sorted({row[2] for row in rows}):
            with chronotope.Learner(path, session=day, config=config) as learner:
                for _, place, _, when, image in (row for row in rows if row[2] == day):
                    learner.observe(place, array_of(image), when)
        own.append(path)
    expected = tmp_path / "expected"
    Map.merge(own, tmp_path / "merged.map").export(expected)
    # On the cluster, in another order, and with some images twice.
    again = [*images, *images[5:9]]
    random.Random(3).shuffle(again)
    schema = "robot string, place string, session string, time timestamp, image binary"
    frame = session.createDataFrame(again, schema).repartition(5)
    shards = fleet.learn_maps(frame).persist()
    assert shards.count() == 9
    assert {row.num_visits for row in shards.collect()} == {3}
    found = tmp_path / "found"
    fleet.join_shards(shards, tmp_path / "joined.map").export(found)
    names = {str(it.relative_to(expected)) for it in expected.rglob("*") if it.is_file()}
    assert names == {str(it.relative_to(found)) for it in found.rglob("*") if it.is_file()}
    differ = [it for it in names if (expected / it).read_bytes() != (found / it).read_bytes()]
    assert not differ
    # A region, and a robot that takes it over without losing its own.
    region = shards.where(shards.place.isin(street.places[:2]))
    with fleet.join_shards(region, tmp_path / "region.map") as part:
        assert [it.name for it in part.places] == street.places[:2]
    newer = Map.merge([own[0], str(tmp_path / "region.map")], tmp_path / "newer.map")
    assert {len(newer[it].visit_ids) for it in street.places[:2]} == {9}
    assert len(newer[street.places[2]].visit_ids) == 3


def test_an_image_that_is_none_is_named(session: Any) -> None:
    now = datetime.datetime(2026, 5, 6, tzinfo=datetime.timezone.utc)
    schema = "robot string, place string, session string, time timestamp, image binary"
    frame = session.createDataFrame([("r", "gate", "s", now, b"no image")], schema)
    with pytest.raises(Exception, match="place `gate`, column `image`, row 0"):
        fleet.learn_maps(frame).collect()
