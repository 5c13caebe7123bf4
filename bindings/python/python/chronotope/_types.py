"""What may be given, and what comes back, in the words of type checkers."""

from __future__ import annotations

import datetime
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from ._chronotope import Features, Grid, Localization, Map
    from ._errors import Error

#: A path of the file system.
PathLike: TypeAlias = Union[str, "os.PathLike[str]"]
#: An image of pixels: uint8 (height, width) or (height, width, 3), a PIL image, what numpy makes an
#: array of, or a path.
PixelsLike: TypeAlias = Any
#: An image: pixels, a path, or features.
ImageLike: TypeAlias = Any
#: Several images.
ImagesLike: TypeAlias = Union[Iterable[Any], "npt.NDArray[np.uint8]"]
#: uint8 or bool (height, width), 0 or False where nothing is used; or a path.
MaskLike: TypeAlias = Union["npt.NDArray[np.uint8]", "npt.NDArray[np.bool_]", str, "os.PathLike[str]"]
#: An aware datetime, a datetime64 of UTC, text in RFC 3339 with an offset, or seconds since 1970.
TimeLike: TypeAlias = Union[datetime.datetime, "np.datetime64", str, int, float]
#: As many times as there are images; None where one is not known.
TimesLike: TypeAlias = Union[Iterable[Any], "npt.NDArray[Any]"]
#: A dictionary as JSON has it; where that is offered, True or False.
ConfigLike: TypeAlias = Union[Mapping[str, Any], bool]
#: A map that is open, or the path of one.
MapLike: TypeAlias = Union["Map", str, "os.PathLike[str]"]
#: True for a bar of tqdm where it is installed, or a function of (done, total).
ProgressLike: TypeAlias = Union[bool, Callable[[int, int], object]]
#: (n, 2) or (n,) of any float.
PointsLike: TypeAlias = npt.ArrayLike
#: uint8 (n, 32).
DescriptorsLike: TypeAlias = npt.ArrayLike
#: A map of cells: bool, int8 or float, (height, width) or (depth, height, width); where offered, a path.
CellsLike: TypeAlias = Any
#: A grid, or the path of one.
GridLike: TypeAlias = Union["Grid", str, "os.PathLike[str]"]
#: Numbers, as an array or as lists.
FloatsLike: TypeAlias = npt.ArrayLike
#: Names of places; with how many 0/1 states each shows, a dictionary.
PlacesLike: TypeAlias = Union[Sequence[str], Mapping[str, int]]
#: What is explored, as the engine takes it.
ExploredLike: TypeAlias = Any
#: What was seen of a place: True or False, or as many of them as it has states.
LookLike: TypeAlias = Union[bool, Sequence[bool], "npt.NDArray[Any]"]
#: int64 microseconds since 1970.
Microseconds: TypeAlias = npt.NDArray[np.int64]
#: int32 (n,).
Codes: TypeAlias = npt.NDArray[np.int32]
#: int8: 1, 0, or -1 where missing.
States: TypeAlias = npt.NDArray[np.int8]

Points: TypeAlias = npt.NDArray[np.float32]
Strengths: TypeAlias = npt.NDArray[np.float32]
Descriptors: TypeAlias = npt.NDArray[np.uint8]
Numbers: TypeAlias = npt.NDArray[np.float64]
Triples: TypeAlias = npt.NDArray[np.float64]
#: float32 of a grid's shape, NaN where unknown.
Probabilities: TypeAlias = npt.NDArray[np.float32]
#: int8 of a grid's shape: 100, 0, or -1 where unknown.
Occupancy: TypeAlias = npt.NDArray[np.int8]
#: (row, column), in 3-D (layer, row, column).
Index: TypeAlias = tuple[int, ...]
#: (x, y), in 3-D (x, y, z), in m.
Point: TypeAlias = tuple[float, ...]
Ids: TypeAlias = npt.NDArray[np.uint32]
Stamps: TypeAlias = npt.NDArray[np.int64]
Ternary: TypeAlias = npt.NDArray[np.int8]
Picture: TypeAlias = npt.NDArray[np.uint8]
ByteStrings: TypeAlias = list[bytes]
Matches: TypeAlias = npt.NDArray[np.void]
Json: TypeAlias = dict[str, Any]
Moment: TypeAlias = datetime.datetime
MaybeMoment: TypeAlias = Union[datetime.datetime, None]
#: Of ``localize_many``; exceptions only where ``errors="return"`` asks for them.
Answers: TypeAlias = list[Any]

#: The fields of ``Localization.matches``, packed.
MATCH = np.dtype(
    [
        ("feature", "<u4"),
        ("live", "<u4"),
        ("map_x", "<f4"),
        ("map_y", "<f4"),
        ("live_x", "<f4"),
        ("live_y", "<f4"),
        ("p", "<f8"),
        ("distance_bits", "<u2"),
        ("inlier", "?"),
    ]
)
