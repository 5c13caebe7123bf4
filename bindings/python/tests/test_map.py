"""Is a map file opened, learnt, looked into and changed as the documentation says?"""

from __future__ import annotations

import json
import multiprocessing
import os
import pathlib
import shutil

import numpy as np
import pytest

import chronotope
from chronotope import Map


def test_a_built_map_knows_its_places(learnt: pathlib.Path, street: chronotope.Street) -> None:
    map_ = Map.open(learnt)
    assert [place.name for place in map_.places] == sorted(street.places)
    assert len(map_) == 3 and street.places[0] in map_ and "nowhere" not in map_
    place = map_[street.places[0]]
    assert place.xy.shape == (len(place), 2) and place.descriptors.shape == (len(place), 32)
    assert place.visit_times_us.shape == (10,)
    assert len(place.visit_sources) == len(place.visit_ids) == len(place.visit_sessions) == 10
    seen = place.seen()
    assert seen.shape == (10, len(place)) and set(np.unique(seen)) <= {-1, 0, 1}
    assert map_.edges and map_.generation >= 1
    assert "3 places" in repr(map_) and street.places[0] in repr(place)


def test_paths_of_any_kind_open_a_map(learnt: pathlib.Path) -> None:
    for path in (learnt, str(learnt)):
        assert Map.open(path).path == learnt
    assert Map.open(learnt, read_only=True).read_only
    with pytest.raises(TypeError):
        Map.open(3)  # type: ignore[arg-type]


def test_a_closed_map_says_so(map_path: pathlib.Path) -> None:
    with Map.open(map_path) as map_:
        assert not map_.closed
    assert map_.closed and "closed" in repr(map_)
    for call in (
        lambda: map_.places,
        lambda: map_.generation,
        map_.inspect,
        map_.log,
        map_.verify,
        map_.refresh,
        lambda: map_.rollback(0),
        lambda: len(map_),
        lambda: chronotope.Localizer(map_),
        lambda: chronotope.Learner(map_),
    ):
        with pytest.raises(chronotope.ClosedError) as raised:
            call()
        assert raised.value.kind == "closed" and "Map.open" in str(raised.value)
    map_.close()


def test_what_was_read_outlives_a_closed_map(map_path: pathlib.Path, query) -> None:
    map_ = Map.open(map_path)
    place, localizer = map_.places[0], chronotope.Localizer(map_)
    map_.close()
    assert len(place) > 0
    assert localizer.localize(query[0], query[1]).place == query[2]


@pytest.mark.parametrize(
    ("content", "kinds"),
    [
        (b"", (chronotope.FormatError,)),
        (b"no map", (chronotope.FormatError,)),
        (b"SQLite format 3\0" + bytes(4080), (chronotope.FormatError, chronotope.IoError)),
    ],
)
def test_what_is_no_map_is_named(
    tmp_path: pathlib.Path, content: bytes, kinds: tuple[type[chronotope.Error], ...]
) -> None:
    path = tmp_path / "other.map"
    path.write_bytes(content)
    with pytest.raises(kinds) as raised:
        Map.open(path)
    assert raised.value.path == str(path)


def test_a_missing_map_is_not_found(tmp_path: pathlib.Path) -> None:
    for call in (Map.open, Map.verify_file, chronotope.Localizer, chronotope.Robot):
        with pytest.raises(FileNotFoundError):
            call(tmp_path / "none.map")


def test_a_damaged_map_is_refused_and_the_damage_named(map_path: pathlib.Path) -> None:
    data = bytearray(map_path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    map_path.write_bytes(data)
    report = Map.verify_file(map_path)
    assert report["clean"] is False and report["faults"]
    with pytest.raises(chronotope.FormatError) as raised:
        Map.open(map_path)
    assert raised.value.path == str(map_path)


def test_an_intact_map_is_clean(map_path: pathlib.Path) -> None:
    assert Map.verify_file(map_path)["clean"] is True
    assert Map.open(map_path).verify()["faults"] == []


def test_a_map_is_never_overwritten(folder: pathlib.Path, map_path: pathlib.Path) -> None:
    before = map_path.read_bytes()
    other = map_path.with_name("other.map")
    shutil.copy(map_path, other)
    for call in (
        lambda: Map.build(folder, map_path),
        lambda: Map.create(map_path),
        lambda: Map.merge([map_path, other], map_path),
    ):
        with pytest.raises(FileExistsError) as raised:
            call()
        assert raised.value.help
    assert map_path.read_bytes() == before


def test_every_commit_is_a_generation_that_one_returns_to(map_path: pathlib.Path) -> None:
    map_ = Map.open(map_path)
    names = [place.name for place in map_.places]
    before = map_.generation
    assert map_.rename_place(names[0], "gate") == before + 1
    assert "gate" in map_ and names[0] not in map_
    assert map_.rollback(before) == before + 2
    assert names[0] in map_ and "gate" not in map_
    log = map_.log()
    assert log[-1]["is_rollback"] and log[-1]["number"] == before + 2
    assert map_.prune(keep_last=1)[0] > 0
    with pytest.raises(chronotope.NotFoundError):
        map_.rollback(999)


def test_places_are_joined_and_removed(map_path: pathlib.Path) -> None:
    map_ = Map.open(map_path)
    first, second, third = (place.name for place in map_.places)
    map_.remove_place(third)
    assert len(map_) == 2
    num_visits = sum(len(place.visit_ids) for place in map_.places)
    map_.join_places(first, second)
    assert len(map_) == 1 and len(map_[first].visit_ids) == num_visits
    with pytest.raises(chronotope.NotFoundError) as raised:
        map_.place("nowhere")
    assert first in str(raised.value)


def test_edges_are_added_and_removed(map_path: pathlib.Path) -> None:
    map_ = Map.open(map_path)
    first, second = (place.name for place in map_.places[:2])
    before = map_.edges
    map_.add_edge(first, second, name="corridor")
    assert (first, second, "corridor") in map_.edges
    map_.remove_edge(first, second, name="corridor")
    assert sorted(map_.edges) == sorted(before)
    with pytest.raises(LookupError):
        map_.remove_edge(first, second, name="corridor")
    with pytest.raises(chronotope.Error):
        map_.add_edge(first, "nowhere")


def test_maps_of_two_days_become_one(
    street: chronotope.Street, tmp_path: pathlib.Path
) -> None:
    learn, _ = street.schedule(8, 1)
    paths = []
    for name, times in (("even", learn[::2]), ("odd", learn[1::2])):
        data = chronotope.write_street(street, tmp_path / name, times)
        paths.append(tmp_path / f"{name}.map")
        Map.build(data, paths[-1], keep_appearances="all")
    merged = Map.merge(paths, tmp_path / "year.map")
    assert len(merged) == 3
    assert sum(len(place.visit_ids) for place in merged.places) == 3 * 8
    # A map that is open will do; the order means nothing.
    with Map.open(paths[1]) as odd:
        again = Map.merge([odd, paths[0]], tmp_path / "again.map")
    assert again.inspect()["digest"] == merged.inspect()["digest"]
    relearnt = Map.merge(paths, tmp_path / "relearnt.map", relearn=True)
    assert len(relearnt) == 3


def test_strangers_are_merged_only_if_that_is_said(
    learnt: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    other = chronotope.Street(seed=99, num_places=2)
    learn, _ = other.schedule(4, 1)
    data = chronotope.write_street(other, tmp_path / "other", learn)
    path = tmp_path / "other.map"
    with Map.build(data, path) as map_:
        for place in map_.places:
            map_.rename_place(place.name, f"park-{place.name}")
    with pytest.raises(chronotope.ConfigError, match="disjoint"):
        Map.merge([learnt, path], tmp_path / "town.map")
    assert len(Map.merge([learnt, path], tmp_path / "town.map", disjoint=True)) == 5


@pytest.mark.parametrize("maps", [[], ["a.map"]])
def test_fewer_than_two_maps_are_not_merged(maps: list[str], tmp_path: pathlib.Path) -> None:
    with pytest.raises(chronotope.ConfigError):
        Map.merge(maps, tmp_path / "out.map")


def test_a_map_learns_more_and_nothing_twice(
    map_path: pathlib.Path, queries: pathlib.Path
) -> None:
    map_ = Map.open(map_path)
    report = map_.update(queries)
    assert report.num_learnt + report.num_held + report.num_same_visit == 9
    assert report.problems == [] and "visits learnt" in repr(report)
    generation = map_.generation
    again = map_.update(queries)
    assert again.num_learnt == 0 and map_.generation == generation


def test_what_is_left_out_is_listed(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    data = tmp_path / "data"
    shutil.copytree(folder, data)
    images = sorted((data / "images").iterdir())
    images[0].write_bytes(b"broken")
    images[1].write_bytes(b"")
    with Map.build(data, tmp_path / "street.map") as map_:
        assert map_.learnt is not None
        assert len(map_.learnt.problems) == 2
        assert any(images[0].name in problem for problem in map_.learnt.problems)
    assert Map.open(tmp_path / "street.map").learnt is None


def test_nothing_to_learn_leaves_nothing_behind(tmp_path: pathlib.Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    (data / "index.csv").write_text("place,time,path\nhome,2024-05-01T08:30:00Z,none.png\n")
    with pytest.raises(chronotope.FormatError, match="no image"):
        Map.build(data, tmp_path / "street.map")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]
    with pytest.raises(chronotope.Error):
        Map.build(tmp_path / "nowhere", tmp_path / "street.map")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"preset": "best"}, "lttl"),
        ({"config": {"features-per-visits": 3}}, "features-per-visits"),
        ({"config": {"features-per-visit": -1}}, "config"),
        ({"config": 3}, "dictionary"),
        ({"keep_appearances": "some"}, "experiences"),
        ({"threads": 0}, "threads"),
        ({"zone": "Europe/Nowhere"}, "Nowhere"),
    ],
)
def test_arguments_out_of_range_are_named(
    folder: pathlib.Path, tmp_path: pathlib.Path, arguments: dict[str, object], words: str
) -> None:
    with pytest.raises(chronotope.Error) as raised:
        Map.build(folder, tmp_path / "street.map", **arguments)  # type: ignore[arg-type]
    assert words in str(raised.value)


def test_visits_that_are_not_believed_are_held(
    map_path: pathlib.Path, street: chronotope.Street, tmp_path: pathlib.Path
) -> None:
    data = tmp_path / "dark"
    _, query = street.schedule(10, 3)
    chronotope.write_street(street, data, query[:1])
    for image in (data / "images").iterdir():
        head = image.read_bytes()[:15]
        image.write_bytes(head + bytes(448 * 384))
    map_ = Map.open(map_path)
    report = map_.update(data)
    held = map_.held()
    assert report.num_held == len(held) == 3
    assert all("black" in visit["reason"] for visit in held)
    map_.drop_held([held[0]["visit"][:8]])
    assert len(map_.held()) == 2
    map_.accept([held[1]["visit"]])
    map_.drop_held()
    assert map_.held() == []
    with pytest.raises(chronotope.NotFoundError):
        map_.accept(["ffffffff"])


def test_what_a_map_predicts(map_path: pathlib.Path, query) -> None:
    map_ = Map.open(map_path)
    predicted = map_.predict(query[2], query[1], n=20)
    assert len(predicted) == 20 and predicted.place == query[2] and predicted.time == query[1]
    assert predicted.xy.shape == (20, 2) and predicted.ids.shape == predicted.p.shape == (20,)
    assert ((predicted.p >= 0) & (predicted.p <= 1)).all()
    p, low, high = predicted.estimate.T
    assert (low <= p).all() and (p <= high).all()
    many = map_.predict_many(query[2], [query[1], "2024-12-20T20:00:00Z"], n=20)
    assert many[0].to_dict() == predicted.to_dict() and len(many) == 2
    candidates = {"base-s": 31_556_952.0, "count": 4}
    yearly = {"model": {"kind": "fremen", "candidates": candidates, "order": 1}}
    summer, winter = map_.predict_many(
        query[2], ["2024-06-20T12:00:00Z", "2024-12-20T12:00:00Z"], config={"visibility": yearly}
    )
    assert summer.ids.tolist() != winter.ids.tolist()
    assert "<svg" in predicted._repr_html_()
    for bad in (lambda: map_.predict("nowhere", 0), lambda: map_.predict(query[2], "now")):
        with pytest.raises(chronotope.Error):
            bad()
    with pytest.raises(chronotope.ConfigError, match="n"):
        map_.predict(query[2], 0, n=0)


def test_a_map_is_calibrated_once(map_path: pathlib.Path) -> None:
    map_ = Map.open(map_path)
    assert map_.calibrate() == 30
    assert map_.calibrate() is None


def test_a_map_goes_through_plain_files(map_path: pathlib.Path, tmp_path: pathlib.Path) -> None:
    map_ = Map.open(map_path)
    map_.export(tmp_path / "plain")
    again = Map.import_folder(tmp_path / "plain", tmp_path / "again.map")
    assert again.inspect()["digest"] == map_.inspect()["digest"]


def test_a_map_replaced_on_disk_is_noticed(
    map_path: pathlib.Path, folder: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    map_ = Map.open(map_path)
    first = map_.places[0].name
    other = Map.create(tmp_path / "other.map", name="another map")
    other.close()
    os.replace(tmp_path / "other.map", map_path)
    # What was read stays; what is asked of the file is an error, never a mixture.
    assert map_[first].name == first
    for ask in [map_.refresh, lambda: map_.rename_place(first, "gate")]:
        with pytest.raises(chronotope.Error, match="replaced since it was opened") as caught:
            ask()
        assert caught.value.path == str(map_path)
    assert len(Map.open(map_path)) == 0
    assert Map.verify_file(map_path)["clean"] is True


def _rename(path: str, start: object) -> None:
    start.wait()  # type: ignore[attr-defined]
    with Map.open(path) as map_:
        map_.add_edge(map_.places[0].name, map_.places[1].name, name="by another process")


def test_two_processes_write_one_map(map_path: pathlib.Path) -> None:
    context = multiprocessing.get_context("spawn")
    start = context.Event()
    others = [context.Process(target=_rename, args=(str(map_path), start)) for _ in range(2)]
    map_ = Map.open(map_path)
    generation = map_.generation
    for other in others:
        other.start()
    start.set()
    map_.add_edge(map_.places[1].name, map_.places[0].name, name="by this one")
    for other in others:
        other.join()
        assert other.exitcode == 0
    assert map_.refresh() > generation
    names = [name for _, _, name in map_.edges]
    assert "by this one" in names and "by another process" in names


def test_a_map_survives_threads(map_path: pathlib.Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    map_ = Map.open(map_path)
    first, second = (place.name for place in map_.places[:2])
    with ThreadPoolExecutor(4) as pool:
        done = [pool.submit(map_.add_edge, first, second, name=str(at)) for at in range(8)]
        assert len({future.result() for future in done}) == 8
    assert sum(name.isdigit() for _, _, name in map_.edges) == 8


def test_a_read_only_file_is_not_written(map_path: pathlib.Path, queries: pathlib.Path) -> None:
    map_ = Map.open(map_path, read_only=True)
    with pytest.raises(chronotope.Error):
        map_.rename_place(map_.places[0].name, "gate")
    with pytest.raises(OSError):
        map_.update(queries)


def test_dictionaries_are_json(learnt: pathlib.Path) -> None:
    map_ = Map.open(learnt)
    for value in (map_.inspect(), map_.verify(), map_.log(), map_.held()):
        assert json.loads(json.dumps(value)) == value
