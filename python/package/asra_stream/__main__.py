"""The command ``asra-stream``, also as ``python -m asra_stream``."""

import signal
import sys

from . import _core


def main() -> int:
    """Does what the arguments say, and gives the exit code."""
    # The command has its own way of ending at Ctrl-C.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _core.command(["asra-stream", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
