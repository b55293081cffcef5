#!/usr/bin/env python3
"""Figures of the Python package; `tools/python.py --measure` builds what it needs and calls it.

    python_figures.py PYTHON COMMAND [--work DIR] [--points 20M] [--rounds 9] [--only overhead,ctrl_c,pieces,runs,threads]

PYTHON is that of an environment with the wheel, COMMAND the command as Cargo builds it. Prints a table in Markdown. The figure of pieces needs root and control
groups of version 1 or 2, whose controller of memory can be had; it is left out, and said to be, where that is not so.
"""

import argparse
import json
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MIB = 1 << 20


def python(program, *arguments, **options):
    """Starts a program that prints its findings as one line of JSON."""
    command = [PYTHON, "-c", program, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **options)


def findings(process):
    out, _ = process.communicate()
    if process.returncode != 0:
        sys.exit(f"a measurement ended with {process.returncode}")
    return json.loads(out.splitlines()[-1])


ARRAY = """
import json, resource, sys, time, numpy, asra_stream
points = numpy.fromfile(sys.argv[1], dtype="<f4").reshape(-1, 3)
def used():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime
start, before = time.monotonic(), used()
mesh = asra_stream.reconstruct(points)
made = time.monotonic()
mesh.save(sys.argv[2], overwrite=True)
saved, processor = time.monotonic(), used() - before
mesh.vertices, mesh.triangles
print(json.dumps({"made": made - start, "saved": saved - start, "arrays": time.monotonic() - saved, "processor": processor}))
"""


def overhead(work, points, rounds):
    """An array against the command on a raw file of the same points, one after the other."""
    cloud = work / "knot.bin"
    subprocess.run([COMMAND, "generate", "knot", points, "-o", cloud, "--overwrite", "-q"], check=True)
    timed = []
    for _ in range(rounds):
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        subprocess.run([COMMAND, cloud, "-o", work / "command.ply", "--overwrite", "-q"], check=True)
        seconds, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        timed.append({"command": seconds, "command's processor": used, **findings(python(ARRAY, cloud, work / "array.ply"))})
    if (work / "command.ply").read_bytes() != (work / "array.ply").read_bytes():
        sys.exit("the array and the command give different bytes")
    median = {name: statistics.median(one[name] for one in timed) for name in timed[0]}
    for clock, command, array in [("seconds", "command", "saved"), ("seconds of the processors", "command's processor", "processor")]:
        spread = [f"{median[name]:.2f} ({min(one[name] for one in timed):.2f} to {max(one[name] for one in timed):.2f})" for name in (command, array)]
        paired = statistics.median(one[array] / one[command] for one in timed)
        yield f"{points} points (knot, `float32`), {rounds} rounds, {clock}: the command, from a raw file to PLY", spread[0]
        yield "`reconstruct` of the array, and `save` to PLY: the same bytes", spread[1]
        yield "more than the command: of the medians; median of the rounds' quotients", f"{100 * (median[array] / median[command] - 1):+.1f} %; {100 * (paired - 1):+.1f} %"
    yield "`reconstruct` alone; `mesh.vertices` and `mesh.triangles` after it", f"{median['made']:.2f}; {median['arrays']:.2f} s"


INTERRUPTED = """
import json, sys, time, numpy, asra_stream
points = numpy.fromfile(sys.argv[1], dtype="<f4").reshape(-1, 3)
print("begun", flush=True)
try:
    asra_stream.reconstruct(points)
    print(json.dumps(None))
except KeyboardInterrupt:
    print(json.dumps(time.monotonic()))
"""


def ctrl_c(work, points, rounds):
    """Seconds from the signal to the exception, at moments all over a run."""
    cloud = work / "knot.bin"
    if not cloud.exists():
        subprocess.run([COMMAND, "generate", "knot", points, "-o", cloud, "-q"], check=True)
    whole = findings(python(ARRAY, cloud, work / "array.ply"))["made"]
    took = []
    for i in range(20):
        process = python(INTERRUPTED, cloud)
        process.stdout.readline()
        time.sleep(whole * (i + 0.5) / 20)
        sent = time.monotonic()
        process.send_signal(signal.SIGINT)
        came = findings(process)
        if came is not None:
            took.append(came - sent)
    yield f"Ctrl-C at {len(took)} moments of a run of {points} points: median, longest", f"{statistics.median(took):.3f} s, {max(took):.3f} s"


PIECES = """
import json, os, sys, time, numpy
if sys.argv[1]:
    open(sys.argv[1], "w").write(str(os.getpid()))
import asra_stream
def pieces(count, piece=1_000_000):
    for first in range(0, count, piece):
        i = numpy.arange(first, first + piece, dtype=numpy.float64)
        z, angle = (2 * i + 1) / count - 1, 2.399963 * i
        r = numpy.sqrt(1 - z * z)
        yield numpy.stack([r * numpy.cos(angle), r * numpy.sin(angle), z], axis=1).astype(numpy.float32)
start = time.monotonic()
mesh = asra_stream.reconstruct(pieces(int(sys.argv[2])), max_memory="256M", temp_dir=sys.argv[3])
status = dict(line.split(":", 1) for line in open("/proc/self/status") if ":" in line)
print(json.dumps([time.monotonic() - start, int(status["VmHWM"].split()[0]) << 10, len(mesh), mesh.is_closed]))
"""


def group():
    """A new control group for memory, with the names of its files: where processes are put, its limit, its peak, how often the limit was met."""
    for root, names in [
        (Path("/sys/fs/cgroup/memory"), ("memory.limit_in_bytes", "memory.max_usage_in_bytes", "memory.failcnt")),
        (Path("/sys/fs/cgroup"), ("memory.max", "memory.peak", "memory.events")),
    ]:
        folder = root / f"asra-stream-{os.getpid()}"
        try:
            folder.mkdir()
        except OSError:
            continue
        if (folder / names[0]).exists():
            return folder, names
        folder.rmdir()
    return None, None


def pieces(work, points, rounds):
    """A hundred million points in pieces, in a control group."""
    folder, names = group()
    if folder is None:
        yield "10⁸ points in pieces", "not measured: no control group for memory here"
        return
    try:
        (folder / names[0]).write_text(str(512 * MIB))
        process = python(PIECES, folder / "cgroup.procs", 100_000_000, work)
        seconds, resident, triangles, closed = findings(process)
        peak = int((folder / names[1]).read_text())
    finally:
        folder.rmdir()
    yield "10⁸ points (sphere, `float32`) in 100 pieces, `max_memory=\"256M\"`, in a control group of 512 MiB", f"{seconds:.0f} s, {triangles:,} triangles, {'closed' if closed else 'open'}"
    yield "of that process, resident at most (NumPy, its piece and the interpreter among it)", f"{resident / MIB:.0f} MiB"
    yield "charged to the group at most (page cache among it, which fills what is left)", f"{peak / MIB:.0f} MiB"


RUNS = """
import ctypes, gc, json, os, re, resource, sys, tempfile, numpy, asra_stream
def taken():
    libc = ctypes.CDLL(None)
    libc.fopen.restype = ctypes.c_void_p
    with tempfile.NamedTemporaryFile() as file:
        stream = ctypes.c_void_p(libc.fopen(file.name.encode(), b"w"))
        libc.malloc_info(0, stream)
        libc.fclose(stream)
        told = file.read().decode().rsplit("</heap>", 1)[1]
    free = sum(map(int, re.findall('type="(?:fast|rest)" count="[0-9]+" size="([0-9]+)"', told)))
    return int(re.search('<system type="current" size="([0-9]+)"', told)[1]) - free
i = numpy.arange(2_000)
z, angle = (2 * i + 1.0) / 2_000 - 1, 2.399963 * i
points = numpy.stack([numpy.sqrt(1 - z * z) * numpy.cos(angle), numpy.sqrt(1 - z * z) * numpy.sin(angle), z], axis=1)
def stop(update):
    raise RuntimeError
told = []
for run in range(1, 3_001):
    mesh = asra_stream.reconstruct(points, threads=2)
    mesh.vertices, mesh.triangles
    for wrong in ({"cell_size": -1}, {"progress": stop}):
        try:
            asra_stream.reconstruct(points, **wrong)
        except (ValueError, RuntimeError):
            pass
    if run in (10, 100, 500, 1_000, 1_500, 2_000, 2_500, 3_000):
        gc.collect()
        told.append([run, taken(), int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize(), len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))])
print(json.dumps(told))
"""


def runs(work, points, rounds):
    """Memory, files and threads after many runs, of which a third end with an exception."""
    told = findings(python(RUNS))
    for run, taken, resident, files, threads in told:
        what = f"after {run:,} runs, and twice as many attempts that end with exceptions: in use; resident; files; threads"
        yield what, f"{taken / MIB:.2f}; {resident / MIB:.1f} MiB; {files}; {threads}"


THREADS = """
import json, sys, threading, time, numpy, asra_stream
points = numpy.fromfile(sys.argv[1], dtype="<f4").reshape(-1, 3)[: 5_000_000]
over = threading.Event()
def count(counted):
    longest, last = 0.0, time.monotonic()
    while not over.is_set():
        counted[0] += 1
        time.sleep(0.001)
        now = time.monotonic()
        counted[1], last = max(counted[1], now - last), now
def rate(work):
    counted = [0, 0.0]
    over.clear()
    thread = threading.Thread(target=count, args=(counted,))
    start = time.monotonic()
    thread.start()
    work()
    seconds = time.monotonic() - start
    over.set()
    thread.join()
    return counted[0] / seconds, counted[1], seconds
made = []
def make(part):
    made.append(asra_stream.reconstruct(part, threads=1))
def two():
    threads = [threading.Thread(target=make, args=(part,)) for part in (points[::2], points[1::2])]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
def after():
    make(points[::2]), make(points[1::2])
alone, meanwhile = rate(lambda: time.sleep(2)), rate(lambda: asra_stream.reconstruct(points, threads=1))
one_after_the_other, at_once = rate(after), rate(two)
print(json.dumps([alone, meanwhile, one_after_the_other[2], at_once[2]]))
"""


def threads(work, points, rounds):
    """A thread that counts, and two runs at once."""
    cloud = work / "knot.bin"
    if not cloud.exists():
        subprocess.run([COMMAND, "generate", "knot", points, "-o", cloud, "-q"], check=True)
    alone, meanwhile, after, at_once = findings(python(THREADS, cloud))
    yield "a thread that sleeps a millisecond and counts: alone; beside a run of 5 million points on one thread", f"{alone[0]:.0f}; {meanwhile[0]:.0f} a second"
    yield "the longest that it did not count meanwhile", f"{1000 * meanwhile[1]:.0f} ms"
    yield "two runs of 2.5 million points, of one thread each: one after the other; at once", f"{after:.1f}; {at_once:.1f} s"


def main():
    global PYTHON, COMMAND
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("python")
    parser.add_argument("command")
    parser.add_argument("--work", type=Path, help="a folder for clouds and meshes")
    parser.add_argument("--points", default="20M")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", default="overhead,ctrl_c,pieces,runs,threads")
    arguments = parser.parse_args()
    PYTHON, COMMAND = arguments.python, arguments.command
    with tempfile.TemporaryDirectory(dir=arguments.work, prefix="figures-") as work:
        print("| what | figure |\n|---|---|", flush=True)
        for name in arguments.only.split(","):
            for what, figure in globals()[name](Path(work), arguments.points, arguments.rounds):
                print(f"| {what} | {figure} |", flush=True)


if __name__ == "__main__":
    main()
