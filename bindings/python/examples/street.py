"""Learns a year of the rendered street, and says where images of the next one were taken.

python examples/street.py
"""

from __future__ import annotations

import pathlib
import tempfile

import chronotope


def main() -> None:
    street = chronotope.Street(seed=1, num_places=4)
    learn, query = street.schedule(num_learn=12, num_query=3)
    with tempfile.TemporaryDirectory() as folder:
        images = chronotope.write_street(street, pathlib.Path(folder) / "images", learn)
        with chronotope.Map.build(images, pathlib.Path(folder) / "street.map") as street_map:
            print(street_map)
            localizer = chronotope.Localizer(street_map)
        for time in query:
            for place in street.places:
                answer = localizer.localize(street.render(place, time), time)
                inliers = answer.matches[answer.matches["inlier"]]
                print(f"{place} at {time:%d %B %H:%M}: {answer!r}, {len(inliers)} inliers")


if __name__ == "__main__":
    main()
