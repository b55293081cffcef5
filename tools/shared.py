"""What the tools share that measure the program and others: an environment for Python, the program, a process under caps, Markdown.

Whoever measures imports nothing large before: a child's maximum resident size begins with what its parent had.
"""

import contextlib
import gzip
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "asra-stream-tools"
# What the tools that compare with others need.
PACKAGES = ["numpy", "matplotlib", "open3d", "pymeshlab"]
# What a missing library is called in Debian.
DEBIAN = {
    "libusb-1.0": "libusb-1.0-0",
    "libGL.": "libgl1",
    "libEGL.": "libegl1",
    "libX11.": "libx11-6",
    "libgomp": "libgomp1",
    "libOpenGL": "libopengl0",
}


def environment(name, packages):
    """Runs the tool anew in an environment of this name that has the packages; makes it if need be."""
    if os.environ.get("ASRA_STREAM_TOOLS"):
        return
    folder = CACHE / name
    python, whole = folder / "bin/python", folder / "packages.txt"
    if not whole.exists() or whole.read_text().split() != packages:
        print(f"making a Python environment with {', '.join(packages)} in {folder}", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        subprocess.run([python, "-m", "pip", "install", "-q", *packages], check=True)
        whole.write_text("\n".join(packages))
    # The environment is found by the name that Python was started by.
    os.execve(python, [str(python), *sys.argv], os.environ | {"ASRA_STREAM_TOOLS": "1"})


def stoppable(main, words):
    """Runs `main`; Ctrl-C and a termination signal end it with these words, and with it the process that it waits for."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(words)


def must_import(module):
    """Ends with advice if the module cannot be imported. In a process of its own, so that this one stays small."""
    told = subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True, text=True)
    if told.returncode == 0:
        return
    last = (told.stderr.strip().splitlines() or ["?"])[-1]
    missing = next((package for library, package in DEBIAN.items() if library in last), None)
    sys.exit(f"{module} cannot be imported: {last}\n" + (f"on Debian: apt-get install {missing}" if missing else ""))


def built(program):
    """The program that is given, or else this repository's, built for release."""
    if program:
        return program.resolve()
    command = ["cargo", "build", "--release", "--locked", "--message-format=json-render-diagnostics"]
    told = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    messages = [json.loads(line) for line in told.splitlines()]
    return Path(next(m["executable"] for m in messages if m.get("executable") and m["target"]["name"] == "asra-stream"))


def commit():
    """The commit that the repository is at, and whether anything was changed since."""
    told = [
        subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True).stdout.strip()
        for words in (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
    ]
    return (told[0] or "unknown") + (", with changes" if told[1] else "")


def model(folder, name, work):
    """The model's file among the user's, unpacked into the work folder if it is gzipped; None if there is none."""
    if folder is None:
        return None
    if (folder / name).exists():
        return folder / name
    packed, path = folder / f"{name}.gz", work / name
    if not packed.exists():
        return None
    if not path.exists():
        part = path.with_suffix(".part")
        with gzip.open(packed) as source, open(part, "wb") as out:
            shutil.copyfileobj(source, out)
        part.rename(path)
    return path


def measured(command, log, seconds=None, memory=None):
    """Runs a process to its end, or until it hits a cap: seconds, or resident bytes. Its output goes to the file `log`.

    Tells how it ended ("ok", "time", "memory" or words), when it was started, wall and processor seconds, and its maximum resident size in bytes."""
    with open(log, "wb") as out:
        start = time.monotonic()
        command = [str(word) for word in command]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, start_new_session=True)
    ended, hit = threading.Event(), []

    def watch():
        while not ended.wait(0.02):
            with contextlib.suppress(OSError, IndexError):
                resident = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
                over = "time" if seconds and time.monotonic() - start > seconds else "memory" if memory and resident > memory else None
                if over:
                    hit.append(over)
                    os.killpg(process.pid, signal.SIGKILL)
                    return

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        # The process is left unreaped until the watcher is done, so that its number cannot be another's.
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    finally:
        wall = time.monotonic() - start
        ended.set()
        watcher.join()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    outcome = hit[0] if hit else "ok" if process.returncode == 0 else f"exit {process.returncode}"
    return {"outcome": outcome, "started": start, "wall": wall, "cpu": usage.ru_utime + usage.ru_stime, "peak": usage.ru_maxrss * 1024}


def last_line(log):
    lines = log.read_text(errors="replace").strip().splitlines()
    return lines[-1][:200] if lines else "no message"


def table(columns, rows):
    """A Markdown table; a column whose name ends in ':' is aligned right."""
    names = [c.removesuffix(":") for c in columns]
    lines = [names, ["--:" if c.endswith(":") else "---" for c in columns], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines) + "\n"


def digits(value, count=3):
    """The number to so many digits, without an exponent where that is readable; a dash if there is none."""
    if value is None:
        return "–"
    if value == 0:
        return "0"
    if 1e-4 <= abs(value) < 10**count:
        return f"{float(f'{value:.{count}g}'):.6f}".rstrip("0").rstrip(".")
    return f"{value:,.0f}" if 1 <= abs(value) < 1e15 else f"{value:.{count - 1}e}"
