"""
The engine of `chronotope`; use that package.
"""

from _typeshed import SupportsGetItem
from chronotope._types import Answers, ByteStrings, Codes, ConfigLike, Descriptors, DescriptorsLike, Ids, ImageLike, ImagesLike, Json, MapLike, MaskLike, Matches, MaybeMoment, Microseconds, Moment, Numbers, PathLike, Picture, PixelsLike, Points, PointsLike, ProgressLike, Stamps, States, Strengths, Ternary, TimeLike, TimesLike, Triples
from os import PathLike as PathLike2
from pathlib import Path
from typing import Any, SupportsFloat, SupportsIndex, final

__all__ = ["Candidate", "Features", "LearnReport", "Learner", "Localization", "Localizer", "Map", "Place", "PredictedMap", "Robot", "SeriesModel", "Street", "Tracker", "_address_of", "calendar", "compact", "evaluate_visits", "exif_time", "extract", "join_maps", "merge_sums", "parse_time", "parse_times", "periodogram", "predict_models", "read_csv", "sum_visits"]

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
