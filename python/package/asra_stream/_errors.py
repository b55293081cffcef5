"""Exceptions, one for each kind of failure: the same kinds that the command's exit codes tell."""

import json
from typing import Any, ClassVar


class AsraError(Exception):
    """A failure. ``kind`` and ``exit_code`` are those of the command; ``path``, ``place``, ``offset``, ``needed`` and ``given`` are None where they are not known."""

    kind: str = "internal"
    _classes: "ClassVar[dict[str, type[AsraError]]]" = {}

    def __init_subclass__(cls, *, kind: str | None = None, **options: Any) -> None:
        super().__init_subclass__(**options)
        # A subclass that somebody else makes is of its parent's kind.
        if kind is not None:
            cls.kind = kind
            AsraError._classes[kind] = cls

    def __init__(self, message: str, **details: Any) -> None:
        super().__init__(message)
        self.exit_code = details.get("code")
        self.path = details.get("path")
        self.place = details.get("place")
        self.offset = details.get("offset")
        self.needed = details.get("needed")
        self.given = details.get("given")


class UsageError(AsraError, ValueError, kind="usage"):
    """The arguments are wrong, or the output exists."""


class DataError(AsraError, ValueError, kind="data"):
    """The points are damaged, or not what they say they are."""


class NoInputError(AsraError, FileNotFoundError, kind="no-input"):
    """An input is missing or may not be read."""


class InternalError(AsraError, RuntimeError, kind="internal"):
    """A defect of asra-stream."""


class CannotFitError(AsraError, MemoryError, kind="cannot-fit"):
    """More memory or disk is needed than may be had: ``needed`` bytes, where that is known."""


class NoOutputError(AsraError, PermissionError, kind="no-output"):
    """The output may not be written there."""


class IoError(AsraError, OSError, kind="io"):
    """The system said that reading or writing failed."""


class TemporaryError(AsraError, OSError, kind="temporary"):
    """What was in the way may be gone next time: a full disk, an input that changed while it was read."""


class NotReadyError(TemporaryError, kind="not-ready"):
    """Something that another process has to make was not there, however often it was asked for."""


class IntermediateError(TemporaryError, kind="intermediate"):
    """A file in the work folder was damaged. Its record is set aside, so that it is made again."""


class StoppedError(TemporaryError, kind="signal"):
    """A process, or the worker that had started it, was ended by a signal."""


def of(failure: str) -> AsraError:
    """The exception for a failure as reports have it."""
    details = json.loads(failure)
    return AsraError._classes.get(details["kind"], InternalError)(details.pop("message"), **details)
