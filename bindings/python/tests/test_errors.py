"""Are errors exceptions that Python people can use?"""

from __future__ import annotations

import copy
import logging
import pickle

import pytest

import chronotope
from chronotope._errors import _OF_KIND, error_of_kind


@pytest.mark.parametrize(("kind", "class_"), sorted(_OF_KIND.items()))
def test_every_kind_is_a_class_that_keeps_what_it_was_told(
    kind: str, class_: type[chronotope.Error]
) -> None:
    error = error_of_kind(kind, "no map", "street.map", "row 3", "restore a copy")
    assert type(error) is class_ and isinstance(error, chronotope.Error)
    assert (error.kind, error.message, error.path) == (kind, "no map", "street.map")
    assert (error.place, error.help) == ("row 3", "restore a copy")
    assert str(error) == "street.map: row 3: no map (help: restore a copy)"
    assert str(error_of_kind(kind, "no map")) == "no map"


@pytest.mark.parametrize("class_", sorted(set(_OF_KIND.values()), key=lambda it: it.__name__))
def test_exceptions_go_through_pickle_and_copy(class_: type[chronotope.Error]) -> None:
    error = class_("no map", "format", "a", "b", "c")
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(again) is class_ and str(again) == str(error) and again.help == "c"


def test_python_s_own_classes_catch_them() -> None:
    assert issubclass(chronotope.NotFoundError, (FileNotFoundError, LookupError))
    assert issubclass(chronotope.AlreadyExistsError, FileExistsError)
    assert issubclass(chronotope.IoError, OSError)
    for class_ in (chronotope.ShapeError, chronotope.TimeError, chronotope.ConfigError):
        assert issubclass(class_, ValueError)
    assert issubclass(chronotope.ChecksumError, chronotope.FormatError)


def test_the_engine_tells_the_log(
    map_path, queries, caplog: pytest.LogCaptureFixture
) -> None:
    images = sorted((queries / "images").iterdir())
    (map_path.parent / "index.csv").write_text("nonsense")
    copied = map_path.parent / images[0].name
    copied.write_bytes(images[0].read_bytes())
    localizer = chronotope.Localizer(map_path, index_cache="never")
    with caplog.at_level(logging.WARNING, logger="chronotope"):
        localizer.localize(copied, 0)
    assert any("index above" in record.getMessage() for record in caplog.records)
    assert {record.name for record in caplog.records} == {"chronotope"}
    caplog.clear()
    with caplog.at_level(logging.ERROR, logger="chronotope"):
        localizer.localize(copied, 0)
    assert caplog.records == []


def test_the_street_has_bounds() -> None:
    for arguments in ({"num_places": 0}, {"num_places": 1001}, {"image_size": (10, 10)}):
        with pytest.raises(chronotope.ConfigError):
            chronotope.Street(**arguments)  # type: ignore[arg-type]
    street = chronotope.Street(num_places=1)
    with pytest.raises(chronotope.NotFoundError):
        street.render("nowhere", 0)
    assert (street.render(street.places[0], 0) == street.render(street.places[0], 0)).all()
