"""Which moment does an object mean, in microseconds since 1970 in UTC?

A time without an offset is refused: it would be a guess by hours. numpy's ``datetime64`` has no zone at
all and is UTC by its own documentation; naive datetimes, and naive columns of pandas and polars, are
not.
"""

from __future__ import annotations

import datetime
import math
import numbers
from typing import Any

import numpy as np
import numpy.typing as npt

from ._chronotope import parse_time, parse_times
from ._errors import TimeError

_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
_US = datetime.timedelta(microseconds=1)
_MOST_US = 2**63 - 1

Stamps = npt.NDArray[np.int64]


def _error(message: str, help: str, place: str | None = None) -> TimeError:
    return TimeError(message, "time", None, place, help)


def us(time: Any) -> int:
    """Microseconds since 1970 of one moment.

    Errors: ``TimeError`` for a naive datetime, NaT, NaN, text without an offset and what is out of
    range; ``TypeError`` for what is no time at all.
    """
    if isinstance(time, datetime.datetime):
        if type(time).__name__ == "NaTType":
            raise _error("NaT is no time", "leave out the rows without a time")
        offset = time.utcoffset()
        if offset is None:
            raise _error(
                f"{time.isoformat()} has no offset from UTC",
                'give it a zone: time.replace(tzinfo=zoneinfo.ZoneInfo("Europe/Prague")) if it is civil '
                "time there, time.replace(tzinfo=datetime.timezone.utc) if it is UTC",
            )
        return (time - _EPOCH) // _US
    if isinstance(time, np.datetime64):
        return int(_of_datetime64(np.asarray([time]))[0])
    if isinstance(time, str):
        return parse_time(time)
    if isinstance(time, (bool, np.bool_)):
        raise TypeError("True and False are no times")
    if isinstance(time, numbers.Integral):
        return _in_range(int(time) * 1_000_000)
    if isinstance(time, numbers.Real):
        seconds = float(time)
        if not math.isfinite(seconds):
            raise _error(f"{seconds} is no time", "leave out the rows without a time")
        return _in_range(round(seconds * 1e6))
    if type(time).__name__ == "NaTType":
        raise _error("NaT is no time", "leave out the rows without a time")
    if isinstance(time, np.ndarray) and time.ndim == 0:
        return us(time[()])
    raise TypeError(
        f"{type(time).__name__} is no time: give an aware datetime, a datetime64, text with an offset "
        "or seconds since 1970"
    )


def _in_range(microseconds: int) -> int:
    if abs(microseconds) > _MOST_US:
        raise _error(
            f"{microseconds} us is beyond the calendar",
            "a number is seconds since 1970: divide milliseconds by 1e3, nanoseconds by 1e9",
        )
    return microseconds


def moment(microseconds: int) -> datetime.datetime:
    """The moment as an aware datetime in UTC.

    Errors: ``TimeError`` beyond the years 1 to 9999.
    """
    try:
        return _EPOCH + microseconds * _US
    except OverflowError:
        raise _error(
            f"epoch{microseconds:+} us is beyond the years that datetime has", "is the clock right?"
        ) from None


def us_array(times: Any) -> Stamps:
    """Microseconds since 1970 of many moments, int64 (n,).

    ``times`` is an array, a list, a column of pandas or polars, or an index of pandas: of datetime64,
    of aware datetimes, of texts in RFC 3339, or of seconds. A column (n, 1) counts as (n,).

    Errors: ``TimeError`` with the row, ``ShapeError`` of other shapes through ``TypeError``.
    """
    column = _of_frame(times)
    array = np.asarray(column)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1:
        raise _error(
            f"times are one column, not an array of shape {array.shape}",
            "give times of shape (n,) or (n, 1)",
        )
    if array.dtype.kind == "M":
        return _of_datetime64(array)
    if array.dtype.kind in "US":
        return parse_times([str(text) for text in array])
    if array.dtype.kind in "iu":
        return _scaled(array)
    if array.dtype.kind == "f":
        seconds = array.astype(np.float64)
        bad = ~np.isfinite(seconds)
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise _error(
                "NaN and infinity are no times", "leave out the rows without a time", f"row {row}"
            )
        out = np.abs(seconds) > _MOST_US / 1e6
        if out.any():
            _in_range(round(float(seconds[np.flatnonzero(out)[0]]) * 1e6))
        return np.rint(seconds * 1e6).astype(np.int64)
    if array.dtype.kind == "O":
        return np.fromiter((_row(row, it) for row, it in enumerate(array)), np.int64, len(array))
    if array.size == 0:
        return np.empty(0, np.int64)
    if array.dtype.kind == "c":
        raise _error("Complex data not supported: times are real", "give seconds since 1970")
    raise TypeError(f"an array of {array.dtype} holds no times")


def _row(row: int, time: Any) -> int:
    try:
        return us(time)
    except TimeError as error:
        if error.place is None:
            error.place = f"row {row}"
        raise


def _scaled(array: npt.NDArray[Any]) -> Stamps:
    if array.size and max(abs(int(array.min())), abs(int(array.max()))) > _MOST_US // 1_000_000:
        _in_range(int(array.max()) * 1_000_000)
        _in_range(int(array.min()) * 1_000_000)
    return array.astype(np.int64) * 1_000_000


def _of_datetime64(array: npt.NDArray[Any]) -> Stamps:
    missing = np.isnat(array)
    if missing.any():
        row = int(np.flatnonzero(missing)[0])
        raise _error("NaT is no time", "leave out the rows without a time", f"row {row}")
    return array.astype("datetime64[us]").astype(np.int64)


def _of_frame(times: Any) -> Any:
    """The numbers or moments of a column of pandas or polars; anything else as it is."""
    module = type(times).__module__.partition(".")[0]
    if module == "pandas":
        dtype = times.dtype
        if getattr(dtype, "tz", None) is not None:
            utc = times.dt.tz_convert("UTC") if hasattr(times, "dt") else times.tz_convert("UTC")
            naive = utc.dt.tz_localize(None) if hasattr(utc, "dt") else utc.tz_localize(None)
            return naive.to_numpy()
        if getattr(dtype, "kind", "") == "M":
            raise _error(
                "this column of pandas has no zone",
                'times.dt.tz_localize("UTC") if it is UTC, or the zone that it was written in',
            )
        return times.to_numpy()
    if module == "polars":
        dtype = times.dtype
        if type(dtype).__name__ == "Datetime" or str(dtype).startswith("Datetime"):
            if getattr(dtype, "time_zone", None) is None:
                raise _error(
                    "this column of polars has no zone",
                    'times.dt.replace_time_zone("UTC") if it is UTC, or the zone it was written in',
                )
            if times.null_count():
                raise _error("null is no time", "leave out the rows without a time")
            return times.dt.convert_time_zone("UTC").dt.replace_time_zone(None).to_numpy()
        return times.to_numpy()
    if hasattr(times, "toarray"):
        raise TypeError("sparse data are not supported: give times.toarray()")
    if isinstance(times, (str, bytes)):
        raise TypeError("a text is one time and no sequence of times: give [time]")
    return times
