"""A robot that may look for a fifth of the time finds out when somebody is where.

python examples/rooms.py
"""

from __future__ import annotations

import numpy as np

from chronotope import explore

DAYS = 14


def main() -> None:
    minutes = np.arange(DAYS * 24 * 60)
    hours = minutes / 60 % 24
    rooms = {
        "kitchen": (hours > 12) & (hours < 13) | (hours > 18) & (hours < 19.5),
        "office": (hours > 8.5) & (hours < 17),
        "corridor": np.random.default_rng(1).random(len(minutes)) < 0.2,
    }
    for strategy in ("information", "monte-carlo", "random"):
        found = explore.simulate(60 * minutes, rooms, share=0.2, strategy=strategy, seed=1)
        print(found)
    samples = {name: (60 * minutes[::30], states[::30]) for name, states in rooms.items()}
    for visit in explore.plan(samples, DAYS * 86_400, share=0.05):
        print(f"{visit.start:%H:%M} {visit.place}: {visit.reason}")


if __name__ == "__main__":
    main()
