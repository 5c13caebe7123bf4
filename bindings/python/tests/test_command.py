"""Is every answer that of the command's --json, bit for bit?"""

from __future__ import annotations

import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import chronotope
from chronotope import Map, series

Command = Callable[..., list[dict[str, Any]]]


def compare_answers(
    command: Command, map_path: pathlib.Path, images: list[pathlib.Path], *options: str, **arguments: Any
) -> None:
    """Every line of the command, and what Python says of the same images."""
    lines = command("localize", map_path, *images, "--json", "--top", 3, *options, code=None)
    localizer = chronotope.Localizer(map_path, **arguments)
    answers = [answer for image in images for answer in localizer.localize_file(image)]
    assert len(answers) == len(lines) >= len(images)
    for answer, line in zip(answers, lines):
        assert answer.to_json(top=3) == line["line"]


def test_answers_are_those_of_the_command(
    command: Command, learnt: pathlib.Path, queries: pathlib.Path
) -> None:
    compare_answers(command, learnt, sorted((queries / "images").iterdir()))


@pytest.mark.parametrize("method", ["static", "fused", "experience", "experience-all", "freex"])
def test_answers_of_every_method_are_those_of_the_command(
    command: Command, learnt: pathlib.Path, queries: pathlib.Path, method: str
) -> None:
    images = sorted((queries / "images").iterdir())[:3]
    compare_answers(command, learnt, images, "--method", method, "--n", "30", method=method, n=30)


def test_a_time_that_is_given_counts(
    command: Command, learnt: pathlib.Path, queries: pathlib.Path
) -> None:
    image = sorted((queries / "images").iterdir())[0]
    time = "2024-12-20T20:00:00Z"
    lines = command("localize", learnt, image, "--json", "--time", time, code=None)
    answer = chronotope.Localizer(learnt).localize(image, time)
    assert answer.to_json() == lines[0]["line"] and lines[0]["time_source"] == "option"


def test_a_map_is_that_of_the_command(
    command: Command, folder: pathlib.Path, queries: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    theirs, ours = tmp_path / "theirs.map", tmp_path / "ours.map"
    command("map", "build", "--data", folder, "--out", theirs)
    Map.build(folder, ours, threads=1)
    digests = [Map.open(path).inspect()["digest"] for path in (theirs, ours)]
    assert digests[0] == digests[1]
    command("map", "update", theirs, "--data", queries, code=None)
    Map.open(ours).update(queries)
    digests = [Map.open(path).inspect()["digest"] for path in (theirs, ours)]
    assert digests[0] == digests[1]


def test_what_a_map_says_of_itself_is_what_the_command_says(
    command: Command, learnt: pathlib.Path, query
) -> None:
    map_ = Map.open(learnt)

    def lines(*arguments: Any) -> list[dict[str, Any]]:
        return [{k: v for k, v in it.items() if k != "line"} for it in command(*arguments)]

    assert [map_.inspect()] == lines("map", "inspect", learnt, "--json")
    assert [map_.verify()] == lines("map", "verify", learnt, "--json")
    assert map_.log() == lines("map", "log", learnt, "--json")
    assert map_.held() == lines("map", "held", learnt, "--json")
    time = "2024-05-01T08:30:00Z"
    said = command("predict", learnt, "--time", time, "--n", 20, "--json")
    for line, place in zip(said, map_.places):
        assert map_.predict(place.name, time, n=20).to_json() == line["line"]


def test_a_merged_map_is_that_of_the_command(
    command: Command, learnt: pathlib.Path, street: chronotope.Street, tmp_path: pathlib.Path
) -> None:
    _, query = street.schedule(10, 3)
    other = tmp_path / "other.map"
    Map.build(chronotope.write_street(street, tmp_path / "data", query), other)
    command("map", "merge", learnt, other, "--out", tmp_path / "theirs.map")
    merged = Map.merge([learnt, other], tmp_path / "ours.map")
    assert merged.inspect()["digest"] == Map.open(tmp_path / "theirs.map").inspect()["digest"]


def test_a_way_is_that_of_the_command(
    command: Command, learnt: pathlib.Path, queries: pathlib.Path
) -> None:
    images = sorted((queries / "images").iterdir())
    lines = command("localize", learnt, *images, "--json", "--track", code=None)
    localizer = chronotope.Localizer(learnt)
    tracker = chronotope.Tracker(localizer)
    for image, line in zip(images, lines):
        assert tracker.update(localizer.localize(image)).to_json() == line["line"]


def compare_series(command: Command, path: pathlib.Path) -> None:
    at = ["2014-03-03T08:30:00Z", "2016-06-01T20:00:00Z"]
    options = [option for time in at for option in ("--predict-at", time)]
    said = command("spectrum", path, "--json", "--time-unit", "s", *options)[0]
    times, states = series.read_csv(path, time_unit="s")
    learnt = {it["model"]: it for it in said["learnt"]}
    order = next(
        (it["order"] for it in said["held_out"] if it["model"] == "fremen" and it["chosen"]), 0
    )
    for name, model in (
        ("natural", series.Fremen()),
        ("fremen", series.Fremen(periods=(604_800.0, 168), order=order)),
    ):
        model.fit(times, states)
        line = learnt[name]
        assert model.mean_ == line["mean"] or line["mean"] == np.nanmean(states)
        assert [it["period_s"] for it in line["components"]] == model.components_[:, 0].tolist()
        assert [it["amplitude"] for it in line["components"]] == model.components_[:, 1].tolist()
        assert [it["phase_rad"] for it in line["components"]] == model.components_[:, 2].tolist()
        said_at = [[it["p"], it["low"], it["high"]] for it in line["predicted"]]
        assert said_at == model.estimate(at).tolist()


def test_a_series_is_that_of_the_command(command: Command, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "door.csv"
    rng = np.random.default_rng(3)
    hours = np.sort(rng.choice(60 * 24, 600, replace=False))
    states = ((hours % 24 >= 7) & (hours % 24 < 19)) ^ (rng.random(600) < 0.05)
    rows = [f"{1_388_534_400 + 3600 * hour},{int(state)}" for hour, state in zip(hours, states)]
    path.write_text("time,state\n" + "\n".join(rows) + "\n")
    compare_series(command, path)


def test_real_data_stromovka_is_that_of_the_command(
    command: Command, real_data: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    data = real_data / "stromovka"
    theirs, ours = tmp_path / "theirs.map", tmp_path / "ours.map"
    command("map", "build", "--data", data, "--out", theirs, code=None)
    Map.build(data, ours)
    assert Map.open(ours).inspect()["digest"] == Map.open(theirs).inspect()["digest"]
    images = sorted((data / "images").iterdir())
    compare_answers(command, ours, images)
    compare_answers(command, ours, images[:10], "--method", "static", method="static")
    many = chronotope.Localizer(ours).localize_many(images, threads=2)
    alone = chronotope.Localizer(ours)
    assert [it.to_json() for it in many] == [alone.localize(it).to_json() for it in images]


def test_real_data_of_doors_is_that_of_the_command(command: Command, real_data: pathlib.Path) -> None:
    for file in ("door/day7.csv.gz", "door2016/test_week_1.csv.gz"):
        compare_series(command, real_data / "series" / file)
