"""Does a robot know where it is, learn, and follow a way?"""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

import chronotope


def test_a_robot_answers_as_a_localizer_does(
    map_path: pathlib.Path, localizer: chronotope.Localizer, query
) -> None:
    with chronotope.Robot(map_path, index_cache="never") as robot:
        answer = robot.see(query[0], query[1])
        assert answer.to_json() == localizer.localize(query[0], query[1]).to_json()
        assert robot.place == query[2] and robot.path == map_path
        assert robot.totals["num_images"] == robot.totals["num_located"] == 1
        extract_s, localize_s = robot.timing_s
        assert extract_s > 0 and localize_s > 0 and len(robot.session) == 32
        assert "<svg" in answer._repr_html_()
    with pytest.raises(chronotope.ClosedError):
        robot.see(query[0], query[1])


@pytest.mark.parametrize("inline", [True, False])
def test_a_robot_learns_what_it_locates(
    map_path: pathlib.Path, street: chronotope.Street, inline: bool
) -> None:
    before = chronotope.Map.open(map_path).generation
    _, times = street.schedule(10, 3)
    with chronotope.Robot(map_path, learn=True, inline=inline, commit_every_s=0) as robot:
        for time in times:
            robot.see(street.render(street.places[0], time), time, now=time, name=str(time))
            if not inline:
                robot.commit()
        robot.commit()
        events = robot.events()
        session = robot.session
        totals = robot.totals
    assert totals["num_learnt"] == 3 and totals["num_held"] == 0
    assert {event["event"] for event in events} >= {"learnt", "committed"}
    with chronotope.Map.open(map_path) as map_:
        assert map_.generation > before
        assert map_.forget(session) == 3


def test_the_same_images_give_the_same_map(
    learnt: pathlib.Path, street: chronotope.Street, tmp_path: pathlib.Path
) -> None:
    import shutil

    _, times = street.schedule(10, 3)
    digests = []
    for name in ("one", "two"):
        path = tmp_path / f"{name}.map"
        shutil.copy(learnt, path)
        with chronotope.Robot(path, learn=True, inline=True, live=False) as robot:
            for time in times:
                robot.see(street.render(street.places[0], time), time)
        digests.append(chronotope.Map.open(path).inspect()["digest"])
    assert digests[0] == digests[1]


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        ({"track": True, "score": "count"}, chronotope.ConfigError),
        ({"track": {"kidnap": 3.0}}, chronotope.ConfigError),
        ({"learn": {"nonsense": 1}}, chronotope.ConfigError),
        ({"commit_every_s": -1.0}, chronotope.ConfigError),
        ({"commit_every_s": float("nan")}, chronotope.ConfigError),
        ({"mask": np.ones(3, np.uint8)}, chronotope.ShapeError),
    ],
)
def test_arguments_out_of_range_are_named(
    map_path: pathlib.Path, arguments: dict[str, object], kind: type[Exception]
) -> None:
    with pytest.raises(kind):
        chronotope.Robot(map_path, **arguments)  # type: ignore[arg-type]


def test_a_way_is_followed_by_robot_and_tracker(
    map_path: pathlib.Path, street: chronotope.Street
) -> None:
    _, times = street.schedule(10, 3)
    way = [(street.render(place, times[0]), times[0]) for place in street.places]
    localizer = chronotope.Localizer(map_path, index_cache="never")
    tracker = chronotope.Tracker(localizer)
    assert tracker.belief == {}
    with chronotope.Robot(map_path, track=True, index_cache="never") as robot:
        for image, time in way:
            tracked = tracker.update(localizer.localize(image, time))
            assert tracked.to_json() == robot.see(image, time).to_json()
    assert sum(tracker.belief.values()) + tracker.off_map == pytest.approx(1.0)
    tracker.reset()
    assert tracker.belief == {}
    static = chronotope.Localizer(map_path, config={"score": "count", "calibrated": False})
    with pytest.raises(chronotope.ConfigError):
        chronotope.Tracker(static).update(static.localize(*way[0]))


def test_bad_images_and_times_are_refused(map_path: pathlib.Path, query) -> None:
    robot = chronotope.Robot(map_path, index_cache="never")
    with pytest.raises(chronotope.ShapeError):
        robot.see(query[0].astype(float), query[1])
    with pytest.raises(chronotope.ShapeError):
        robot.see(np.zeros((240, 320), np.uint8), query[1])
    with pytest.raises(chronotope.TimeError):
        robot.see(query[0], "2024-05-01T08:30:00")
    with pytest.raises(TypeError):
        robot.see(query[0], None)  # type: ignore[arg-type]
    robot.close()
    robot.close()
