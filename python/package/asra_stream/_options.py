"""Keywords as the command's options, and paths as its arguments."""

import collections.abc
import math
import os

Path = str | os.PathLike[str]
Paths = Path | collections.abc.Sequence[Path]
# A program's file, or the words that start it.
Program = Path | collections.abc.Sequence[Path]


def size(value):
    """A number of bytes as the command takes it."""
    return str(int(value)) if isinstance(value, (int, float)) and math.isfinite(value) else str(value)


def words(options):
    """The command line for keywords: ``cell_size=0.5`` is ``--cell-size=0.5``, ``keep_outliers=True`` is ``--keep-outliers``."""
    line = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        # Numbers and arrays of NumPy as those of Python.
        value = value.tolist() if hasattr(value, "tolist") else value
        if value is None or value is False:
            continue
        if value is True:
            line.append(option)
        elif isinstance(value, (list, tuple)):
            line.append(f"{option}={','.join(str(one) for one in value)}")
        elif isinstance(value, os.PathLike):
            line.append(f"{option}={os.fspath(value)}")
        elif name == "max_memory":
            line.append(f"{option}={size(value)}")
        else:
            line.append(f"{option}={value}")
    return line


def as_paths(inputs):
    """A path, or several, as texts."""
    inputs = [inputs] if isinstance(inputs, (str, bytes, os.PathLike)) else inputs
    if not isinstance(inputs, collections.abc.Iterable):
        raise TypeError(f"expected a path, or several, found {type(inputs).__name__}")
    return [os.fsdecode(path) for path in inputs]
