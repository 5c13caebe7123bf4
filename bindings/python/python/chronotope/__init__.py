"""Visual topological localisation that knows what each place looks like *at a given time*.

A map is a graph of places. Each holds features and the log of when each was seen; from it a model of
visibility is learnt (FreMEn), and for the time of an image the features are predicted that should be
visible now. Only these are matched, and the answer is a place, how sure it is, and why.

>>> import chronotope
>>> street = chronotope.Street(num_places=2)
>>> learn, query = street.schedule(num_learn=6, num_query=1)
>>> image = street.render(street.places[0], query[0])
>>> chronotope.extract(image, n=100)
Features(100 of an image of 448 x 384 px)

``Map`` is a map file, ``Localizer`` says where an image was taken, ``Robot`` does so image after image
and learns, ``Learner`` learns labelled images, ``Tracker`` follows a way. ``chronotope.series`` has the
models of any 0/1 series in scikit-learn's manner: a door, a person in a room. ``Grid`` predicts which cell of
the world is occupied when, and ``chronotope.explore`` with its ``Explorer`` says when and where to look next.

Images are uint8, (height, width) in grey or (height, width, 3) in RGB; x to the right and y down, the
centre of the first pixel at (0, 0). Times are aware datetimes, datetime64 of UTC, text with an offset,
or seconds since 1970. Errors are ``chronotope.Error`` with ``kind``, ``path``, ``place`` and ``help``. What the
engine has to say goes to ``logging.getLogger("chronotope")``.
"""

from __future__ import annotations

from . import explore, series
from ._chronotope import (
    Candidate,
    CellExplanation,
    Explorer,
    Features,
    Grid,
    GridLocalizer,
    GridObservation,
    GridPath,
    GridVerdict,
    LearnReport,
    Learner,
    Localization,
    Localizer,
    Map,
    Office,
    Place,
    PoseEstimate,
    PredictedMap,
    Robot,
    Street,
    Tracker,
    exif_time,
    extract,
)
from ._errors import (
    AlreadyExistsError,
    ChecksumError,
    ClosedError,
    ConfigError,
    ConflictError,
    Error,
    FormatError,
    InternalError,
    IoError,
    NotFoundError,
    ShapeError,
    TimeError,
)
from ._street import write_street
from .series import Fremen

__version__ = "0.1.0"

__all__ = [
    "AlreadyExistsError",
    "Candidate",
    "CellExplanation",
    "ChecksumError",
    "ClosedError",
    "ConfigError",
    "ConflictError",
    "Error",
    "Explorer",
    "Features",
    "FormatError",
    "Fremen",
    "Grid",
    "GridLocalizer",
    "GridObservation",
    "GridPath",
    "GridVerdict",
    "InternalError",
    "IoError",
    "LearnReport",
    "Learner",
    "Localization",
    "Localizer",
    "Map",
    "NotFoundError",
    "Office",
    "Place",
    "PoseEstimate",
    "PredictedMap",
    "Robot",
    "ShapeError",
    "Street",
    "TimeError",
    "Tracker",
    "exif_time",
    "explore",
    "extract",
    "series",
    "write_street",
]
