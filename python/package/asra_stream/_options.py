"""Keywords as the command's options."""

import os


def size(value):
    """A number of bytes as the command takes it."""
    return str(int(value)) if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)


def words(options):
    """The command line for keywords: ``cell_size=0.5`` is ``--cell-size=0.5``, ``keep_outliers=True`` is ``--keep-outliers``."""
    line = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            line.append(option)
        elif isinstance(value, (list, tuple)) or hasattr(value, "tolist"):
            line.append(f"{option}={','.join(str(one) for one in value)}")
        elif isinstance(value, os.PathLike):
            line.append(f"{option}={os.fspath(value)}")
        elif name == "max_memory":
            line.append(f"{option}={size(value)}")
        else:
            line.append(f"{option}={value}")
    return line
