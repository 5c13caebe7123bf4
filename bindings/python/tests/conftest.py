"""A street that is learnt once, and the command to compare with."""

from __future__ import annotations

import json
import os
import pathlib
import shutil
import subprocess
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import chronotope

NUM_LEARN, NUM_QUERY = 10, 3


@pytest.fixture(scope="session")
def street() -> chronotope.Street:
    return chronotope.Street(seed=7, num_places=3)


@pytest.fixture(scope="session")
def folder(street: chronotope.Street, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Images to learn from, with an index."""
    learn, _ = street.schedule(NUM_LEARN, NUM_QUERY)
    return chronotope.write_street(street, tmp_path_factory.mktemp("street") / "learn", learn)


@pytest.fixture(scope="session")
def queries(street: chronotope.Street, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Images of the next year, with an index."""
    _, query = street.schedule(NUM_LEARN, NUM_QUERY)
    return chronotope.write_street(street, tmp_path_factory.mktemp("street") / "query", query)


@pytest.fixture(scope="session")
def learnt(folder: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A map of the street; tests that change it take a copy."""
    path = tmp_path_factory.mktemp("map") / "street.map"
    chronotope.Map.build(folder, path).close()
    return path


@pytest.fixture
def map_path(learnt: pathlib.Path, tmp_path: pathlib.Path) -> pathlib.Path:
    """A copy of the map of the street."""
    path = tmp_path / "street.map"
    shutil.copy(learnt, path)
    return path


@pytest.fixture(scope="session")
def localizer(learnt: pathlib.Path) -> chronotope.Localizer:
    return chronotope.Localizer(learnt, index_cache="never")


@pytest.fixture(scope="session")
def query(street: chronotope.Street) -> tuple[np.ndarray, Any, str]:
    """An image, its time, and the place that it shows."""
    _, times = street.schedule(NUM_LEARN, NUM_QUERY)
    place = street.places[1]
    return street.render(place, times[0]), times[0], place


@pytest.fixture(scope="session")
def command() -> Callable[..., list[dict[str, Any]]]:
    """Runs the command and gives its lines of JSON, each also as text under `line`."""
    path = os.environ.get("CHRONOTOPE_COMMAND")
    if path is None:
        pytest.skip("CHRONOTOPE_COMMAND names no command to compare with; scripts/python.sh sets it")

    def run(*arguments: Any, code: int | None = 0) -> list[dict[str, Any]]:
        done = subprocess.run(
            [path, *map(str, arguments)], capture_output=True, text=True, check=False
        )
        if code is not None:
            assert done.returncode == code, done.stderr
        assert done.returncode != 2, done.stderr
        lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
        return [{"line": line, **json.loads(line)} for line in lines]

    return run


@pytest.fixture(scope="session")
def real_data() -> pathlib.Path:
    """The folder of real data sets."""
    path = os.environ.get("CHRONOTOPE_DATA")
    if path is None:
        pytest.skip("CHRONOTOPE_DATA names no data")
    return pathlib.Path(path)
