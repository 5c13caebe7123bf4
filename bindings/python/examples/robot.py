"""A robot that learns what it locates, on a second thread.

python examples/robot.py MAP IMAGE...
"""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt

import chronotope


def frames(paths: list[str]) -> list[npt.NDArray[np.uint8]]:
    """What a camera would give: here, files that PIL reads."""
    from PIL import Image

    return [np.asarray(Image.open(path).convert("L")) for path in paths]


def main(map_path: str, paths: list[str]) -> None:
    with chronotope.Robot(map_path, learn=True, track=True) as robot:
        for path, frame in zip(paths, frames(paths)):
            answer = robot.see(frame, chronotope.exif_time(path) or "2024-05-01T08:30:00Z", name=path)
            print(path, robot.place, answer.reason)
        for event in robot.events():
            print(event)
        print(robot.totals)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
