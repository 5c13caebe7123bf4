"""Do the models of one series learn, predict, merge and keep?"""

from __future__ import annotations

import copy
import datetime
import pathlib
import pickle
from typing import Any

import numpy as np
import pytest

import chronotope
from chronotope import series
from chronotope.series import (
    Fremen,
    Histogram,
    Logistic,
    Markov,
    Mean,
    PeriodicMixture,
    Persistence,
)

HOURS = np.arange(28 * 24)
TIMES = HOURS * 3600
OPEN = (HOURS % 24 >= 6) & (HOURS % 24 < 18)
NOON, MIDNIGHT = 100 * 86_400 + 12 * 3600, 100 * 86_400
WEEK = (604_800.0, 168)

MODELS = [
    Fremen(),
    Fremen(periods="calendar", order=2),
    Fremen(periods=(86_400.0, 12), order=1),
    Fremen(periods=[86_400.0, 43_200.0], order=1),
    Fremen(periods=WEEK),
    Logistic(),
    Histogram(),
    PeriodicMixture(),
    Markov(),
    Mean(),
    Persistence(),
    Persistence(of=Histogram(num_bins=12)),
]
each_model = pytest.mark.parametrize("model", MODELS, ids=repr)
RHYTHMIC = [model for model in MODELS if not isinstance(model, (Markov, Mean, PeriodicMixture))]


def fitted(model: Any) -> Any:
    return type(model)(**model.get_params(deep=False)).fit(TIMES, OPEN)


@each_model
def test_probabilities_are_probabilities(model: Any) -> None:
    model = fitted(model)
    times = np.linspace(-1e9, 3e9, 1000)
    proba = model.predict_proba(times)
    assert proba.shape == (1000, 2) and proba.dtype == np.float64
    assert ((proba >= 0) & (proba <= 1)).all() and np.allclose(proba.sum(axis=1), 1)
    assert (model.p(times) == proba[:, 1]).all()
    assert (model.predict(times) == (proba[:, 1] >= 0.5)).all()
    estimate = model.estimate(times)
    assert estimate.shape == (1000, 3) and (estimate[:, 0] == proba[:, 1]).all()
    assert (estimate[:, 1] <= estimate[:, 0]).all() and (estimate[:, 0] <= estimate[:, 2]).all()


@pytest.mark.parametrize("model", RHYTHMIC, ids=repr)
def test_a_day_is_learnt(model: Any) -> None:
    p = fitted(model).p([NOON, MIDNIGHT])
    assert p[0] > 0.7 and p[1] < 0.3


def test_a_short_event_of_every_day_is_learnt() -> None:
    model = PeriodicMixture().fit(TIMES, HOURS % 24 == 12)
    p = model.p([NOON, MIDNIGHT])
    assert p[0] > 0.4 and p[1] < 0.1


def test_rhythms_can_be_looked_at() -> None:
    model = fitted(Fremen())
    assert model.components_.shape[1] == 3 and model.components_[0, 0] == 86_400
    assert model.order_ >= 1 and model.mean_ == pytest.approx(0.5, abs=0.01)
    lines = model.periodogram()
    assert lines.shape == (168, 3)
    assert lines[np.argmax(lines[:, 1]), 0] == 86_400
    assert fitted(Mean()).components_.shape == (0, 3)
    assert model.periodogram([86_400.0]).shape == (1, 3)


@each_model
def test_pickle_gives_the_same_bytes_and_bits(model: Any) -> None:
    model = fitted(model)
    data = pickle.dumps(model)
    again = pickle.loads(data)
    assert pickle.dumps(again) == data
    assert (again.estimate(TIMES) == model.estimate(TIMES)).all()
    assert (copy.deepcopy(model).p(TIMES) == model.p(TIMES)).all()
    assert pickle.loads(pickle.dumps(type(model)())).get_params() == type(model)().get_params()


@each_model
def test_learning_in_parts_is_learning_at_once(model: Any) -> None:
    whole = fitted(model)
    parts = type(model)(**model.get_params(deep=False))
    order = np.random.default_rng(1).permutation(len(TIMES))
    for rows in np.array_split(order, 3):
        parts.partial_fit(TIMES[rows], OPEN[rows])
    assert (parts.p(TIMES) == whole.p(TIMES)).all()


@each_model
def test_merging_is_a_union(model: Any) -> None:
    make = lambda rows: type(model)(**model.get_params(deep=False)).fit(TIMES[rows], OPEN[rows])
    early, middle, late = make(slice(0, 400)), make(slice(200, 500)), make(slice(400, None))
    whole = fitted(model)
    for merged in (
        early.merge(middle).merge(late),
        late.merge(early.merge(middle)),
        middle.merge(late).merge(early).merge(early),
    ):
        assert (merged.p(TIMES) == whole.p(TIMES)).all()
    assert (early.merge(early).p(TIMES) == early.p(TIMES)).all()


def test_models_that_differ_are_not_merged() -> None:
    for other in (fitted(Mean()), fitted(Fremen(periods=WEEK, order=1))):
        with pytest.raises(chronotope.ConfigError, match="same model"):
            fitted(Fremen()).merge(other)


def test_what_nobody_would_expect_is_found() -> None:
    states = OPEN.copy()
    states[[100, 400]] ^= True
    model = Fremen().fit(TIMES, OPEN)
    assert model.anomalies(TIMES, states, 0.9).tolist() == [100, 400]
    for confidence in (0.4, 1.1, float("nan")):
        with pytest.raises(chronotope.ConfigError, match="confidence"):
            model.anomalies(TIMES, states, confidence)
    missing = states.astype(float)
    missing[100] = np.nan
    assert model.anomalies(TIMES, missing, 0.9).tolist() == [400]


def test_scores_are_what_they_say() -> None:
    model = fitted(Fremen())
    p = model.p(TIMES)
    assert model.brier(TIMES, OPEN) == pytest.approx(np.mean((p - OPEN) ** 2))
    assert model.score(TIMES, OPEN) == np.mean((p >= 0.5) == OPEN)
    assert np.isnan(model.score([0], [None])) and np.isnan(model.brier([0], [None]))


def test_states_of_any_kind_are_the_same_series() -> None:
    expected = fitted(Fremen()).p(TIMES)
    pandas = pytest.importorskip("pandas")
    polars = pytest.importorskip("polars")
    for states in (
        OPEN.astype(int),
        OPEN.astype(float),
        OPEN.tolist(),
        OPEN[:, None],
        pandas.Series(OPEN),
        pandas.Series(OPEN, dtype="boolean"),
        pandas.Series(OPEN.astype(int), dtype="Int8"),
        polars.Series(OPEN),
        polars.Series(OPEN.astype(int)),
    ):
        assert (Fremen().fit(TIMES, states).p(TIMES) == expected).all()


def test_times_of_any_kind_are_the_same_series() -> None:
    expected = fitted(Fremen()).p(TIMES)
    pandas = pytest.importorskip("pandas")
    polars = pytest.importorskip("polars")
    stamps = TIMES.astype("datetime64[s]")
    aware = [datetime.datetime.fromtimestamp(int(it), datetime.timezone.utc) for it in TIMES]
    for times in (
        TIMES.astype(float),
        TIMES[:, None],
        stamps,
        aware,
        [time.isoformat() for time in aware],
        pandas.Series(stamps).dt.tz_localize("UTC"),
        pandas.date_range("1970-01-01", periods=len(TIMES), freq="h", tz="UTC"),
        polars.Series(aware),
    ):
        assert (Fremen().fit(times, OPEN).p(TIMES) == expected).all()


@pytest.mark.parametrize("missing", [None, float("nan"), "NA"])
def test_missing_states_are_left_out(missing: Any) -> None:
    if missing == "NA":
        missing = pytest.importorskip("pandas").NA
    states: list[Any] = OPEN.tolist()
    for row in range(0, len(states), 7):
        states[row] = missing
    known = np.arange(len(TIMES)) % 7 != 0
    expected = Fremen().fit(TIMES[known], OPEN[known]).p(TIMES)
    assert (Fremen().fit(TIMES, states).p(TIMES) == expected).all()


@pytest.mark.parametrize(
    ("times", "states", "kind", "place"),
    [
        ([0, 1], [0, 2], chronotope.ConfigError, "row 1"),
        ([0, 1], [0.0, 0.5], chronotope.ConfigError, "row 1"),
        ([0, 1], [-1, 0], chronotope.ConfigError, "row 0"),
        ([0, 1], ["open", "shut"], chronotope.ConfigError, "row 0"),
        ([0, 1], [object(), True], chronotope.ConfigError, "row 0"),
        ([0, 1, 2], [True, False], chronotope.ShapeError, None),
        ([0], [[True, False]], chronotope.ShapeError, "states"),
        ([0, float("nan")], [True, False], chronotope.TimeError, "row 1"),
        (["2024-05-01T08:30:00"], [True], chronotope.TimeError, "row 0"),
        ([datetime.datetime(2024, 5, 1)], [True], chronotope.TimeError, "row 0"),
        (np.zeros((2, 2)), [True, False], chronotope.TimeError, None),
        ([0, 1], None, chronotope.ConfigError, None),
    ],
)
def test_what_is_no_series_is_refused(
    times: Any, states: Any, kind: type[chronotope.Error], place: str | None
) -> None:
    with pytest.raises(kind) as raised:
        Fremen().fit(times, states)
    assert raised.value.place == place


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (Fremen(order=2), "order"),
        (Fremen(periods="moon"), "calendar"),
        (Fremen(periods=(604_800.0, 0)), "candidate"),
        (Fremen(periods=(-1.0, 3)), "period"),
        (Fremen(periods=[]), "candidate"),
        (Fremen(periods=[float("nan")]), "NaN"),
        (Fremen(periods=WEEK, order=-1), "order"),
        (Histogram(num_bins=0), "num-bins"),
        (Histogram(prior=-1.0), "prior"),
        (Histogram(period_s=0.0), "period"),
        (PeriodicMixture(order=0), "order"),
        (Logistic(harmonics=[0]), "harmonics"),
        (Logistic(harmonics=[1, 1]), "harmonics"),
    ],
    ids=repr,
)
def test_parameters_out_of_range_are_named(model: Any, words: str) -> None:
    with pytest.raises(chronotope.Error) as raised:
        model.fit(TIMES, OPEN)
    assert words in str(raised.value)


@each_model
def test_few_samples_are_no_failure(model: Any) -> None:
    make = lambda: type(model)(**model.get_params(deep=False))
    assert make().fit([], []).p([0.0]).tolist() == [0.5]
    one = make().fit([0], [True]).p([0.0, 1e9])
    assert ((one >= 0) & (one <= 1)).all()
    assert np.isfinite(make().fit([0, 0], [True, False]).p([0.0])).all()


def test_what_was_not_fitted_says_so() -> None:
    for call in (
        lambda: Fremen().p([0]),
        lambda: Fremen().predict([0]),
        lambda: Fremen().components_,
        lambda: Fremen().periodogram(),
        lambda: Fremen().merge(fitted(Fremen())),
    ):
        with pytest.raises(chronotope.ConfigError, match="fit"):
            call()


def test_parameters_are_got_and_set() -> None:
    model = Persistence(of=Histogram(num_bins=12))
    assert model.get_params()["of__num_bins"] == 12
    model.set_params(of__num_bins=6)
    assert isinstance(model.of, Histogram) and model.of.num_bins == 6
    assert repr(model) == "Persistence(of=Histogram(num_bins=6))" and repr(Fremen()) == "Fremen()"
    with pytest.raises(chronotope.ConfigError, match="no parameter"):
        model.set_params(bins=3)


def test_a_csv_file_is_a_series(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "door.csv"
    path.write_text("time,state\n2024-05-01T08:30:00Z,1\n2024-05-01T08:31:00Z,\n2024-05-01T08:32:00Z,0\n")
    times, states = series.read_csv(path)
    assert times.astype("datetime64[s]").astype(str).tolist() == [
        "2024-05-01T08:30:00",
        "2024-05-01T08:31:00",
        "2024-05-01T08:32:00",
    ]
    assert states[0] == 1 and np.isnan(states[1]) and states[2] == 0
    path.write_text("time,state\nyesterday,1\n")
    with pytest.raises(chronotope.Error) as raised:
        series.read_csv(path)
    assert "2" in (raised.value.place or "") and raised.value.path == str(path)
    with pytest.raises(FileNotFoundError):
        series.read_csv(tmp_path / "none.csv")


def test_a_packed_file_is_unpacked(tmp_path: pathlib.Path) -> None:
    import gzip

    path = tmp_path / "door.csv.gz"
    path.write_bytes(gzip.compress(b"time,state\n0,1\n60,0\n"))
    times, states = series.read_csv(path)
    assert states.tolist() == [1, 0] and len(times) == 2
    path.write_bytes(b"no gzip")
    with pytest.raises(chronotope.FormatError) as raised:
        series.read_csv(path)
    assert raised.value.path == str(path)
    with pytest.raises(chronotope.NotFoundError):
        series.read_csv(tmp_path / "none.csv.gz")


@pytest.mark.parametrize("data", [b"", b"nonsense", b"\0" * 64])
def test_bytes_that_are_no_model_are_refused(data: bytes) -> None:
    from chronotope._chronotope import SeriesModel

    with pytest.raises(chronotope.FormatError):
        SeriesModel.decode(data)


def test_damaged_bytes_of_a_model_are_refused() -> None:
    from chronotope._chronotope import SeriesModel

    data = bytearray(fitted(Fremen()).__getstate__()["model"])
    data[len(data) // 2] ^= 1
    with pytest.raises(chronotope.FormatError):
        SeriesModel.decode(bytes(data))
