"""Which moment does an object mean, and which are refused?"""

from __future__ import annotations

import datetime
import zoneinfo
from typing import Any

import numpy as np
import pytest

import chronotope
from chronotope._times import moment, us, us_array

UTC = datetime.timezone.utc
EXPECTED = 1_714_552_200_000_000  # 2024-05-01T08:30:00Z


@pytest.mark.parametrize(
    "time",
    [
        datetime.datetime(2024, 5, 1, 8, 30, tzinfo=UTC),
        datetime.datetime(2024, 5, 1, 10, 30, tzinfo=zoneinfo.ZoneInfo("Europe/Prague")),
        np.datetime64("2024-05-01T08:30:00"),
        np.datetime64("2024-05-01T08:30:00.000000000"),
        np.array(np.datetime64("2024-05-01T08:30:00")),
        "2024-05-01T08:30:00Z",
        "2024-05-01T10:30:00+02:00",
        "1714552200s",
        "1714552200000ms",
        1_714_552_200,
        1_714_552_200.0,
        np.int64(1_714_552_200),
        np.float64(1_714_552_200.0),
    ],
    ids=repr,
)
def test_the_same_moment_in_many_forms(time: Any) -> None:
    assert us(time) == EXPECTED


def test_pandas_and_polars_timestamps_are_moments() -> None:
    pandas = pytest.importorskip("pandas")
    assert us(pandas.Timestamp("2024-05-01T08:30:00Z")) == EXPECTED
    with pytest.raises(chronotope.TimeError):
        us(pandas.Timestamp("2024-05-01T08:30:00"))
    with pytest.raises(chronotope.TimeError, match="NaT"):
        us(pandas.NaT)


@pytest.mark.parametrize(
    ("time", "words"),
    [
        (datetime.datetime(2024, 5, 1, 8, 30), "replace(tzinfo"),
        ("2024-05-01T08:30:00", "offset"),
        ("2024-05-01 08:30", "offset"),
        ("2024-05-01", "offset"),
        ("yesterday", "RFC 3339"),
        ("", "RFC 3339"),
        (np.datetime64("NaT"), "NaT"),
        (float("nan"), "nan"),
        (float("inf"), "inf"),
        (1e300, "seconds"),
        (1_714_552_200_000_000_000, "nanoseconds"),
    ],
    ids=repr,
)
def test_what_is_a_guess_is_refused_with_the_remedy(time: Any, words: str) -> None:
    with pytest.raises(chronotope.TimeError) as raised:
        us(time)
    assert raised.value.kind == "time" and words in str(raised.value)


@pytest.mark.parametrize("time", [None, True, np.True_, [], {}, datetime.date(2024, 5, 1), 3j])
def test_what_is_no_time_is_a_type_error(time: Any) -> None:
    with pytest.raises(TypeError):
        us(time)


def test_microseconds_survive_both_ways() -> None:
    for microseconds in (0, 1, -1, EXPECTED + 123_456, -(10**15)):
        there = moment(microseconds)
        assert there.tzinfo is not None and us(there) == microseconds
    with pytest.raises(chronotope.TimeError):
        moment(2**62)


def test_many_times_in_many_forms() -> None:
    texts = ["2024-05-01T08:30:00Z", "2024-05-01T08:31:00Z"]
    expected = [EXPECTED, EXPECTED + 60_000_000]
    aware = [datetime.datetime.fromisoformat(text.replace("Z", "+00:00")) for text in texts]
    stamps = np.array(texts, dtype="datetime64[s]") if False else np.array(
        ["2024-05-01T08:30:00", "2024-05-01T08:31:00"], "datetime64[ns]"
    )
    seconds = np.array([1_714_552_200, 1_714_552_260])
    for times in (texts, np.array(texts), aware, stamps, seconds, seconds.astype(float), list(seconds)):
        assert us_array(times).tolist() == expected
    assert us_array(seconds[:, None]).tolist() == expected
    assert us_array([]).tolist() == []


def test_columns_of_pandas_need_a_zone() -> None:
    pandas = pytest.importorskip("pandas")
    naive = pandas.Series(pandas.to_datetime(["2024-05-01T08:30:00"]))
    with pytest.raises(chronotope.TimeError, match="tz_localize"):
        us_array(naive)
    with pytest.raises(chronotope.TimeError, match="tz_localize"):
        us_array(pandas.DatetimeIndex(naive))
    prague = naive.dt.tz_localize("UTC").dt.tz_convert("Europe/Prague")
    assert us_array(prague).tolist() == [EXPECTED]
    assert us_array(pandas.DatetimeIndex(prague)).tolist() == [EXPECTED]
    assert us_array(pandas.Series(["2024-05-01T08:30:00Z"])).tolist() == [EXPECTED]
    with pytest.raises(chronotope.TimeError, match="NaT"):
        us_array(pandas.Series(pandas.to_datetime(["2024-05-01T08:30:00Z", None])))


def test_columns_of_polars_need_a_zone() -> None:
    polars = pytest.importorskip("polars")
    naive = polars.Series([datetime.datetime(2024, 5, 1, 8, 30)])
    with pytest.raises(chronotope.TimeError, match="replace_time_zone"):
        us_array(naive)
    assert us_array(naive.dt.replace_time_zone("UTC")).tolist() == [EXPECTED]
    prague = naive.dt.replace_time_zone("UTC").dt.convert_time_zone("Europe/Prague")
    assert us_array(prague).tolist() == [EXPECTED]


@pytest.mark.parametrize(
    ("times", "row"),
    [
        (["2024-05-01T08:30:00Z", "2024-05-01T08:30:00"], "row 1"),
        ([0.0, float("nan")], "row 1"),
        (np.array(["2024-05-01", "NaT"], "datetime64[s]"), "row 1"),
        ([datetime.datetime(2024, 5, 1, tzinfo=UTC), datetime.datetime(2024, 5, 1)], "row 1"),
    ],
)
def test_the_row_of_a_bad_time_is_named(times: Any, row: str) -> None:
    with pytest.raises(chronotope.TimeError) as raised:
        us_array(times)
    assert raised.value.place == row


@pytest.mark.parametrize("times", ["2024-05-01T08:30:00Z", b"x", np.zeros((2, 2)), [True, False]])
def test_what_is_no_column_of_times_is_refused(times: Any) -> None:
    with pytest.raises((TypeError, chronotope.TimeError)):
        us_array(times)
