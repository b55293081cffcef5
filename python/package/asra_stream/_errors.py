"""Exceptions, one for each kind of failure: the same kinds that the command's exit codes tell."""

import json
from typing import Any


class AsraError(Exception):
    """A failure. ``kind`` and ``exit_code`` are those of the command; ``path``, ``place``, ``offset``, ``needed`` and ``given`` are None where they are not known."""

    kind: str = "internal"

    def __init__(self, message: str, **details: Any) -> None:
        super().__init__(message)
        self.exit_code = details.get("code")
        self.path = details.get("path")
        self.place = details.get("place")
        self.offset = details.get("offset")
        self.needed = details.get("needed")
        self.given = details.get("given")


class UsageError(AsraError, ValueError):
    """The arguments are wrong, or the output exists."""

    kind = "usage"


class DataError(AsraError, ValueError):
    """The points are damaged, or not what they say they are."""

    kind = "data"


class NoInputError(AsraError, FileNotFoundError):
    """An input is missing or may not be read."""

    kind = "no-input"


class InternalError(AsraError, RuntimeError):
    """A defect of asra-stream."""

    kind = "internal"


class CannotFitError(AsraError, MemoryError):
    """More memory or disk is needed than may be had: ``needed`` bytes, where that is known."""

    kind = "cannot-fit"


class NoOutputError(AsraError, PermissionError):
    """The output may not be written there."""

    kind = "no-output"


class IoError(AsraError, OSError):
    """The system said that reading or writing failed."""

    kind = "io"


class TemporaryError(AsraError, OSError):
    """What was in the way may be gone next time: a full disk, an input that changed while it was read."""

    kind = "temporary"


_CLASSES = {
    cls.kind: cls
    for cls in (UsageError, DataError, NoInputError, InternalError, CannotFitError, NoOutputError, IoError, TemporaryError)
}


def of(failure: str) -> AsraError:
    """The exception for a failure as reports have it."""
    details = json.loads(failure)
    return _CLASSES.get(details["kind"], InternalError)(details.pop("message"), **details)
