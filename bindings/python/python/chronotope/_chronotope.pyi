"""
The engine of `chronotope`; use that package.
"""

from _typeshed import SupportsGetItem
from chronotope._types import Answers, ByteStrings, CellsLike, Codes, ConfigLike, Descriptors, DescriptorsLike, ExploredLike, FloatsLike, GridLike, Ids, ImageLike, ImagesLike, Index, Json, LookLike, MapLike, MaskLike, Matches, MaybeMoment, Microseconds, Moment, Numbers, Occupancy, PathLike, Picture, PixelsLike, PlacesLike, Point, Points, PointsLike, Probabilities, ProgressLike, Stamps, States, Strengths, Ternary, TimeLike, TimesLike, Triples
from os import PathLike as PathLike2
from pathlib import Path
from typing import Any, SupportsFloat, SupportsIndex, final

__all__ = ["Candidate", "CellExplanation", "Explorer", "Features", "Grid", "GridLocalizer", "GridObservation", "GridPath", "GridVerdict", "LearnReport", "Learner", "Localization", "Localizer", "Map", "Office", "Place", "PlannedVisit", "PoseEstimate", "PredictedMap", "Prospect", "Robot", "SeriesModel", "Simulation", "Street", "Tour", "Tracker", "_address_of", "calendar", "compact", "evaluate_visits", "exif_time", "explore_next", "explore_plan", "explore_prospects", "explore_simulate", "explore_tour", "extract", "join_maps", "merge_sums", "parse_time", "parse_times", "periodogram", "predict_models", "read_csv", "sum_visits"]

@final
class Candidate:
    """
    What speaks for one place of an answer.
    """
    def __repr__(self, /) -> str: ...
    @property
    def displacement_px(self, /) -> tuple[float, float] | None:
        """
        The displacement of these, (dx, dy) in px, live minus map.
        """
    @property
    def matches(self, /) -> Matches:
        """
        Its matches, as those of ``Localization.matches``.
        """
    @property
    def num_inliers(self, /) -> int:
        """
        Those that agree on one displacement.
        """
    @property
    def num_matches(self, /) -> int:
        """
        Features of the place that were found.
        """
    @property
    def place(self, /) -> str:
        """
        The name of the place.
        """
    @property
    def posterior(self, /) -> float:
        """
        The probability of being here.
        """
    @property
    def predicted(self, /) -> Ids:
        """
        Ids within the place of the features that were predicted, uint32 (n,); none for the
        experience methods.
        """
    @property
    def probabilities(self, /) -> Numbers:
        """
        Their p(t), float64 (n,).
        """
    @property
    def score(self, /) -> float:
        """
        What it is ranked by: log odds of this place against another one, or a count of matches.
        """

@final
class CellExplanation:
    """
    Why a cell is predicted as it is.
    """
    def __repr__(self, /) -> str: ...
    @property
    def cell(self, /) -> tuple[int, int, int]:
        """
        The cell (x, y, z), counted from the grid's lower corner; in an array [y, x], in 3-D [z, y, x].
        """
    @property
    def last_seen(self, /) -> MaybeMoment:
        """
        When it was last seen, in UTC; None where it never was.
        """
    @property
    def last_state(self, /) -> str | None:
        """
        How it was last seen: ``"free"`` or ``"occupied"``.
        """
    @property
    def num_changes(self, /) -> int:
        """
        Changes between free and occupied.
        """
    @property
    def num_observed(self, /) -> int:
        """
        Observations that saw it.
        """
    @property
    def num_occupied(self, /) -> int:
        """
        Observations that saw it occupied.
        """
    @property
    def p(self, /) -> float | None:
        """
        The probability that it is occupied; None where it was never seen.
        """
    @property
    def periodic(self, /) -> float:
        """
        The part of the rhythms.
        """
    @property
    def persistence(self, /) -> float:
        """
        The weight of the last observation against them.
        """
    @property
    def rhythms(self, /) -> Triples:
        """
        Its rhythms, strongest first, float64 (k, 3): period in s, amplitude, phase in rad.
        """
    @property
    def tau_s(self, /) -> float | None:
        """
        How long a state lasts on average, s; None where it never changed.
        """
    @property
    def time(self, /) -> Moment:
        """
        The time, in UTC.
        """
    def to_dict(self, /) -> Json:
        """
        As ``chronotope grid explain --json`` prints it.
        """
    def to_json(self, /) -> str:
        """
        The line that ``chronotope grid explain --json`` prints.
        """

@final
class Explorer:
    """
    A robot that plans where to look when, looks, and learns what it has seen.

    ``places`` are names, or a dictionary of names and how many 0/1 states each place shows at once (the
    features of a view, the seats of a room). At most ``share`` of the slots of ``slot`` seconds are
    spent on visits.

    ``strategy`` is ``"information"`` (what a look leaves behind: states that stay, and a better model),
    ``"greedy"``, ``"monte-carlo"``, ``"novelty"``, ``"round-robin"`` or ``"random"``; what is drawn
    follows from ``seed``. ``model`` is what is believed of each place: ``"histogram-persistent"``,
    ``"short-term"``, ``"long-term"``, ``"fremen"``, ``"gaussians"``, ``"natural"`` or ``"histogram"``,
    and each with ``-persistent``.

    The loop: ``plan`` a day; for each slot ask ``next``, go there, ``observe``; the next day, ``plan``
    again.

    Source: J. M. Santos, T. Krajník, T. Duckett: Spatio-temporal exploration strategies for long-term
    autonomy of mobile robots, Robotics and Autonomous Systems, 2017, eq. 10 to 12; ``"information"`` is
    this project's own.

    Errors: ``ConfigError`` for unknown names and numbers out of range, ``AlreadyExistsError`` for a
    name that comes twice.
    """
    def __new__(cls, /, places: PlacesLike, *, model: str = "histogram-persistent", strategy: str = "information", share: SupportsFloat | SupportsIndex = 0.5, slot: SupportsFloat | SupportsIndex = 600.0, seed: SupportsIndex = 0) -> Explorer: ...
    def __repr__(self, /) -> str: ...
    def next(self, /, slot: SupportsIndex) -> PlannedVisit | None:
        """
        Where to be in a slot of the present plan, counted from 0; None if it is for other tasks, or if
        nothing is planned. What was seen since may have changed it. Slots are asked for in order, and
        each once.
        """
    @property
    def num_rerouted(self, /) -> int:
        """
        How often a visit was changed by what was seen since it was planned.
        """
    def observe(self, /, place: str, time: TimeLike, states: LookLike) -> None:
        """
        Takes what was seen at a place: True or False, or as many of them as it has states. A look that
        is older than the last one is learnt from, and is not taken for the last.

        Errors: ``NotFoundError`` for an unknown place, ``TimeError``, ``ConfigError`` for what are no
        states, ``ShapeError`` for another number of them.
        """
    @property
    def places(self, /) -> list[str]:
        """
        The names of the places.
        """
    def plan(self, /, start: TimeLike, slots: SupportsIndex = 144) -> list[PlannedVisit]:
        """
        Learns from what was seen, plans ``slots`` slots from ``start`` on, and gives the visits in
        order of time.

        Errors: ``TimeError``, ``ConfigError`` for no slots or too many.
        """
    @property
    def planned(self, /) -> list[PlannedVisit]:
        """
        The plan as it stands now, changed by what was seen since it was made.
        """
    def predict(self, /, place: str, time: TimeLike) -> Numbers:
        """
        What is believed of a place at a time: the probability of each state, float64 (states,).

        Errors: ``NotFoundError``, ``TimeError``.
        """
    def prospects(self, /, time: TimeLike, *, slots: SupportsIndex = 144) -> list[Prospect]:
        """
        What a look at a time would be worth at each place, the best first, by what was learnt until the
        last ``plan``. ``slots`` is how far ahead what is seen counts.

        Errors: ``TimeError``, ``ConfigError``.
        """

@final
class Features:
    """
    Keypoints and their descriptors, strongest first.

    Made by ``extract``, or from arrays of another program's features: ``xy`` float (n, 2) in px,
    x to the right and y down with the centre of the first pixel at (0, 0); ``descriptors`` uint8
    (n, 32), bit 0 of a descriptor the highest of its first byte, as OpenCV has it. Answers make sense
    only if the map was learnt with the same extractor.

    Errors: ``ShapeError`` if the arrays do not fit each other or hold NaN.
    """
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self, /) -> int: ...
    def __len__(self, /) -> int: ...
    def __new__(cls, /, xy: PointsLike, descriptors: DescriptorsLike, *, size: PointsLike | None = None, response: PointsLike | None = None, image_size: tuple[SupportsIndex, SupportsIndex] | None = None) -> Features: ...
    def __reduce__(self, /) -> Any: ...
    def __repr__(self, /) -> str: ...
    @property
    def descriptors(self, /) -> Descriptors:
        """
        Descriptors, uint8 (n, 32): 256 bits each, compared by their Hamming distance.
        """
    @property
    def image_size(self, /) -> tuple[int, int] | None:
        """
        Width and height of the image in px, where known.
        """
    @property
    def response(self, /) -> Strengths:
        """
        Strengths, float32 (n,), in the detector's unit.
        """
    @property
    def size(self, /) -> Strengths:
        """
        Diameters of the neighbourhoods, float32 (n,), px.
        """
    @property
    def xy(self, /) -> Points:
        """
        Positions, float32 (n, 2): x and y in px.
        """

@final
class Grid:
    """
    A grid of occupancy that remembers when each cell was free and when occupied, and predicts the map
    of any time.

    ``Grid(shape, resolution)`` begins one in memory, ``save`` keeps it in a file, ``Grid.open`` opens
    one, ``Grid.build`` makes one of a folder of maps. In a file every change is a generation that
    ``rollback`` can return to. A ``with`` block closes it. Threads may share it, and wait for each
    other.

    **Arrays** are (height, width), and (depth, height, width) in 3-D; **row 0 has the lowest y**,
    column 0 the lowest x, layer 0 the lowest z, as in ``nav_msgs/OccupancyGrid``
    (``data.reshape(height, width)``). Show one with ``imshow(grid.predict(time), origin="lower")``.
    Given are

    - bool: occupied or free;
    - int8 as in ROS: percent from 0 to 100, -1 where unknown;
    - floats: probabilities, NaN where unknown.

    Percent and probabilities above ``occupied`` are occupied, below ``free`` free, and unknown between,
    which leaves the cell as it was. uint8 is refused, because it may be any of these or a picture's
    shades.

    ``shape`` counts cells, ``resolution`` is their side in metres, ``origin`` the lower left corner (x,
    y) of the first cell, in 3-D (x, y, z). A cell is predicted by ``model``: ``"fremen"`` (a mean and
    the ``order`` strongest rhythms), ``"histogram"``, ``"folded"``, ``"mean"`` or ``"last"``; ``base``
    is the longest period, ``"day"``, ``"week"`` or ``"year"``, and ``parts`` into how many it is
    divided (hours unless said otherwise). ``persistence``, 0 to 1, is how much a fresh observation
    counts against the rhythms, and ``surprise=True`` counts of it only what the rhythms had not
    foreseen.

    Source: T. Krajník et al., FreMEn, IEEE Transactions on Robotics 2017, eq. 10; persistence: T.
    Krajník et al., Persistent localization and life-long mapping, IROS 2016, eq. 2.

    Errors: ``ShapeError`` for other shapes, ``ConfigError`` for numbers that make no grid and unknown
    models.
    """
    def __enter__(self, /) -> Grid: ...
    def __exit__(self, /, *_exception: "object") -> None: ...
    def __new__(cls, /, shape: SupportsGetItem[int, SupportsIndex], resolution: SupportsFloat | SupportsIndex, origin: SupportsGetItem[int, SupportsFloat | SupportsIndex] = ..., *, model: str = "fremen", base: str = "day", parts: SupportsIndex | None = None, order: SupportsIndex = 2, persistence: SupportsFloat | SupportsIndex = 1.0, surprise: bool = False) -> Grid: ...
    def __repr__(self, /) -> str: ...
    def accept(self, /, ids: SupportsGetItem[int, str] | None = None) -> int:
        """
        Integrates maps in quarantine after all: by the first digits of their identities, all of them
        where none is named. Gives how many.

        Errors: ``NotFoundError``, ``ConfigError`` for digits that begin several.
        """
    def add(self, /, map: CellsLike, time: TimeLike, *, observer: str = "", trust: bool = False, origin: SupportsGetItem[int, SupportsFloat | SupportsIndex] | None = None, occupied: SupportsFloat | SupportsIndex = 0.65, free: SupportsFloat | SupportsIndex = 0.196, voxel: SupportsFloat | SupportsIndex | None = None) -> GridVerdict:
        """
        Judges a map and adds it, or keeps it in quarantine, as ``chronotope grid add`` does: it is laid
        onto the map that the grid predicts for its time, and what contradicts that more than usual is
        not believed.

        ``map`` is an array as for ``observe``, or the path of a map (YAML of ``map_server``, ``*.bt``,
        ``*.ply``, ``*.csv``). ``trust=True`` integrates it whatever it shows, which a map of a 3-D grid
        has to be. Only grids in files have a quarantine. Each call is a generation; ``add_folder``
        makes one of many maps.

        Errors: as ``observe``; ``ConfigError`` for a grid in memory.
        """
    def add_folder(self, /, folder: PathLike, *, trust: bool = False, occupied: SupportsFloat | SupportsIndex = 0.65, free: SupportsFloat | SupportsIndex = 0.196, voxel: SupportsFloat | SupportsIndex | None = None) -> list[GridVerdict]:
        """
        Judges the maps of a folder with an ``index.csv`` (see ``build``), oldest first, as ``chronotope
        grid add --maps`` does, and gives what became of each. All of them become one generation; after
        Ctrl-C none.
        """
    @staticmethod
    def build(folder: PathLike, path: PathLike, *, occupied: SupportsFloat | SupportsIndex = 0.65, free: SupportsFloat | SupportsIndex = 0.196, voxel: SupportsFloat | SupportsIndex | None = None) -> Grid:
        """
        Makes a grid file of a folder of maps that are believed, as ``chronotope grid build --maps``
        does.

        The folder has an ``index.csv`` with the columns time, path and perhaps observer; maps are those
        of ``map_server`` (YAML), in 3-D ``OctoMap`` trees (``*.bt``) and lists of points (``*.ply``, ``*.csv``,
        in voxels of ``voxel`` metres). They must be on one raster; the grid covers them all.

        Errors: ``AlreadyExistsError`` if ``path`` exists, ``FormatError`` and ``NotFoundError`` for
        what cannot be read, ``ShapeError`` for maps of other rasters.
        """
    def cell(self, /, at: SupportsGetItem[int, SupportsFloat | SupportsIndex]) -> Index:
        """
        Where in an array the cell at a place in metres is: (row, column), in 3-D (layer, row, column).

        Errors: ``NotFoundError`` for a place outside of the grid.
        """
    def center(self, /, index: SupportsGetItem[int, SupportsIndex]) -> Point:
        """
        The centre in metres, (x, y) or (x, y, z), of a cell of an array, (row, column) or (layer, row,
        column).

        Errors: ``ShapeError`` for a cell outside of the grid.
        """
    def close(self, /) -> None:
        """
        Lets go of what it holds, and of the file.
        """
    @property
    def closed(self, /) -> bool:
        """
        Whether ``close`` was called.
        """
    def drop_held(self, /, ids: SupportsGetItem[int, str] | None = None) -> int:
        """
        Forgets maps in quarantine, named likewise. Gives how many.
        """
    def entropy(self, /, time: TimeLike, start: SupportsGetItem[int, SupportsIndex] | None = None, stop: SupportsGetItem[int, SupportsIndex] | None = None) -> float:
        """
        How uncertain the grid is at a time, in bits: the sum of the entropies of its cells, 1 for one
        that was never seen. ``start`` and ``stop`` are a box of numpy indices, (row, column) or (layer,
        row, column), without ``stop``: ``grid.entropy(time, (10, 20), (40, 60))`` is of ``[10:40,
        20:60]``.

        Errors: ``ShapeError`` for a box that is not in the grid.
        """
    def explain(self, /, at: SupportsGetItem[int, SupportsFloat | SupportsIndex], time: TimeLike) -> CellExplanation:
        """
        Why a cell is predicted as it is: its rhythms, when it was last seen, how often it changed.
        ``at`` is its place (x, y) in metres, in 3-D (x, y, z); ``center`` gives that of a cell of an
        array.

        Errors: ``NotFoundError`` for a place outside of the grid, ``TimeError``.
        """
    def export(self, /, time: TimeLike, path: PathLike, *, mode: str = "trinary") -> None:
        """
        Writes the map that is expected at a time, as ``chronotope grid predict --out`` does:
        ``NAME.yaml`` with its picture beside it for ``map_server``, in 3-D ``*.bt`` (``OctoMap``), or a list of
        points, ``*.ply``, ``*.csv``. ``mode`` says what shades mean: ``"trinary"``, ``"scale"`` or
        ``"raw"``. An earlier map is replaced.

        Errors: ``ConfigError``, ``ShapeError`` for a 3-D grid as a picture, ``AlreadyExistsError`` for
        a file of another kind, ``IoError``.
        """
    def forget(self, /, before: TimeLike) -> int:
        """
        Forgets what was observed before a time, and gives how many observations that were. Of a file
        earlier generations have them until ``prune``.
        """
    @property
    def generation(self, /) -> int | None:
        """
        Which commit was read last, counted from 0; None for a grid in memory.
        """
    def held(self, /) -> list[Json]:
        """
        The maps in quarantine, oldest first, as ``chronotope grid quarantine list --json`` prints them.
        """
    def include(self, /, other: Grid) -> int:
        """
        Adds all observations of another grid of the same cells that this one does not have; gives how
        many.

        Errors: ``ShapeError``, ``ConflictError``.
        """
    def inspect(self, /) -> Json:
        """
        What it holds, as ``chronotope grid inspect --json`` prints it.
        """
    def localizer(self, /, time: TimeLike, *, first: SupportsFloat | SupportsIndex, step: SupportsFloat | SupportsIndex, max_range: SupportsFloat | SupportsIndex, pose: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] | None = None, seed: SupportsIndex = 1) -> GridLocalizer:
        """
        Localises a laser in the map that is expected at ``time``: see ``GridLocalizer``. ``first``,
        ``step`` and ``max_range`` describe its beams as for ``map_of_scans``. ``pose`` (x, y, heading)
        is about where it is at first, within 0.2 m and 0.1 rad; without it, it may be anywhere.

        Errors: ``ShapeError`` for a 3-D grid, ``NotFoundError`` if nothing is free, ``TimeError``.
        """
    def log(self, /) -> list[Json]:
        """
        Every commit, oldest first, as ``chronotope grid log --json`` prints them.
        """
    def map_of_scans(self, /, ranges: FloatsLike, poses: FloatsLike, *, first: SupportsFloat | SupportsIndex, step: SupportsFloat | SupportsIndex, max_range: SupportsFloat | SupportsIndex, sensor: str | None = None) -> Probabilities:
        """
        What a laser has seen, as a map for ``observe`` and ``add``: float32 of the grid's ``shape``,
        NaN where no beam came. ``ranges`` is (beams,) or (scans, beams) in metres, ``poses`` (3,) or
        (scans, 3): x, y and heading of the laser in metres and radians. Beam i looks to heading +
        ``first`` + i ``step``, counted anticlockwise; a range of ``max_range`` and more, or infinity,
        says that nothing is nearer, and NaN nothing at all (REP 117). ``sensor`` is ``"ideal"`` (one
        scan is nearly sure; the default for one) or ``"reduced"`` (several must agree; the default for
        several).

        Errors: ``ShapeError`` for other shapes and 3-D grids, ``ConfigError`` for numbers that are
        none.
        """
    @staticmethod
    def merge(grids: SupportsGetItem[int, GridLike], path: PathLike | None = None) -> Grid:
        """
        Makes one grid of several, the union of what they saw, the same in any order.

        With ``path`` a new file of grids that are in files, as ``chronotope grid merge`` does;
        otherwise a grid in memory.

        Errors: ``ShapeError`` for grids of other cells, ``ConflictError`` where one observer saw two
        things at one time, ``AlreadyExistsError`` if ``path`` exists.
        """
    @property
    def num_observations(self, /) -> int:
        """
        How many observations it has.
        """
    def observe(self, /, map: CellsLike, time: TimeLike, *, observer: str = "", origin: SupportsGetItem[int, SupportsFloat | SupportsIndex] | None = None, occupied: SupportsFloat | SupportsIndex = 0.65, free: SupportsFloat | SupportsIndex = 0.196, voxel: SupportsFloat | SupportsIndex | None = None) -> GridObservation:
        """
        Adds a map that is believed, as it is; ``add`` judges maps first.

        ``map`` is an array (see ``Grid``) of the grid's shape or, with ``origin`` (the lower corner of
        its first cell in metres), of any: its cells must coincide with the grid's. A path is read as
        for ``add``. ``time`` is when it was made: an aware datetime, a datetime64 (of UTC), text with
        an offset, or seconds since 1970. Observer and time are an observation's identity: the same once
        more changes nothing. Observations may come in any order. Of a grid in a file each call is a
        generation; ``observe_many`` makes one of many.

        Errors: ``ShapeError``, ``ConfigError`` for values that are none, ``TimeError``,
        ``ConflictError`` where this observer saw something else at this time.
        """
    def observe_many(self, /, maps: CellsLike, times: TimesLike, *, observer: str = "", occupied: SupportsFloat | SupportsIndex = 0.65, free: SupportsFloat | SupportsIndex = 0.196) -> int:
        """
        Adds many maps that are believed, in one step: arrays of the grid's shape, or one array with an
        axis more, and as many times. Gives how many are new. If one of them is refused, nothing has
        changed.

        Errors: as ``observe``, with the number of the map; ``ShapeError`` if maps and times are not as
        many.
        """
    @property
    def observers(self, /) -> list[str]:
        """
        Who made each observation, in the same order.
        """
    def occupancy(self, /, time: TimeLike, *, occupied: SupportsFloat | SupportsIndex = 0.65, free: SupportsFloat | SupportsIndex = 0.196) -> Occupancy:
        """
        ``predict`` as ``nav_msgs/OccupancyGrid`` has it, int8: 100 where p > ``occupied``, 0 where p <
        ``free``, -1 between and where a cell was never seen.

        Errors: ``TimeError``, ``ConfigError`` for thresholds that cross.
        """
    @staticmethod
    def open(path: PathLike, *, read_only: bool = False, model: str = "fremen", base: str = "day", parts: SupportsIndex | None = None, order: SupportsIndex = 2, persistence: SupportsFloat | SupportsIndex = 1.0, surprise: bool = False) -> Grid:
        """
        Opens a grid file: to be written where file and folder allow it, else read-only. Reads and
        checks all of its newest generation. The other arguments are those of ``Grid``.

        Errors: ``NotFoundError``, ``FormatError`` if it is no grid, ``ChecksumError`` if it is damaged.
        """
    @property
    def origin(self, /) -> tuple[float, float, float]:
        """
        The lower corner of the first cell, (x, y, z) in m; z is 0 in 2-D.
        """
    @property
    def path(self, /) -> Path | None:
        """
        The file; None for a grid in memory.
        """
    def plan(self, /, start: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex], goal: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex], time: TimeLike, *, radius: SupportsFloat | SupportsIndex = 0.25, speed: SupportsFloat | SupportsIndex = 0.5) -> GridPath | None:
        """
        The way of a robot that departs at ``time``, through what is predicted for the time of its
        arrival at each cell, as ``chronotope grid plan`` finds it; None where there is none. ``start``
        and ``goal`` are (x, y) in metres; it keeps ``radius`` metres from surfaces and drives ``speed``
        metres a second.

        Errors: ``NotFoundError`` for places outside of the grid, ``ShapeError`` for a 3-D grid,
        ``ConfigError``.
        """
    def predict(self, /, time: TimeLike) -> Probabilities:
        """
        The map that is expected at a time: probabilities of being occupied, float32 of the grid's
        ``shape``, row 0 at the lowest y, NaN where a cell was never seen (T-RO 2017 eq. 10, IROS 2016
        eq. 2).

        Models are fitted when they are needed, and again only where something new was observed.

        Errors: ``TimeError``.
        """
    def prune(self, /, *, keep_last: SupportsIndex = 1, keep: SupportsGetItem[int, SupportsIndex] = ...) -> int:
        """
        Forgets generations but the newest ``keep_last`` and those in ``keep``; gives how many are gone.
        """
    @property
    def read_only(self, /) -> bool:
        """
        Whether a change is known to fail: the file was opened to be read, or may not be written.
        """
    def refresh(self, /) -> int:
        """
        Reads what other processes have committed, and gives the newest generation.

        Errors: ``ConflictError`` if a grid of other cells has taken its place.
        """
    @property
    def resolution(self, /) -> float:
        """
        The side of a cell, m.
        """
    def rhythms(self, /) -> tuple[Probabilities, Probabilities]:
        """
        The strongest rhythm of each cell: its period in s and its amplitude, two arrays, float32 of the
        grid's ``shape``, NaN where a cell has none.
        """
    def rollback(self, /, to: SupportsIndex) -> int:
        """
        Returns to what the grid was at a generation, as a new generation, and gives its number.

        Errors: ``NotFoundError``.
        """
    def save(self, /, path: PathLike) -> Grid:
        """
        Keeps a grid in a new file, and gives that one; what is in it counts as usual for ``add``.

        Errors: ``AlreadyExistsError``, ``IoError``.
        """
    def set_model(self, /, *, model: str = "fremen", base: str = "day", parts: SupportsIndex | None = None, order: SupportsIndex = 2, persistence: SupportsFloat | SupportsIndex = 1.0, surprise: bool = False) -> None:
        """
        Predicts by another model from now on; nothing that was observed is lost.
        """
    @property
    def shape(self, /) -> Index:
        """
        The shape of its maps: (height, width), in 3-D (depth, height, width).
        """
    @property
    def times_us(self, /) -> Stamps:
        """
        When each observation was, int64 (n,), microseconds since 1970 in UTC, oldest first:
        ``.view("datetime64[us]")``.
        """
    def verify(self, /) -> Json:
        """
        Checks every byte of this grid's file, as ``verify_file``.
        """
    @staticmethod
    def verify_file(path: PathLike) -> Json:
        """
        Checks every byte of a grid file and changes nothing: a dictionary as ``chronotope grid verify
        --json`` prints it, with ``clean`` and ``faults``.

        Errors: ``NotFoundError``, ``FormatError`` if it is no grid at all.
        """

@final
class GridLocalizer:
    """
    Says where a laser is in one predicted map, scan by scan: adaptive Monte Carlo localisation with a
    likelihood field. The same seed gives the same poses for any number of threads.

    Made by ``Grid.localizer``. Sources: S. Thrun, W. Burgard, D. Fox: Probabilistic Robotics, sections
    6.4 and 8.3; the map of the time: T. Krajník et al., IROS 2016.
    """
    def __repr__(self, /) -> str: ...
    @property
    def particles(self, /) -> Numbers:
        """
        All beliefs, float64 (n, 4): x and y in m, heading in rad, weight; weights add up to 1.
        """
    def see(self, /, ranges: FloatsLike, odometry: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex]) -> PoseEstimate:
        """
        Where the laser is after this scan.

        ``ranges`` is (beams,) in metres; ``odometry`` (x, y, heading) in metres and radians is where
        the laser believes to be by its wheels, in any frame: what counts is how it moved since the last
        scan. A scan after less than 0.2 m and 0.2 rad only moves the estimate.

        Errors: ``ShapeError``, ``ConfigError`` for an odometry that is not finite.
        """

@final
class GridObservation:
    """
    What an observation said, compared with what was last known of its cells before it.
    """
    def __repr__(self, /) -> str: ...
    @property
    def num_changed(self, /) -> int:
        """
        Cells that were free and are occupied, or the reverse.
        """
    @property
    def num_hidden(self, /) -> int:
        """
        Cells that the last observation around them had seen, and this one did not.
        """
    @property
    def num_known(self, /) -> int:
        """
        Cells that it saw free or occupied.
        """
    @property
    def num_revealed(self, /) -> int:
        """
        Cells that the last observation around them had not seen.
        """
    @property
    def outcome(self, /) -> str:
        """
        ``"integrated"``, or ``"known"`` for one that had been added before.
        """
    def to_dict(self, /) -> Json:
        """
        All of it, as a dictionary.
        """

@final
class GridPath:
    """
    A way through a grid, and when the robot is where on it.
    """
    def __len__(self, /) -> int: ...
    def __repr__(self, /) -> str: ...
    @property
    def arrival(self, /) -> Moment:
        """
        When it is there, in UTC.
        """
    @property
    def length_m(self, /) -> float:
        """
        Its length, m.
        """
    @property
    def p_free(self, /) -> float:
        """
        How likely nothing stops the robot on it.
        """
    @property
    def times_us(self, /) -> Stamps:
        """
        When the robot comes to each, int64 (n,), microseconds since 1970 in UTC:
        ``.view("datetime64[us]")``.
        """
    def to_dict(self, /) -> Json:
        """
        As ``chronotope grid plan --json`` prints it.
        """
    def to_json(self, /) -> str:
        """
        The line that ``chronotope grid plan --json`` prints.
        """
    @property
    def xy(self, /) -> Numbers:
        """
        The centres of its cells from start to goal, float64 (n, 2), m.
        """

@final
class GridVerdict:
    """
    What became of a map that was judged, and why.

    ``outcome`` is ``"integrated"``; ``"quarantined"``: it is not believed and kept (``Grid.held``);
    ``"adopted"``: it shows the same change as others in quarantine, and ``num_maps`` of them were
    integrated; or ``"known"``: it was in the grid already.
    """
    def __repr__(self, /) -> str: ...
    @property
    def disagreement(self, /) -> float | None:
        """
        The share of its cells that were wrongly predicted, after it was laid onto the prediction.
        """
    @property
    def expected(self, /) -> float | None:
        """
        The share that the prediction itself expected to be wrong.
        """
    @property
    def id(self, /) -> str:
        """
        The map's identity, by which ``Grid.accept`` and ``Grid.drop_held`` know it.
        """
    @property
    def limit(self, /) -> float | None:
        """
        The largest share that is usual; None as long as maps are not judged.
        """
    @property
    def num_maps(self, /) -> int:
        """
        How many maps were integrated: one, none, or with others out of quarantine several.
        """
    @property
    def observer(self, /) -> str:
        """
        Who made it.
        """
    @property
    def outcome(self, /) -> str:
        """
        ``"integrated"``, ``"quarantined"``, ``"adopted"`` or ``"known"``.
        """
    @property
    def reason(self, /) -> str | None:
        """
        Why it is not believed: ``"contradiction"``, ``"shift"``, ``"nothing"`` (nothing of it can be
        compared), or None where it is.
        """
    @property
    def shift_limit_m(self, /) -> float | None:
        """
        The largest shift that is usual, m; None as long as maps are not judged.
        """
    @property
    def shift_m(self, /) -> float | None:
        """
        By how many metres it had to be moved; None where nothing was predicted to lay it onto.
        """
    @property
    def time(self, /) -> Moment:
        """
        When it was made, in UTC.
        """
    def to_dict(self, /) -> Json:
        """
        All of it, as a dictionary.
        """
    @property
    def why(self, /) -> str:
        """
        The same as a sentence with the numbers.
        """

@final
class LearnReport:
    """
    What was learnt of a folder, and what was left out.
    """
    def __repr__(self, /) -> str: ...
    @property
    def num_held(self, /) -> int:
        """
        Visits that the map does not believe (``Map.held``).
        """
    @property
    def num_known(self, /) -> int:
        """
        Images that the map had already.
        """
    @property
    def num_learnt(self, /) -> int:
        """
        Visits that were learnt.
        """
    @property
    def num_same_visit(self, /) -> int:
        """
        Images that belong to a visit that was learnt.
        """
    @property
    def problems(self, /) -> list[str]:
        """
        What was left out, and why.
        """

@final
class Learner:
    """
    Learns images of known places into a map, visit by visit.

    ``map`` is a ``Map`` or a path. Nothing is in the file before ``commit``, which a ``with`` block calls at
    its end; ``commit_every_s`` commits by itself at most so often (None: never). ``session`` names the
    run that the visits belong to (``Map.forget``). ``config`` replaces keys of the table ``[learn]``.

    Errors: ``IoError`` if the file may not be written.
    """
    def __enter__(self, /) -> Learner: ...
    def __exit__(self, /, *_exception: "object") -> None: ...
    def __new__(cls, /, map: MapLike, *, session: str = "python", config: ConfigLike | None = None, commit_every_s: SupportsFloat | SupportsIndex | None = None) -> Learner: ...
    def close(self, /) -> None:
        """
        Commits, and lets go of the file.
        """
    def commit(self, /) -> int:
        """
        Writes what was learnt as a generation of the file, and gives its number; on top of what others
        have committed meanwhile.
        """
    def observe(self, /, place: str, image: ImageLike, time: TimeLike, *, mask: MaskLike | None = None, bgr: bool = False, name: str = "") -> Json:
        """
        Learns one image of ``place``, taken at ``time``; gives a dictionary with ``num_seen``,
        ``num_born``, ``experience``, ``is_same_visit`` and ``doubt``, which says why it is held instead.

        ``image`` is an array, a PIL image, ``Features`` with their ``image_size``, or the path of a file, which
        is cut, turned, scaled and masked as an index.csv above it says. ``name`` is kept for people (of a path:
        its own).

        Errors: ``AlreadyExistsError`` if the very same visit was learnt before, ``ShapeError`` for images of
        another size than the map's, ``TimeError``, ``FormatError`` for a file that is no image.
        """

@final
class Localization:
    """
    Where an image was taken, how sure that is, and why.

    Made by ``Localizer.localize`` and ``Robot.see``. ``decision`` is one of ``"at"`` (``place`` is
    where the robot is), ``"near"`` (it is at one of the neighbours in ``region``), ``"ambiguous"``
    (in the map, but several places fit) and ``"unknown"``. "Not here" is an answer and no error.
    """
    def __repr__(self, /) -> str: ...
    def _jpeg(self, /) -> bytes | None:
        """
        The image as JPEG, if there is one.
        """
    def _repr_html_(self, /) -> str:
        """
        The image with what was found (green), missing (orange) and unexpected (grey), and the
        posterior as bars: what a notebook shows.
        """
    @property
    def best(self, /) -> Candidate | None:
        """
        The first place, whatever was decided; None in a map without places.
        """
    @property
    def decision(self, /) -> str:
        """
        ``"at"``, ``"near"``, ``"ambiguous"`` or ``"unknown"``.
        """
    @property
    def displacement_px(self, /) -> tuple[float, float] | None:
        """
        By how much the image is moved against the first place: (dx, dy) in px, live minus map; None
        if no matches agree on that.
        """
    @property
    def displacement_spread_px(self, /) -> tuple[float, float] | None:
        """
        The spread of the matches that agree, (x, y) in px.
        """
    @property
    def features(self, /) -> Features:
        """
        The features of the image.
        """
    @property
    def matches(self, /) -> Matches:
        """
        The matches of the first place: a structured array with ``feature`` (its id within the
        place), ``live`` (row of ``features``), ``map_x``, ``map_y``, ``live_x``, ``live_y`` in px,
        ``p`` (its predicted visibility; NaN for the experience methods), ``distance_bits`` and
        ``inlier``.
        """
    @property
    def method(self, /) -> str:
        """
        The method that answered.
        """
    @property
    def missing_xy(self, /) -> Points:
        """
        Where the features that were predicted of the first place and not found would lie in the
        image, float32 (n, 2) in px.
        """
    @property
    def name(self, /) -> str:
        """
        What the image is called: its path, or the argument ``name``.
        """
    @property
    def num_inliers(self, /) -> int:
        """
        Matches of the first place that agree on one displacement.
        """
    @property
    def num_matches(self, /) -> int:
        """
        Matches of the first place.
        """
    @property
    def off_map(self, /) -> float:
        """
        The probability of being at none of the places.
        """
    @property
    def pairs_compared(self, /) -> int:
        """
        Hamming distances that were computed.
        """
    @property
    def place(self, /) -> str | None:
        """
        The place that was decided for; of neighbours the most probable; None if there is none.
        """
    @property
    def places(self, /) -> list[str]:
        """
        The names of the places in order of ``ranking``.
        """
    @property
    def posterior(self, /) -> Numbers:
        """
        The posterior probability of each place in order of ``ranking``, float64 (n,). With
        ``off_map`` they sum to 1. Of methods that count matches it is a share of the score, and not
        calibrated.
        """
    @property
    def ranking(self, /) -> list[Candidate]:
        """
        Every place that was matched, best first.
        """
    @property
    def reason(self, /) -> str:
        """
        The numbers behind the decision, as a sentence.
        """
    @property
    def region(self, /) -> list[str]:
        """
        The places that hold the probability which the risk asks for, most probable first.
        """
    @property
    def scores(self, /) -> Numbers:
        """
        The score of each place in order of ``ranking``, float64 (n,): log odds, or a count.
        """
    @property
    def tied(self, /) -> int:
        """
        How many places share the best score.
        """
    @property
    def time(self, /) -> MaybeMoment:
        """
        When the image was taken, in UTC, where that is known.
        """
    @property
    def time_source(self, /) -> str | None:
        """
        Who said so: ``"option"`` (the argument), ``"index"`` or ``"exif"``.
        """
    def to_dict(self, /, *, top: SupportsIndex = 0) -> Json:
        """
        The answer as a dictionary with the keys of ``chronotope localize --json``.
        """
    def to_json(self, /, *, top: SupportsIndex = 0) -> str:
        """
        The answer as the line that ``chronotope localize --json --top N`` prints.
        """
    @property
    def truth(self, /) -> str | None:
        """
        The place that an index says it shows.
        """
    @property
    def unexpected(self, /) -> Ids:
        """
        Rows of ``features`` that nothing predicted, uint32 (n,).
        """

@final
class Localizer:
    """
    Says where images were taken, by one state of a map.

    ``map`` is a ``Map`` or the path of one. ``method`` is ``"fremen"`` (the default: the features that
    should be visible at the image's time), ``"static"``, ``"fused"``, ``"experience"``,
    ``"experience-all"`` or ``"freex"``; ``score`` is ``"likelihood"``, ``"inliers"`` or ``"count"``;
    ``n`` features of each place are matched; an answer names a wrong place with a probability of at
    most ``risk``. ``config`` replaces single keys of the table ``[localize]``
    (``chronotope localize --print-config``), and the attribute ``config`` shows all.

    Fitting takes a tenth of a second to a few seconds; of a path it is kept in a file beside the map
    where it took more than one (``index_cache``: ``"auto"``, ``"always"``, ``"never"``). It reads the
    map as it was then: make another one after ``Map.refresh``. Threads may share it, and work at the
    same time.

    Of paths, ``zone`` ("Europe/Prague") is that of EXIF times without an offset, and ``manifest`` the
    name of a supported dataset, a manifest or a folder, whose index and rule for file names count
    before an index.csv above the file.

    Errors: those of ``Map.open``; ``ConfigError`` for values out of range and for an extractor that this
    version does not know.
    """
    def __new__(cls, /, map: MapLike, *, method: str | None = None, score: str | None = None, n: SupportsIndex | None = None, risk: SupportsFloat | SupportsIndex | None = None, config: ConfigLike | None = None, index_cache: str = "auto", zone: str | None = None, manifest: str | None = None) -> Localizer: ...
    def __repr__(self, /) -> str: ...
    @property
    def config(self, /) -> Json:
        """
        Everything that is in effect, with the keys of the table ``[localize]``.
        """
    def extract(self, /, image: PixelsLike, *, mask: MaskLike | None = None, bgr: bool = False) -> Features:
        """
        The features of an image, as the map was learnt with: what ``localize`` finds in it.

        Errors: as ``extract``.
        """
    @property
    def generation(self, /) -> int:
        """
        Which commit of the map it reads.
        """
    @property
    def image_size(self, /) -> tuple[int, int] | None:
        """
        Width and height in px of the images that the map was learnt from; None while it is empty.
        """
    def localize(self, /, image: ImageLike, time: TimeLike | None = None, *, mask: MaskLike | None = None, bgr: bool = False, name: str = "", prior: SupportsGetItem[int, str] | None = None) -> Localization:
        """
        Says where an image was taken.

        ``image`` is uint8 (height, width), or (height, width, 3) in RGB (``bgr=True``: in BGR, as
        OpenCV has it), a PIL image, ``Features``, or a path. A contiguous grey array is read where it
        lies. An image of another size than the map's but of its shape is scaled to it.

        ``time`` is when it was taken: an aware datetime, a datetime64 (of UTC), text with an offset
        or seconds since 1970. Of a path it may be left out where an index.csv above the file or its EXIF
        data with an offset say it.

        ``mask`` (height, width) hides what is 0 or False.

        ``prior`` names the places where it may have been taken, as far as is known: these are matched,
        and in a large map all others only if the image decides for none of them.

        Errors: ``ShapeError`` for arrays that are no image and images that do not fit the map,
        ``TimeError`` for a time that is missing or naive, ``FormatError`` and ``NotFoundError`` for files,
        ``NotFoundError`` for a place that is not in the map.
        """
    def localize_file(self, /, path: PathLike, time: TimeLike | None = None) -> list[Localization]:
        """
        Says where the pictures of a file were taken: one answer for each that its index cuts out of
        it, in its order.

        Errors: as ``localize``.
        """
    def localize_many(self, /, images: ImagesLike, times: TimesLike | None = None, *, threads: SupportsIndex | None = None, bgr: bool = False, errors: str = "raise", progress: ProgressLike | None = None) -> Answers:
        """
        Says where many images were taken, on several threads: the same answers, in the same order,
        as ``localize`` gives one by one.

        ``images`` is a sequence of what ``localize`` takes, or an array (n, height, width); ``times``
        as many times, or None. ``threads`` is the number of threads, of all cores by default.
        ``errors="return"`` puts an exception in the place of an answer that cannot be given, instead of
        raising the first. ``progress=True`` shows a bar where ``tqdm`` is installed. Ctrl-C is heard
        every few images.

        Errors: as ``localize``; their ``place`` says which image.
        """
    @property
    def method(self, /) -> str:
        """
        The method that answers.
        """
    @property
    def places(self, /) -> list[str]:
        """
        The names of the places, in the order of the map.
        """

@final
class Map:
    """
    A map file: places, what was seen at each visit, and every commit that made it.

    ``Map.open`` reads one, ``Map.build`` learns one from a folder of images, ``Map.create`` begins an
    empty one, ``Map.merge`` makes one of several. Any number of processes may read a file while one
    writes; what others have committed is seen after ``refresh``. Every change is a generation that
    ``rollback`` can return to. A ``with`` block closes it.
    """
    def __contains__(self, name: str, /) -> bool: ...
    def __enter__(self, /) -> Map: ...
    def __exit__(self, /, *_exception: "object") -> None: ...
    def __getitem__(self, name: str, /) -> Place: ...
    def __len__(self, /) -> int: ...
    def __repr__(self, /) -> str: ...
    def accept(self, /, ids: SupportsGetItem[int, str] | None = None, *, config: ConfigLike | None = None) -> int:
        """
        Learns visits that are held; ``ids`` are their beginnings, None means all. Gives the generation.
        """
    def add_edge(self, /, start: str, end: str, *, name: str = "") -> int:
        """
        Adds a way from one place to another, and gives the generation.

        Errors: ``NotFoundError`` if the map lacks a place.
        """
    @staticmethod
    def build(data: PathLike, path: PathLike, *, preset: str = "default", config: ConfigLike | None = None, keep_appearances: str | None = None, zone: str | None = None, threads: SupportsIndex | None = None, progress: ProgressLike | None = None) -> Map:
        """
        Learns a map from a folder of images of known places and times, as ``chronotope map build``
        does.

        ``data`` is a folder with an ``index.csv`` (columns place, time, path), one in a known layout,
        or a manifest. Visits are committed to ``path.part`` while it learns; Ctrl-C loses nothing, and
        the same call goes on where it stopped. ``config`` replaces keys of the table ``[learn]``,
        ``keep_appearances`` is ``"none"``, ``"experiences"`` or ``"all"``. What was left out and why is in
        ``map.learnt.problems`` and in the log.

        Errors: ``AlreadyExistsError`` if ``path`` exists, ``FormatError`` if nothing could be learnt.
        """
    def calibrate(self, /, *, config: ConfigLike | None = None) -> int | None:
        """
        Works out once what matches in this map are worth and keeps it with it, so that localizers
        start at once; gives the number of past images, or None if it was known.
        """
    def close(self, /) -> None:
        """
        Lets go of the file; snapshots and localizers that were made of it stay as they are.
        """
    @property
    def closed(self, /) -> bool:
        """
        Whether ``close`` was called.
        """
    @staticmethod
    def create(path: PathLike, *, preset: str = "default", name: str | None = None, zone: str | None = None) -> Map:
        """
        Begins an empty map, for a ``Learner``; a file that exists is never overwritten.

        ``name`` gives the map's UUID, so that the same images give the same map; it is random
        otherwise. ``preset`` is ``"default"`` or ``"lttl"``, the recipe of the FreMEn authors' benchmark.

        Errors: ``AlreadyExistsError``, ``ConfigError``.
        """
    def drop_held(self, /, ids: SupportsGetItem[int, str] | None = None) -> int:
        """
        Forgets visits that are held. Gives the generation.
        """
    @property
    def edges(self, /) -> list[tuple[str, str, str]]:
        """
        The ways between places: (from, to, name).
        """
    def export(self, /, folder: PathLike) -> None:
        """
        Writes the map as plain files (JSON, CSV, NPY) into a new folder.
        """
    def forget(self, /, session: str) -> int:
        """
        Takes back all visits of a run, by its UUID or name, and says how many they were.
        """
    @property
    def generation(self, /) -> int:
        """
        Which commit was read last, counted from 0.
        """
    def held(self, /) -> list[Json]:
        """
        The visits that it does not believe, as ``chronotope map held --json`` prints them.
        """
    @staticmethod
    def import_folder(folder: PathLike, path: PathLike) -> Map:
        """
        Makes a map of such a folder.

        Errors: ``AlreadyExistsError`` if ``path`` exists, ``FormatError`` for damaged files.
        """
    def inspect(self, /) -> Json:
        """
        All that it holds, as ``chronotope map inspect --json`` prints it.
        """
    def join_places(self, /, place: str, other: str) -> int:
        """
        Makes the visits of ``other`` visits of ``place``.
        """
    @property
    def learnt(self, /) -> LearnReport | None:
        """
        What the last ``build`` has learnt and left out; None for a map that was opened.
        """
    def log(self, /) -> list[Json]:
        """
        Every commit, oldest first, as ``chronotope map log --json`` prints them.
        """
    @staticmethod
    def merge(maps: SupportsGetItem[int, MapLike], path: PathLike, *, relearn: bool = False, disjoint: bool = False, config: ConfigLike | None = None) -> Map:
        """
        Makes one map of several, of robots or days, as ``chronotope map merge`` does: the union of
        their visits, the same in any order.

        ``relearn=True`` learns all visits anew (``config`` as for ``build``); ``disjoint=True`` allows maps
        that have nothing in common.

        Errors: ``ConfigError`` for maps of other extractors or without anything in common,
        ``AlreadyExistsError`` if ``path`` exists.
        """
    @staticmethod
    def open(path: PathLike, *, read_only: bool = False) -> Map:
        """
        Opens a map file: to be written where file and folder allow it, else read-only.

        Reads and checks all of it.

        Errors: ``NotFoundError``, ``FormatError`` if it is no map, ``ChecksumError`` if it is damaged.
        """
    @property
    def path(self, /) -> Path:
        """
        The file.
        """
    def place(self, /, name: str) -> Place:
        """
        The place of this name.

        Errors: ``NotFoundError``, with the names that there are.
        """
    @property
    def places(self, /) -> list[Place]:
        """
        The places, in order of creation.
        """
    def predict(self, /, place: str, time: TimeLike, *, n: SupportsIndex | None = None, config: ConfigLike | None = None) -> PredictedMap:
        """
        Which features of a place should be visible at a time, most likely first, as
        ``chronotope predict`` says; at most ``n``.

        Models are fitted at each call; ask for several times at once with ``predict_many``.

        Errors: ``NotFoundError``, ``TimeError``, ``ConfigError``.
        """
    def predict_many(self, /, place: str, times: SupportsGetItem[int, TimeLike], *, n: SupportsIndex | None = None, config: ConfigLike | None = None) -> list[PredictedMap]:
        """
        ``predict`` for several times, of models that are fitted once.
        """
    def prune(self, /, *, keep_last: SupportsIndex = 1, keep_daily: bool = False, keep: SupportsGetItem[int, SupportsIndex] = ...) -> tuple[int, int, int]:
        """
        Forgets generations but the newest ``keep_last``, those in ``keep`` and, with ``keep_daily``, the
        last of each day; gives how many are gone, and the bytes of the file before and after.
        """
    @property
    def read_only(self, /) -> bool:
        """
        Whether the file was opened without the right to change it.
        """
    def refresh(self, /) -> int:
        """
        Reads what other processes have committed, and gives the newest generation.
        """
    def remove_edge(self, /, start: str, end: str, *, name: str | None = None) -> int:
        """
        Removes the ways from one place to another, or the one of that name.

        Errors: ``NotFoundError``.
        """
    def remove_place(self, /, place: str) -> int:
        """
        Removes a place with all of its visits.
        """
    def rename_place(self, /, place: str, to: str) -> int:
        """
        Gives a place another name, and gives the generation.
        """
    def rollback(self, /, to: SupportsIndex) -> int:
        """
        Returns to what the map was at a generation, as a new generation, and gives its number;
        nothing is lost.

        Errors: ``NotFoundError``.
        """
    def update(self, /, data: PathLike, *, config: ConfigLike | None = None, keep_appearances: str | None = None, threads: SupportsIndex | None = None, progress: ProgressLike | None = None) -> LearnReport:
        """
        Learns more images of known places and times into the map, as ``chronotope map update`` does;
        what it has already is not learnt again.

        Errors: ``IoError`` if the file may not be written.
        """
    def verify(self, /) -> Json:
        """
        Checks every byte of this map's file, as ``verify_file``.
        """
    @staticmethod
    def verify_file(path: PathLike) -> Json:
        """
        Checks every byte of a map file and changes nothing: a dictionary as
        ``chronotope map verify --json`` prints it, with ``clean`` and ``faults``.

        Errors: ``NotFoundError``, ``FormatError`` if it is no map at all.
        """

@final
class Office:
    """
    An office that is drawn: two rooms, a corridor between cupboards that are open by day, a second way
    through doors, desks and chairs; all of it follows hour and weekday (UTC), the same on every
    machine.

    ``resolution`` is the side of a cell in metres. After T. Krajník et al., IROS 2016, sections V and
    VI.

    Errors: ``ConfigError`` for a resolution that makes no grid.
    """
    def __new__(cls, /, seed: SupportsIndex = 1, *, resolution: SupportsFloat | SupportsIndex = 0.05) -> Office: ...
    def __repr__(self, /) -> str: ...
    def grid(self, /) -> Grid:
        """
        An empty grid in memory over the whole office.
        """
    @property
    def places(self, /) -> tuple[tuple[float, float], tuple[float, float]]:
        """
        Two places (x, y) in m where nothing ever stands: in the first room, and in the second.
        """
    def render(self, /, time: TimeLike) -> Occupancy:
        """
        The map of a moment, without the people who walk by, int8 (height, width) as in ROS: 100
        occupied, 0 free, -1 unknown; row 0 has the lowest y.

        Errors: ``TimeError``.
        """

@final
class Place:
    """
    One place of a map, as it was when it was asked for.
    """
    def __len__(self, /) -> int:
        """
        How many features it has.
        """
    def __repr__(self, /) -> str: ...
    @property
    def descriptors(self, /) -> Descriptors:
        """
        Their descriptors, uint8 (n, 32).
        """
    @property
    def features(self, /) -> Features:
        """
        Its features, in order of birth.
        """
    @property
    def name(self, /) -> str:
        """
        Its name.
        """
    @property
    def pose(self, /) -> tuple[float, float, float] | None:
        """
        Position in metres in a frame of the user's, where known.
        """
    def seen(self, /) -> Ternary:
        """
        What was seen when, int8 (m visits, n features): 1 seen, 0 not seen, -1 not observable (before
        its birth, or under a mask).
        """
    @property
    def visit_ids(self, /) -> list[str]:
        """
        The identity of each visit across maps.
        """
    @property
    def visit_sessions(self, /) -> list[str]:
        """
        The run of each visit.
        """
    @property
    def visit_sources(self, /) -> list[str]:
        """
        Where the image of each visit came from.
        """
    @property
    def visit_times_us(self, /) -> Stamps:
        """
        When each visit was, int64 (m,), microseconds since 1970 in UTC: ``.view("datetime64[us]")``.
        """
    @property
    def xy(self, /) -> Points:
        """
        Positions of the features, float32 (n, 2), px.
        """

@final
class PlannedVisit:
    """
    One visit of a plan, or one stop of a tour.
    """
    def __repr__(self, /) -> str: ...
    @property
    def end(self, /) -> Moment:
        """
        When it may leave, in UTC.
        """
    @property
    def info_bits(self, /) -> float:
        """
        What it is expected to teach, in the bits of the strategy.
        """
    @property
    def place(self, /) -> str:
        """
        Where.
        """
    @property
    def reason(self, /) -> str:
        """
        Why, in words.
        """
    @property
    def slot(self, /) -> int | None:
        """
        The slot of the plan that it fills, counted from 0; None for a stop of a tour.
        """
    @property
    def start(self, /) -> Moment:
        """
        When the robot is to be there, in UTC.
        """
    def to_dict(self, /) -> Json:
        """
        As ``chronotope explore plan --json`` prints it.
        """
    def to_json(self, /) -> str:
        """
        The line that ``chronotope explore plan --json`` prints.
        """

@final
class PoseEstimate:
    """
    Where a laser is, and how surely.
    """
    def __repr__(self, /) -> str: ...
    @property
    def deviation_m(self, /) -> float:
        """
        Their standard deviation in x and y together, m.
        """
    @property
    def deviation_rad(self, /) -> float:
        """
        Their standard deviation in heading, rad.
        """
    @property
    def fit(self, /) -> float:
        """
        How well the scan fits the map: the geometric mean of the likelihood of a beam.
        """
    @property
    def num_particles(self, /) -> int:
        """
        Particles of all groups.
        """
    @property
    def pose(self, /) -> tuple[float, float, float]:
        """
        x and y in m, heading in rad: the mean of the heaviest group of particles.
        """
    @property
    def share(self, /) -> float:
        """
        The share of all weight that they have: low where the laser may be in several places.
        """
    def to_dict(self, /) -> Json:
        """
        As ``chronotope grid localize --json`` prints it, but for the log's time.
        """

@final
class PredictedMap:
    """
    What a place should look like at a time.
    """
    def __len__(self, /) -> int: ...
    def __repr__(self, /) -> str: ...
    def _repr_html_(self, /) -> str: ...
    @property
    def estimate(self, /) -> Triples:
        """
        p(t) with the lower and the upper end of its 95 % interval, float64 (n, 3).
        """
    @property
    def ids(self, /) -> Ids:
        """
        Ids of the features within the place, most likely first, uint32 (n,).
        """
    @property
    def p(self, /) -> Numbers:
        """
        p(t) of each, float64 (n,).
        """
    @property
    def place(self, /) -> str:
        """
        The place.
        """
    @property
    def time(self, /) -> Moment:
        """
        The time, in UTC.
        """
    def to_dict(self, /) -> Json:
        """
        As ``chronotope predict --json`` prints it.
        """
    def to_json(self, /) -> str:
        """
        The line that ``chronotope predict --json`` prints.
        """
    @property
    def xy(self, /) -> Points:
        """
        Where they are, float32 (n, 2), px.
        """

@final
class Prospect:
    """
    What a look at a place would be worth, if nothing else were planned.
    """
    def __repr__(self, /) -> str: ...
    @property
    def looks(self, /) -> float:
        """
        Looks that the model of this hour rests on.
        """
    @property
    def model_bits(self, /) -> float:
        """
        What a look tells of the model, in bits of a state that is known for one slot.
        """
    @property
    def p(self, /) -> float:
        """
        The mean over its states of the probability of 1.
        """
    @property
    def place(self, /) -> str:
        """
        The place.
        """
    @property
    def slots(self, /) -> float:
        """
        For so many slots what is seen stays true.
        """
    @property
    def state_bits(self, /) -> float:
        """
        The uncertainty of its states at the look, bits.
        """
    def to_dict(self, /) -> Json:
        """
        As ``chronotope explore explain --json`` prints it.
        """
    def to_json(self, /) -> str:
        """
        The line that ``chronotope explore explain --json`` prints.
        """
    @property
    def value(self, /) -> float:
        """
        What places are ranked by.
        """

@final
class Robot:
    """
    A map, a camera's features, and what is believed: localises image after image, and learns from
    them if it shall.

    ``learn=True`` learns each located image as a visit of its place, on a second thread; a dictionary
    replaces keys of the table ``[learn]``. ``inline=True`` learns between images instead: slower, and
    the same images give the same map. ``track=True`` takes the images as one way (a dictionary: the
    table ``[motion]``). ``live=False`` says that the images were recorded, and may come in any order of
    time. The other arguments are those of ``Localizer``. A ``with`` block commits at its end.

    Errors: those of ``Localizer``; ``ConfigError`` if it shall learn but the map may not be written.
    """
    def __enter__(self, /) -> Robot: ...
    def __exit__(self, /, *_exception: "object") -> None: ...
    def __new__(cls, /, map: PathLike, *, method: str | None = None, score: str | None = None, n: SupportsIndex | None = None, risk: SupportsFloat | SupportsIndex | None = None, config: ConfigLike | None = None, learn: ConfigLike | None = None, inline: bool = False, track: ConfigLike | None = None, mask: MaskLike | None = None, live: bool = True, index_cache: str = "auto", commit_every_s: SupportsFloat | SupportsIndex = 1.0) -> Robot: ...
    def __repr__(self, /) -> str: ...
    def close(self, /) -> None:
        """
        Commits what was learnt and lets go of the file.
        """
    def commit(self, /) -> None:
        """
        Waits until everything that was located is learnt, and commits it.
        """
    def events(self, /) -> list[Json]:
        """
        What happened since this was called last, the oldest first: dictionaries with ``event`` one of
        ``"learnt"``, ``"held"``, ``"same-visit"``, ``"not-learnt"``, ``"missed"``, ``"not-committed"`` and
        ``"committed"``. At most 256 are kept.
        """
    @property
    def path(self, /) -> Path:
        """
        The map's file.
        """
    @property
    def place(self, /) -> str | None:
        """
        The place of the last image, if that was decided.
        """
    def see(self, /, image: PixelsLike, time: TimeLike, *, mask: MaskLike | None = None, bgr: bool = False, name: str = "", now: TimeLike | None = None) -> Localization:
        """
        Says where an image was taken, and learns it if that is wanted and it was located.

        ``image`` and ``time`` as for ``Localizer.localize``, but no file. ``now`` is what the robot's clock
        says where that is not the system's. What goes wrong with learning is an event, no exception.

        Errors: ``ShapeError`` for an image of another size than the map's, ``TimeError``.
        """
    @property
    def session(self, /) -> str:
        """
        The run that its visits belong to: ``Map.forget`` takes them back.
        """
    @property
    def timing_s(self, /) -> tuple[float, float]:
        """
        How long the last image took, seconds: to extract its features, and to localise them.
        """
    @property
    def totals(self, /) -> Json:
        """
        What was done so far: ``num_images``, ``num_located``, ``num_learnt``, ``num_same_visit``,
        ``num_held``, ``num_not_learnt``, ``num_missed``.
        """

@final
class SeriesModel:
    """
    A model of one state, fitted.
    """
    def anomalies(self, /, times_us: Microseconds, states: States, confidence: SupportsFloat | SupportsIndex) -> Ids:
        """
        Rows of the samples that the model gave a probability below 1 - ``confidence``, uint32.

        Errors: ``ConfigError`` unless ``confidence`` is in [0.5, 1].
        """
    @property
    def components(self, /) -> Triples:
        """
        The rhythms, strongest first, float64 (k, 3): period in s, amplitude, phase in rad.
        """
    @staticmethod
    def decode(bytes: bytes) -> SeriesModel:
        """
        The model that ``encode`` wrote.

        Errors: ``ChecksumError``, ``FormatError``.
        """
    def encode(self, /) -> bytes:
        """
        The model as bytes, from which ``decode`` makes one that predicts the same bits.
        """
    def estimate(self, /, times_us: Microseconds) -> Triples:
        """
        p with the lower and the upper end of its 95 % interval, float64 (n, 3).
        """
    @staticmethod
    def fit(times_us: Microseconds, states: States, config: str) -> SeriesModel:
        """
        Fits the model that ``config``, the JSON of a visibility model, names.
        """
    @property
    def level(self, /) -> float | None:
        """
        What the rhythms swing about; None for a model that is not a level and rhythms.
        """
    @property
    def mean(self, /) -> float | None:
        """
        The share of samples that are 1; None for a model that does not keep it.
        """
    @property
    def order(self, /) -> int:
        """
        The most rhythms that the model may have.
        """
    def p(self, /, times_us: Microseconds) -> Numbers:
        """
        p at each time, float64 (n,).
        """

@final
class Simulation:
    """
    How well a robot has known the places that it explored.
    """
    def __repr__(self, /) -> str: ...
    @property
    def bits_a_visit(self, /) -> float:
        """
        What a visit was expected to teach, on average, in the bits of the strategy.
        """
    @property
    def by_day(self, /) -> Numbers:
        """
        The same of each planned stretch, float64 (n,).
        """
    @property
    def error(self, /) -> float:
        """
        The share of states, over places and moments, that it had wrong when it took each to be 1 if p >
        1/2; what it was looking at it knew (RAS 2017 eq. 1 and 2).
        """
    @property
    def num_rerouted(self, /) -> int:
        """
        How often a visit was not the one that had been planned.
        """
    @property
    def num_visits(self, /) -> int:
        """
        How many they are.
        """
    def to_dict(self, /) -> Json:
        """
        As ``chronotope explore simulate --by-day --json`` prints it.
        """
    def to_json(self, /) -> str:
        """
        The line that ``chronotope explore simulate --by-day --json`` prints.
        """
    @property
    def visits(self, /) -> list[PlannedVisit]:
        """
        Every visit that was made, in order of time.
        """

@final
class Street:
    """
    A street that is drawn: places with lamps, shutters, blossom, cars and shadows that follow year,
    week and day, the same on every machine.

    ``rhythms=False`` makes the control, in which nothing depends on time. ``image_size`` is width and
    height, 256 x 240 to 1280 x 1024 px.

    Errors: ``ConfigError`` for sizes and numbers of places out of range.
    """
    def __new__(cls, /, seed: SupportsIndex = 1, *, num_places: SupportsIndex = 4, rhythms: bool = True, image_size: tuple[SupportsIndex, SupportsIndex] = ...) -> Street: ...
    def __repr__(self, /) -> str: ...
    @property
    def places(self, /) -> list[str]:
        """
        The names of the places, in order along the street.
        """
    def render(self, /, place: str, time: TimeLike, *, visit: SupportsIndex = 0) -> Picture:
        """
        The image of one visit, uint8 (height, width); another ``visit`` is another one at that time.

        Errors: ``NotFoundError``, ``TimeError``.
        """
    def schedule(self, /, num_learn: SupportsIndex = 12, num_query: SupportsIndex = 6) -> tuple[list[Moment], list[Moment]]:
        """
        When somebody walks along the street: rounds in 2023 to learn from, and in 2024 to localise.
        """

@final
class Tour:
    """
    A way through places, with what is looked at when.
    """
    def __len__(self, /) -> int: ...
    def __repr__(self, /) -> str: ...
    @property
    def spent_s(self, /) -> float:
        """
        Seconds of driving and visiting.
        """
    @property
    def stops(self, /) -> list[PlannedVisit]:
        """
        Its stops in order of time: visits, and when it is charged.
        """
    def to_dict(self, /) -> Json:
        """
        All of it, as a dictionary; stops are as ``chronotope explore plan --roads --json`` prints them.
        """
    @property
    def travel_s(self, /) -> float:
        """
        Seconds of driving alone.
        """
    @property
    def value(self, /) -> float:
        """
        The sum of what its visits add.
        """

@final
class Tracker:
    """
    Follows a robot from answer to answer along the map's edges: a Bayes filter over the places.

    ``config`` replaces keys of the table ``[motion]``. For answers of one ``Localizer`` with the score
    ``"likelihood"``, one way at a time.

    Errors: ``ConfigError`` for another score or numbers that are no probabilities.
    """
    def __new__(cls, /, localizer: Localizer, *, config: ConfigLike | None = None) -> Tracker: ...
    @property
    def belief(self, /) -> Json:
        """
        What is believed of each place, by name; empty before the first image.
        """
    @property
    def off_map(self, /) -> float:
        """
        What is believed of being at none of them.
        """
    def reset(self, /) -> None:
        """
        Forgets where the robot was.
        """
    def update(self, /, answer: Localization) -> Localization:
        """
        Takes the next image's answer into account, and gives the answer for the whole way.

        Errors: ``ConfigError`` for an answer by another score, ``ShapeError`` for one of another map.
        """

def _address_of(image: PixelsLike) -> int:
    """
    Where the pixels that would be read begin in memory, for tests: the array's own address if
    nothing is copied.
    """

def calendar() -> str:
    """
    The candidate periods of the calendar (year, week, day and their fractions), as JSON.
    """

def compact(place_codes: Codes, places: SupportsGetItem[int, str], visit_codes: Codes, visits: SupportsGetItem[int, bytes | bytearray], times_us: Microseconds, features: Codes, states: States) -> tuple[Ids, ByteStrings, Stamps, ByteStrings]:
    """
    The observations of some rows, visit by visit.

    ``places`` are names and ``visits`` identities of 16 bytes, with a code for each row; ``features`` int32,
    ``states`` int8. Errors: ``FormatError`` with column and row, also for rows that contradict each other.
    """

def evaluate_visits(place: str, visits: SupportsGetItem[int, bytes | bytearray], times_us: Microseconds, states: SupportsGetItem[int, bytes | bytearray], features: Codes, models: SupportsGetItem[int, bytes | bytearray]) -> tuple[int, float, float, int]:
    """
    How well the models of a place's features have predicted visits, each counted once: observations that there
    is a model of, the sum of squared errors, the sum of -ln p of what was observed (p at least 1e-6), and
    observations without a model.

    Summed in order of the visits' identities, and of features within each: the same for any order of rows.
    """

def exif_time(path: PathLike) -> MaybeMoment:
    """
    When an image was taken, by its EXIF data; None if they say nothing with an offset.
    """

def explore_next(data: ExploredLike, now: TimeLike, *, day_from: TimeLike | None, visited: SupportsGetItem[int, tuple[str, TimeLike]], slots: SupportsIndex, slot: SupportsFloat | SupportsIndex, share: SupportsFloat | SupportsIndex, strategy: str, seed: SupportsIndex, model: str, zone: str | None) -> PlannedVisit | None:
    """
    Where to go now, if the share of the day's time is not spent.
    """

def explore_plan(data: ExploredLike, start: TimeLike, *, slots: SupportsIndex, slot: SupportsFloat | SupportsIndex, share: SupportsFloat | SupportsIndex, strategy: str, seed: SupportsIndex, model: str, zone: str | None) -> list[PlannedVisit]:
    """
    The visits of a day.
    """

def explore_prospects(data: ExploredLike, time: TimeLike, *, slots: SupportsIndex, slot: SupportsFloat | SupportsIndex, model: str, zone: str | None) -> list[Prospect]:
    """
    What a look at a time would be worth at each place.
    """

def explore_simulate(times_us: Microseconds, places: SupportsGetItem[int, tuple[str, SupportsIndex, States]], *, slots: SupportsIndex, slot: SupportsFloat | SupportsIndex, share: SupportsFloat | SupportsIndex, strategy: str, seed: SupportsIndex, model: str) -> Simulation:
    """
    Plays a recording through.
    """

def explore_tour(data: ExploredLike, start: TimeLike, roads: SupportsGetItem[int, tuple[str, str, SupportsFloat | SupportsIndex]], *, at: str | None, charger: tuple[str, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] | None, open: SupportsGetItem[int, tuple[str, TimeLike, TimeLike]], slots: SupportsIndex, slot: SupportsFloat | SupportsIndex, share: SupportsFloat | SupportsIndex, model: str, zone: str | None) -> Tour:
    """
    A tour of a robot for which driving takes time.
    """

def extract(image: PixelsLike, *, n: SupportsIndex = 600, mask: MaskLike | None = None, bgr: bool = False) -> Features:
    """
    The features of an image.

    STAR keypoints with 256 bits of BRIEF, bit for bit those of OpenCV: uint8 (height, width) in
    grey, or (height, width, 3) in RGB, in BGR with ``bgr=True``; a PIL image, or the path of a file.
    At most ``n`` are kept, strongest first, by default as many as maps of the preset ``"default"`` learn
    (``Localizer.extract`` takes what its map was learnt with); those under a ``mask`` that is 0 are left
    out.

    Errors: ``ShapeError`` for other types, shapes and strides, ``FormatError`` for a file that is no
    image, ``ConfigError`` for ``n = 0``.

    Sources: M. Agrawal, K. Konolige, M. R. Blas: CenSurE, ECCV 2008; M. Calonder et al.: BRIEF, ECCV
    2010.
    """

def join_maps(parts: SupportsGetItem[int, str | PathLike2[str]], path: PathLike) -> int:
    """
    Writes the map that these files are parts of, and gives the number of its places: parts of one map by their
    UUID, then the union of these maps.

    Errors: ``AlreadyExistsError`` if ``path`` exists, ``ConfigError`` for maps of other extractors.
    """

def merge_sums(place: str, features: Codes, sums: SupportsGetItem[int, bytes | bytearray], order: SupportsIndex) -> tuple[Ids, Ids, Ids, Numbers, ByteStrings, ByteStrings, list[list[list[float]]]]:
    """
    The sums of equal features added, and the models of at most ``order`` rhythms.

    Errors: ``ShapeError`` for more observations than a sum holds, ``ConfigError`` for sums of other periods,
    ``FormatError`` and ``ChecksumError`` for bytes that are no sums.
    """

def parse_time(text: str) -> int:
    """
    Microseconds since 1970 of a text in RFC 3339 with an offset, or a number with its unit.

    Errors: ``TimeError``, with what helps.
    """

def parse_times(texts: SupportsGetItem[int, str]) -> Stamps:
    """
    Microseconds since 1970 of texts in RFC 3339 with an offset.

    Errors: ``TimeError`` with the row.
    """

def periodogram(times_us: Microseconds, states: States, candidates: str) -> Triples:
    """
    How strong each candidate period is in the states, float64 (k, 3): period in s, amplitude, and
    the window, which is the same of the sampling alone.
    """

def predict_models(models: SupportsGetItem[int, bytes | bytearray], times_us: Microseconds) -> Numbers:
    """
    p of each model at each time, float64 (models x times,), model by model.
    """

def read_csv(path: PathLike, *, content: SupportsGetItem[int, SupportsIndex] | None = None, time_column: str | None = None, state_column: str | None = None, time_unit: str | None = None) -> tuple[Stamps, Ternary]:
    """
    Times and states of a CSV file of rows ``time,state``, as ``chronotope spectrum`` reads it.

    ``content`` are its bytes, where they are known already: of a packed file, unpacked.

    Errors: ``FormatError`` and ``TimeError`` with the line, ``NotFoundError``.
    """

def sum_visits(place: str, visits: SupportsGetItem[int, bytes | bytearray], times_us: Microseconds, states: SupportsGetItem[int, bytes | bytearray], candidates: str) -> tuple[Ids, ByteStrings]:
    """
    The sums of the features of one place over some visits, each counted once, however often it is there:
    features uint32, and for each the bytes of its sums.

    Errors: ``FormatError`` for visits that contradict each other, ``ShapeError`` for more observations than
    a sum holds.
    """
