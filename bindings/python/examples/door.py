"""When will a door be open? Any 0/1 series, in scikit-learn's manner.

python examples/door.py [DOOR.csv]
"""

from __future__ import annotations

import sys

import numpy as np

from chronotope import Fremen, series


def main(path: str | None) -> None:
    if path is None:
        hours = np.arange(28 * 24)
        times = np.datetime64("2024-01-01T00", "s") + hours * np.timedelta64(3600, "s")
        states = ((hours % 24 >= 7) & (hours % 24 < 18)).astype(float)
    else:
        read_times, states = series.read_csv(path)
        times = read_times.astype("datetime64[s]")
    door = Fremen().fit(times, states)
    for period_s, amplitude, _ in door.components_:
        print(f"every {period_s / 3600:.1f} h, by {amplitude:.2f}")
    for time in ("2024-05-06T08:30:00Z", "2024-05-06T23:00:00Z"):
        p, low, high = door.estimate([time])[0]
        print(f"{time}: open with p = {p:.2f} ({low:.2f} to {high:.2f})")
    print(f"{len(door.anomalies(times, states, confidence=0.95))} surprises")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
