"""Which array of cells does a map mean?"""

from __future__ import annotations

from typing import Any

import numpy as np

from ._errors import ShapeError

_HELP = {
    "u": "for 0 and 1 give map.astype(bool), for percent with 255 as unknown map.astype(numpy.int8); of a "
    "picture of map_server give the path of its YAML file",
    "i": "for percent, -1 where unknown, give map.astype(numpy.int8); for 0 and 1 map.astype(bool)",
}
_OTHERWISE = (
    "give bool, int8 (0 to 100 and -1 as in a ROS OccupancyGrid) or floats (probabilities, NaN where unknown)"
)


def as_cells(map: Any, name: str) -> Any:
    """The cells of a map as int8, float32 or, of bool, as bytes, that lie one after another.

    bool: occupied or free. int8: as in ``nav_msgs/OccupancyGrid``, percent from 0 to 100 and -1 where
    unknown. Floats: probabilities, NaN where unknown. An array of the first three that is contiguous is
    not copied.

    ``name`` is that of the argument, for errors.

    Errors: ``ShapeError`` for any other type, for masked arrays, and for what has not two or three
    axes.
    """

    def _error(message: str, help: str) -> ShapeError:
        return ShapeError(message, "shape", None, name, help)

    if map is None or isinstance(map, (str, bytes)):
        raise TypeError(f"{type(map).__name__} is no array of cells")
    array = np.asanyarray(map)
    if isinstance(array, np.ma.MaskedArray):
        raise _error(
            "a masked array holds values below its mask",
            "give map.filled(-1) of int8, or map.filled(numpy.nan) of floats",
        )
    if array.size == 0:
        raise _error(f"an array of {array.shape} has no cells", "was the crop outside of the map?")
    if array.ndim not in (2, 3):
        raise _error(
            f"an array of {array.shape} is no map",
            "give (height, width), row 0 at the lowest y; of a 3-D grid (depth, height, width)",
        )
    kind = array.dtype.kind
    if kind == "b":
        return np.require(array, None, ["C", "A"]).view(np.uint8)
    if array.dtype == np.int8:
        return np.require(array, None, ["C", "A"])
    if kind == "f":
        # What is too large for float32 becomes infinite, which is no probability either.
        with np.errstate(over="ignore"):
            return np.require(array, np.float32, ["C", "A"])
    raise _error(f"{array.dtype} may mean several things in a map", _HELP.get(kind, _OTHERWISE))


def as_floats(numbers: Any, dtype: Any, name: str) -> Any:
    """Numbers as floats that lie one after another.

    Errors: ``ShapeError`` for what are no numbers.
    """
    try:
        array = np.asarray(numbers)
    except ValueError as cause:
        raise ShapeError(str(cause), "shape", None, name, "rows have one length") from None
    if array.dtype.kind not in "iuf" or isinstance(numbers, np.ma.MaskedArray):
        raise ShapeError(
            f"{array.dtype} holds no numbers of {name}", "shape", None, name, "give floats"
        )
    with np.errstate(over="ignore"):
        return np.require(array, dtype, ["C", "A"])
