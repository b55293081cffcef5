#!/usr/bin/env python3
"""Whole runs of asra-stream on generated knots: by number of points, by k, by threads, by budget; and their plot.

    cargo build --release
    tools/bench.py points                     1,000,000 and 10,000,000 points; more with --sizes 1M,10M,100M
    tools/bench.py k | threads | budget       2,000,000 points, or --points N
    tools/bench.py plot points.json out.png   time and memory by number of points (makes itself a Python environment with matplotlib)

Each run is a process of its own, input in the system's cache, check and writing included; figures are medians of --runs. A table goes to standard
output, all figures to a JSON file if --json names one. Clouds are made once, in --dir, and kept.
"""

import argparse
import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "asra-stream-tools"
UNITS = {"K": 10**3, "M": 10**6, "G": 10**9}


def number(text):
    return int(text[:-1]) * UNITS[text[-1]] if text[-1] in UNITS else int(text.replace("_", ""))


def machine():
    model = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "?")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") >> 20
    return f"{model}, {len(os.sched_getaffinity(0))} processors, {memory} MiB, {platform.system()} {platform.release()}"


def cloud(arguments, shape, points):
    path = arguments.dir / f"{shape}-{points}.bin"
    if not path.exists():
        subprocess.run([arguments.program, "generate", shape, str(points), "-q", "-o", path], check=True)
    return path


def once(arguments, path, options):
    report = arguments.dir / "report.json"
    command = [arguments.program, path, "-q", "-o", arguments.dir / "mesh.ply", "--overwrite", "--report", report]
    start = time.monotonic()
    process = subprocess.Popen([*map(str, command), "--temp-dir", str(arguments.dir), *options])
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"{path} {' '.join(options)}: exit {status}")
    run = json.loads(report.read_text())
    memory = run["memory"]
    return {
        "points": run["points"]["count"],
        "triangles": run["output"]["triangles"],
        "seconds": time.monotonic() - start,
        "processor": usage.ru_utime + usage.ru_stime,
        "resident": memory["peak_resident"],
        "resident_predicted": memory["plan"]["predicted"],
        "disk": memory["peak_disk"],
        "disk_predicted": memory["plan"]["predicted_disk"],
    }


def median_run(arguments, path, options):
    runs = [once(arguments, path, options) for _ in range(arguments.runs)]
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]}


def measure(arguments):
    arguments.dir.mkdir(parents=True, exist_ok=True)
    common = ["--max-memory", arguments.max_memory] if arguments.max_memory else []
    cores = len(os.sched_getaffinity(0))
    threads = sorted({1, 2, *(2**i for i in range(2, 10) if 2**i <= cores), cores})
    variants = {
        "points": [(size, []) for size in arguments.sizes],
        "k": [(arguments.points, ["--k", k]) for k in ("2", "3", "4", "5", "6")],
        "threads": [(arguments.points, ["--threads", str(n)]) for n in threads],
        "budget": [(arguments.points, ["--max-memory", b]) for b in ("64M", "128M", "256M", "512M", "2G")],
    }[arguments.what]
    print(f"{datetime.date.today()}; {machine()}; {arguments.shape}; medians of {arguments.runs}\n")
    print("| points | options | triangles | seconds | processor, s | points/s | resident, MiB | planned | disk, MiB | planned |")
    print("|--:|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    results = []
    for points, options in variants:
        options = options if "--max-memory" in options else common + options
        r = median_run(arguments, cloud(arguments, arguments.shape, points), options)
        results.append({"options": options, **r})
        mebibytes = " | ".join(f"{r[key] / 2**20:,.0f}" for key in ("resident", "resident_predicted", "disk", "disk_predicted"))
        print(
            f"| {r['points']:,} | {' '.join(options)} | {r['triangles']:,} | {r['seconds']:.2f} | {r['processor']:.2f} "
            f"| {r['points'] / r['seconds']:,.0f} | {mebibytes} |",
            flush=True,
        )
    if arguments.json:
        date = str(datetime.date.today())
        whole = {"date": date, "machine": machine(), "shape": arguments.shape, "runs": arguments.runs, "results": results}
        arguments.json.write_text(json.dumps(whole, indent=1) + "\n")


def plot(arguments):
    try:
        import matplotlib
    except ImportError:
        if os.environ.get("ASRA_STREAM_TOOLS"):
            raise
        python = ENVIRONMENT / "bin/python"
        subprocess.run([sys.executable, "-m", "venv", ENVIRONMENT], check=True)
        subprocess.run([python, "-m", "pip", "install", "-q", "matplotlib"], check=True)
        # The environment is found by the name that Python was started by.
        os.execve(python, [str(python), *sys.argv], os.environ | {"ASRA_STREAM_TOOLS": "1"})
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    whole = json.loads(arguments.results.read_text())
    results = sorted(whole["results"], key=lambda r: r["points"])
    points = [r["points"] for r in results]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    left.loglog(points, [r["seconds"] for r in results], "o-", label="seconds")
    left.loglog(points, [r["processor"] for r in results], "s--", label="processor seconds")
    left.set_ylabel("seconds")
    size = [r["resident"] / 2**20 for r in results]
    right.loglog(points, size, "o-", label="resident")
    right.loglog(points, [size[0] * (n / points[0]) ** (2 / 3) for n in points], ":", color="grey", label="as n^(2/3)")
    disks = [(n, r["disk"] / 2**20) for n, r in zip(points, results) if r["disk"]]
    right.loglog([n for n, _ in disks], [d for _, d in disks], "s-", label="temporary disk")
    right.loglog(points, [12 * n / 2**20 for n in points], "--", color="grey", label="the input")
    right.set_ylabel("MiB")
    for axes in (left, right):
        axes.set_xlabel("points")
        axes.grid(True, which="major", alpha=0.3)
        axes.legend()
    figure.suptitle(f"asra-stream, {whole['shape']}, {whole['date']}; {whole['machine']}", fontsize=8)
    figure.savefig(arguments.picture, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="what", required=True)
    for what in ("points", "k", "threads", "budget"):
        one = commands.add_parser(what)
        one.add_argument("--program", type=Path, default=ROOT / "target/release/asra-stream")
        one.add_argument("--dir", type=Path, default=ROOT / "target/bench")
        one.add_argument("--shape", default="knot")
        one.add_argument("--sizes", type=lambda text: [number(n) for n in text.split(",")], default=[10**6, 10**7])
        one.add_argument("--points", type=number, default=2 * 10**6)
        one.add_argument("--max-memory")
        one.add_argument("--runs", type=int, default=5)
        one.add_argument("--json", type=Path)
        one.set_defaults(do=measure)
    picture = commands.add_parser("plot")
    picture.add_argument("results", type=Path)
    picture.add_argument("picture", type=Path)
    picture.set_defaults(do=plot)
    arguments = parser.parse_args()
    arguments.do(arguments)


if __name__ == "__main__":
    main()
