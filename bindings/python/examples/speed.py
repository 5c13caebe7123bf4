"""What do threads of Python gain, and what does the package cost beside the engine? Medians of turns, side by side.

python examples/speed.py [TURNS]
"""

from __future__ import annotations

import datetime
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from typing import Callable

import numpy as np
import numpy.typing as npt

import chronotope

IMPORT = "import numpy, time; begun = time.perf_counter(); import chronotope; print(time.perf_counter() - begun)"


def seconds(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def main() -> None:
    num_turns = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    street = chronotope.Street(seed=1, num_places=4)
    learn, query = street.schedule(num_learn=12, num_query=32)
    frames = [(street.render(place, at), at) for at in query for place in street.places]
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "street.map"
        images = chronotope.write_street(street, pathlib.Path(folder) / "images", learn)
        chronotope.Map.build(images, path).close()
        localizer = chronotope.Localizer(path)

        def localize(some: list[tuple[npt.NDArray[np.uint8], datetime.datetime]]) -> None:
            for image, at in some:
                localizer.localize(image, at)

        def on_threads(num: int) -> None:
            threads = [threading.Thread(target=localize, args=(frames[at::num],)) for at in range(num)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()

        def in_engine(num: int) -> None:
            localizer.localize_many([image for image, _ in frames], [at for _, at in frames], threads=num)

        print(f"two threads against one, {len(frames)} images, {num_turns} turns:")
        for name, work in (("of Python", on_threads), ("of the engine", in_engine)):
            work(2)
            gains = [seconds(lambda: work(1)) / seconds(lambda: work(2)) for _ in range(num_turns)]
            print(f"  {name}: {statistics.median(gains):.2f} times as fast")

        with chronotope.Robot(path) as robot:
            costs = []
            for _ in range(num_turns):
                for image, at in frames:
                    whole = seconds(lambda: robot.see(image, at))
                    costs.append(whole / sum(robot.timing_s) - 1)
        height, width = frames[0][0].shape
        print(f"an image of {width} x {height}: {100 * statistics.median(costs):+.1f} % over the engine")
    imports = [subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, check=True, text=True) for _ in range(9)]
    print(f"import chronotope after numpy: {1e3 * min(float(it.stdout) for it in imports):.1f} ms")


if __name__ == "__main__":
    main()
