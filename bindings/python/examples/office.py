"""Learns three weeks of a made-up office, and says what it will look like, and which way will be free.

python examples/office.py
"""

from __future__ import annotations

import datetime
import pathlib
import tempfile

import chronotope

#: A Monday.
BEGIN = datetime.datetime(2024, 5, 6, tzinfo=datetime.timezone.utc)


def main() -> None:
    office = chronotope.Office(seed=1, resolution=0.1)
    times = [BEGIN + datetime.timedelta(hours=3 * n) for n in range(3 * 7 * 8)]
    grid = office.grid()
    grid.observe_many([office.render(time) for time in times], times)
    print(grid)
    for hour in (3, 13):
        time = BEGIN + datetime.timedelta(days=23, hours=hour)
        predicted, truth = grid.occupancy(time), office.render(time)
        known = (predicted >= 0) & (truth >= 0)
        share = (predicted[known] == truth[known]).mean()
        path = grid.plan(*office.places, time)
        print(f"{time:%A %H:%M}: {share:.1%} of the cells are right, {path}")
    with tempfile.TemporaryDirectory() as folder:
        with grid.save(pathlib.Path(folder) / "office.grid") as kept:
            later = BEGIN + datetime.timedelta(days=22, hours=10)
            print(kept.add(office.render(later), later, observer="robot"))
            upside_down = office.render(later + datetime.timedelta(hours=1))[::-1]
            print(kept.add(upside_down, later + datetime.timedelta(hours=1), observer="robot"))


if __name__ == "__main__":
    main()
