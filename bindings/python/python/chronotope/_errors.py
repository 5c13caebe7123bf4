"""What failed, where, and what helps?

One exception with ``kind``, ``path``, ``place`` and ``help``; subclasses to catch, each also one of
Python's own, so that ``except ValueError`` and ``except FileNotFoundError`` work as people expect.
"""

from __future__ import annotations

from typing import Any


class Error(Exception):
    """What the engine has to say of a failure.

    Attributes:
        kind: one of ``"io"``, ``"format"``, ``"checksum"``, ``"config"``, ``"shape"``, ``"time"``,
            ``"not-found"``, ``"already-exists"``, ``"conflict"``, ``"closed"``, ``"internal"``.
        message: what failed, without file, place and remedy.
        path: the file concerned, or None.
        place: the place in it, such as ``line 7``, or the argument concerned, or None.
        help: what can be done about it, or None.
    """

    kind: str
    message: str
    path: str | None
    place: str | None
    help: str | None

    def __init__(
        self,
        message: str = "",
        kind: str = "config",
        path: str | None = None,
        place: str | None = None,
        help: str | None = None,
    ) -> None:
        # The arguments make it again when it is unpickled.
        Exception.__init__(self, message, kind, path, place, help)
        self.message = message
        self.kind = kind
        self.path = path
        self.place = place
        self.help = help

    def __str__(self) -> str:
        before = [part for part in (self.path, self.place) if part]
        text = ": ".join([*before, self.message])
        return f"{text} (help: {self.help})" if self.help else text

    def __reduce__(self) -> tuple[Any, ...]:
        parts = (self.message, self.kind, self.path, self.place, self.help)
        return type(self), parts


class FormatError(Error, ValueError):
    """A file is not what its name or header says, or holds what cannot be used."""


class ChecksumError(FormatError):
    """Stored bytes do not match their checksum."""


class ConfigError(Error, ValueError):
    """An argument or a value of a configuration cannot be used."""


class ShapeError(Error, ValueError):
    """Sizes do not fit each other, or an array is no image."""


class TimeError(Error, ValueError):
    """A time is missing, naive, malformed, or out of range."""


class NotFoundError(Error, LookupError, FileNotFoundError):
    """What was named is not there: a file, a place, a generation, a visit."""


class AlreadyExistsError(Error, FileExistsError):
    """What was to be added is there already: a file, a visit."""


class ConflictError(Error, RuntimeError):
    """Somebody else was faster; the same call may succeed after ``refresh``."""


class IoError(Error, OSError):
    """The operating system refused to read or write."""


class ClosedError(Error, ValueError):
    """It was closed."""


class InternalError(Error, RuntimeError):
    """A fault of chronotope itself."""


_OF_KIND: dict[str, type[Error]] = {
    "io": IoError,
    "format": FormatError,
    "checksum": ChecksumError,
    "config": ConfigError,
    "shape": ShapeError,
    "time": TimeError,
    "not-found": NotFoundError,
    "already-exists": AlreadyExistsError,
    "conflict": ConflictError,
    "closed": ClosedError,
    "internal": InternalError,
}


def error_of_kind(
    kind: str,
    message: str,
    path: str | None = None,
    place: str | None = None,
    help: str | None = None,
) -> Error:
    """The exception for a kind of the engine."""
    return _OF_KIND.get(kind, Error)(message, kind, path, place, help)
