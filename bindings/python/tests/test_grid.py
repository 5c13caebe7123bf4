"""Do grids take maps in, predict them, keep them and say so as the command does?"""

from __future__ import annotations

import datetime
import os
import pathlib
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import chronotope
from chronotope import Grid

Command = Callable[..., list[dict[str, Any]]]

SHAPE, RESOLUTION, ORIGIN = (40, 60), 0.05, (-1.0, 2.0)
HOUR, DAY = 3600, 86_400
NOON, NIGHT = 30 * DAY + 13 * HOUR, 30 * DAY + 2 * HOUR
#: A cell of the cupboard, which is open from 8 to 18 o'clock, as (row, column).
DOOR = (7, 42)


def room(hour: int, moved: bool = False) -> np.ndarray:
    """A room as ROS has it, with a cupboard that is open by day. ``moved``: furniture stands somewhere else."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    wall = (y < 2) | (y >= 38) | (x < 2) | (x >= 58)
    inner = ((x == 20) & (y < 15)) | ((y == 25) & (x >= 30) & (x < 45))
    is_open = 8 <= hour % 24 < 18
    door = is_open & (y >= 6) & (y < 9) & (x >= 40) & (x < 46)
    table = moved & (x >= 8) & (x < 16) & (y >= 20) & (y < 28)
    cells = np.where(wall | inner | door | table, 100, 0).astype(np.int8)
    cells[39, 59] = -1
    return cells


def wrong(hour: int) -> np.ndarray:
    """The same turned by half a turn: walls stand where nothing was ever."""
    return np.ascontiguousarray(room(hour)[::-1, ::-1])


HOURS = range(0, 120, 3)


@pytest.fixture
def grid() -> Grid:
    """Five days, a map every three hours."""
    grid = Grid(SHAPE, RESOLUTION, ORIGIN)
    assert grid.observe_many([room(it) for it in HOURS], [it * HOUR for it in HOURS]) == 40
    return grid


@pytest.fixture
def path(grid: Grid, tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "room.grid"
    grid.save(path).close()
    return path


def write_map(folder: pathlib.Path, name: str, cells: np.ndarray) -> None:
    """A map of map_server: row 0 of its picture is the one with the highest y."""
    shades = np.select([cells == 100, cells == 0], [0, 254], 205).astype(np.uint8)
    head = f"P5 {cells.shape[1]} {cells.shape[0]} 255\n".encode()
    (folder / f"{name}.pgm").write_bytes(head + shades[::-1].tobytes())
    (folder / f"{name}.yaml").write_text(
        f"image: {name}.pgm\nresolution: {RESOLUTION}\norigin: [{ORIGIN[0]}, {ORIGIN[1]}, 0]\nnegate: 0\n"
        "mode: trinary\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def write_folder(folder: pathlib.Path, hours: Any, make: Callable[[int], np.ndarray]) -> pathlib.Path:
    folder.mkdir()
    rows = ["time,path,observer"]
    for hour in hours:
        write_map(folder, str(hour), make(hour))
        rows.append(f"{hour * HOUR},{hour}.yaml,robot")
    (folder / "index.csv").write_text("\n".join(rows) + "\n")
    return folder


def plain(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{k: v for k, v in it.items() if k != "line"} for it in lines]


def digest(grid: Grid) -> str:
    return str(grid.log()[-1]["digest"])


# Predictions


def test_day_and_night_are_predicted(grid: Grid) -> None:
    noon, night = grid.predict(NOON), grid.predict(NIGHT)
    assert noon.shape == SHAPE == grid.shape and noon.dtype == np.float32
    assert noon[DOOR] > 0.8 and night[DOOR] < 0.2
    assert np.isnan(noon[39, 59]) and np.isnan(noon).sum() == 1
    for hour, p in ((13, noon), (2, night)):
        assert (grid.occupancy(30 * DAY + hour * HOUR) == room(hour)).all(), hour
        assert ((p > 0.5) == (room(hour) == 100)).all()


def test_row_0_has_the_lowest_y(grid: Grid) -> None:
    assert grid.origin == (-1.0, 2.0, 0.0) and grid.resolution == RESOLUTION
    assert grid.center((0, 0)) == pytest.approx((-0.975, 2.025))
    x, y = grid.center(DOOR)
    assert (x, y) == pytest.approx((-1 + 42.5 * 0.05, 2 + 7.5 * 0.05))
    assert grid.cell((x, y)) == DOOR
    explained = grid.explain((x, y), NOON)
    assert explained.cell == (42, 7, 0) and explained.p == pytest.approx(float(grid.predict(NOON)[DOOR]))
    for outside in ((-1.01, 2.0), (float("nan"), 2.0)):
        with pytest.raises(chronotope.NotFoundError) as raised:
            grid.cell(outside)
        assert "it reaches from" in str(raised.value)
    for index in ((40, 0), (0, 60), (-1, 0), (0,), (0, 0, 0)):
        with pytest.raises(chronotope.ShapeError):
            grid.center(index)


def test_a_cell_is_explained(grid: Grid) -> None:
    found = grid.explain(grid.center(DOOR), NOON)
    assert (found.num_observed, found.num_occupied) == (40, 15)
    assert found.last_seen == datetime.datetime(1970, 1, 5, 21, tzinfo=datetime.timezone.utc)
    assert found.last_state == "free" and found.num_changes == 10
    assert found.tau_s is not None and 0 < found.persistence < 1
    assert found.rhythms[0, 0] == pytest.approx(DAY) and found.rhythms.shape == (2, 3)
    assert found.to_dict()["p"] == found.p and "p = " in repr(found)
    unseen = grid.explain(grid.center((39, 59)), NOON)
    assert unseen.p is None and unseen.last_seen is None and "never seen" in repr(unseen)


def test_rhythms_and_entropy_are_maps_and_bits(grid: Grid) -> None:
    period, amplitude = grid.rhythms()
    changing = np.zeros(SHAPE, bool)
    changing[6:9, 40:46] = True
    assert (np.isfinite(period) == changing).all() and (period[changing] == DAY).all()
    assert (amplitude[changing] > 0.2).all()
    with np.errstate(invalid="ignore", divide="ignore"):
        p = grid.predict(NOON).astype(float)
        bits = np.nan_to_num(-p * np.log2(p)) + np.nan_to_num(-(1 - p) * np.log2(1 - p))
    bits[39, 59] = 1
    assert grid.entropy(NOON) == pytest.approx(bits.sum())
    assert grid.entropy(NOON, (5, 38), (10, 50)) == pytest.approx(bits[5:10, 38:50].sum())
    for start, stop in (((5, 5), (5, 9)), ((5, 5), (4, 9)), ((0, 0), (41, 60)), ((-1, 0), (5, 5))):
        with pytest.raises(chronotope.ShapeError):
            grid.entropy(NOON, start, stop)


def test_other_models_predict_otherwise(grid: Grid) -> None:
    by = {}
    for model in ("fremen", "histogram", "folded", "mean", "last"):
        grid.set_model(model=model, persistence=0, parts=8)
        by[model] = float(grid.predict(NOON)[DOOR])
    assert by["mean"] == pytest.approx(15 / 40) and by["last"] == 0.0
    assert min(by["fremen"], by["histogram"], by["folded"]) > 0.7
    grid.set_model(base="week", parts=7, order=1, surprise=True)
    for wrong_model in ({"model": "spline"}, {"base": "month"}, {"order": 99}, {"persistence": 2.0}, {"parts": 0}):
        with pytest.raises(chronotope.ConfigError):
            grid.set_model(**wrong_model)
    with pytest.raises(chronotope.ConfigError):
        Grid(SHAPE, RESOLUTION, model="spline")


# What is given


def test_bool_percent_and_probabilities_are_the_same_map(grid: Grid) -> None:
    cells = room(10)
    p = np.where(cells < 0, np.nan, cells / 100)
    grids = []
    for given in (cells, p, p.astype(np.float32), p.astype(">f8"), cells == 100):
        other = Grid(SHAPE, RESOLUTION, ORIGIN)
        assert other.observe(given, 0).num_known == (2400 if given.dtype == bool else 2399)
        grids.append(other.occupancy(0))
    for found in grids[:4]:
        assert (found == cells).all()
    grids[4][39, 59] = -1
    assert (grids[4] == cells).all()


def test_thresholds_say_what_is_unknown() -> None:
    grid = Grid((1, 4), 1.0)
    assert grid.observe(np.array([[0.1, 0.3, 0.6, 0.9]]), 0).num_known == 2
    assert grid.occupancy(0).tolist() == [[0, -1, -1, 100]]
    assert grid.observe(np.array([[10, 30, 60, 90]], np.int8), 1, occupied=0.5, free=0.5).num_known == 4
    assert grid.occupancy(1).tolist() == [[0, 0, 100, 100]]
    with pytest.raises(chronotope.ConfigError):
        grid.observe(np.array([[0.1, 0.3, 0.6, 0.9]]), 2, occupied=0.2, free=0.5)


def test_views_and_read_only_arrays_are_read(grid: Grid) -> None:
    cells = room(10)
    wide = np.zeros((80, 120), np.int8)
    wide[::2, ::2] = cells
    locked = cells.copy()
    locked.flags.writeable = False
    turned = np.ascontiguousarray(cells[::-1])[::-1]
    for at, given in enumerate((wide[::2, ::2], locked, turned, np.asfortranarray(cells), cells.tolist())):
        other = Grid(SHAPE, RESOLUTION, ORIGIN)
        if isinstance(given, list):
            with pytest.raises(chronotope.ShapeError):
                other.observe(given, at)
            continue
        other.observe(given, at)
        assert (other.occupancy(at) == cells).all()


@pytest.mark.parametrize(
    "given",
    [
        room(0).astype(np.uint8),
        room(0).astype(np.int16),
        room(0).astype(np.int64),
        room(0).astype(complex),
        room(0).astype(object),
        room(0).astype("U3"),
        room(0)[:10],
        room(0).T,
        room(0)[0],
        room(0)[None],
        np.empty((0, 60), np.int8),
        np.ma.masked_array(room(0), room(0) < 0),
    ],
    ids=["uint8", "int16", "int64", "complex", "object", "text", "cut", "turned", "row", "stack", "empty", "masked"],
)
def test_what_is_no_map_is_refused_and_changes_nothing(grid: Grid, given: Any) -> None:
    with pytest.raises(chronotope.ShapeError) as raised:
        grid.observe(given, NOON)
    assert raised.value.kind == "shape" and raised.value.help and raised.value.place == "map"
    assert grid.num_observations == 40


def test_values_that_are_none_are_named_with_their_cell(grid: Grid) -> None:
    cells = room(0)
    cells[3, 5] = 101
    p = np.zeros(SHAPE)
    p[3, 5] = np.inf
    for given in (cells, p, np.where(p > 0, -0.1, p)):
        with pytest.raises(chronotope.ConfigError) as raised:
            grid.observe(given, NOON)
        assert raised.value.place == "map[3, 5]" and raised.value.help
    with pytest.raises(chronotope.ConfigError) as raised:
        grid.observe((room(0) == 100).astype(np.int8), NOON)
    assert "astype(bool)" in str(raised.value)
    for nothing in (None, "", 3):
        with pytest.raises((TypeError, chronotope.Error)):
            grid.observe(nothing, NOON)  # type: ignore[arg-type]
    assert grid.num_observations == 40


def test_a_bool_of_other_bytes_is_occupied() -> None:
    grid = Grid((1, 2), 1.0)
    grid.observe(np.array([[2, 0]], np.uint8).view(bool), 0)
    assert grid.occupancy(0).tolist() == [[100, 0]]


def test_a_part_of_the_grid_lies_where_it_is_said_to() -> None:
    grid = Grid((4, 6), 0.5, (1.0, 2.0))
    part = np.full((2, 2), 100, np.int8)
    grid.observe(part, 0, origin=(2.0, 2.5))
    assert np.argwhere(grid.occupancy(0) == 100).tolist() == [[1, 2], [1, 3], [2, 2], [2, 3]]
    for origin in ((2.1, 2.5), (9.0, 2.0), (float("nan"), 0.0), (1.0,)):
        with pytest.raises(chronotope.Error):
            grid.observe(part, 1, origin=origin)
    assert grid.num_observations == 1


@pytest.mark.parametrize(
    "time",
    [datetime.datetime(2024, 5, 1, 8), "2024-05-01T08:00:00", np.datetime64("NaT"), float("nan")],
    ids=["naive", "without-offset", "NaT", "NaN"],
)
def test_naive_times_are_refused(grid: Grid, time: Any) -> None:
    for call in (grid.predict, grid.occupancy, grid.entropy, grid.forget, lambda it: grid.observe(room(0), it)):
        with pytest.raises(chronotope.TimeError):
            call(time)
    with pytest.raises(chronotope.TimeError):
        grid.observe_many([room(0)], [time])
    assert grid.num_observations == 40


def test_times_of_every_kind_are_the_same(grid: Grid) -> None:
    aware = datetime.datetime(1970, 1, 31, 13, tzinfo=datetime.timezone.utc)
    kinds = (NOON, float(NOON), aware, np.datetime64(NOON, "s"), "1970-01-31T14:00:00+01:00")
    expected = grid.predict(NOON)
    for time in kinds:
        np.testing.assert_array_equal(grid.predict(time), expected)


def test_observations_may_come_in_any_order_and_once_more(grid: Grid) -> None:
    other = Grid(SHAPE, RESOLUTION, ORIGIN)
    for hour in reversed(HOURS):
        assert other.observe(room(hour), hour * HOUR).outcome == "integrated"
    np.testing.assert_array_equal(other.predict(NOON), grid.predict(NOON))
    again = other.observe(room(9), 9 * HOUR)
    assert again.outcome == "known" and other.num_observations == 40
    with pytest.raises(chronotope.ConflictError):
        other.observe(room(0), 9 * HOUR)
    assert other.observe(room(0), 9 * HOUR, observer="second").outcome == "integrated"
    assert other.num_observations == 41 and other.observers.count("second") == 1
    assert other.times_us.tolist() == sorted(other.times_us.tolist())


def test_an_observation_says_what_changed(grid: Grid) -> None:
    seen = grid.observe(room(130), 130 * HOUR)
    assert (seen.num_known, seen.num_changed, seen.num_hidden) == (2399, 18, 0)
    assert seen.to_dict()["num_changed"] == 18 and "18 of them changed" in repr(seen)


def test_many_maps_are_taken_all_or_none(grid: Grid) -> None:
    stack = np.stack([room(it) for it in (200, 203)])
    with pytest.raises(chronotope.ShapeError) as raised:
        grid.observe_many(stack, [200 * HOUR])
    assert "2 maps and 1 times" in str(raised.value)
    with pytest.raises(chronotope.ShapeError) as raised:
        grid.observe_many([room(200), room(203)[:5]], [200 * HOUR, 203 * HOUR])
    assert raised.value.place == "maps[1]"
    percent = room(203)
    percent[3, 5] = 101
    with pytest.raises(chronotope.ConfigError) as raised:
        grid.observe_many([room(200), percent], [200 * HOUR, 203 * HOUR])
    assert raised.value.place == "maps[1][3, 5]"
    with pytest.raises(chronotope.ConflictError):
        grid.observe_many([room(200), room(0)], [200 * HOUR, 9 * HOUR])
    assert grid.num_observations == 40
    assert grid.observe_many(stack, np.array([200, 203]) * HOUR) == 2
    assert grid.observe_many(stack, np.array([200, 203]) * HOUR) == 0


def test_a_grid_has_bounds() -> None:
    for arguments in (
        ((0, 5), 0.1),
        ((5, 5), 0.0),
        ((5, 5), float("nan")),
        ((5, 5), -1.0),
        ((-5, 5), 0.1),
        ((5,), 0.1),
        ((5, 5), 0.1, (0.0, 0.0, 0.0)),
        ((5, 5), 0.1, (float("inf"), 0.0)),
        ((1 << 20, 1 << 20), 0.1),
        ((1 << 40, 1), 0.1),
    ):
        with pytest.raises((chronotope.ConfigError, chronotope.ShapeError)):
            Grid(*arguments)  # type: ignore[arg-type]


def test_voxels_are_layers_rows_and_columns(tmp_path: pathlib.Path) -> None:
    grid = Grid((2, 3, 4), 0.5, (0.0, 1.0, 2.0))
    assert grid.shape == (2, 3, 4) and grid.center((1, 2, 3)) == pytest.approx((1.75, 2.25, 2.75))
    voxels = np.zeros((2, 3, 4), np.int8)
    voxels[1, 2, 3] = 100
    grid.observe(voxels, 0)
    assert (grid.occupancy(0) == voxels).all() and grid.cell((1.75, 2.25, 2.75)) == (1, 2, 3)
    with pytest.raises(chronotope.ShapeError):
        grid.observe(voxels[0], 1)
    with pytest.raises(chronotope.ShapeError):
        grid.export(0, tmp_path / "solid.yaml")
    grid.export(0, tmp_path / "solid.ply")
    again = Grid((2, 3, 4), 0.5, (0.0, 1.0, 2.0))
    with pytest.raises(chronotope.ConfigError) as raised:
        again.observe(tmp_path / "solid.ply", 0)
    assert "voxel=0.1" in str(raised.value)
    for call in (
        lambda: grid.plan((0.1, 1.1), (1.0, 2.0), 0),
        lambda: grid.localizer(0, first=0.0, step=0.1, max_range=5.0),
        lambda: grid.map_of_scans([1.0], [0.0, 0.0, 0.0], first=0.0, step=0.1, max_range=5.0),
    ):
        with pytest.raises(chronotope.ShapeError):
            call()
    kept = grid.save(tmp_path / "solid.grid")
    with pytest.raises(chronotope.ShapeError):
        kept.add(voxels, 1)
    assert kept.add(voxels, 1, trust=True).outcome == "integrated" and kept.num_observations == 2


# Files


def test_a_grid_in_a_file_predicts_what_one_in_memory_does(grid: Grid, path: pathlib.Path) -> None:
    with Grid.open(path) as kept:
        assert (kept.path, kept.generation, kept.read_only) == (path, 1, False)
        np.testing.assert_array_equal(kept.predict(NOON), grid.predict(NOON))
        for target in (kept, grid):
            target.observe(room(130), 130 * HOUR)
        np.testing.assert_array_equal(kept.predict(NOON), grid.predict(NOON))
        assert kept.generation == 2
    assert kept.closed and "closed" in repr(kept)
    with Grid.open(path, read_only=True) as kept:
        assert kept.num_observations == 41 and kept.read_only and "41 observations" in repr(kept)
        np.testing.assert_array_equal(kept.predict(NOON), grid.predict(NOON))
        with pytest.raises(chronotope.Error):
            kept.observe(room(133), 133 * HOUR)
        assert kept.num_observations == 41
    assert grid.path is None and grid.generation is None and "in memory" in repr(grid)


def test_a_closed_grid_says_so(grid: Grid, path: pathlib.Path) -> None:
    kept = Grid.open(path)
    for closed in (kept, grid):
        closed.close()
        closed.close()
        for call in (
            lambda: closed.predict(NOON),
            lambda: closed.observe(room(0), NOON),
            lambda: closed.add(room(0), NOON),
            lambda: closed.num_observations,
            lambda: closed.inspect(),
            lambda: closed.log(),
            lambda: closed.held(),
            lambda: closed.save(path.with_name("other.grid")),
            lambda: Grid.merge([closed]),
        ):
            with pytest.raises(chronotope.ClosedError):
                call()


def test_what_is_no_grid_is_named(tmp_path: pathlib.Path, map_path: pathlib.Path) -> None:
    other = tmp_path / "other.grid"
    for content in (b"", b"no grid", b"SQLite format 3\0" + bytes(4080)):
        other.write_bytes(content)
        with pytest.raises((chronotope.FormatError, chronotope.IoError)) as raised:
            Grid.open(other)
        assert raised.value.path == str(other)
    with pytest.raises(chronotope.FormatError):
        Grid.open(map_path)
    for missing in (Grid.open, Grid.verify_file):
        with pytest.raises(FileNotFoundError):
            missing(tmp_path / "none.grid")


def test_damage_is_named(path: pathlib.Path) -> None:
    assert Grid.verify_file(path)["clean"] and Grid.open(path).verify()["faults"] == []
    data = bytearray(path.read_bytes())
    # Where pages keep their rows: at their ends.
    for at in range(3 * 4096 - 64, len(data), 4096):
        data[at] ^= 0xFF
    path.write_bytes(data)
    report = Grid.verify_file(path)
    assert report["clean"] is False and report["faults"]
    with pytest.raises(chronotope.FormatError):
        Grid.open(path)


def test_a_grid_is_never_overwritten(grid: Grid, path: pathlib.Path, tmp_path: pathlib.Path) -> None:
    before = path.read_bytes()
    folder = write_folder(tmp_path / "maps", [0, 3], room)
    for call in (
        lambda: grid.save(path),
        lambda: Grid.build(folder, path),
        lambda: Grid.merge([path, path], path),
    ):
        with pytest.raises(FileExistsError):
            call()
    assert path.read_bytes() == before


@pytest.mark.skipif(os.name == "nt", reason="open files cannot be moved")
def test_a_file_that_was_moved_away_or_replaced_is_not_written(grid: Grid, path: pathlib.Path) -> None:
    kept = Grid.open(path)
    path.rename(path.with_name("moved.grid"))
    with pytest.raises(chronotope.Error):
        kept.observe(room(130), 130 * HOUR)
    grid.save(path)
    with pytest.raises(chronotope.Error):
        kept.add(room(130), 130 * HOUR)
    assert kept.num_observations == 40
    assert kept.refresh() == 1
    assert kept.observe(room(130), 130 * HOUR).outcome == "integrated"
    assert Grid.open(path.with_name("moved.grid")).num_observations == 40
    path.unlink()
    Grid((5, 5), 1.0).save(path)
    with pytest.raises(chronotope.ConflictError):
        kept.refresh()


def test_two_who_write_see_each_other_after_refresh(path: pathlib.Path) -> None:
    one, other = Grid.open(path), Grid.open(path)
    one.observe(room(130), 130 * HOUR)
    with pytest.raises(chronotope.ConflictError):
        other.observe(room(133), 133 * HOUR)
    assert other.refresh() == 2 and other.num_observations == 41
    assert other.observe(room(133), 133 * HOUR).outcome == "integrated"


def test_generations_are_listed_and_returned_to(path: pathlib.Path) -> None:
    grid = Grid.open(path)
    before = digest(grid)
    assert grid.forget(60 * HOUR) == 20 and grid.num_observations == 20
    assert digest(grid) != before and grid.predict(NOON)[DOOR] > 0.5
    assert grid.rollback(1) == 3 and digest(grid) == before and grid.num_observations == 40
    assert [it["number"] for it in grid.log()] == [0, 1, 2, 3]
    assert grid.forget(0) == 0 and grid.generation == 3
    num_before = len(grid.log())
    assert grid.prune(keep_last=1) == num_before - len(grid.log()) > 0
    assert grid.log()[-1]["number"] == 3 and grid.num_observations == 40
    with pytest.raises(chronotope.NotFoundError):
        grid.rollback(99)
    memory = Grid((2, 2), 1.0)
    for call in (memory.log, memory.verify, memory.held, memory.refresh, lambda: memory.rollback(0), memory.prune):
        with pytest.raises(chronotope.ConfigError) as raised:
            call()
        assert "save" in str(raised.value)


def test_forgetting_in_memory_is_forgetting_in_a_file(grid: Grid, path: pathlib.Path) -> None:
    kept = Grid.open(path)
    assert grid.forget(60 * HOUR) == kept.forget(60 * HOUR) == 20
    np.testing.assert_array_equal(grid.predict(NOON), kept.predict(NOON))


def test_merging_is_a_union_in_any_order(tmp_path: pathlib.Path, grid: Grid) -> None:
    parts = []
    for at in range(3):
        part = Grid(SHAPE, RESOLUTION, ORIGIN)
        hours = list(HOURS)[at::2]
        part.observe_many([room(it) for it in hours], [it * HOUR for it in hours])
        parts.append(part.save(tmp_path / f"{at}.grid"))
    one = Grid.merge(parts, tmp_path / "one.grid")
    other = Grid.merge([tmp_path / f"{at}.grid" for at in (2, 0, 1)], tmp_path / "other.grid")
    assert digest(one) == digest(other) and one.num_observations == 40
    memory = Grid.merge([parts[0], tmp_path / "1.grid"])
    for merged in (one, memory):
        np.testing.assert_array_equal(merged.predict(NOON), grid.predict(NOON))
    assert parts[0].include(grid) == 20 and parts[0].num_observations == 40
    assert digest(parts[0]) == digest(one)
    with pytest.raises(chronotope.ConfigError) as raised:
        Grid.merge([grid, parts[0]], tmp_path / "none.grid")
    assert raised.value.place == "grids[0]"
    with pytest.raises(chronotope.ShapeError):
        Grid.merge([grid, Grid((5, 5), 1.0)])
    with pytest.raises(chronotope.ConfigError):
        Grid.merge([])


# The guard


def test_a_doubtful_map_is_kept_in_quarantine(path: pathlib.Path) -> None:
    grid = Grid.open(path)
    good = grid.add(room(120), 120 * HOUR, observer="robot")
    assert good.outcome == "integrated" and good.reason is None and good.limit is not None
    doubtful = grid.add(wrong(123), 123 * HOUR, observer="robot")
    assert doubtful.outcome == "quarantined" and doubtful.num_maps == 0
    assert doubtful.reason in ("contradiction", "shift") and "usual" in doubtful.why
    assert doubtful.to_dict()["id"] == doubtful.id and "quarantined" in repr(doubtful)
    assert grid.num_observations == 41
    assert grid.add(room(120), 120 * HOUR, observer="robot").outcome == "known"
    assert grid.add(wrong(123), 123 * HOUR, observer="robot").outcome == "quarantined"
    again = Grid.open(path)
    held = again.held()
    assert [it["id"] for it in held] == [doubtful.id] and held[0]["reason"] == doubtful.reason
    with pytest.raises(chronotope.NotFoundError):
        again.accept(["zz"])
    assert again.accept([doubtful.id[:8]]) == 1
    assert again.held() == [] and again.num_observations == 42
    assert again.rollback(again.log()[1]["number"]) and again.num_observations == 40


def test_quarantined_maps_are_dropped_or_adopted(path: pathlib.Path) -> None:
    grid = Grid.open(path)
    grid.add(wrong(120), 120 * HOUR)
    assert grid.drop_held() == 1 and grid.held() == [] and grid.num_observations == 40
    # Furniture that was moved comes again and again.
    outcomes = [grid.add(room(it, moved=True), it * HOUR).outcome for it in (123, 126, 129)]
    assert outcomes == ["quarantined", "quarantined", "adopted"]
    assert grid.num_observations == 43 and grid.held() == []
    assert grid.add(wrong(132), 132 * HOUR, trust=True).outcome == "integrated"
    memory = Grid(SHAPE, RESOLUTION, ORIGIN)
    with pytest.raises(chronotope.ConfigError) as raised:
        memory.add(room(0), 0)
    assert "save" in str(raised.value) and memory.num_observations == 0


def test_a_folder_of_maps_is_one_generation(path: pathlib.Path, tmp_path: pathlib.Path) -> None:
    folder = write_folder(tmp_path / "more", (126, 123, 120), lambda it: wrong(it) if it == 123 else room(it))
    grid = Grid.open(path)
    verdicts = grid.add_folder(folder)
    assert [it.outcome for it in verdicts] == ["integrated", "quarantined", "integrated"]
    assert [it.observer for it in verdicts] == ["robot"] * 3 and grid.generation == 2
    (folder / "126.pgm").write_bytes(b"P5 3")
    with pytest.raises(chronotope.FormatError):
        Grid.open(path).add_folder(folder)
    with pytest.raises(FileNotFoundError):
        grid.add_folder(tmp_path / "none")
    assert grid.generation == 2


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_leaves_the_grid_as_it_was(path: pathlib.Path, tmp_path: pathlib.Path) -> None:
    from test_manners import interrupted

    folder = write_folder(tmp_path / "more", range(120, 2520, 3), room)
    code, said, took_s = interrupted(
        """
        import sys, chronotope
        grid = chronotope.Grid.open(sys.argv[1])
        print("ready", flush=True)
        grid.add_folder(sys.argv[2])
        """,
        tmp_path,
        path,
        folder,
    )
    if code == 0:
        pytest.skip("it had finished before Ctrl-C came")
    assert "KeyboardInterrupt" in said and took_s < 20
    assert Grid.open(path).generation == 1 and Grid.verify_file(path)["clean"]


# A robot


def walls() -> Grid:
    """An empty room of 6 m x 4 m, known to be so."""
    grid = Grid((80, 120), 0.05)
    cells = np.zeros((80, 120), np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    cells[:30, 40:44] = 100
    grid.observe(cells, 0)
    return grid


def cast(cells: np.ndarray, pose: tuple[float, float, float], angles: np.ndarray) -> np.ndarray:
    """What a laser measures: the way to the first occupied cell."""
    x, y, heading = pose
    steps = np.arange(0, 10, 0.01)[:, None]
    px, py = x + steps * np.cos(heading + angles), y + steps * np.sin(heading + angles)
    row = np.clip((py / 0.05).astype(int), 0, 79)
    column = np.clip((px / 0.05).astype(int), 0, 119)
    hit = cells[row, column] == 100
    ranges: np.ndarray = steps[hit.argmax(axis=0), 0]
    return ranges


LASER = {"first": -np.pi / 2, "step": np.pi / 180, "max_range": 81.0}
ANGLES = -np.pi / 2 + np.pi / 180 * np.arange(181)


def test_scans_become_a_map() -> None:
    grid = Grid((20, 40), 0.1)
    one = grid.map_of_scans([1.08], (0.55, 0.95, 0.0), first=0.0, step=0.1, max_range=8.0)
    assert one.shape == (20, 40) and one.dtype == np.float32
    assert (one[9, 5:16] < 0.1).all() and one[9, 16] > 0.9 and np.isnan(one[9, 18:]).all() and np.isnan(one[0]).all()
    grid.observe(one, 0)
    assert grid.occupancy(0)[9, 16] == 100
    nothing = grid.map_of_scans([np.nan], (0.55, 0.95, 0.0), first=0.0, step=0.1, max_range=8.0)
    assert np.isnan(nothing).all()
    several = grid.map_of_scans(np.full((5, 1), 1.08), [(0.55, 0.95, 0.0)] * 5, first=0.0, step=0.1, max_range=8.0)
    assert 0.1 < several[9, 10] < 0.2 and several[9, 16] > 0.9
    for ranges, poses, kind in (
        ([[1.0]], (0.0, 0.0, 0.0), chronotope.ShapeError),
        ([1.0], (0.0, 0.0), chronotope.ShapeError),
        ([[1.0], [1.0, 2.0]], [(0.0, 0.0, 0.0)] * 2, chronotope.ShapeError),
        (["a"], (0.0, 0.0, 0.0), chronotope.ShapeError),
        ([1.0], (float("nan"), 0.0, 0.0), chronotope.ConfigError),
    ):
        with pytest.raises(kind):
            grid.map_of_scans(ranges, poses, first=0.0, step=0.1, max_range=8.0)  # type: ignore[arg-type]
    for wrong_laser in ({"max_range": 0.0}, {"step": float("nan")}, {"sensor": "magic"}):
        laser = {"first": 0.0, "step": 0.1, "max_range": 8.0, **wrong_laser}
        with pytest.raises(chronotope.ConfigError):
            grid.map_of_scans([1.0], (0.0, 0.0, 0.0), **laser)


def test_a_robot_is_localised_and_the_same_seed_is_the_same() -> None:
    grid = walls()
    cells = grid.occupancy(0)
    ways = [(1.0 + 0.25 * at, 2.5, 0.0) for at in range(8)]
    found = []
    for _ in range(2):
        localizer = grid.localizer(0, **LASER, pose=ways[0], seed=4)
        estimates = [localizer.see(cast(cells, way, ANGLES), way) for way in ways]
        x, y, heading = estimates[-1].pose
        assert abs(x - ways[-1][0]) < 0.1 and abs(y - 2.5) < 0.1 and abs(heading) < 0.05
        assert estimates[-1].share > 0.9 and estimates[-1].deviation_m < 0.2
        particles = localizer.particles
        assert particles.shape[1] == 4 and particles[:, 3].sum() == pytest.approx(1)
        assert "particles" in repr(localizer) and "PoseEstimate" in repr(estimates[-1])
        found.append([it.to_dict() for it in estimates])
    assert found[0] == found[1]
    anywhere = grid.localizer(0, **LASER)
    assert len(anywhere.particles) > len(localizer.particles)
    with pytest.raises(chronotope.ShapeError):
        anywhere.see([[1.0]], ways[0])
    with pytest.raises(chronotope.ConfigError):
        anywhere.see([1.0], (float("nan"), 0.0, 0.0))
    with pytest.raises(chronotope.NotFoundError):
        Grid((5, 5), 1.0).localizer(0, **LASER)


def test_a_way_leads_round_what_will_be_there() -> None:
    grid = walls()
    path = grid.plan((1.0, 0.5), (4.0, 0.5), 0, radius=0.1)
    assert path is not None and path.length_m > 3.5 and 0.9 < path.p_free <= 1
    assert path.xy.shape == (len(path), 2) and path.times_us.shape == (len(path),)
    assert path.xy[0] == pytest.approx(grid.center(grid.cell((1.0, 0.5))))
    assert (path.arrival.timestamp() - path.length_m / 0.5) == pytest.approx(0, abs=0.01)
    assert (path.xy[:, 1] > 1.5).any() and "GridPath" in repr(path)
    assert grid.plan((1.0, 0.5), (4.0, 0.5), 0, radius=3.0) is None
    with pytest.raises(chronotope.NotFoundError):
        grid.plan((1.0, 0.5), (40.0, 0.5), 0)
    for wrong_number in ({"speed": 0.0}, {"radius": -1.0}):
        with pytest.raises(chronotope.ConfigError):
            grid.plan((1.0, 0.5), (4.0, 0.5), 0, **wrong_number)


def test_an_office_is_the_same_on_every_machine() -> None:
    office = chronotope.Office(seed=3, resolution=0.1)
    monday = 4 * DAY
    day, night = office.render(monday + 13 * HOUR), office.render(monday + 3 * HOUR)
    assert day.dtype == np.int8 and set(np.unique(day)) <= {-1, 0, 100} and (day != night).any()
    assert (office.render(monday + 13 * HOUR) == day).all()
    assert (chronotope.Office(seed=3, resolution=0.1).render(monday + 3 * HOUR) == night).all()
    grid = office.grid()
    assert grid.shape == day.shape and grid.observe(day, monday).num_known == (day >= 0).sum()
    (ax, ay), (bx, by) = office.places
    assert day[grid.cell((ax, ay))] == 0 and day[grid.cell((bx, by))] == 0
    with pytest.raises(chronotope.ConfigError):
        chronotope.Office(resolution=0.0)


# Threads


def test_threads_share_a_grid(grid: Grid) -> None:
    times = [NOON, NIGHT] * 8
    expected = [grid.predict(it) for it in times]
    with ThreadPoolExecutor(4) as pool:
        for found, right in zip(pool.map(grid.predict, times), expected):
            np.testing.assert_array_equal(found, right)
        hours = range(300, 360, 3)
        list(pool.map(lambda it: grid.observe(room(it), it * HOUR), hours))
    assert grid.num_observations == 60


# The command


@pytest.fixture
def built(command: Command, tmp_path: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    """The same folder, built by the command and by Python."""
    folder = write_folder(tmp_path / "maps", HOURS, room)
    theirs, ours = tmp_path / "theirs.grid", tmp_path / "ours.grid"
    command("grid", "build", "--maps", folder, "--out", theirs)
    Grid.build(folder, ours).close()
    return theirs, ours


def test_a_grid_is_that_of_the_command(
    command: Command, built: tuple[pathlib.Path, pathlib.Path], grid: Grid
) -> None:
    theirs, ours = built
    one, other = Grid.open(theirs), Grid.open(ours)
    assert digest(one) == digest(other)
    np.testing.assert_array_equal(other.predict(NOON), grid.predict(NOON))
    assert [other.inspect()] == plain(command("grid", "inspect", ours, "--json"))
    assert [other.verify()] == plain(command("grid", "verify", ours, "--json"))
    assert other.log() == plain(command("grid", "log", ours, "--json"))


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_an_exported_map_is_that_of_the_command(
    command: Command, built: tuple[pathlib.Path, pathlib.Path], mode: str, tmp_path: pathlib.Path
) -> None:
    time = "1970-01-31T13:00:00Z"
    (tmp_path / "theirs").mkdir()
    (tmp_path / "ours").mkdir()
    command("grid", "predict", built[0], "--time", time, "--out", tmp_path / "theirs/now.yaml", "--mode", mode)
    grid = Grid.open(built[1])
    grid.export(time, tmp_path / "ours/now.yaml", mode=mode)
    names = sorted(it.name for it in (tmp_path / "theirs").iterdir())
    assert names == sorted(it.name for it in (tmp_path / "ours").iterdir()) and len(names) == 2
    for name in names:
        assert (tmp_path / "ours" / name).read_bytes() == (tmp_path / "theirs" / name).read_bytes()
    if mode == "trinary":
        head, pixels = b"P5\n60 40\n255\n", (tmp_path / "ours/now.pgm").read_bytes()
        shades = np.frombuffer(pixels[len(head) :], np.uint8).reshape(SHAPE)[::-1]
        expected = np.select([room(13) == 100, room(13) == 0], [0, 254], 205)
        assert pixels.startswith(head) and (shades == expected).all()
    with pytest.raises(chronotope.ConfigError):
        grid.export(time, tmp_path / "ours/now.yaml", mode="colours")


@pytest.mark.parametrize(
    ("options", "model"),
    [
        ([], {}),
        (["--model", "histogram", "--parts", "12"], {"model": "histogram", "parts": 12}),
        (["--base", "week", "--order", "1", "--surprise"], {"base": "week", "order": 1, "surprise": True}),
        (["--no-persistence"], {"persistence": 0}),
        (["--persistence", "0.5"], {"persistence": 0.5}),
    ],
)
def test_an_explanation_is_that_of_the_command(
    command: Command, built: tuple[pathlib.Path, pathlib.Path], options: list[str], model: dict[str, Any]
) -> None:
    grid = Grid.open(built[1], **model)
    time = "1970-01-06T13:00:00Z"
    for index in (DOOR, (0, 0), (39, 59)):
        x, y = grid.center(index)
        said = command("grid", "explain", built[1], "--at", x, y, "--time", time, "--json", *options)
        assert grid.explain((x, y), time).to_json() == said[0]["line"]
    said = command("grid", "predict", built[1], "--time", time, "--json", *options)
    assert grid.entropy(time) == said[0]["entropy_bits"]
    assert int((grid.predict(time) > 0.5).sum()) == said[0]["num_occupied"]


def test_a_quarantine_is_that_of_the_command(
    command: Command, built: tuple[pathlib.Path, pathlib.Path], tmp_path: pathlib.Path
) -> None:
    theirs, ours = built
    folder = write_folder(tmp_path / "more", (120, 123, 126), lambda it: wrong(it) if it == 123 else room(it))
    said = command("grid", "add", theirs, "--maps", folder, "--json", code=1)[0]
    grid = Grid.open(ours)
    verdicts = grid.add_folder(folder)
    assert said["quarantined"] == [it.id for it in verdicts if it.outcome == "quarantined"] != []
    assert said["num_added"] == 2 and digest(grid) == digest(Grid.open(theirs))
    held = command("grid", "quarantine", "list", ours, "--json")
    assert grid.held() == plain(held)
    # One map at a time, of a file and as an array, comes to the same.
    again = ours.with_name("again.grid")
    Grid.build(tmp_path / "maps", again).close()
    with Grid.open(again) as one_by_one:
        one_by_one.add(folder / "120.yaml", 120 * HOUR, observer="robot")
        one_by_one.add(wrong(123), 123 * HOUR, observer="robot")
        one_by_one.add(room(126).astype(float) / np.where(room(126) < 0, np.nan, 100), 126 * HOUR, observer="robot")
        assert digest(one_by_one) == digest(grid)
    command("grid", "quarantine", "accept", theirs, "--all")
    assert grid.accept() == 1 and digest(grid) == digest(Grid.open(theirs))


def test_merging_and_forgetting_are_those_of_the_command(
    command: Command, built: tuple[pathlib.Path, pathlib.Path], tmp_path: pathlib.Path
) -> None:
    folder = write_folder(tmp_path / "later", range(200, 230, 3), room)
    later = tmp_path / "later.grid"
    Grid.build(folder, later).close()
    command("grid", "merge", built[0], later, "--out", tmp_path / "one.grid")
    ours = Grid.merge([later, built[1]], tmp_path / "other.grid")
    assert digest(ours) == digest(Grid.open(tmp_path / "one.grid"))
    command("grid", "forget", tmp_path / "one.grid", "--before", "1970-01-03T00:00:00Z")
    ours.forget("1970-01-03T00:00:00Z")
    assert digest(ours) == digest(Grid.open(tmp_path / "one.grid"))


def test_a_way_and_a_pose_are_those_of_the_command(command: Command, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "walls.grid"
    grid = walls().save(path)
    time = "2024-05-01T08:00:00Z"
    said = command("grid", "plan", path, "--from", 1, 0.5, "--to", 4, 0.5, "--time", time, "--radius", 0.1, "--json")
    found = grid.plan((1.0, 0.5), (4.0, 0.5), time, radius=0.1)
    assert found is not None and found.to_json() == said[0]["line"]
    cells, ways, lines = grid.occupancy(time), [(1.0 + 0.25 * at, 2.5, 0.0) for at in range(6)], []
    scans = [np.round(cast(cells, way, ANGLES), 2) for way in ways]
    for at, (way, scan) in enumerate(zip(ways, scans)):
        numbers = [*scan, *way, *way, at]
        text = " ".join(f"{it:.2f}" for it in numbers)
        lines.append(f"FLASER {len(scan)} {text} host {at}.0")
    (tmp_path / "run.log").write_text("\n".join(lines) + "\n")
    localizer = grid.localizer(time, **LASER, pose=ways[0])
    estimates = [localizer.see(scan.astype(np.float32), way) for way, scan in zip(ways, scans)]
    said = command(
        *("grid", "localize", path, "--log", tmp_path / "run.log", "--time", time),
        *("--at", *ways[0], "--json"),
        code=None,
    )
    for line in said:
        line.pop("log_s")
    assert [it.to_dict() for it in estimates] == plain(said) and len(said) == 6


def test_a_copy_is_the_same_grid(path: pathlib.Path, tmp_path: pathlib.Path) -> None:
    shutil.copy(path, tmp_path / "copy.grid")
    np.testing.assert_array_equal(Grid.open(path).predict(NOON), Grid.open(tmp_path / "copy.grid").predict(NOON))
