"""Is it planned when and where to look, and is that what the command says?"""

from __future__ import annotations

import datetime
import os
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import chronotope
from chronotope import Explorer, explore

Command = Callable[..., list[dict[str, Any]]]

#: Eight days of every ten minutes from 2024-05-01 on: somebody is in the kitchen from 7 to 8 h and from 18 to 20 h,
#: in the office from 9 to 17 h.
START = 1_714_521_600
TIMES = START + 600 * np.arange(8 * 144)
HOURS = TIMES // 3600 % 24
ROOMS = {"kitchen": np.isin(HOURS, (7, 18, 19)), "office": (HOURS >= 9) & (HOURS < 17)}
SERIES = {name: (TIMES, states) for name, states in ROOMS.items()}
NEXT_DAY = "2024-05-09T00:00:00Z"
STRATEGIES = ["round-robin", "random", "greedy", "monte-carlo", "novelty", "information"]
ROADS = [("kitchen", "hall", 30.0), ("hall", "office", 60.0)]


def days(explorer: Explorer, count: int) -> list[dict[str, Any]]:
    """The visits of some days of a robot that sees the rooms as they are."""
    made = []
    for day in range(count):
        explorer.plan(START + day * 86_400)
        for slot in range(144):
            visit = explorer.next(slot)
            if visit is None:
                continue
            assert visit.slot == slot and visit.start.timestamp() == START + day * 86_400 + slot * 600
            explorer.observe(visit.place, visit.start, ROOMS[visit.place][day * 144 + slot])
            made.append(visit.to_dict())
    return made


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_robot_keeps_to_its_share_and_learns(strategy: str) -> None:
    explorer = Explorer(["kitchen", "office"], strategy=strategy, share=0.25, seed=3)
    made = days(explorer, 4)
    assert 0 < len(made) <= 4 * 36
    assert {it["place"] for it in made} == {"kitchen", "office"}
    explorer.plan(START + 4 * 86_400)
    (noon,), (night,) = (explorer.predict("office", START + 86_400 * 4 + 3600 * it) for it in (13, 3))
    assert noon > 0.6 > 0.4 > night


def test_the_same_seed_is_the_same_robot() -> None:
    for strategy in ("random", "monte-carlo", "information"):
        one, same, other = (
            days(Explorer(["kitchen", "office"], strategy=strategy, share=0.3, seed=seed), 2) for seed in (7, 7, 8)
        )
        assert one == same
        assert one != other, strategy


def test_a_plan_changes_by_what_is_seen() -> None:
    explorer = Explorer(["kitchen", "office"], share=0.5)
    assert explorer.planned == [] and explorer.next(0) is None and explorer.places == ["kitchen", "office"]
    planned = explorer.plan(START, slots=72)
    assert [it.to_json() for it in explorer.planned] == [it.to_json() for it in planned]
    assert len(planned) == 36 and all(it.end - it.start == datetime.timedelta(minutes=10) for it in planned)
    days(explorer, 2)
    assert explorer.num_rerouted > 0
    assert "2 places" in repr(explorer) and "PlannedVisit" in repr(planned[0]) and planned[0].reason
    found = explorer.prospects(START + 2 * 86_400)
    assert [it.place for it in found] == [it.place for it in sorted(found, key=lambda it: -it.value)]
    assert {it.place for it in found} == {"kitchen", "office"} and "Prospect" in repr(found[0])


def test_a_place_may_show_several_states() -> None:
    explorer = Explorer({"view": 3, "door": 1}, share=1.0)
    explorer.plan(START, 6)
    for states in ([True, False, True], (1, 0, 1), np.array([1.0, 0.0, 1.0]), np.array([True, False, True])):
        explorer.observe("view", START + 60, states)
    explorer.observe("door", START, np.True_)
    assert (explorer.predict("view", START + 61) > 0.5).tolist() == [True, False, True]
    for states in ([True], True, [[True, False, True]]):
        with pytest.raises(chronotope.ShapeError):
            explorer.observe("view", START + 120, states)  # type: ignore[arg-type]
    for states in ([True, None, True], [0.5, 0.5, 0.5], [np.nan, 0, 1], "abc"):
        with pytest.raises(chronotope.ConfigError):
            explorer.observe("view", START + 120, states)  # type: ignore[arg-type]


def test_bad_words_and_numbers_are_named() -> None:
    for name, value in (("strategy", "guess"), ("model", "spline"), ("share", 1.5), ("share", float("nan"))):
        with pytest.raises(chronotope.ConfigError) as raised:
            Explorer(["a"], **{name: value})
        assert raised.value.place == name
        with pytest.raises(chronotope.ConfigError) as raised:
            explore.plan(SERIES, NEXT_DAY, **{name: value})
        assert raised.value.place == name
    for slot in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(chronotope.ConfigError):
            Explorer(["a"], slot=slot)
    with pytest.raises(chronotope.AlreadyExistsError):
        Explorer(["a", "a"])
    with pytest.raises(chronotope.ShapeError):
        Explorer({"a": 0})
    with pytest.raises(TypeError):
        Explorer("kitchen")
    explorer = Explorer(["a"])
    for slots in (0, 40_001):
        with pytest.raises(chronotope.ConfigError):
            explorer.plan(START, slots)
    with pytest.raises(chronotope.NotFoundError) as raised:
        explorer.observe("b", START, True)
    assert "places are a" in str(raised.value)
    with pytest.raises(chronotope.NotFoundError):
        explorer.predict("b", START)


@pytest.mark.parametrize("time", [datetime.datetime(2024, 5, 9), "2024-05-09T00:00:00", np.datetime64("NaT")])
def test_naive_times_are_refused(time: Any) -> None:
    explorer = Explorer(["kitchen"])
    for call in (
        explorer.plan,
        explorer.prospects,
        lambda it: explorer.observe("kitchen", it, True),
        lambda it: explorer.predict("kitchen", it),
        lambda it: explore.plan(SERIES, it),
        lambda it: explore.next_visit(SERIES, it),
        lambda it: explore.prospects(SERIES, it),
        lambda it: explore.plan_tour(SERIES, it, ROADS),
        lambda it: explore.plan({"a": ([it], [True])}, NEXT_DAY),
        lambda it: explore.simulate([it], [[True]], slots=1),
    ):
        with pytest.raises(chronotope.TimeError):
            call(time)


def test_only_the_past_is_known() -> None:
    half = {name: (TIMES[:576], states[:576]) for name, states in ROOMS.items()}
    start = int(TIMES[576])
    with_future = [it.to_json() for it in explore.plan(SERIES, start)]
    assert with_future == [it.to_json() for it in explore.plan(half, start)]
    assert with_future != [it.to_json() for it in explore.plan(SERIES, start + 86_400)]
    shuffled = np.random.default_rng(1).permutation(576)
    mixed = {name: (times[shuffled], states[shuffled]) for name, (times, states) in half.items()}
    assert with_future == [it.to_json() for it in explore.plan(mixed, start)]
    missing = {name: (np.append(times, start - 5), [*states, None]) for name, (times, states) in half.items()}
    assert with_future == [it.to_json() for it in explore.plan(missing, start)]


def test_bad_data_are_named() -> None:
    for data, kind in (
        ({"a": TIMES}, chronotope.ShapeError),
        ({"a": (TIMES, ROOMS["office"][:5])}, chronotope.ShapeError),
        ({"a": (TIMES[:3], [0, 1, 2])}, chronotope.ConfigError),
        ({"a": ([np.nan], [True])}, chronotope.TimeError),
    ):
        with pytest.raises(kind):
            explore.plan(data, NEXT_DAY)  # type: ignore[arg-type]
    with pytest.raises(FileNotFoundError):
        explore.plan("none.map", NEXT_DAY)
    with pytest.raises(TypeError):
        explore.plan(3, NEXT_DAY)  # type: ignore[arg-type]
    assert explore.plan({}, NEXT_DAY) == []


def test_the_day_s_visits_are_counted() -> None:
    now = START + 8 * 86_400 + 3600
    day = {"day_from": NEXT_DAY, "share": 0.03}
    assert explore.next_visit(SERIES, now, **day) is not None
    visited = [("kitchen", now - 1200), ("garage", now - 600)]
    assert explore.next_visit(SERIES, now, visited=visited, **day) is not None
    for more in (visited + [("office", now - 1900)] * 2 + [("office", now - 2500)], [("x", now - 60)] * 4):
        assert explore.next_visit(SERIES, now, visited=more, **day) is None
    for bad in ({"visited": [("kitchen", now + 5)]}, {"visited": [("kitchen", START)]}, {"day_from": now + 5}):
        with pytest.raises(chronotope.ConfigError):
            explore.next_visit(SERIES, now, **{**day, **bad})


def test_a_tour_takes_the_way_into_account() -> None:
    tour = explore.plan_tour(SERIES, NEXT_DAY, ROADS, at="kitchen", share=0.2)
    stops = tour.stops
    assert len(tour) == len(stops) > 3 and {it.place for it in stops} == {"kitchen", "office"}
    for before, after in zip(stops, stops[1:]):
        way = 90.0 if before.place != after.place else 0.0
        assert (after.start - before.end).total_seconds() >= way
    assert tour.spent_s <= 0.2 * 86_400 + 1e-6 and 0 < tour.travel_s < tour.spent_s and tour.value > 0
    assert tour.to_dict()["stops"] == [it.to_dict() for it in stops] and "Tour" in repr(tour)
    hours = ("2024-05-09T10:00:00Z", "2024-05-09T12:00:00Z")
    limited = explore.plan_tour(
        SERIES, NEXT_DAY, ROADS, open={"office": [hours]}, charger=("kitchen", 14_400.0, 3600.0)
    )
    office = [it for it in limited.stops if it.place == "office"]
    assert office and all(it.start.hour in (10, 11) for it in office)
    assert any(it.reason == "charging" and it.place == "kitchen" for it in limited.stops)
    for bad, kind in (
        ({"at": "garage"}, chronotope.NotFoundError),
        ({"charger": ("garage", 1.0, 1.0)}, chronotope.NotFoundError),
        ({"charger": ("kitchen", -1.0, 1.0)}, chronotope.ConfigError),
        ({"open": {"garage": [hours]}}, chronotope.NotFoundError),
        ({"open": {"office": [hours[::-1]]}}, chronotope.ConfigError),
    ):
        with pytest.raises(kind):
            explore.plan_tour(SERIES, NEXT_DAY, ROADS, **bad)  # type: ignore[arg-type]
    with pytest.raises(chronotope.ConfigError) as raised:
        explore.plan_tour(SERIES, NEXT_DAY, [("kitchen", "office", -1.0)])
    assert raised.value.place == "roads"


def test_a_map_is_explored(learnt: pathlib.Path) -> None:
    by_path = explore.plan(learnt, NEXT_DAY)
    by_map = explore.plan(chronotope.Map.open(learnt), NEXT_DAY)
    assert [it.to_json() for it in by_path] == [it.to_json() for it in by_map] != []
    assert {it.place for it in by_path} <= {it.name for it in chronotope.Map.open(learnt).places}
    assert len(explore.prospects(learnt, NEXT_DAY)) == 3


# Simulation


def test_a_simulation_of_arrays_is_one_of_a_dictionary() -> None:
    array = np.stack(list(ROOMS.values()), axis=1)
    found = [
        explore.simulate(TIMES, ROOMS, seed=2),
        explore.simulate(TIMES, array, names=["kitchen", "office"], seed=2),
        explore.simulate(TIMES, array.astype(float), names=["kitchen", "office"], seed=2),
        explore.simulate(TIMES.astype("datetime64[s]"), array.astype(np.int8), names=["kitchen", "office"], seed=2),
    ]
    assert len({it.to_json() for it in found}) == 1
    one = found[0]
    assert one.by_day.shape == (8,) and one.num_visits == len(one.visits) == 8 * 72
    assert one.error == pytest.approx(one.by_day.mean()) and one.by_day[-1] < one.by_day[0] < 0.5
    assert one.bits_a_visit == pytest.approx(np.mean([it.info_bits for it in one.visits]))
    assert "seed 2" in repr(one) and {it.place for it in one.visits} == {"kitchen", "office"}
    assert one.to_json() != explore.simulate(TIMES, ROOMS, seed=3).to_json()
    several = explore.simulate(TIMES, {"both": array}, seed=2)
    assert several.num_visits == 8 * 72 and several.error < one.error


def test_more_looks_teach_more() -> None:
    few, many = (explore.simulate(TIMES, ROOMS, share=it).error for it in (0.05, 0.5))
    assert many < few
    assert explore.simulate(TIMES, ROOMS, share=0).num_visits == 0


def test_what_cannot_be_simulated_is_named() -> None:
    array = np.stack(list(ROOMS.values()), axis=1)
    unknown = array.astype(float)
    unknown[5, 1] = np.nan
    for times, states, kind in (
        (TIMES, array[:, 0], chronotope.ShapeError),
        (TIMES, array[:5], chronotope.ShapeError),
        (TIMES, array[:, :0], chronotope.ShapeError),
        (TIMES[:0], array[:0], chronotope.ShapeError),
        (TIMES, {}, chronotope.ShapeError),
        (TIMES, {"a": array[None]}, chronotope.ShapeError),
        (TIMES[:100], array[:100], chronotope.ShapeError),
        (TIMES, unknown, chronotope.ConfigError),
        (TIMES, array + 1, chronotope.ConfigError),
        (TIMES[::-1], array, chronotope.TimeError),
        (np.zeros(len(TIMES)), array, chronotope.TimeError),
    ):
        with pytest.raises(kind):
            explore.simulate(times, states)
    for names, kind in ((["a"], chronotope.ShapeError), (["a", "a"], chronotope.AlreadyExistsError)):
        with pytest.raises(kind):
            explore.simulate(TIMES, array, names=names)
    with pytest.raises(chronotope.ConfigError):
        explore.simulate(TIMES, ROOMS, names=["a", "b"])


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_ends_a_simulation(tmp_path: pathlib.Path) -> None:
    from test_manners import interrupted

    code, said, took_s = interrupted(
        """
        import numpy
        from chronotope import explore
        times = numpy.arange(1_000_000) * 60
        states = numpy.random.default_rng(1).random((len(times), 10)) < 0.5
        print("ready", flush=True)
        explore.simulate(times, states)
        """,
        tmp_path,
    )
    assert code != 0 and "KeyboardInterrupt" in said and took_s < 20


# The command


@pytest.fixture
def files(tmp_path: pathlib.Path) -> list[pathlib.Path]:
    paths = []
    for name, states in ROOMS.items():
        rows = [f"{time},{int(state)}" for time, state in zip(TIMES, states)]
        paths.append(tmp_path / f"{name}.csv")
        paths[-1].write_text("when,somebody\n" + "\n".join(rows) + "\n")
    return paths


UNIT = ("--time-unit", "s")


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_plan_is_that_of_the_command(command: Command, files: list[pathlib.Path], strategy: str) -> None:
    options = ("--strategy", strategy, "--seed", 5, "--share", 0.3)
    said = command("explore", "plan", *files, *UNIT, "--from", NEXT_DAY, "--json", *options)
    planned = explore.plan(SERIES, NEXT_DAY, strategy=strategy, seed=5, share=0.3)
    assert [it.to_json() for it in planned] == [it["line"] for it in said] != []


def test_a_plan_of_a_zone_is_that_of_the_command(command: Command, files: list[pathlib.Path]) -> None:
    options = ("--zone", "Europe/Prague", "--model", "fremen", "--slot-s", 900, "--slots", 96)
    said = command("explore", "plan", *files, *UNIT, "--from", NEXT_DAY, "--json", *options)
    planned = explore.plan(SERIES, NEXT_DAY, zone="Europe/Prague", model="fremen", slot=900, slots=96)
    assert [it.to_json() for it in planned] == [it["line"] for it in said]


def test_a_plan_of_a_map_is_that_of_the_command(command: Command, learnt: pathlib.Path) -> None:
    said = command("explore", "plan", learnt, "--from", NEXT_DAY, "--json")
    assert [it.to_json() for it in explore.plan(learnt, NEXT_DAY)] == [it["line"] for it in said]


def test_the_next_visit_is_that_of_the_command(command: Command, files: list[pathlib.Path]) -> None:
    now = "2024-05-08T15:25:00Z"
    day = ("--day-from", "2024-05-08T00:00:00Z", "--visited", "garage=2024-05-08T07:10:00Z")
    for options, given in (
        ((), {}),
        (day, {"day_from": day[1], "visited": [("garage", "2024-05-08T07:10:00Z")], "share": 1.0}),
    ):
        share = ("--share", 1.0) if options else ()
        said = command("explore", "next", *files, *UNIT, "--now", now, "--json", *options, *share)
        visit = explore.next_visit(SERIES, now, **given)
        assert ([] if visit is None else [visit.to_json()]) == [it["line"] for it in said]


def test_prospects_are_those_of_the_command(command: Command, files: list[pathlib.Path]) -> None:
    said = command("explore", "explain", *files, *UNIT, "--at", NEXT_DAY, "--json")
    found = explore.prospects(SERIES, NEXT_DAY)
    assert [it.to_json() for it in found] == [it["line"] for it in said] and len(found) == 2


def test_a_tour_is_that_of_the_command(
    command: Command, files: list[pathlib.Path], tmp_path: pathlib.Path
) -> None:
    roads = tmp_path / "roads.txt"
    roads.write_text("node hall\n" + "".join(f"link {a} {b} {s}\n" for a, b, s in ROADS))
    hours = ("2024-05-09T08:00:00Z", "2024-05-09T18:00:00Z")
    said = command(
        *("explore", "plan", *files, *UNIT, "--from", NEXT_DAY, "--json", "--roads", roads, "--at", "office"),
        *("--charger", "kitchen", "--run-s", 14400, "--charge-s", 3600, "--open", f"office={hours[0]}/{hours[1]}"),
    )
    tour = explore.plan_tour(
        SERIES, NEXT_DAY, ROADS, at="office", charger=("kitchen", 14_400, 3600), open={"office": [hours]}
    )
    assert [it.to_json() for it in tour.stops] == [it["line"] for it in said] != []


def test_a_simulation_is_that_of_the_command(command: Command, files: list[pathlib.Path]) -> None:
    options = ("--strategy", "monte-carlo", "--model", "long-term", "--share", 0.25, "--seeds", 2, "--by-day")
    said = command("explore", "simulate", *files, *UNIT, "--json", *options)
    for seed, line in enumerate(said):
        found = explore.simulate(TIMES, ROOMS, strategy="monte-carlo", model="long-term", share=0.25, seed=seed)
        assert found.to_json() == line["line"]
    assert len(said) == 2
