"""When and where should a robot look next, so that what it knows stays true?

``Explorer`` is the loop of a robot: it plans a day, looks, learns and plans again. The functions here
are those of the command ``chronotope explore``, for whoever has the samples already:

==================  =============================================================================
``plan``            the visits of a day
``next_visit``      where to go now, given what was seen and visited today
``prospects``       what a look would be worth at each place, and why
``plan_tour``       the same where driving takes time, with opening times and a charger
``simulate``        how well a robot would have known places that had explored them
==================  =============================================================================

What is explored is ``data``: a dictionary of a place's name to (times, states), samples of one 0/1
state as ``Fremen.fit`` takes them; or a ``Map`` or the path of one, whose places show their features.
Only what was seen before the moment in question is used. Times are aware datetimes, datetime64 of UTC,
text with an offset, or seconds since 1970; slots are ``slot`` seconds long, and at most ``share`` of
them are spent.

Source: J. M. Santos, T. Krajník, T. Duckett: Spatio-temporal exploration strategies for long-term
autonomy of mobile robots, Robotics and Autonomous Systems, 2017. Strategies and models are listed at
``Explorer``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union

import numpy as np
import numpy.typing as npt

from . import _chronotope as _engine
from ._chronotope import Explorer, PlannedVisit, Prospect, Simulation, Tour
from ._errors import ConfigError, ShapeError
from ._times import us_array
from ._types import TimeLike
from .series import _states

if TYPE_CHECKING:
    from ._chronotope import Map

__all__ = [
    "Explorer",
    "PlannedVisit",
    "Prospect",
    "Simulation",
    "Tour",
    "next_visit",
    "plan",
    "plan_tour",
    "prospects",
    "simulate",
]

#: Samples of each place by its name, a map, or the path of one.
Data = Union[Mapping[str, tuple[Any, Any]], "Map", str, "os.PathLike[str]"]


def _look(states: Any) -> list[bool]:
    """What was seen of all states of a place."""
    seen = _states(np.atleast_1d(np.asarray(states)))
    if (seen < 0).any():
        row = int(np.flatnonzero(seen < 0)[0])
        raise ConfigError(
            "a look sees every state of a place", "config", None, f"states[{row}]", "give True or False"
        )
    return [bool(state) for state in seen == 1]


def _data(data: Any) -> Any:
    """What the engine takes: a map as it is, or names, microseconds and states."""
    if not isinstance(data, Mapping):
        return data
    rows = []
    for name, samples in data.items():
        try:
            times, states = samples
        except (TypeError, ValueError):
            raise ShapeError(
                "a place has (times, states)", "shape", None, f"data[{name!r}]", "give a pair of columns"
            ) from None
        rows.append((name, us_array(times), _states(states)))
    return rows


def plan(
    data: Data,
    start: TimeLike,
    *,
    slots: int = 144,
    slot: float = 600.0,
    share: float = 0.5,
    strategy: str = "information",
    seed: int = 0,
    model: str = "histogram-persistent",
    zone: str | None = None,
) -> list[PlannedVisit]:
    """The visits of ``slots`` slots from ``start`` on, in order of time, as ``chronotope explore plan``
    makes them.

    ``zone`` ("Europe/Prague"): rhythms of series follow the clocks there; those of a map have its own.

    Errors: ``ConfigError`` for unknown names and numbers out of range, ``TimeError``, ``ShapeError``.
    """
    return _engine.explore_plan(
        _data(data),
        start,
        slots=slots,
        slot=slot,
        share=share,
        strategy=strategy,
        seed=seed,
        model=model,
        zone=zone,
    )


def next_visit(
    data: Data,
    now: TimeLike,
    *,
    day_from: TimeLike | None = None,
    visited: Iterable[tuple[str, TimeLike]] = (),
    slots: int = 144,
    slot: float = 600.0,
    share: float = 0.5,
    strategy: str = "information",
    seed: int = 0,
    model: str = "histogram-persistent",
    zone: str | None = None,
) -> PlannedVisit | None:
    """Where to go now, as ``chronotope explore next`` says; None once the share of the day is spent.

    With ``day_from`` the slots of the day are counted from there: every slot of it in which ``data``
    has a look is a visit that was made. ``visited`` are others, (place, time).

    Errors: as ``plan``; ``ConfigError`` for a day that begins after ``now``.
    """
    return _engine.explore_next(
        _data(data),
        now,
        day_from=day_from,
        visited=list(visited),
        slots=slots,
        slot=slot,
        share=share,
        strategy=strategy,
        seed=seed,
        model=model,
        zone=zone,
    )


def prospects(
    data: Data,
    time: TimeLike,
    *,
    slots: int = 144,
    slot: float = 600.0,
    model: str = "histogram-persistent",
    zone: str | None = None,
) -> list[Prospect]:
    """What a look at ``time`` would be worth at each place, the best first, as ``chronotope explore
    explain`` says.

    Errors: as ``plan``.
    """
    return _engine.explore_prospects(
        _data(data), time, slots=slots, slot=slot, model=model, zone=zone
    )


def plan_tour(
    data: Data,
    start: TimeLike,
    roads: Iterable[tuple[str, str, float]],
    *,
    at: str | None = None,
    charger: tuple[str, float, float] | None = None,
    open: Mapping[str, Sequence[tuple[TimeLike, TimeLike]]] | None = None,
    slots: int = 144,
    slot: float = 600.0,
    share: float = 0.5,
    model: str = "histogram-persistent",
    zone: str | None = None,
) -> Tour:
    """The tour that teaches most where driving takes time, as ``chronotope explore plan --roads`` finds
    it.

    ``roads`` are (place, place, seconds), there and back; names that are no place of ``data`` are on
    the way only. It begins ``at`` a place, the first one unless said otherwise. ``charger`` is (place,
    seconds to run, seconds to charge); ``open`` are the times (from, to) between which a place can be
    visited.

    Errors: as ``plan``; ``NotFoundError`` for a place that is not there.
    """
    hours = [(name, *times) for name, all_times in (open or {}).items() for times in all_times]
    return _engine.explore_tour(
        _data(data),
        start,
        [(a, b, float(seconds)) for a, b, seconds in roads],
        at=at,
        charger=charger,
        open=hours,
        slots=slots,
        slot=slot,
        share=share,
        model=model,
        zone=zone,
    )


def _known(states: Any, name: str) -> npt.NDArray[np.int8]:
    """States of all moments, 0 and 1, one after another."""
    array = np.asarray(states)
    flat = _states(array.reshape(-1))
    if (flat < 0).any():
        row = int(np.flatnonzero(flat < 0)[0])
        raise ConfigError(
            "a simulation needs what could have been seen at every moment",
            "config",
            None,
            f"{name}, state {row}",
            "leave out moments at which a state is not known",
        )
    return flat


def _places(states: Any, names: Sequence[str] | None) -> list[tuple[str, int, npt.NDArray[np.int8]]]:
    """Names, numbers of states, and states of each place."""
    if isinstance(states, Mapping):
        if names is not None:
            raise ConfigError("a dictionary has its own names", "config", None, "names", "leave them out")
        rows = []
        for name, column in states.items():
            array = np.asarray(column)
            if array.ndim not in (1, 2):
                raise ShapeError(
                    f"states of shape {array.shape}",
                    "shape",
                    None,
                    f"states[{name!r}]",
                    "give (moments,) or (moments, states)",
                )
            num_states = 1 if array.ndim == 1 else array.shape[1]
            rows.append((name, num_states, _known(array, f"states[{name!r}]")))
        return rows
    array = np.asarray(states)
    if array.ndim != 2:
        raise ShapeError(
            f"states of shape {array.shape}",
            "shape",
            None,
            "states",
            "give (moments, places), or a dictionary of names",
        )
    if names is None:
        names = [str(place) for place in range(array.shape[1])]
    if len(names) != array.shape[1]:
        raise ShapeError(
            f"{len(names)} names for {array.shape[1]} places", "shape", None, "names", "give one for each"
        )
    columns = zip(names, array.T)
    return [(name, 1, _known(column, f"states of {name!r}")) for name, column in columns]


def simulate(
    times: Any,
    states: Any,
    *,
    names: Sequence[str] | None = None,
    slots: int = 144,
    slot: float = 600.0,
    share: float = 0.5,
    strategy: str = "information",
    seed: int = 0,
    model: str = "histogram-persistent",
) -> Simulation:
    """Plays a recording through, as ``chronotope explore simulate`` does: a robot begins with nothing,
    plans ``slots`` slots at a time, is shown what it visits and nothing else, and learns.

    ``times`` (moments,) ascend; ``states`` are bool or 0/1, (moments, places), or a dictionary of a
    place's name to (moments,) or (moments, states). What is left after the last whole plan is not used.

    >>> import numpy as np
    >>> minutes = np.arange(7 * 24 * 60)
    >>> hours = minutes / 60 % 24
    >>> open = {"office": (hours > 8) & (hours < 17), "kitchen": (hours > 12) & (hours < 13)}
    >>> found = simulate(60 * minutes, open, share=0.2, seed=1)
    >>> found.num_visits, len(found.by_day), found.error < 0.1
    (196, 7, True)

    Errors: ``TimeError`` for times that do not ascend, ``ShapeError``, ``ConfigError``.
    """
    return _engine.explore_simulate(
        us_array(times),
        _places(states, names),
        slots=slots,
        slot=slot,
        share=share,
        strategy=strategy,
        seed=seed,
        model=model,
    )
