"""Does a localizer say where an image was taken, in every form that it takes?"""

from __future__ import annotations

import json
import pathlib
import shutil

import numpy as np
import pytest

import chronotope
from chronotope import Localizer


def test_an_answer_has_all_of_its_evidence(localizer: Localizer, query) -> None:
    image, time, place = query
    answer = localizer.localize(image, time, name="now")
    assert answer.decision == "at" and answer.place == place and answer.region == [place]
    assert answer.best is not None and answer.best.place == answer.ranking[0].place == place
    assert len(answer.ranking) == len(answer.places) == 3
    assert answer.posterior.sum() + answer.off_map == pytest.approx(1.0)
    assert answer.scores[0] == answer.best.score and answer.tied == 1
    assert answer.time == time and answer.time_source == "option" and answer.name == "now"
    assert answer.truth is None and answer.method == "fremen" and answer.pairs_compared > 0
    assert answer.displacement_px is not None and answer.displacement_spread_px is not None
    assert place in repr(answer) and "posterior" in repr(answer.best)
    with pytest.raises(AttributeError):
        answer.place = "elsewhere"  # type: ignore[misc]


def test_a_prior_names_places_and_decides_nothing_alone(localizer: Localizer, query) -> None:
    image, time, place = query
    plain = localizer.localize(image, time)
    for prior in ([place], [it for it in localizer.places if it != place], [], (place, place)):
        answer = localizer.localize(image, time, prior=prior)
        assert answer.place == place and answer.scores[0] == plain.scores[0]
    with pytest.raises(chronotope.NotFoundError, match="no place `nowhere`"):
        localizer.localize(image, time, prior=[place, "nowhere"])
    with pytest.raises(TypeError):
        localizer.localize(image, time, prior=place)


def test_matches_are_a_structured_array(localizer: Localizer, query) -> None:
    answer = localizer.localize(query[0], query[1])
    matches = answer.matches
    assert len(matches) == answer.num_matches
    assert int(matches["inlier"].sum()) == answer.num_inliers
    assert matches.dtype.names[:2] == ("feature", "live")
    assert (matches["distance_bits"] <= 256).all() and (matches["p"] <= 1).all()
    live = answer.features.xy[matches["live"]]
    assert (live == np.stack([matches["live_x"], matches["live_y"]], axis=1)).all()
    inliers = matches[matches["inlier"]]
    moved = np.median(inliers["live_x"] - inliers["map_x"])
    assert answer.displacement_px is not None
    assert moved == pytest.approx(answer.displacement_px[0], abs=2)
    assert len(answer.unexpected) == len(answer.features) - answer.num_inliers
    assert len(answer.missing_xy) == len(answer.ranking[0].predicted) - answer.num_inliers
    assert not matches.flags.writeable


def test_the_map_is_known_by_path_and_by_object(learnt: pathlib.Path, query) -> None:
    of_path = Localizer(learnt, index_cache="never")
    of_text = Localizer(str(learnt), index_cache="never")
    of_map = Localizer(chronotope.Map.open(learnt))
    answers = {it.localize(query[0], query[1]).to_json() for it in (of_path, of_text, of_map)}
    assert len(answers) == 1


def test_images_of_any_kind_have_one_answer(
    localizer: Localizer, query, tmp_path: pathlib.Path
) -> None:
    pil = pytest.importorskip("PIL.Image")
    image, time, _ = query
    path = tmp_path / "now.pgm"
    path.write_bytes(b"P5 448 384 255\n" + image.tobytes())
    colour = np.repeat(image[..., None], 3, axis=2)
    features = localizer.extract(image)
    assert len(features) == 600 and features == chronotope.extract(image)
    expected = localizer.localize(image, time).to_dict()
    for other in (colour, pil.fromarray(image), features):
        assert localizer.localize(other, time).to_dict() == expected
    for other in (path, str(path)):
        assert localizer.localize(other, time).to_dict() == {**expected, "image": str(path)}


def test_a_file_knows_its_time_by_its_index(
    localizer: Localizer, queries: pathlib.Path, street: chronotope.Street
) -> None:
    for path in sorted((queries / "images").iterdir())[:3]:
        answer = localizer.localize(path)
        assert answer.time_source == "index" and answer.truth in street.places
        assert [it.to_json() for it in localizer.localize_file(path)] == [answer.to_json()]


def test_an_index_that_changes_is_read_again(
    localizer: Localizer, queries: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    data = tmp_path / "data"
    shutil.copytree(queries, data)
    path = sorted((data / "images").iterdir())[0]
    before = localizer.localize(path).time
    index = data / "index.csv"
    index.write_text(index.read_text().replace("2024-", "2025-"))
    import os

    os.utime(index, (0, 0))
    after = localizer.localize(path).time
    assert before is not None and after is not None and after.year == before.year + 1


@pytest.mark.parametrize("method", ["static", "fused", "experience", "experience-all", "freex"])
def test_every_method_answers(learnt: pathlib.Path, query, method: str) -> None:
    localizer = Localizer(learnt, method=method, index_cache="never")
    assert localizer.method == method
    answer = localizer.localize(query[0], query[1])
    assert answer.method == method
    assert answer._repr_html_()


def test_methods_without_a_clock_need_no_time(learnt: pathlib.Path, query) -> None:
    localizer = Localizer(learnt, method="static", index_cache="never")
    answer = localizer.localize(query[0])
    assert answer.place == query[2] and answer.time is None and answer.time_source is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"method": "best"}, "fremen"),
        ({"score": "best"}, "likelihood"),
        ({"n": 0}, "n"),
        ({"risk": 0.0}, "risk"),
        ({"risk": 1.5}, "risk"),
        ({"risk": float("nan")}, "risk"),
        ({"config": {"methods": "static"}}, "methods"),
        ({"config": {"risk": "high"}}, "config"),
        ({"config": []}, "dictionary"),
        ({"index_cache": "often"}, "auto"),
    ],
)
def test_arguments_out_of_range_are_named(
    learnt: pathlib.Path, arguments: dict[str, object], words: str
) -> None:
    with pytest.raises(chronotope.ConfigError) as raised:
        Localizer(learnt, **arguments)  # type: ignore[arg-type]
    assert words in str(raised.value)


def test_what_is_in_effect_can_be_read_and_given_back(learnt: pathlib.Path, query) -> None:
    localizer = Localizer(learnt, n=30, risk=0.2, config={"time-bucket-s": 0}, index_cache="never")
    assert localizer.config["risk"] == 0.2 and localizer.config["time-bucket-s"] == 0
    again = Localizer(learnt, config=localizer.config, index_cache="never")
    assert again.config == localizer.config
    answers = [it.localize(query[0], query[1]).to_json() for it in (localizer, again)]
    assert answers[0] == answers[1]


def test_a_missing_or_naive_time_is_refused(localizer: Localizer, query) -> None:
    import datetime

    for time in (None, datetime.datetime(2024, 5, 1), "2024-05-01T08:30:00"):
        with pytest.raises(chronotope.TimeError) as raised:
            localizer.localize(query[0], time)
        assert raised.value.help


def test_a_file_without_a_time_is_refused(
    localizer: Localizer, query, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / "now.pgm"
    path.write_bytes(b"P5 448 384 255\n" + query[0].tobytes())
    with pytest.raises(chronotope.TimeError, match="give time") as raised:
        localizer.localize(path)
    assert raised.value.path == str(path)


def test_an_image_of_another_shape_does_not_fit(localizer: Localizer, query) -> None:
    with pytest.raises(chronotope.ShapeError):
        localizer.localize(np.zeros((100, 448), np.uint8), query[1])


def test_an_image_of_the_same_shape_is_scaled(localizer: Localizer, query) -> None:
    large = np.repeat(np.repeat(query[0], 2, axis=0), 2, axis=1)
    answer = localizer.localize(np.ascontiguousarray(large), query[1])
    assert answer.place == query[2] and answer.features.image_size == (448, 384)


def test_what_is_masked_is_not_used(localizer: Localizer, query) -> None:
    mask = np.ones(query[0].shape, bool)
    mask[:, :200] = False
    answer = localizer.localize(query[0], query[1], mask=mask)
    assert (answer.features.xy[:, 0] >= 199).all()


def test_an_image_of_nothing_is_unknown(localizer: Localizer, query) -> None:
    answer = localizer.localize(np.zeros_like(query[0]), query[1])
    assert answer.decision == "unknown" and answer.place is None
    assert len(answer.matches) == 0 and answer.displacement_px is None
    assert "unknown" in answer._repr_html_()


def test_many_images_have_the_answers_of_each(localizer: Localizer, street) -> None:
    _, times = street.schedule(10, 3)
    images = [street.render(place, time) for time in times for place in street.places]
    when = [time for time in times for _ in street.places]
    alone = [localizer.localize(*pair).to_json() for pair in zip(images, when)]
    for threads in (None, 1, 2, 3):
        many = localizer.localize_many(images, when, threads=threads)
        assert [answer.to_json() for answer in many] == alone
    stack = np.stack(images)
    stamps = np.array([time.replace(tzinfo=None) for time in when], "datetime64[us]")
    assert [it.to_json() for it in localizer.localize_many(stack, stamps)] == alone
    assert localizer.localize_many([], []) == []


def test_many_files_have_the_answers_of_each(localizer: Localizer, queries: pathlib.Path) -> None:
    paths = sorted((queries / "images").iterdir())
    many = localizer.localize_many(paths)
    assert [it.to_json() for it in many] == [localizer.localize(it).to_json() for it in paths]


def test_one_bad_image_of_many_is_named_or_returned(localizer: Localizer, query) -> None:
    image, time, place = query
    bad = [image, np.zeros((4, 4)), image]
    with pytest.raises(chronotope.ShapeError) as raised:
        localizer.localize_many(bad, [time] * 3)
    assert raised.value.place == "images[1]"
    answers = localizer.localize_many(bad, [time] * 3, errors="return")
    assert [type(it).__name__ for it in answers] == ["Localization", "ShapeError", "Localization"]
    assert answers[0].place == place and "images[1]" in str(answers[1])


@pytest.mark.parametrize(
    ("times", "kind", "place"),
    [
        (["2024-05-01T08:30:00Z"], chronotope.ShapeError, "times"),
        (["2024-05-01T08:30:00Z", "2024-05-01T08:30:00"], chronotope.TimeError, "times[1]"),
        ([0.0, float("nan")], chronotope.TimeError, "times[1]"),
        (None, chronotope.TimeError, "images[0]"),
    ],
)
def test_times_of_many_images_have_to_fit(
    localizer: Localizer, query, times: object, kind: type[chronotope.Error], place: str
) -> None:
    with pytest.raises(kind) as raised:
        localizer.localize_many([query[0], query[0]], times)  # type: ignore[arg-type]
    assert raised.value.place == place


@pytest.mark.parametrize(("argument", "value"), [("threads", 0), ("errors", "ignore")])
def test_arguments_for_many_images_are_checked(
    localizer: Localizer, argument: str, value: object
) -> None:
    with pytest.raises(chronotope.ConfigError):
        localizer.localize_many([], **{argument: value})  # type: ignore[arg-type]


def test_progress_is_told(localizer: Localizer, query) -> None:
    told: list[tuple[int, int]] = []
    localizer.localize_many(
        [query[0]] * 9, [query[1]] * 9, threads=1, progress=lambda *it: told.append(it)
    )
    assert told[-1] == (9, 9) and [done for done, _ in told] == sorted(done for done, _ in told)


def test_times_out_of_order_change_nothing(localizer: Localizer, street) -> None:
    _, times = street.schedule(10, 3)
    image = street.render(street.places[0], times[0])
    forwards = [localizer.localize(image, time).to_json() for time in times]
    backwards = [localizer.localize(image, time).to_json() for time in reversed(times)]
    assert forwards == backwards[::-1]


def test_a_dictionary_is_the_json(localizer: Localizer, query) -> None:
    answer = localizer.localize(query[0], query[1])
    assert json.loads(answer.to_json()) == answer.to_dict()
    assert len(answer.to_dict(top=2)["ranking"]) == 2 and "ranking" not in answer.to_dict()


def test_a_notebook_shows_the_picture(localizer: Localizer, query, tmp_path) -> None:
    answer = localizer.localize(query[0], query[1], name="<now>")
    html = answer._repr_html_()
    assert "data:image/jpeg;base64," in html and "off the map" in html and "&lt;now&gt;" in html
    assert html.count("<circle") == (
        answer.num_inliers + len(answer.missing_xy) + len(answer.unexpected)
    )
    bare = localizer.localize(chronotope.extract(query[0]), query[1])
    assert "data:image" not in bare._repr_html_() and "<circle" in bare._repr_html_()


def test_what_is_said_of_a_localizer(localizer: Localizer, street) -> None:
    assert localizer.places == sorted(street.places) and localizer.image_size == (448, 384)
    assert "fremen" in repr(localizer) and localizer.generation >= 1
