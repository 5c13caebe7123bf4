"""When will a 0/1 state be true? Models of one series, in scikit-learn's manner.

A door, a person in a room, a passable edge: states that are 0 or 1 at known times. ``Fremen`` learns a mean
and a few rhythms; the others stand beside it:

========================  ==========================================  ==================================
model                     p(t)                                        for
========================  ==========================================  ==================================
``Fremen``                mean and rhythms of year, week and day      any sampling; the one to begin with
``Logistic``              rhythms in log odds                         calibrated p from few samples
``Histogram``             the share in the same part of the day       rhythms of any shape, known period
``PeriodicMixture``       a few Gaussians round the day               short events at fixed times
``Persistence``           the last state first, a model later         minutes ahead
``Markov``                relaxes from the last state to the mean     short term
``Mean``                  the share of samples that are 1             the baseline
========================  ==========================================  ==================================

Times are an array, list or column (pandas, polars) of aware datetimes, datetime64 of UTC, texts with an
offset, or seconds since 1970; in any order. States are bool, 0 and 1, or nullable: None, NaN and
``pandas.NA`` are missing samples. A model keeps its samples, which are the truth: ``partial_fit`` adds
some, ``merge`` takes those of another model, and what is fitted follows from all of them, in any order.

Nothing here needs scikit-learn; with it, ``clone``, pipelines and model selection work.

Sources: T. Krajník, J. P. Fentanes, J. M. Santos, T. Duckett: FreMEn, IEEE Transactions on Robotics, 2017;
J. M. Santos, T. Krajník, T. Duckett: Spatio-temporal exploration strategies, RAS, 2017.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, Union

import numpy as np
import numpy.typing as npt

from . import _chronotope as _engine
from ._errors import ConfigError, FormatError, NotFoundError, ShapeError
from ._times import us_array
from ._types import PathLike

if TYPE_CHECKING:
    from ._chronotope import SeriesModel

__all__ = [
    "Fremen",
    "Histogram",
    "Logistic",
    "Markov",
    "Mean",
    "PeriodicMixture",
    "Persistence",
    "Series",
    "read_csv",
]

#: One day and one week, in seconds.
DAY_S = 86_400.0
WEEK_S = 604_800.0

Floats = npt.NDArray[np.float64]
Periods = Union[str, tuple[float, int], Sequence[float]]
_Self = TypeVar("_Self", bound="Series")


class NotFittedError(ConfigError, AttributeError):
    """Nothing was learnt yet: call ``fit``."""


def _not_fitted(name: str) -> NotFittedError:
    """Also scikit-learn's exception of that name, for whoever has it loaded."""
    message, help = f"this {name} was not fitted", "call fit(times, states) first"
    sklearn = sys.modules.get("sklearn.exceptions")
    if sklearn is None:
        return NotFittedError(message, help=help)
    both = type("NotFittedError", (NotFittedError, sklearn.NotFittedError), {})
    error: NotFittedError = both(message, help=help)
    return error


def _states(states: Any) -> npt.NDArray[np.int8]:
    """1, 0 and -1 for what is missing, int8 (n,)."""
    module = type(states).__module__.partition(".")[0]
    if module == "pandas":
        states = states.astype(object).to_numpy()
    elif module == "polars":
        states = np.asarray(states.to_list(), dtype=object)
    array = np.asarray(states)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1:
        raise ShapeError(
            f"states are one column, not an array of shape {array.shape}", "shape", None, "states"
        )
    if array.dtype.kind == "b":
        return array.astype(np.int8)
    if array.dtype.kind in "iuf":
        known = np.ones(array.shape, bool) if array.dtype.kind != "f" else ~np.isnan(array)
        wrong = known & (array != 0) & (array != 1)
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise _no_state(array[row], row)
        return np.where(known, array == 1, -1).astype(np.int8)
    if array.dtype.kind == "O":
        return np.fromiter((_state(row, it) for row, it in enumerate(array)), np.int8, len(array))
    if array.size == 0:
        return np.empty(0, np.int8)
    raise _no_state(array[0], 0)


def _state(row: int, state: Any) -> int:
    if state is None or type(state).__name__ in ("NAType", "NaTType"):
        return -1
    if isinstance(state, (bool, np.bool_)):
        return int(state)
    if isinstance(state, (int, float, np.integer, np.floating)):
        if state != state:
            return -1
        if state in (0, 1):
            return int(state)
    raise _no_state(state, row)


def _no_state(state: Any, row: int) -> ConfigError:
    return ConfigError(
        f"{state!r} is no state of a 0/1 series",
        "config",
        None,
        f"row {row}",
        "states are bool, 0 or 1; None and NaN are missing. Of classes, learn one at a time: states == c",
    )


def read_csv(
    path: PathLike,
    *,
    time_column: str | None = None,
    state_column: str | None = None,
    time_unit: str | None = None,
) -> tuple[npt.NDArray[np.datetime64], npt.NDArray[np.float64]]:
    """Times, datetime64[us] (n,), and states, float64 (n,) with NaN for missing ones, of a CSV file.

    As the command ``chronotope spectrum`` reads it: rows of time, state; a header and further columns may
    be there; a file that ends in ``.gz`` is unpacked.

    Errors: ``FormatError`` and ``TimeError`` with the line, ``NotFoundError``.
    """
    content = None
    if os.fspath(path).endswith(".gz"):
        import gzip
        import zlib

        try:
            with gzip.open(path) as file:
                content = file.read()
        except FileNotFoundError as cause:
            raise NotFoundError(str(cause.strerror), "not-found", os.fspath(path)) from cause
        except (gzip.BadGzipFile, EOFError, zlib.error) as cause:
            raise FormatError(f"no gzip file: {cause}", "format", os.fspath(path)) from cause
    times, states = _engine.read_csv(
        path, content=content, time_column=time_column, state_column=state_column, time_unit=time_unit
    )
    return times.view("datetime64[us]"), np.where(states < 0, np.nan, states).astype(np.float64)


class Series:
    """What all models of one series can do; use ``Fremen`` or one of the others."""

    #: scikit-learn reads it.
    _estimator_type: ClassVar[str] = "classifier"

    #: False and True, as the columns of ``predict_proba``.
    classes_: npt.NDArray[np.int64]

    def _model(self) -> dict[str, Any]:
        raise NotImplementedError

    # ---- parameters, as scikit-learn has them

    @classmethod
    def _parameter_names(cls) -> list[str]:
        return sorted(cls._defaults())

    @classmethod
    def _defaults(cls) -> dict[str, Any]:
        """The arguments, which are all keywords, with their defaults."""
        return cls.__init__.__kwdefaults__ or {}

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The arguments that it was made with; of models within it, too, if ``deep``."""
        params: dict[str, Any] = {}
        for name in self._parameter_names():
            value = getattr(self, name)
            params[name] = value
            if deep and isinstance(value, Series):
                inner = value.get_params()
                params.update({f"{name}__{key}": it for key, it in inner.items()})
        return params

    def set_params(self: _Self, **params: Any) -> _Self:
        """Changes arguments; what was fitted stays until the next ``fit``.

        Errors: ``ConfigError`` for a name that there is not.
        """
        names = self._parameter_names()
        for key, value in params.items():
            name, _, inner = key.partition("__")
            if name not in names:
                raise ConfigError(
                    f"{type(self).__name__} has no parameter {name!r}",
                    "config",
                    None,
                    None,
                    f"it has {', '.join(names) or 'none'}",
                )
            if inner:
                getattr(self, name).set_params(**{inner: value})
            else:
                setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        defaults = self._defaults()
        params = self.get_params(deep=False)
        changed = {k: v for k, v in params.items() if not _is_same(v, defaults[k])}
        arguments = ", ".join(f"{name}={value!r}" for name, value in changed.items())
        return f"{type(self).__name__}({arguments})"

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import ClassifierTags, InputTags, Tags, TargetTags

        return Tags(
            estimator_type="classifier",
            target_tags=TargetTags(required=True, one_d_labels=True),
            classifier_tags=ClassifierTags(multi_class=False, poor_score=True),
            regressor_tags=None,
            transformer_tags=None,
            input_tags=InputTags(one_d_array=True, two_d_array=True, string=True),
        )

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "times_us_")

    # ---- learning

    def fit(self: _Self, times: Any, states: Any) -> _Self:
        """Learns a series of ``times`` (n,) and ``states`` (n,) in place of what was known.

        Errors: ``TimeError`` and ``ConfigError`` with the row, ``ShapeError`` if there are not as many of the
        one as of the other.
        """
        times_us, states = self._samples(times, states)
        self._set(times_us, states)
        self.n_features_in_ = 1
        self._fitted()
        return self

    def partial_fit(self: _Self, times: Any, states: Any, classes: Any = None) -> _Self:
        """Learns more samples: ``fit`` of all of them together. What follows is fitted when it is asked
        for."""
        times_us, states = self._samples(times, states)
        if hasattr(self, "times_us_"):
            times_us = np.concatenate([self.times_us_, times_us])
            states = np.concatenate([self.states_, states])
        self._set(times_us, states)
        self.n_features_in_ = 1
        return self

    def merge(self: _Self, other: Series) -> _Self:
        """A new model of the samples of both: the union, so that a sample that both have counts once.

        Commutative, associative and idempotent. Errors: ``ConfigError`` for models with other parameters.
        """
        self._check_fitted()
        other._check_fitted()
        if type(self) is not type(other) or self._config() != other._config():
            raise ConfigError(
                f"{self!r} and {other!r} are not the same model",
                help="give both the same parameters: a.set_params(**b.get_params())",
            )
        pairs = np.stack(
            [
                np.concatenate([self.times_us_, other.times_us_]),
                np.concatenate([self.states_, other.states_]).astype(np.int64),
            ],
            axis=1,
        )
        union = np.unique(pairs, axis=0)
        merged = type(self)(**self.get_params(deep=False))
        merged._set(union[:, 0].copy(), union[:, 1].astype(np.int8))
        merged.n_features_in_ = 1
        return merged

    def _samples(
        self, times: Any, states: Any
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int8]]:
        if states is None:
            raise ConfigError(
                "requires y to be passed, but the target y is None", help="give the states"
            )
        times_us, states = us_array(times), _states(states)
        if len(times_us) != len(states):
            raise ShapeError(f"{len(times_us)} times and {len(states)} states are no series", "shape")
        return times_us, states

    def _set(self, times_us: npt.NDArray[np.int64], states: npt.NDArray[np.int8]) -> None:
        # In order of time, samples of one time in order of state: the order of arrival means nothing.
        order = np.lexsort((states, times_us))
        self.times_us_ = times_us[order]
        self.states_ = states[order]
        self.classes_ = np.array([0, 1])
        self.__dict__.pop("model_", None)

    def _config(self) -> str:
        return _json({"model": self._model()})

    def _check_fitted(self) -> None:
        if not hasattr(self, "times_us_"):
            raise _not_fitted(type(self).__name__)

    def _fitted(self) -> SeriesModel:
        self._check_fitted()
        model: SeriesModel | None = self.__dict__.get("model_")
        if model is None:
            model = _engine.SeriesModel.fit(self.times_us_, self.states_, self._config())
            self.__dict__["model_"] = model
        return model

    # ---- predicting

    def predict_proba(self, times: Any) -> Floats:
        """The probabilities of 0 and of 1 at each time, float64 (n, 2)."""
        p = self._fitted().p(us_array(times))
        return np.stack([1.0 - p, p], axis=1)

    def predict(self, times: Any) -> npt.NDArray[np.int64]:
        """1 where p >= 0.5, else 0; int64 (n,)."""
        p = self._fitted().p(us_array(times))
        return (p >= 0.5).astype(np.int64)

    def p(self, times: Any) -> Floats:
        """The probability of 1 at each time, float64 (n,)."""
        return self._fitted().p(us_array(times))

    def estimate(self, times: Any) -> Floats:
        """p with the lower and the upper end of its 95 % interval, float64 (n, 3).

        At hours that were never sampled, p is near the mean and its interval wide.
        """
        return self._fitted().estimate(us_array(times))

    def score(self, times: Any, states: Any) -> float:
        """The share of known states that ``predict`` has right."""
        states = _states(states)
        known = states >= 0
        if not known.any():
            return float("nan")
        return float((self.predict(times)[known] == states[known]).mean())

    def brier(self, times: Any, states: Any) -> float:
        """The mean squared difference of p and the known states."""
        states = _states(states)
        known = states >= 0
        if not known.any():
            return float("nan")
        return float(np.mean((self.p(times)[known] - states[known]) ** 2))

    def anomalies(
        self, times: Any, states: Any, confidence: float = 0.95
    ) -> npt.NDArray[np.uint32]:
        """Rows of the samples that had a probability below 1 - ``confidence``, uint32 (k,) (T-RO 2017
        III-D, where it is 1/2).

        Errors: ``ConfigError`` unless ``confidence`` is in [0.5, 1].
        """
        return self._fitted().anomalies(us_array(times), _states(states), confidence)

    # ---- looking

    @property
    def mean_(self) -> float | None:
        """The share of samples that are 1, where a burst of samples counts as one."""
        return self._fitted().mean

    @property
    def order_(self) -> int:
        """The most rhythms that the model may have."""
        return self._fitted().order

    @property
    def components_(self) -> Floats:
        """The rhythms, strongest first, float64 (k, 3): period in s, amplitude, phase in rad.

        p(t) swings by the amplitude times cos(2 pi t / period + phase).
        """
        return self._fitted().components

    def periodogram(self, periods: Periods = (WEEK_S, 168)) -> Floats:
        """How strong each candidate period is, float64 (k, 3): period in s, amplitude, and the window,
        which is the same of the sampling alone: near 1, nothing can tell that rhythm from none.

        ``periods`` as for ``Fremen``.
        """
        self._check_fitted()
        candidates = _json(_candidates(periods))
        return _engine.periodogram(self.times_us_, self.states_, candidates)

    # ---- keeping

    def __getstate__(self) -> dict[str, Any]:
        state: dict[str, Any] = {"params": self.get_params(deep=False)}
        if hasattr(self, "times_us_"):
            state["times_us"] = self.times_us_.tobytes()
            state["states"] = self.states_.tobytes()
            state["model"] = self._fitted().encode()
        return state

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        for name, value in state["params"].items():
            setattr(self, name, value)
        if "model" in state:
            times_us = np.frombuffer(state["times_us"], np.int64)
            self._set(times_us, np.frombuffer(state["states"], np.int8))
            self.n_features_in_ = 1
            self.__dict__["model_"] = _engine.SeriesModel.decode(state["model"])

    def __sklearn_clone__(self: _Self) -> _Self:
        params = {
            name: value.__sklearn_clone__() if isinstance(value, Series) else value
            for name, value in self.get_params(deep=False).items()
        }
        return type(self)(**params)


def _json(value: dict[str, Any]) -> str:
    # Imported where it is needed: `import chronotope` is quick.
    import json

    try:
        return json.dumps(value, sort_keys=True, allow_nan=False)
    except ValueError:
        raise ConfigError("NaN and infinity are no parameters of a model") from None


def _is_same(value: Any, default: Any) -> bool:
    return value is default or (type(value) is type(default) and bool(value == default))


def _candidates(periods: Periods) -> dict[str, Any]:
    """The candidate periods as the engine reads them."""
    if isinstance(periods, str):
        if periods == "calendar":
            import json

            found: dict[str, Any] = json.loads(_engine.calendar())
            return found
        raise ConfigError(
            f"there are no periods {periods!r}",
            help='give "natural", "calendar", (longest period in s, how many fractions), or a list of '
            "periods in s",
        )
    given = list(periods)
    if len(given) == 2 and isinstance(periods, tuple):
        base_s, count = given
        return {"base-s": float(base_s), "count": int(count)}
    return {"periods-s": [float(period) for period in given]}


class Fremen(Series):
    """A mean and the strongest rhythms of a state: FreMEn.

    With ``periods="natural"``, the default, rhythms of year, week and day are solved for together and
    judged by held-out days; there is nothing to tune. With ``"calendar"``, with ``(base_s, count)`` for the
    fractions base/1 .. base/count, or with a list of periods in seconds, the ``order`` strongest of these
    make up p(t) (T-RO 2017 eq. 10, with its factor 2); ``order=None`` chooses the order on held-out samples.

    Predictions are believed as far as the samples reach.

    >>> import numpy as np
    >>> hours = np.arange(28 * 24)
    >>> door = Fremen().fit(hours * 3600, (hours % 24 >= 6) & (hours % 24 < 18))
    >>> bool(door.p(["1970-06-01T12:00:00Z"])[0] > 0.9)
    True
    """

    def __init__(self, *, order: int | None = None, periods: Periods = "natural") -> None:
        self.order = order
        self.periods = periods

    def _model(self) -> dict[str, Any]:
        if isinstance(self.periods, str) and self.periods == "natural":
            if self.order is not None:
                raise ConfigError(
                    "the natural rhythms are chosen by what held-out days bear out, so their order cannot "
                    "be fixed",
                    place="order",
                    help='leave order out, or give periods="calendar" or (604800, 168)',
                )
            return {"kind": "natural"}
        order: Any = {} if self.order is None else int(self.order)
        if isinstance(order, int) and order < 0:
            raise ConfigError(f"an order is 0 or more, not {order}", place="order")
        return {"kind": "fremen", "candidates": _candidates(self.periods), "order": order}


class Mean(Series):
    """The share of samples that are 1, at any time: the baseline."""

    def __init__(self) -> None:
        pass

    def _model(self) -> dict[str, Any]:
        return {"kind": "mean"}


class Logistic(Series):
    """The rhythms base/1 .. base/count in log odds, with priors: calibrated p from few samples.

    ``harmonics`` uses exactly these instead of choosing.
    """

    def __init__(
        self,
        *,
        base_s: float = DAY_S,
        count: int = 12,
        harmonics: Sequence[int] | None = None,
    ) -> None:
        self.base_s = base_s
        self.count = count
        self.harmonics = harmonics

    def _model(self) -> dict[str, Any]:
        model: dict[str, Any] = {
            "kind": "logistic",
            "candidates": {"base-s": float(self.base_s), "count": int(self.count)},
        }
        if self.harmonics is not None:
            model["harmonics"] = [int(harmonic) for harmonic in self.harmonics]
        return model


class Histogram(Series):
    """The share of samples that are 1 in the same part of the day, of ``num_bins`` parts, or of another
    period; ``prior`` samples at the mean are added to each part."""

    def __init__(
        self, *, period_s: float = DAY_S, num_bins: int = 24, prior: float = 1.0
    ) -> None:
        self.period_s = period_s
        self.num_bins = num_bins
        self.prior = prior

    def _model(self) -> dict[str, Any]:
        return {
            "kind": "histogram",
            "period-s": float(self.period_s),
            "num-bins": int(self.num_bins),
            "prior": float(self.prior),
        }


class PeriodicMixture(Series):
    """A few Gaussians round the day (PerGaM, RAS 2017 4.3.2): short events at fixed times."""

    def __init__(
        self, *, period_s: float = DAY_S, num_bins: int = 144, order: int = 3
    ) -> None:
        self.period_s = period_s
        self.num_bins = num_bins
        self.order = order

    def _model(self) -> dict[str, Any]:
        return {
            "kind": "pergam",
            "period-s": float(self.period_s),
            "num-bins": int(self.num_bins),
            "order": int(self.order),
        }


class Markov(Series):
    """Relaxes from the last state to the share of time that it was 1 (RAS 2017 eq. 5-6): short term."""

    def __init__(self) -> None:
        pass

    def _model(self) -> dict[str, Any]:
        return {"kind": "markov"}


class Persistence(Series):
    """The last state first, another model later (T-RO 2017 eq. 12-13); ``of`` is ``Fremen()`` if None."""

    def __init__(self, *, of: Series | None = None) -> None:
        self.of = of

    def _model(self) -> dict[str, Any]:
        of = Fremen() if self.of is None else self.of
        return {"kind": "persistent", "of": of._model()}
