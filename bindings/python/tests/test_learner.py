"""Are labelled images learnt one by one?"""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

import chronotope


def test_a_learner_makes_a_map_that_locates(
    street: chronotope.Street, tmp_path: pathlib.Path, query
) -> None:
    path = tmp_path / "street.map"
    map_ = chronotope.Map.create(path, name="street")
    learn, _ = street.schedule(6, 1)
    with chronotope.Learner(map_, session="year") as learner:
        for time in learn:
            for place in street.places:
                learnt = learner.observe(place, street.render(place, time), time, name="a")
        assert learnt["num_seen"] > 0 and learnt["doubt"] is None
        assert map_.generation == 0
    assert map_.refresh() == 1 and len(map_) == 3
    answer = chronotope.Localizer(map_).localize(query[0], query[1])
    assert answer.best is not None and answer.best.place == query[2]


def test_features_are_learnt_as_their_image_is(
    street: chronotope.Street, tmp_path: pathlib.Path
) -> None:
    learn, _ = street.schedule(3, 1)
    digests = []
    for name in ("pixels", "features"):
        map_ = chronotope.Map.create(tmp_path / f"{name}.map", name="street")
        with chronotope.Learner(map_) as learner:
            for time in learn:
                image = street.render(street.places[0], time)
                given = image if name == "pixels" else chronotope.extract(image)
                learner.observe("home", given, time)
        map_.refresh()
        digests.append(map_.inspect()["num_features"])
    assert digests[0] == digests[1]
    with pytest.raises(chronotope.ShapeError, match="image_size"):
        bare = chronotope.Features(np.zeros((1, 2)), np.zeros((1, 32), np.uint8))
        chronotope.Learner(tmp_path / "pixels.map").observe("home", bare, 0)


def test_a_file_is_learnt_as_its_pixels_are(
    street: chronotope.Street, tmp_path: pathlib.Path
) -> None:
    pil = pytest.importorskip("PIL.Image")
    time = street.schedule(1, 1)[0][0]
    image = street.render(street.places[0], time)
    path = tmp_path / "a.png"
    pil.fromarray(image).save(path)
    mask = np.full(image.shape, 255, np.uint8)
    mask[:, : image.shape[1] // 2] = 0
    born = []
    for name, given in (("pixels", image), ("path", path), ("text", str(path))):
        map_ = chronotope.Map.create(tmp_path / f"{name}.map", name="street")
        with chronotope.Learner(map_) as learner:
            born.append(learner.observe("home", given, time, mask=mask)["num_born"])
    assert born[0] > 0
    assert born == born[:1] * 3
    (tmp_path / "b.png").write_text("no image")
    learner = chronotope.Learner(tmp_path / "path.map")
    for missing, kind in (("b.png", chronotope.FormatError), ("c.png", chronotope.NotFoundError)):
        with pytest.raises(kind, match=missing):
            learner.observe("home", tmp_path / missing, time)


def test_the_same_visit_is_not_learnt_twice(map_path: pathlib.Path, query) -> None:
    learner = chronotope.Learner(map_path)
    learner.observe(query[2], query[0], query[1])
    again = None
    try:
        again = learner.observe(query[2], query[0], query[1])
    except chronotope.AlreadyExistsError:
        pass
    assert again is None or again["is_same_visit"]


def test_what_was_learnt_is_committed_now_and_then(map_path: pathlib.Path, query) -> None:
    map_ = chronotope.Map.open(map_path)
    learner = chronotope.Learner(map_, commit_every_s=0)
    learner.observe(query[2], query[0], query[1])
    assert map_.refresh() == learner.commit()
    learner.close()
    with pytest.raises(chronotope.ClosedError):
        learner.observe(query[2], query[0], query[1])


@pytest.mark.parametrize("place", ["", "a\nb", "x" * 300])
def test_names_that_are_none_are_refused(map_path: pathlib.Path, query, place: str) -> None:
    with pytest.raises(chronotope.ConfigError, match="name"):
        chronotope.Learner(map_path).observe(place, query[0], query[1])


def test_bad_images_and_times_change_nothing(map_path: pathlib.Path, query) -> None:
    learner = chronotope.Learner(map_path)
    before = learner.commit()
    for image, time, kind in (
        (query[0].astype(float), query[1], chronotope.ShapeError),
        (np.zeros((240, 320), np.uint8), query[1], chronotope.ShapeError),
        (query[0], "2024-05-01T08:30:00", chronotope.TimeError),
        (query[0], float("nan"), chronotope.TimeError),
        (query[0], None, TypeError),
    ):
        with pytest.raises(kind):
            learner.observe(query[2], image, time)  # type: ignore[arg-type]
    assert learner.commit() == before
