"""Is a map whose times only number its visits localised without a clock, as the command does?"""

from __future__ import annotations

import pathlib
from collections.abc import Callable
from typing import Any

import chronotope


def test_times_that_only_number_visits_are_not_used(
    street: chronotope.Street, tmp_path: pathlib.Path, command: Callable[..., list[dict[str, Any]]]
) -> None:
    learn, query = street.schedule(6, 1)
    data = chronotope.write_street(street, tmp_path / "data", learn)
    index = data / "index.csv"
    times = sorted({line.split(",")[1] for line in index.read_text().splitlines()[1:]})
    text = index.read_text()
    for number, time in enumerate(times):
        text = text.replace(time, f"1970-01-{number // 3 + 1:02d}T00:0{number % 3}:00Z")
    index.write_text(text)
    # Nothing of a year that no camera knew is refused if it is said that these are no moments.
    path = tmp_path / "street.map"
    chronotope.Map.build(data, path, config={"guard": {"clock": "ignore", "judge": "never"}}).close()
    image = street.render(street.places[0], query[0])
    localizer = chronotope.Localizer(path, index_cache="never")
    assert localizer.method == "static"
    assert chronotope.Localizer(chronotope.Map.open(path)).method == "static"
    assert chronotope.Localizer(path, method="fremen", index_cache="never").method == "fremen"
    with chronotope.Robot(path, index_cache="never") as robot:
        assert robot.see(image, query[0]).method == "static"
    file = tmp_path / "now.pgm"
    file.write_bytes(b"P5 448 384 255\n" + image.tobytes())
    lines = command("localize", path, file, "--json", code=None)
    assert localizer.localize(file).to_json() == lines[0]["line"]
