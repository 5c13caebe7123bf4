"""How does the rendered street become a folder of images?"""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from ._chronotope import Street
from ._types import PathLike

if TYPE_CHECKING:
    import pathlib

#: From one place to the next, at walking pace.
_WALK = datetime.timedelta(minutes=5)


def write_street(street: Street, folder: PathLike, times: Iterable[Any]) -> pathlib.Path:
    """Writes a round along ``street`` at each of ``times`` as images with an ``index.csv``.

    Each place is visited five minutes after the one before. ``times`` are aware datetimes, as
    ``Street.schedule`` gives them. Images are PGM files; neighbours are joined in ``edges.csv``. For
    ``Map.build`` and for the command ``chronotope map build --data``.
    """
    # Imported where they are needed: `import chronotope` is quick.
    import csv
    import pathlib

    folder = pathlib.Path(folder)
    (folder / "images").mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, str, str]] = []
    for start in times:
        for at, place in enumerate(street.places):
            time = start + at * _WALK
            image = street.render(place, time)
            name = f"images/{place}-{time:%Y%m%dT%H%M%S}.pgm"
            height, width = image.shape
            head = f"P5 {width} {height} 255\n".encode()
            (folder / name).write_bytes(head + image.tobytes())
            rows.append((place, time.isoformat(), name))
    with open(folder / "index.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("place", "time", "path"))
        writer.writerows(rows)
    pairs = list(zip(street.places, street.places[1:]))
    with open(folder / "edges.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("from", "to"))
        for one, other in pairs:
            writer.writerows([(one, other), (other, one)])
    return folder
