"""How does a cluster learn what many robots have observed? With PySpark 4: ``pip install chronotope[spark]``.

Models of binary states, from a table of observations (``place``, ``visit``, ``time``, ``feature``, ``state``;
docs/fleet.md describes it):

>>> from chronotope import spark as fleet                                # doctest: +SKIP
>>> observations = fleet.read_observations(session, "s3a://fleet/observations/")  # doctest: +SKIP
>>> models = fleet.learn_series(observations)                            # doctest: +SKIP
>>> fleet.predict(models, ["2026-05-06T08:30:00Z"]).show()               # doctest: +SKIP

Each visit is known by its identity and counts once, however often its rows come. Sums are whole numbers and
merge exactly, so the models are, byte for byte, those that one process learns of the same rows, whatever the
partitions and the order, and whichever worker fails.

Maps of places, from a table of images (``robot``, ``place``, ``session``, ``time``, ``image``): ``extract`` makes
the features of each image where it lies (48 bytes each), ``learn_maps`` learns each place of each robot, and
``join_shards`` makes one map file of the results, or one for each region.

Only Arrow passes between Spark and Python; every worker needs this package.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

try:
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyspark.sql import functions as sql
    from pyspark.taskcontext import TaskContext
except ImportError as cause:
    raise ImportError("chronotope.spark needs PySpark 4: pip install chronotope[spark]") from cause

from . import _chronotope as _engine
from ._errors import ConfigError, Error, FormatError, NotFoundError
from ._times import us_array
from ._types import PathLike

if TYPE_CHECKING:
    from pyspark.sql import DataFrame, SparkSession

    from ._chronotope import Map

__all__ = [
    "evaluate",
    "extract",
    "join_shards",
    "learn_maps",
    "learn_series",
    "merge_models",
    "predict",
    "read_observations",
]

#: The columns of a table of observations.
OBSERVATIONS: Mapping[str, str] = {
    "place": "string",
    "visit": "binary",
    "time": "timestamp",
    "feature": "int",
    "state": "boolean",
}
#: What the footer of a file says that chronotope has written, and the table of observations there.
_TABLE_KEY = b"chronotope.table"
_TABLE = b"observations/1"
#: The columns of a table of models.
MODELS = (
    "place string, feature int, num_observed int, num_seen int, mean double, period_s array<double>, "
    "amplitude array<double>, phase_rad array<double>, sums binary, model binary"
)
#: The columns of a table of images.
IMAGES: Mapping[str, str] = {
    "robot": "string",
    "place": "string",
    "session": "string",
    "time": "timestamp",
    "image": "binary",
}
_FEATURES = (
    "robot string, place string, session string, time timestamp, keypoints binary, descriptors binary, "
    "width int, height int"
)
_SHARDS = "robot string, place string, num_visits int, num_known int, map binary"
_VISITS = "place string, visit binary, time_us bigint, states binary, salt int"

#: Rows that are made visits of at once: enough that a visit is seldom cut in two.
_ROWS_AT_ONCE = 200_000
#: A place with more visits than this is summed in so many parts that each has about as many.
_VISITS_A_PART = 16_384
#: Features whose sums one call merges.
_FEATURES_A_BLOCK = 1_024
#: Maps that are open at once while they are joined.
_MAPS_AT_ONCE = 64


# ---- what is read


def read_observations(session: SparkSession, *paths: PathLike) -> DataFrame:
    """The table of observations in these files and folders, whose footers are checked first.

    Paths are files, or folders that hold such tables alone; patterns are for ``session.read.parquet``.

    Errors: ``FormatError`` that names file, row group and column for a column that is missing, of another
    type, or null somewhere; for a time in other units than microseconds, or without a zone; for another table,
    or a newer version of this one; and for a folder without ``_SUCCESS``. ``NotFoundError``.
    """
    files = [file for path in paths for file in _files_of(os.fspath(path))]
    if not files:
        raise ConfigError("no table is named", help="give the paths of files or folders")
    for filesystem, name, shown in files:
        _check_footer(filesystem, name, shown)
    return session.read.parquet(*[os.fspath(path) for path in paths])


def _files_of(path: str) -> list[tuple[Any, str, str]]:
    """File system, name in it and name for people of each Parquet file."""
    from pyarrow import fs

    if "://" in path:
        # As Hadoop calls it, and as Arrow does.
        filesystem, name = fs.FileSystem.from_uri(path.replace("s3a://", "s3://", 1))
    else:
        filesystem, name = fs.LocalFileSystem(), os.path.abspath(path)
    info = filesystem.get_file_info(name)
    if info.type == fs.FileType.NotFound:
        raise NotFoundError(
            "there is no such file or folder", "not-found", path, None, "name files and folders, no patterns"
        )
    if info.type == fs.FileType.File:
        return [(filesystem, name, path)]
    inside = filesystem.get_file_info(fs.FileSelector(name))
    if not any(it.base_name == "_SUCCESS" for it in inside):
        raise FormatError(
            "this folder has no _SUCCESS",
            "format",
            path,
            None,
            "whoever writes it is not finished, or has failed: write it again",
        )
    # As Spark has it, such names are no data.
    inside = [it for it in inside if not it.base_name.startswith(("_", "."))]
    for it in inside:
        if it.type == fs.FileType.Directory:
            raise FormatError(
                "this table is partitioned into folders, whose names hold a column",
                "format",
                os.path.join(path, it.base_name),
                None,
                "write it without partitionBy: row groups are found by place and day anyway",
            )
    found = sorted(it.path for it in inside if it.base_name.endswith(".parquet"))
    if not found:
        raise FormatError(
            "this folder has no .parquet file",
            "format",
            path,
            None,
            "name the files, or the folder that they are in",
        )
    return [(filesystem, it, os.path.join(path, os.path.basename(it))) for it in found]


def _check_footer(filesystem: Any, name: str, shown: str) -> None:
    from pyarrow import parquet

    try:
        with filesystem.open_input_file(name) as file:
            found_file = parquet.ParquetFile(file)
            metadata, schema = found_file.metadata, found_file.schema_arrow
    except (pa.ArrowInvalid, OSError) as cause:
        raise FormatError(str(cause), "format", shown, "footer", "write the file again") from cause
    mark = (metadata.metadata or {}).get(_TABLE_KEY, _TABLE)
    if mark != _TABLE:
        raise FormatError(
            f"this is a table `{mark.decode(errors='replace')}`, where `{_TABLE.decode()}` is expected",
            "format",
            shown,
            f"footer, key `{_TABLE_KEY.decode()}`",
            "give a table of observations; of a newer version a newer chronotope reads it",
        )
    expected = {
        "place": pa.string(),
        "visit": pa.binary(),
        "time": pa.timestamp("us", tz="UTC"),
        "feature": pa.int32(),
        "state": pa.bool_(),
    }
    for column, kind in expected.items():
        place = f"all row groups, column `{column}`"
        if column not in schema.names:
            has = ", ".join(schema.names)
            raise FormatError(
                f"the file has not this column, but {has}", "format", shown, place, _has_columns()
            )
        found = _in_parquet(schema.field(column).type)
        if found != kind and not (column == "visit" and found == pa.binary(16)):
            raise FormatError(
                f"it must be {kind}, and is {found}", "format", shown, place, _remedy_of(column)
            )
    for group in range(metadata.num_row_groups):
        for at in range(metadata.num_columns):
            chunk = metadata.row_group(group).column(at)
            statistics = chunk.statistics
            is_ours = chunk.path_in_schema in expected
            if is_ours and statistics is not None and statistics.null_count:
                raise FormatError(
                    f"{statistics.null_count} rows are null",
                    "format",
                    shown,
                    f"row group {group}, column `{chunk.path_in_schema}`",
                    "leave out rows of which something is not known",
                )


def _in_parquet(kind: pa.DataType) -> pa.DataType:
    """What Parquet knows of a type: not how long or how encoded the writer's Arrow had it in memory, and of a
    time only whether it has a zone, as it is kept in UTC then."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    if pa.types.is_timestamp(kind) and kind.tz is not None:
        return pa.timestamp(kind.unit, tz="UTC")
    plain = {
        "large_string": pa.string(),
        "string_view": pa.string(),
        "large_binary": pa.binary(),
        "binary_view": pa.binary(),
    }
    return plain.get(str(kind), kind)


def _has_columns() -> str:
    return f"a table of observations has the columns {', '.join(OBSERVATIONS)}"


def _remedy_of(column: str) -> str:
    remedies = {
        "time": "a moment has a zone: cast it to timestamp by the zone of the clock that showed it, and write "
        "with spark.sql.parquet.outputTimestampType=TIMESTAMP_MICROS",
        "visit": "write the 128 bits of the identity as 16 bytes",
        "state": "true is seen, false not seen; leave out what could not be seen",
    }
    return remedies.get(column, "cast the column")


def _check_columns(frame: DataFrame, expected: Mapping[str, str], table: str) -> DataFrame:
    """The expected columns of a table; any further ones are left out."""
    found = {field.name: field.dataType.simpleString() for field in frame.schema.fields}
    for column, kind in expected.items():
        place = f"column `{column}`"
        if column not in found:
            has = f"the table has not this column, but {', '.join(found)}"
            help = f"a table of {table} has the columns {', '.join(expected)}"
            raise FormatError(has, "format", None, place, help)
        if found[column] != kind:
            message = f"it must be {kind}, and is {found[column]}"
            raise FormatError(message, "format", None, place, _remedy_of(column))
    return frame.select(*expected)


def _named(error: Error, what: str = "") -> Error:
    """The error with where on the cluster it was found."""
    context = TaskContext.get()
    partition = "" if context is None else f"partition {context.partitionId()}"
    error.place = ", ".join(it for it in (partition, what, error.place) if it)
    return error


def _refuse_nulls(table: pa.Table) -> None:
    for name in table.column_names:
        if table.column(name).null_count:
            row = pc.index(pc.is_null(table.column(name)), True).as_py()
            raise _named(
                FormatError(
                    "it is null",
                    "format",
                    None,
                    f"column `{name}`, row {row} of a batch",
                    "leave out rows of which something is not known",
                )
            )


# ---- models of binary states


def _gathered(batches: Iterable[pa.RecordBatch]) -> Iterator[pa.Table]:
    """Tables of many rows, of batches of few."""
    gathered: list[pa.RecordBatch] = []
    num_rows = 0
    for batch in batches:
        gathered.append(batch)
        num_rows += batch.num_rows
        if num_rows >= _ROWS_AT_ONCE:
            yield pa.Table.from_batches(gathered)
            gathered, num_rows = [], 0
    if num_rows:
        yield pa.Table.from_batches(gathered)


def _encoded(column: pa.ChunkedArray) -> tuple[np.ndarray[Any, np.dtype[np.int32]], list[Any]]:
    """For each row its number in the list of different values."""
    encoded = column.combine_chunks().dictionary_encode()
    if isinstance(encoded, pa.ChunkedArray):
        encoded = encoded.combine_chunks()
    return encoded.indices.to_numpy(), encoded.dictionary.to_pylist()


def _us(column: pa.ChunkedArray) -> np.ndarray[Any, np.dtype[np.int64]]:
    us: np.ndarray[Any, np.dtype[np.int64]] = column.cast(pa.int64()).to_numpy()
    return us


def _part_of(visit: bytes, num_parts: int) -> int:
    """The same for every copy of a visit. Identities may be numbers that count up."""
    bits = int.from_bytes(visit, "big") * 0x9E3779B97F4A7C15F39CC0605CEDC835
    return (bits >> 64) % num_parts


def _visits_of(frame: DataFrame, num_parts: Mapping[str, int]) -> DataFrame:
    """The states of each visit in a few bytes; a visit whose rows lie in several places comes several times."""
    parts = dict(num_parts)

    def compact(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        for table in _gathered(batches):
            _refuse_nulls(table)
            place_codes, places = _encoded(table.column("place"))
            visit_codes, visits = _encoded(table.column("visit"))
            try:
                codes, ids, times, states = _engine.compact(
                    place_codes,
                    places,
                    visit_codes,
                    visits,
                    _us(table.column("time")),
                    table.column("feature").to_numpy(),
                    table.column("state").cast(pa.int8()).to_numpy(),
                )
            except Error as error:
                raise _named(error) from None
            names = [places[code] for code in codes]
            salts = [_part_of(id, parts.get(name, 1)) for name, id in zip(names, ids)]
            arrays = [
                pa.array(names, pa.string()),
                pa.array(ids, pa.binary()),
                pa.array(times, pa.int64()),
                pa.array(states, pa.binary()),
                pa.array(salts, pa.int32()),
            ]
            yield pa.RecordBatch.from_arrays(arrays, ["place", "visit", "time_us", "states", "salt"])

    return frame.mapInArrow(compact, _VISITS)


def _parts_of(frame: DataFrame, salts: int | None) -> dict[str, int]:
    """The parts in which the places with the most visits are summed."""
    if salts is not None:
        if salts < 1:
            raise ConfigError(f"{salts} parts are none", place="salts", help="give 1 or more")
        if salts == 1:
            return {}
        places = frame.select("place").distinct().collect()
        return {row.place: salts for row in places}
    counted = frame.groupBy("place").agg(sql.approx_count_distinct("visit").alias("num"))
    large = counted.where(counted.num > _VISITS_A_PART).collect()
    return {row.place: -(-row.num // _VISITS_A_PART) for row in large}


def _models(place: str, features: Any, sums: Sequence[bytes], order: int) -> pa.Table:
    try:
        merged = _engine.merge_sums(place, features, sums, order)
    except Error as error:
        raise _named(error) from None
    numbers, num_observed, num_seen, mean, sums, models, rhythms = merged
    doubles = pa.list_(pa.float64())
    columns = {
        "place": pa.array([place] * len(numbers), pa.string()),
        "feature": pa.array(numbers, pa.int32()),
        "num_observed": pa.array(num_observed, pa.int32()),
        "num_seen": pa.array(num_seen, pa.int32()),
        "mean": pa.array(mean, pa.float64()),
        "period_s": pa.array(rhythms[0], doubles),
        "amplitude": pa.array(rhythms[1], doubles),
        "phase_rad": pa.array(rhythms[2], doubles),
        "sums": pa.array(sums, pa.binary()),
        "model": pa.array(models, pa.binary()),
    }
    return pa.table(columns)


def _candidates(periods: str | tuple[float, int] | Sequence[float]) -> str:
    """As ``chronotope.series.Fremen`` has them."""
    if isinstance(periods, str):
        if periods != "calendar":
            raise ConfigError(
                f"there are no periods {periods!r}",
                place="periods",
                help='"calendar", (base_s, count), or a list of seconds',
            )
        return _engine.calendar()
    if isinstance(periods, tuple):
        base_s, count = periods
        return json.dumps({"base-s": float(base_s), "count": int(count)})
    return json.dumps({"periods-s": [float(it) for it in periods]})


def learn_series(
    observations: DataFrame,
    *,
    periods: str | tuple[float, int] | Sequence[float] = "calendar",
    order: int = 2,
    salts: int | None = None,
) -> DataFrame:
    """A model for each feature of each place: the mean and at most ``order`` rhythms of ``periods``, and the sums
    that they follow from, so that others can be merged into them (``merge_models``).

    ``periods`` is ``"calendar"``, ``(base_s, count)`` or a list of seconds, as for ``chronotope.Fremen``. Each visit
    is counted once. Places with very many visits are summed in parts, so that no worker waits for one of
    them; ``salts`` says in how many, for all places (None: counted first, by two columns of the table).

    Errors: ``FormatError`` if the table is not one of observations. While it runs, as Spark's exception with the
    same text: nulls, identities that have not 16 bytes, rows that contradict each other, and more than
    8,388,607 observations of one feature.
    """
    frame = _check_columns(observations, OBSERVATIONS, "observations")
    candidates = _candidates(periods)
    if order < 0:
        raise ConfigError(f"{order} rhythms are none", place="order", help="give 0 or more")
    parts = _parts_of(frame, salts)
    visits = _visits_of(frame, parts)

    def sums_of(place: str, table: pa.Table) -> tuple[Any, list[bytes]]:
        try:
            return _engine.sum_visits(
                place,
                table.column("visit").to_pylist(),
                _us(table.column("time_us")),
                table.column("states").to_pylist(),
                candidates,
            )
        except Error as error:
            raise _named(error) from None

    if not parts:

        def learn(key: tuple[pa.Scalar, ...], table: pa.Table) -> pa.Table:
            place = key[0].as_py()
            features, sums = sums_of(place, table)
            return _models(place, features.astype(np.int32), sums, order)

        return visits.groupBy("place").applyInArrow(learn, MODELS)

    def sum_part(key: tuple[pa.Scalar, ...], table: pa.Table) -> pa.Table:
        place = key[0].as_py()
        features, sums = sums_of(place, table)
        columns = {
            "place": pa.array([place] * len(features), pa.string()),
            "block": pa.array(features // _FEATURES_A_BLOCK, pa.int32()),
            "feature": pa.array(features, pa.int32()),
            "sums": pa.array(sums, pa.binary()),
        }
        return pa.table(columns)

    partial = visits.groupBy("place", "salt").applyInArrow(
        sum_part, "place string, block int, feature int, sums binary"
    )
    return partial.groupBy("place", "block").applyInArrow(_merging(order), MODELS)


def _merging(order: int) -> Callable[[tuple[pa.Scalar, ...], pa.Table], pa.Table]:
    def merge(key: tuple[pa.Scalar, ...], table: pa.Table) -> pa.Table:
        _refuse_nulls(table)
        features = table.column("feature").to_numpy()
        return _models(key[0].as_py(), features, table.column("sums").to_pylist(), order)

    return merge


def merge_models(*models: DataFrame, order: int = 2) -> DataFrame:
    """The models of all observations that several tables of models were learnt from.

    The models have at most ``order`` rhythms, of the periods that all tables were learnt with. Exact, and only
    right for tables that share no visit, such as those of different days: sums do not know what is in them.
    Where visits may come late or twice, learn from the observations again.
    """
    if not models:
        raise ConfigError("no models are named", help="give one table or more")
    expected = {"place": "string", "feature": "int", "sums": "binary"}
    tables = [_check_columns(it, expected, "models") for it in models]
    union = tables[0]
    for table in tables[1:]:
        union = union.union(table)
    block = sql.floor(union.feature / _FEATURES_A_BLOCK).cast("int").alias("block")
    return union.select("*", block).groupBy("place", "block").applyInArrow(_merging(order), MODELS)


def predict(models: DataFrame, times: Any) -> DataFrame:
    """``place``, ``feature``, ``time`` and the probability ``p`` that the state is 1 then, for every model and time.

    ``times`` are what ``chronotope`` takes everywhere: aware datetimes, text with an offset, seconds.
    """
    expected = {"place": "string", "feature": "int", "model": "binary"}
    frame = _check_columns(models, expected, "models")
    times_us = us_array(times)
    num_times = len(times_us)

    def predict_batches(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        when = pa.array(times_us, pa.int64()).cast(pa.timestamp("us", tz="UTC"))
        for batch in batches:
            _refuse_nulls(pa.Table.from_batches([batch]))
            try:
                p = _engine.predict_models(batch.column("model").to_pylist(), times_us)
            except Error as error:
                raise _named(error) from None
            rows = pa.array(np.repeat(np.arange(batch.num_rows), num_times))
            arrays = [
                batch.column("place").take(rows),
                batch.column("feature").take(rows),
                when.take(pa.array(np.tile(np.arange(num_times), batch.num_rows))),
                pa.array(p, pa.float64()),
            ]
            yield pa.RecordBatch.from_arrays(arrays, ["place", "feature", "time", "p"])

    return frame.mapInArrow(predict_batches, "place string, feature int, time timestamp, p double")


def evaluate(models: DataFrame, observations: DataFrame) -> DataFrame:
    """How well models predict observations that they were not learnt from, place by place: ``num_observations``,
    ``brier`` (mean squared error), ``log_loss`` (mean of -ln p of what was observed, p at least 1e-6), and
    ``num_without_model``. Each visit counts once; the sums are the same for any partitions.
    """
    expected = {"place": "string", "feature": "int", "model": "binary"}
    known = _check_columns(models, expected, "models")
    frame = _check_columns(observations, OBSERVATIONS, "observations")
    visits = _visits_of(frame, {})

    def judge(key: tuple[pa.Scalar, ...], visits: pa.Table, models: pa.Table) -> pa.Table:
        place = key[0].as_py()
        _refuse_nulls(models)
        try:
            num, squares, nats, num_without = _engine.evaluate_visits(
                place,
                visits.column("visit").to_pylist(),
                _us(visits.column("time_us")),
                visits.column("states").to_pylist(),
                models.column("feature").to_numpy(),
                models.column("model").to_pylist(),
            )
        except Error as error:
            raise _named(error) from None
        is_observed = num + num_without > 0
        # A place without any model has no mean.
        brier, log_loss = (total / num if num else None for total in (squares, nats))
        columns = {
            "place": pa.array([place], pa.string()),
            "num_observations": pa.array([num], pa.int64()),
            "brier": pa.array([brier], pa.float64()),
            "log_loss": pa.array([log_loss], pa.float64()),
            "num_without_model": pa.array([num_without], pa.int64()),
        }
        return pa.table(columns).slice(0, int(is_observed))

    grouped = visits.groupBy("place").cogroup(known.groupBy("place"))
    schema = (
        "place string, num_observations bigint, brier double, log_loss double, num_without_model bigint"
    )
    return grouped.applyInArrow(judge, schema)


# ---- maps of places


def extract(images: DataFrame, *, n: int = 600) -> DataFrame:
    """The ``n`` strongest features of each image, where the image lies: 48 bytes each instead of pixels.

    ``images`` has ``robot``, ``place``, ``session``, ``time`` and ``image``, the bytes of a file in one of the six
    formats that ``chronotope`` reads. The images cannot be made of the result again.
    """
    frame = _check_columns(images, IMAGES, "images")

    def extract_batches(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "image")
            for batch in batches:
                _refuse_nulls(pa.Table.from_batches([batch]))
                columns: list[list[Any]] = [[], [], [], []]
                for row in range(batch.num_rows):
                    with open(file, "wb") as out:
                        out.write(batch.column("image")[row].as_py())
                    try:
                        features = _engine.extract(file, n=n)
                    except Error as error:
                        error.path = None
                        shown = f"place `{batch.column('place')[row].as_py()}`, column `image`, row {row}"
                        raise _named(error, shown) from None
                    keypoints, descriptors, size = features.__reduce__()[1]
                    width, height = size
                    for column, value in zip(columns, (keypoints, descriptors, width, height)):
                        column.append(value)
                arrays = [batch.column(name) for name in ("robot", "place", "session", "time")]
                arrays += [pa.array(it, pa.binary()) for it in columns[:2]]
                arrays += [pa.array(it, pa.int32()) for it in columns[2:]]
                names = "robot place session time keypoints descriptors width height".split()
                yield pa.RecordBatch.from_arrays(arrays, names)

    return frame.mapInArrow(extract_batches, _FEATURES)


def learn_maps(
    features: DataFrame, *, config: Mapping[str, Any] | None = None, preset: str = "default"
) -> DataFrame:
    """A part of a map for each place of each robot: ``robot``, ``place``, ``num_visits``, ``num_known`` (images that were
    there already, or of the same stay) and ``map``, the bytes of a map file.

    ``features`` is what ``extract`` gives, or a table of images, which are extracted first. The visits of a place are
    learnt in order of time, as one robot learns them, and none is held back: a guard needs a map of other
    places, and who has labelled the images vouches for them. ``config`` replaces keys of the table
    ``[learn]``. All visits of one place of one robot must fit into a worker's memory.
    """
    names = features.columns
    if "image" in names:
        features = extract(features)
    expected = {
        **{name: IMAGES[name] for name in ("robot", "place", "session", "time")},
        "keypoints": "binary",
        "descriptors": "binary",
        "width": "int",
        "height": "int",
    }
    frame = _check_columns(features, expected, "features of images")
    settings = {"guard": {"judge": "never"}, **(config or {})}

    def learn(key: tuple[pa.Scalar, ...], table: pa.Table) -> pa.Table:
        robot, place = (it.as_py() for it in key)
        _refuse_nulls(table)
        rows = table.select(["time", "session", "keypoints", "descriptors", "width", "height"])
        rows = rows.set_column(0, "time", rows.column("time").cast(pa.int64())).to_pylist()
        rows.sort(key=lambda row: (row["time"], row["session"], row["descriptors"]))
        try:
            content, num_visits, num_known = _learn_place(robot, place, rows, settings, preset)
        except Error as error:
            raise _named(error, f"robot `{robot}`, place `{place}`") from None
        columns = {
            "robot": pa.array([robot], pa.string()),
            "place": pa.array([place], pa.string()),
            "num_visits": pa.array([num_visits], pa.int32()),
            "num_known": pa.array([num_known], pa.int32()),
            "map": pa.array([content], pa.binary()),
        }
        return pa.table(columns)

    return frame.groupBy("robot", "place").applyInArrow(learn, _SHARDS)


def _learn_place(
    robot: str, place: str, rows: Sequence[dict[str, Any]], config: Mapping[str, Any], preset: str
) -> tuple[bytes, int, int]:
    from ._errors import AlreadyExistsError
    from ._images import features_of_bytes
    from ._times import moment

    num_known = 0
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "part.map")
        # Its robot gives the map its UUID, so that the parts of a robot's map know each other.
        _engine.Map.create(path, preset=preset, name=robot).close()
        session, learner = None, None
        for row in rows:
            if learner is None or row["session"] != session:
                if learner is not None:
                    learner.close()
                session = row["session"]
                learner = _engine.Learner(path, session=session, config=dict(config))
            size = (row["width"], row["height"])
            features = features_of_bytes(row["keypoints"], row["descriptors"], size)
            try:
                learnt = learner.observe(place, features, moment(row["time"]))
                num_known += bool(learnt["is_same_visit"])
            except AlreadyExistsError:
                num_known += 1
        if learner is not None:
            learner.close()
        with _engine.Map.open(path, read_only=True) as learnt_map:
            num_visits = sum(len(it.visit_ids) for it in learnt_map.places)
        with open(path, "rb") as file:
            return file.read(), num_visits, num_known


def join_shards(shards: DataFrame, path: PathLike) -> Map:
    """The map file that the parts in a table of ``learn_maps`` make, written at ``path``: first of each robot's parts
    its map, then their union by the identity of visits.

    For a map of a region, give the shards of its places: ``shards.where(shards.place.isin(places))``. A robot
    takes over a newer one by ``Map.merge([its_own, newer], path)`` and loses nothing of its own.

    Errors: ``AlreadyExistsError`` if ``path`` exists, ``ConfigError`` for maps of other extractors or image sizes.
    """
    frame = _check_columns(shards, {"robot": "string", "map": "binary"}, "map shards")
    with tempfile.TemporaryDirectory() as folder:
        parts: list[str] = []
        # Robot by robot, because the parts of one map are joined before maps are merged.
        robot, robots = None, []
        for row in frame.orderBy("robot").toLocalIterator():
            if row.robot != robot:
                robot = row.robot
                parts = []
                robots.append(parts)
            part = os.path.join(folder, f"{len(robots)}-{len(parts)}.map")
            with open(part, "wb") as file:
                file.write(row.map)
            parts.append(part)
        if not robots:
            raise ConfigError("there are no shards", help="give a table of learn_maps with rows")
        maps = []
        for number, parts in enumerate(robots):
            maps.append(os.path.join(folder, f"robot-{number}.map"))
            _engine.join_maps(parts, maps[-1])
        level = 0
        while len(maps) > _MAPS_AT_ONCE:
            fewer = []
            for start in range(0, len(maps), _MAPS_AT_ONCE):
                fewer.append(os.path.join(folder, f"level-{level}-{start}.map"))
                _engine.join_maps(maps[start : start + _MAPS_AT_ONCE], fewer[-1])
            maps, level = fewer, level + 1
        _engine.join_maps(maps, path)
    return _engine.Map.open(path)
