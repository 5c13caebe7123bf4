"""How does somebody who waits see that something happens?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class _Calls:
    def __init__(self, function: Callable[[int, int], object], total: int) -> None:
        self._function, self._total, self._done = function, total, 0

    def update(self, by: int) -> None:
        self._done += by
        self._function(self._done, self._total)

    def close(self) -> None:
        pass


def bar(wish: bool | Callable[[int, int], object], total: int, what: str) -> Any:
    """A bar of tqdm where it is installed, calls of a function, or None."""
    if not isinstance(wish, (bool, int)):
        return _Calls(wish, total)
    if not wish:
        return None
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    return tqdm(total=total, desc=what, unit="image")
