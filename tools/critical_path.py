#!/usr/bin/env python3
"""How long a run takes by many workers, or on many processors: models, fed with seconds and bytes that were measured.

    tools/critical_path.py measure -o tasks.json    does all tasks of runs of three sizes one by one, on one thread, and notes what each took
    tools/critical_path.py table tasks.json         10^9 to 10^12 points by 2 to 1,000 workers, for some speeds of the shared file system
    tools/critical_path.py run tasks.json           a run of --points by --workers processes, beside what the model says of it
    tools/critical_path.py sleep tasks.json         the tasks of 10^12 points by 1,000 workers through the package's driver and Dask's scheduler; they sleep, --scale times as fast
    tools/critical_path.py stages CLOUD             one process: of each stage, what only one thread does, and its time on --processors

The model of tasks: a kind's processor seconds are so many for each point and triangle, and so are its bytes; both are fitted to what was measured. Tasks are dealt out, in their order, to workers of one
processor, and weigh as unequally as measured ones. Kinds come one after the other. What a wave reads and writes takes no less than the shared file system needs for it. A task that is
alone in its wave has --alone processors, of which it makes use of four fifths; with --cold, computing and moving bytes add up instead. That last figure and the fitted laws beyond the sizes measured are assumptions.

The model of stages: a thread's processor seconds are looked at as each stage ends. What the calling thread takes is done one after the other, what workers take is shared out. A stage takes no
less than either the first or all of it over the processors, and no more than the first and the second over the processors. The surface's jobs are slabs, of which there may be fewer than processors;
it is stitched in as many pieces as the program has for so many threads, and each piece but the first closes two seams more. Memory is taken to be as fast for many as for two.
"""

import argparse
import contextlib
import heapq
import itertools
import json
import os
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
import types
from pathlib import Path

from shared import ROOT, built, commit, digits, environment, stoppable, table

# Points of the runs that are measured, and for how many processes each is cut.
SIZES, PROCESSES = (2_000_000, 6_000_000, 20_000_000), 8
# As the program cuts a run: slabs of so many slices; two pieces for each process, of six slabs at least; each piece makes two slabs more than its own.
SLICES, PIECES, LEAST, MORE = 20, 2, 6, 2
# What there is as often as there are processes; of other kinds there are as many as pieces, but for those that are alone.
BY_PROCESS, OF_PIECES = ("bucket",), ("piece",)
# What reads all of the input, which is mapped, so that the system does not count its bytes: of the knot 12 for each point.
READERS, RECORD = ("plan", "bucket"), 12
# Of the processors of a machine, what a task that is alone makes use of. Assumed.
USE = 0.8
# Seconds from the end of a wave until the next has begun.
BARRIER = 0.5
# Threads for each piece of the surface, and the slabs that it has at least (`run/planner.rs`).
THREADS_OF_PIECE, SLABS_OF_PIECE = 4, 24


def call(command):
    """Runs a process; seconds by the clock and of processors, and bytes read and written, from the system's cache or not."""
    begin = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    words = process.stderr.read()
    # It is looked at when it has ended, and before it is gone.
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    wall = time.monotonic() - begin
    told = dict(line.split(": ") for line in Path(f"/proc/{process.pid}/io").read_text().splitlines())
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(map(str, command))}: {words.strip()[-600:]}")
    return {"wall": wall, "cpu": usage.ru_utime + usage.ru_stime, "bytes": int(told["rchar"]) + int(told["wchar"])}


def listed(program, folder, *which):
    return json.loads(subprocess.run([program, "tasks", folder, *which, "--json"], check=True, stdout=subprocess.PIPE).stdout)


def planned(program, points, folder, processes, budget, cloud=None):
    """A run of so many points of a knot, cut into tasks; what planning took."""
    cloud = cloud or folder / "knot.bin"
    if not cloud.exists():
        subprocess.run([program, "generate", "knot", str(points), "-o", cloud, "--quiet"], check=True)
    return call([program, "plan", cloud, "-o", folder / "m.ply", "--k", "4", "--work", folder / "work", "--processes", processes, "-j", 1, "--quiet", *budget])


def shape(folder):
    """Slices and triangles of a run that is done."""
    with open(folder / "m.ply", "rb") as file:
        head = file.read(4096).split(b"end_header")[0].decode(errors="replace")
    return int(head.split(" slices ")[1].split()[0]), int(head.split("element face ")[1].split()[0])


def measure(options, program):
    runs = []
    for points in options.sizes:
        with tempfile.TemporaryDirectory(dir=options.folder) as name:
            folder = Path(name)
            kinds = {"plan": [planned(program, points, folder, PROCESSES, options.budget)]}
            first = None
            while not (now := listed(program, folder / "work", "--ready"))["finished"]:
                for task in (entry["task"] for entry in now["tasks"]):
                    kinds.setdefault(task.split("/")[0], []).append(call([program, "work", folder / "work", task, "-j", 1, "--quiet", *options.budget]))
                    first = first or task
            # A task that is done already costs what every task costs beside its work.
            nothing = min((call([program, "work", folder / "work", first, "-j", 1, "--quiet", *options.budget]) for _ in range(5)), key=lambda one: one["cpu"])
            slices, triangles = shape(folder)
            runs.append({"points": points, "triangles": triangles, "slices": slices, "processes": PROCESSES, "nothing": nothing, "kinds": kinds})
            print(f"{points:,} points, {triangles:,} triangles: " + ", ".join(f"{kind} {sum(t['cpu'] for t in tasks):.1f} s" for kind, tasks in kinds.items()), flush=True)
    options.output.write_text(json.dumps({"commit": commit(), "runs": runs}, indent=1))


def fitted(rows, columns):
    """The least squares, relative to z, of factors of these columns of x that are not below zero; of others they are zero."""
    import numpy

    rows = [([one / z for one in x], 1.0) for x, z in rows if z > 0]
    if not rows:
        return (0.0, 0.0, 0.0)
    x, z = (numpy.array(column, dtype=float) for column in zip(*rows, strict=True))
    best = None
    # So few factors that each set of them can be tried.
    for kept in (kept for count in range(1, len(columns) + 1) for kept in itertools.combinations(columns, count)):
        factors, *_ = numpy.linalg.lstsq(x[:, kept], z, rcond=None)
        if (factors < 0).any():
            continue
        wrong = ((x[:, kept] @ factors - z) ** 2).sum()
        if best is None or wrong < best[0] - 1e-9:
            law = [0.0, 0.0, 0.0]
            for column, factor in zip(kept, factors, strict=True):
                law[column] = float(factor)
            best = (wrong, tuple(law))
    return best[1]


class Model:
    def __init__(self, path):
        self.runs = json.loads(path.read_text())["runs"]
        self.large = max(self.runs, key=lambda run: run["points"])
        self.kinds = list(self.large["kinds"])
        self.nothing = sorted(run["nothing"]["cpu"] for run in self.runs)[len(self.runs) // 2]
        self.laws = {kind: {what: self.law(kind, what) for what in ("cpu", "bytes")} for kind in self.kinds}

    def law(self, kind, what):
        """For each task, point and triangle, without what a task costs that is done, and without the slabs that pieces make twice."""
        rows = []
        for run in self.runs:
            tasks = run["kinds"].get(kind, [])
            least = run["nothing"]["cpu"] if what == "cpu" and kind != "plan" else 0
            total = sum(max(0.0, task[what] - least) for task in tasks)
            total += RECORD * run["points"] if what == "bytes" and kind in READERS else 0
            rows.append(((len(tasks), run["points"], run["triangles"]), total / self.twice(kind, run["slices"] / SLICES, len(tasks) or 1)))
        # Seconds are too uncertain for three factors of three runs, and every task's own are known; bytes are exact.
        return fitted(rows, (1, 2) if what == "cpu" else (0, 1, 2))

    def twice(self, kind, slabs, count):
        return (slabs + MORE * (count - 1)) / slabs if kind in OF_PIECES else 1.0

    def sizes(self, points):
        """Triangles and slabs of a knot of so many points, at the same cells for each."""
        ratio = points / self.large["points"]
        return self.large["triangles"] * ratio ** (2 / 3), self.large["slices"] * ratio ** (1 / 3) / SLICES

    def count(self, kind, slabs, processes):
        if len(self.large["kinds"][kind]) == 1:
            return 1
        return processes if kind in BY_PROCESS else max(1, min(PIECES * processes, int(slabs / LEAST)))

    def tasks(self, kind, points, processes):
        """Processor seconds of each task of a kind, and the bytes of all."""
        triangles, slabs = self.sizes(points)
        count = self.count(kind, slabs, processes)
        (_, a, b), (_, c, d) = self.laws[kind]["cpu"], self.laws[kind]["bytes"]
        more = self.twice(kind, slabs, count)
        measured = [max(1e-9, task["cpu"] - self.nothing) for task in self.large["kinds"][kind]]
        # As unequal as measured ones, which stand for their places along the axis.
        weights = [measured[number * len(measured) // count] for number in range(count)]
        total = (a * points + b * triangles) * more
        # The same bytes for each task are those of the program itself, which every machine has in its cache.
        return [total * weight / sum(weights) for weight in weights], (c * points + d * triangles) * more

    def waves(self, points, workers, speed, alone, processes=None, cold=False):
        """Seconds of each kind, and what it waits for: `one` task, `processors` or the `files`. Where nothing stays in a cache (`cold`), a task waits for bytes and then computes."""
        told = {}
        for kind in self.kinds:
            seconds, amount = self.tasks(kind, points, processes or workers)
            if len(seconds) == 1:
                busy, why = seconds[0] / max(1.0, USE * alone) + self.nothing, "one"
            else:
                free = [0.0] * min(workers, len(seconds))
                for one in seconds:
                    heapq.heapreplace(free, free[0] + one + self.nothing)
                busy, why = max(free), "processors"
            files = amount / speed if speed else 0.0
            told[kind] = ((busy + files if cold else max(busy, files)) + BARRIER, "files" if files > busy else why)
        return told


def clock(seconds):
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def tabled(options, _):
    model = Model(options.measured)
    rows = []
    for kind in model.kinds:
        (_, a, b), (_, c, d) = model.laws[kind]["cpu"], model.laws[kind]["bytes"]
        rows.append([kind, digits(a * 1e9), digits(b * 1e9), digits(c), digits(d)])
    print(f"Every task: {1e3 * model.nothing:.0f} ms.\n")
    print(table(["kind", "ns a point:", "ns a triangle:", "bytes a point:", "bytes a triangle:"], rows))
    workers = (2, 8, 32, 100, 300, 1000)
    for alone in options.alones:
        rows = []
        for speed in (0.4e9, 2e9, 20e9, 100e9):
            for points in (10**9, 10**10, 10**11, 10**12):
                cells = []
                for count in workers:
                    told = model.waves(points, count, speed, alone, cold=options.cold)
                    total = sum(seconds for seconds, _ in told.values())
                    # What takes longest.
                    worst = max(told, key=lambda kind: told[kind][0])
                    cells.append(f"{clock(total)}, {worst} {100 * told[worst][0] / total:.0f} %")
                rows.append([digits(speed / 1e9), f"10^{len(str(points)) - 1}", *cells])
        print(f"A task that is alone has {alone} processors; the time, and the kind that takes most of it:\n")
        print(table(["GB/s", "points", *(f"{count:,} workers:" for count in workers)], rows))
    for points in (10**10, 10**12):
        told = model.waves(points, 1000, 20e9, options.alones[-1])
        print(f"{points:.0e} points, 1,000 workers, 20 GB/s: " + ", ".join(f"{kind} {clock(seconds)} ({why})" for kind, (seconds, why) in told.items()) + "\n")


def run(options, program):
    model = Model(options.measured)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        plan = planned(program, options.points, folder, options.processes, options.budget)
        # What any task costs at this moment on this machine, which others use, too: all processes report their processors' seconds.
        begin = time.monotonic()
        command = [program, "work", folder / "work", "--any", "-j", "1", "--quiet", *options.budget]
        processes = [subprocess.Popen([*map(str, command), "--shard", f"{number}/{options.workers}"]) for number in range(options.workers)]
        busy = 0.0
        for process in processes:
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            busy += usage.ru_utime + usage.ru_stime
        wall = time.monotonic() - begin
        if any(process.returncode for process in processes):
            sys.exit("a process failed")
    told = model.waves(options.points, options.workers, options.speed, 1, options.processes, options.cold)
    tasks = {kind: seconds for kind, (seconds, _) in told.items() if kind != "plan"}
    work = sum(sum(model.tasks(kind, options.points, options.processes)[0]) for kind in tasks)
    got = sum(tasks.values())
    print(f"{options.points:,} points by {options.workers} processes, cut for {options.processes}")
    print(f"plan: measured {plan['wall']:.1f} s ({plan['cpu']:.1f} of the processor), model {told['plan'][0] - BARRIER:.1f} s")
    print(f"tasks by the clock: measured {wall:.1f} s, model {got:.1f} s: {got / wall:.2f}")
    print(f"tasks, processor seconds: measured {busy:.1f} s, model {work:.1f} s: {work / busy:.2f}")
    print("model: " + ", ".join(f"{kind} {seconds:.1f} s" for kind, seconds in tasks.items()))


def sleep(options, _):
    # The package's own driver, without the part in Rust.
    sys.modules["asra_stream"] = types.ModuleType("asra_stream")
    sys.modules["asra_stream"].__path__ = [str(ROOT / "python/package/asra_stream")]
    from asra_stream import dask as driver
    from distributed import Client, LocalCluster

    model = Model(options.measured)
    told = model.waves(options.points, options.workers, None, options.alone)
    costs, order = {}, []
    for kind in (kind for kind in model.kinds if kind != "plan"):
        seconds, _ = model.tasks(kind, options.points, options.workers)
        names = [kind if len(seconds) == 1 else f"{kind}/{number}" for number in range(len(seconds))]
        if len(seconds) == 1:
            seconds = [told[kind][0] - BARRIER]
        costs.update(zip(names, seconds, strict=True))
        order.append(names)
    done = set()

    class Job:
        """The folder, as far as the driver asks."""

        folder = ""

        def tasks(self, *_):
            for names in order:
                left = [name for name in names if name not in done]
                if left:
                    return {"finished": False, "tasks": [{"task": name} for name in left]}
            return {"finished": True, "tasks": []}

    class Sleeping(driver._Run):
        @staticmethod
        def perform(_, task, seconds):
            time.sleep(seconds[task])
            return driver._Ended(0, "done", "", "")

        def _start(self, task):
            self._submit = {"seconds": {task: costs[task] / options.scale}}
            super()._start(task)

    def tell(event):
        if event["event"] == "done":
            done.add(event["task"])

    threads = 10
    cluster = LocalCluster(n_workers=options.workers // threads, threads_per_worker=threads, processes=False, memory_limit=0, dashboard_address=None)
    with cluster, Client(cluster) as client:
        client.wait_for_workers(options.workers // threads)
        begin, busy = time.monotonic(), time.process_time()
        sleeper = Sleeping(client, Job(), 5, {}, tell)
        sleeper.drive()
        took, busy = time.monotonic() - begin, time.process_time() - busy
    ideal = sum((told[names[0].split("/")[0]][0] - BARRIER) for names in order)
    short = ideal / options.scale
    print(f"{len(costs):,} tasks of {options.points:.0e} points by {options.workers:,} workers, {options.scale:,.0f} times as fast, ideally {short:.1f} s (in truth {clock(ideal)})")
    print(f"measured {took:.1f} s: {1e3 * (took - short) / len(costs):.1f} ms a task more; scheduler, workers and driver took {1e3 * busy / len(costs):.1f} ms of a processor for each task")


def looked_at(process):
    """Processor seconds so far of the calling thread, of workers, and of other threads that still run."""
    told = {"calling": 0.0, "workers": 0.0, "others": 0.0}
    for thread in Path(f"/proc/{process.pid}/task").iterdir():
        with contextlib.suppress(OSError):
            name = (thread / "comm").read_text()
            of = "calling" if int(thread.name) == process.pid else "workers" if name.startswith("asra-worker") else "others"
            told[of] += int((thread / "schedstat").read_text().split()[0]) / 1e9
    return told


def staged(command, folder):
    """Processor seconds of each stage of a run, by kind of thread, and its number of slabs."""
    for left in folder.iterdir():
        left.unlink()
    report = folder / "report.json"
    process = subprocess.Popen([*map(str, command), "-o", folder / "m.ply", "--report", report, "--progress", "json"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    stages, before = {}, looked_at(process)
    for line in process.stderr:
        event = json.loads(line)
        if event["event"] == "end" and event["exit_code"]:
            sys.exit(event["message"])
        if event["event"] != "stage":
            continue
        now = looked_at(process)
        so_far = stages.setdefault(event["stage"], dict.fromkeys(now, 0.0))
        for kind in now:
            so_far[kind] += max(0.0, now[kind] - before[kind])
        before = now
    if process.wait():
        sys.exit(f"exit code {process.returncode}")
    return stages, len(json.loads(report.read_text())["seams"]) + 1


def stages(options, program):
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        command = [program, options.measured, *shlex.split(options.options), "-j", options.workers, *options.budget]
        runs = [staged(command, Path(name)) for _ in range(options.runs)]
    slabs = runs[0][1]

    def median(stage, kind):
        return statistics.median(run[stage][kind] for run, _ in runs)

    def least_and_most(stage, processors):
        calling, workers = median(stage, "calling"), median(stage, "workers")
        if stage != "surface":
            return max(calling, (calling + workers) / processors), calling + workers / processors
        pieces = max(1, min(-(-processors // THREADS_OF_PIECE), slabs // SLABS_OF_PIECE))
        of_piece = calling * (1 / pieces + (2 / slabs if pieces > 1 else 0))
        # No job is less than a slab.
        jobs = workers / slabs * -(-slabs // processors)
        return max(of_piece, jobs, (calling + workers) / processors), of_piece + jobs

    rows, whole = [], [[0.0, 0.0] for _ in options.processors]
    total = sum(median(stage, kind) for stage in runs[0][0] for kind in ("calling", "workers"))
    for stage in runs[0][0]:
        calling, workers = median(stage, "calling"), median(stage, "workers")
        times = [least_and_most(stage, processors) for processors in options.processors]
        for sums, (least, most) in zip(whole, times, strict=True):
            sums[0] += least
            sums[1] += most
        share = calling / (calling + workers) if calling + workers else 0
        rows.append([stage, f"{calling + workers:.3f}", f"{calling:.3f}", f"{share:.2f}", *(f"{least:.3f} to {most:.3f}" for least, most in times)])
    calling = sum(median(stage, "calling") for stage in runs[0][0])
    rows.append(["all", f"{total:.3f}", f"{calling:.3f}", f"{calling / total:.2f}", *(f"{least:.3f} to {most:.3f}" for least, most in whole)])
    rows.append(["as fast as one", "", "", "", *(f"{total / most:.1f} to {total / least:.1f}" for least, most in whole)])
    print(f"{options.measured.name}, {slabs} slabs; processor seconds of {options.workers} threads, medians of {options.runs}\n")
    print(table(["stage", "all:", "one thread alone:", "of all:", *(f"{processors}:" for processors in options.processors)], rows))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["measure", "table", "run", "sleep", "stages"])
    parser.add_argument("measured", type=Path, nargs="?", help="what `measure` has written; of stages, the cloud")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--sizes", type=lambda text: [int(float(one)) for one in text.split(",")], default=SIZES, help="points of the runs to measure")
    parser.add_argument("--points", type=lambda text: int(float(text)), help="of the run, or of the tasks that sleep [default: 1e7; 1e12]")
    parser.add_argument("--workers", type=int, help="[default: 2; 1000]")
    parser.add_argument("--processes", type=int, default=PROCESSES, help="for how many at a time the run is cut [default: 8]")
    parser.add_argument("--alone", type=int, default=16, help="processors of a task that is alone [default: 16; in tables 1, too; in a run 1]")
    parser.add_argument("--scale", type=float, default=1000, help="how much faster tasks sleep than they would work [default: 1000]")
    parser.add_argument("--speed", type=float, help="of a run: bytes a second of its file system [default: no limit]")
    parser.add_argument("--cold", action="store_true", help="tables and runs where no file stays in a cache, as in control groups of little memory: computing and waiting for bytes add up")
    parser.add_argument("--max-memory", help="of every process that is measured or run [default: the program's own]")
    parser.add_argument("--program", type=Path)
    parser.add_argument("--folder", type=Path, help="where runs lie [default: the system's folder for temporary files]")
    parser.add_argument("--options", default="", help="of stages: what the program is told")
    parser.add_argument("--processors", type=lambda text: [int(one) for one in text.split(",")], default=[2, 16, 64], help="of stages [default: 2,16,64]")
    parser.add_argument("--runs", type=int, default=5, help="of stages; the medians count [default: 5]")
    options = parser.parse_args()
    if options.what == "measure" and not options.output or options.what != "measure" and not options.measured:
        parser.error("measure wants --output, stages a cloud, all else what measure has written")
    if options.what not in ("measure", "stages"):
        environment("critical-path", ["distributed", "numpy"])
    options.budget = ["--max-memory", options.max_memory] if options.max_memory else []
    options.alones = [1, options.alone]
    options.points = options.points or (10**12 if options.what == "sleep" else 10**7)
    options.workers = options.workers or (1000 if options.what == "sleep" else 2)
    {"measure": measure, "table": tabled, "run": run, "sleep": sleep, "stages": stages}[options.what](options, built(options.program) if options.what in ("measure", "run", "stages") else None)


if __name__ == "__main__":
    stoppable(main, "stopped")
