"""The command, run in this process, and how far it is."""

import collections.abc
import contextlib
import json
import sys
from typing import Any

from . import _core
from ._options import words

Progress = collections.abc.Callable[[dict[str, Any]], object] | bool | None


@contextlib.contextmanager
def shown(progress):
    """What is called with every update: a callable as it is; of True, a bar of tqdm where that is installed, else lines."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        if not callable(progress):
            raise TypeError(f"progress: expected a callable, True, False or None, found {type(progress).__name__}")
        yield progress
        return
    try:
        from tqdm.auto import tqdm
    except ImportError:

        def tell(update):
            if update["ended"]:
                share = "" if update["fraction"] is None else f"{100 * update['fraction']:4.0f} %  "
                print(f"{share}{update['stage']}: {update['done']:,} {update['unit']}", file=sys.stderr, flush=True)

        yield tell
        return
    with tqdm(total=100, unit="%", bar_format="{l_bar}{bar}| {elapsed}<{remaining}") as bar:

        def show(update):
            bar.set_description(update["stage"], refresh=False)
            if update["fraction"] is not None:
                bar.update(100 * update["fraction"] - bar.n)

        yield show


def executed(command, positional, options, progress=None):
    """What a command says of its work, a dict; keywords as its options, paths as its arguments."""
    with shown(progress) as tell:
        # What comes after "--" is a name, whatever it begins with.
        line = ["asra-stream", *command, *words(options), "--", *positional]
        return json.loads(_core.execute(line, tell))
