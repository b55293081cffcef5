#!/usr/bin/env python3
"""Whether a run keeps its budget: random configurations, each in a memory control group of the budget and 32 MiB.

    cargo build --release
    sudo tools/memory.py PROGRAM --work DIR [--count 200] [--seed 1] [--most 600000] [--report FILE.md]

Every configuration is a shape, a format (raw, PLY, text, LAS, LAZ), k, a surface, fitting, smoothing, 1 to 8 threads, and a budget between the least
that `plan --json` names and four times that, a third of them the least. Resident is the most of RssAnon + RssShmem, looked at every
millisecond: mapped files are not in it. Needs the memory controller of control groups, version 1 or 2, writable. A Python environment is made in the
user's cache. Ends with exit code 1 if a run was killed, refused late, or more than 2 % above its budget.
"""

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import time
from pathlib import Path

from shared import commit, environment, stoppable, table

PACKAGES = ["numpy", "laspy", "lazrs"]
MIB = 1 << 20
BESIDE = 32 * MIB
ABOVE = 1.02
PLAN_OVER_PEAK = 1.3
# `holed` is the sphere without a cap of a tenth of its surface, `comb` a block with slots and fins of 2.5 and 2.8 sampling distances.
SHAPES = ["sphere", "torus", "knot", "terrain", "plane", "box", "volume", "cluster", "line", "steps", "holed", "comb"]
MADE_OF = {"holed": "sphere", "comb": "volume"}
FORMATS = ["raw", "ply", "text", "las", "laz"]
FITS = ["nearest", "sphere", "none"]
# The longest that a run may take; longer is told apart from being killed for its memory.
SECONDS = 1800


def group(name, limit):
    """A control group with a limit of memory; the folder, and the file that takes a process's number."""
    first = Path("/sys/fs/cgroup/memory")
    folder = (first if first.is_dir() else Path("/sys/fs/cgroup")) / name
    folder.mkdir(exist_ok=True)
    (folder / ("memory.limit_in_bytes" if first.is_dir() else "memory.max")).write_text(str(limit))
    return folder


def resident(status):
    """RssAnon + RssShmem in bytes."""
    lines = (line.split() for line in status.splitlines() if line.startswith(("RssAnon", "RssShmem")))
    return sum(int(words[1]) << 10 for words in lines)


def capped(command, limit, log):
    """Runs a command in a group. Its exit code (negative for a signal), what was resident when (each time that it was more than before, and every hundredth of a second), and seconds."""
    folder = group(f"asra-memory-{os.getpid()}", limit)
    try:
        start, most, seen = time.monotonic(), 0, [(0, 0)]
        with open(log, "wb") as out:
            enter = lambda: (folder / "cgroup.procs").write_text(str(os.getpid()))
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, preexec_fn=enter)
            with open(f"/proc/{process.pid}/status") as status:
                while process.poll() is None:
                    try:
                        status.seek(0)
                        now, bytes_now = time.monotonic() - start, resident(status.read())
                    except OSError:
                        break
                    if bytes_now > most or now > seen[-1][0] + 0.01:
                        seen.append((now, bytes_now))
                    most = max(most, bytes_now)
                    if time.monotonic() - start > SECONDS:
                        process.kill()
                    time.sleep(0.001)
        return process.wait(), seen, time.monotonic() - start
    finally:
        for _ in range(100):
            try:
                folder.rmdir()
                break
            except OSError:
                time.sleep(0.05)


def of_phases(seen, seconds, phases):
    """The most that was resident in each phase of a report, as its clock has them: they follow each other, and end with the run."""
    most, after = {}, seconds - sum(length for _, length in phases)
    for name, length in phases:
        inside = [bytes_then for then, bytes_then in seen if after <= then < after + length]
        most[name] = max(inside, default=0)
        after += length
    return most


def cloud(program, work, shape, points, noise, form):
    """A cloud as a file of a format; made once."""
    raw = work / f"{shape}-{points}-{noise}.bin"
    if not raw.exists() and shape in MADE_OF:
        whole = cloud(program, work, MADE_OF[shape], points, noise, "raw")
        subprocess.run([sys.executable, __file__, "--convert", whole, raw], check=True)
    if not raw.exists():
        subprocess.run([program, "generate", shape, str(points), "--noise", str(noise), "-o", raw, "-q"], check=True)
    if form == "raw":
        return raw
    path = raw.with_suffix({"ply": ".ply", "text": ".xyz", "las": ".las", "laz": ".laz"}[form])
    if path.exists():
        return path
    # In a process of its own: a child's peak begins with what its parent had.
    subprocess.run([sys.executable, __file__, "--convert", raw, path], check=True)
    return path


def capless(points):
    low, high = points[:, 0].min(), points[:, 0].max()
    return points[points[:, 0] < low + 0.9 * (high - low)]


def combed(points):
    """Points that fill a cube, each moved onto the nearest side of a comb in it: turned, so that the grid lies askew to its slots."""
    import numpy

    low, high = points.min(0), points.max(0)
    at = (points - low) / (high - low)
    spacing = 0.05
    for _ in range(30):
        spacing = (spacing + ((1 / (5.3 * spacing) + 4) / len(points)) ** 0.5) / 2
    fin, period = 2.8 * spacing, 5.3 * spacing
    x = at[:, 0] % period
    in_fin = x < fin
    # The distances to a side of the fin or slot, to the top or the slot's floor, and to an end.
    wall = numpy.where(in_fin, numpy.where(x < fin / 2, -x, fin - x), numpy.where(x < (fin + period) / 2, fin - x, period - x))
    across = numpy.where(in_fin, 1.0, 0.5) - at[:, 2]
    below = at[:, 2] < 0.5
    along = numpy.where(at[:, 1] < 0.5, -at[:, 1], 1 - at[:, 1])
    # Where the block is, its lower side and its ends; elsewhere what is nearest.
    steps = numpy.stack([wall + below, along, numpy.where(below, numpy.where(in_fin, -at[:, 2], across), across)], 1)
    axis = numpy.abs(steps).argmin(1)
    at[numpy.arange(len(at)), axis] += steps[numpy.arange(len(at)), axis]
    sin, cos = numpy.sin(0.5), numpy.cos(0.5)
    turned = at @ numpy.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    return turned.astype("<f4")


def convert(raw, path):
    """Writes a raw cloud of single precision in another format; in its own, as another shape that is made of it."""
    import numpy

    points = numpy.fromfile(raw, "<f4").reshape(-1, 3)
    if path.suffix == ".bin":
        left = combed(points) if path.name.startswith("comb") else capless(points)
        left.tofile(path)
        layout = json.loads(Path(f"{raw}.json").read_text())
        Path(f"{path}.json").write_text(json.dumps(layout | {"count": len(left)}))
    elif path.suffix == ".ply":
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        header += "".join(f"property float {c}\n" for c in "xyz") + "end_header\n"
        path.write_bytes(header.encode() + points.tobytes())
    elif path.suffix == ".xyz":
        numpy.savetxt(path, points, fmt="%.6f")
    else:
        import laspy

        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = [1e-5] * 3, [0.0] * 3
        las = laspy.LasData(header)
        las.x, las.y, las.z = (points[:, a].astype(float) for a in range(3))
        las.intensity = numpy.arange(len(points)) % 60000
        las.classification = numpy.arange(len(points)) % 7
        las.write(path)


def drawn(dice, most, fits=FITS, shapes=SHAPES):
    """A configuration at random."""
    shape = dice.choice(shapes)
    options = ["--k", str(dice.choice([2, 3, 4, 6, 8]))]
    surface = dice.choice(["closed", "closed", "terrain", "sheet"])
    if surface != "closed":
        options += ["--surface", surface] + (["--facing", dice.choice(["1,0.4,0.7", "0,0,1"])] if surface == "sheet" else [])
    if surface == "terrain" and dice.random() < 0.2:
        options += ["--base", "-2"]
    options += ["--fit", dice.choice(fits), "--smooth", str(dice.choice([0, 1, 1, 2, 5]))]
    points = int(2 ** dice.uniform(12, most.bit_length()))
    return {
        "shape": shape,
        "points": min(points, most),
        "noise": dice.choice([0, 0.001, 0.01]),
        "format": dice.choice(FORMATS),
        "options": options + ["-j", str(dice.randint(1, 8))],
        "factor": 1.0 if dice.random() < 1 / 3 else 4 ** dice.random(),
    }


def tried(program, work, case):
    """One configuration: planned, then run."""
    source = cloud(program, work, case["shape"], case["points"], case["noise"], case["format"])
    plan = subprocess.run(
        [program, "plan", source, *case["options"], "--max-memory", "64G", "--json"], capture_output=True, text=True
    )
    if plan.returncode != 0:
        return case | {"outcome": "no plan", "words": plan.stderr.strip().splitlines()[-1:]}
    least = json.loads(plan.stdout)["memory_least_bytes"]
    budget = int(least * case["factor"])
    mesh, report, log = work / "mesh.ply", work / "report.json", work / "log.txt"
    report.unlink(missing_ok=True)
    command = [program, source, *case["options"], "--max-memory", str(budget), "-o", mesh, "--overwrite", "-q", "--report", report]
    code, seen, seconds = capped([str(word) for word in command], budget + BESIDE, log)
    told = json.loads(report.read_text()) if report.exists() else {}
    mesh.unlink(missing_ok=True)
    outcome = "ok" if code == 0 else "too slow" if seconds > SECONDS else "killed" if code == -9 else f"exit {code}"
    if told.get("error", {}).get("kind") == "cannot-fit":
        outcome = "refused late"
    planned = told.get("memory", {}).get("plan", {}).get("predicted")
    return case | {
        "outcome": outcome,
        "budget": budget,
        "least": least,
        "peak": max(bytes_then for _, bytes_then in seen),
        "planned": planned,
        "seconds": seconds,
        "words": told.get("error", {}).get("message", ""),
        "plan": told.get("memory", {}).get("plan", {}),
        "phases": of_phases(seen, seconds, told.get("seconds", [])),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most", type=int, default=600_000, help="points of the largest cloud")
    parser.add_argument("--fits", nargs="+", default=FITS, help="what vertices are moved onto, at random (also: facets, auto)")
    parser.add_argument("--shapes", nargs="+", default=SHAPES, choices=SHAPES, help="what clouds are of, at random")
    parser.add_argument("--only", nargs="+", type=int, help="numbers of configurations: these, in this order")
    parser.add_argument("--report", type=Path)
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    program, dice = arguments.program.resolve(), random.Random(arguments.seed)
    results = []
    cases = [drawn(dice, arguments.most, arguments.fits, arguments.shapes) for _ in range(arguments.count)]
    for number in arguments.only or range(arguments.count):
        case = cases[number] | {"number": number}
        result = tried(program, arguments.work, case)
        results.append(result)
        with open(arguments.work / "results.jsonl", "a") as out:
            out.write(json.dumps(result) + "\n")
        if result["outcome"] == "no plan":
            print(number, "no plan", case["shape"], case["points"], *case["options"], *result["words"], flush=True)
            continue
        share = result["peak"] / result["budget"]
        planned = f"{result['planned'] / MIB:6.1f}" if result["planned"] else "     –"
        mark = " <--" if result["outcome"] != "ok" or share > ABOVE else ""
        print(
            f"{number:4} {result['outcome']:12} budget {result['budget'] / MIB:6.1f} peak {result['peak'] / MIB:6.1f} plan {planned} "
            f"{share:5.2f} x{case['factor']:.2f} {case['shape']} {case['points']} --noise {case['noise']} {case['format']} "
            f"{' '.join(case['options'])} {result['words']}{mark}",
            flush=True,
        )
    text, bad = summary(results)
    print(text)
    if arguments.report:
        arguments.report.write_text(text)
    sys.exit(1 if bad else 0)


def summary(results):
    """What came out, as Markdown, and how many runs were not as they should be."""
    ran = [r for r in results if r["outcome"] != "no plan"]
    done = [r for r in ran if r["outcome"] == "ok"]
    count = lambda outcome: sum(r["outcome"] == outcome for r in ran)
    above = [r for r in done if r["peak"] > ABOVE * r["budget"]]
    ratios = sorted(r["planned"] / r["peak"] for r in done if r["planned"])
    other = len(ran) - len(done) - count("killed") - count("refused late")
    rows = [
        ["configurations", len(ran)],
        ["done", len(done)],
        ["killed", count("killed")],
        ["refused late", count("refused late")],
        ["ended otherwise", other],
        ["resident above the budget by more than 2 %", len(above)],
        ["the most resident, of the budget", f"{max((r['peak'] / r['budget'] for r in done), default=0):.2f}"],
        ["resident above the plan", sum(r["peak"] > r["planned"] for r in done if r["planned"])],
        ["plan over peak, median", f"{statistics.median(ratios):.2f}" if ratios else "–"],
        ["plan over peak, nine tenths below", f"{ratios[len(ratios) * 9 // 10]:.2f}" if ratios else "–"],
        [f"plan over peak above {PLAN_OVER_PEAK}", sum(r > PLAN_OVER_PEAK for r in ratios)],
    ]
    text = f"At {commit()}.\n\n" + table(["what", "figure:"], rows)
    worst = sorted(done, key=lambda r: r["peak"] / r["budget"], reverse=True)[:8]
    bad = [r for r in ran if r["outcome"] in ("killed", "refused late")]
    line = lambda r: [
        f"`{r['shape']} {r['points']} --noise {r['noise']}` {r['format']} `{' '.join(r['options'])}`",
        r["outcome"],
        *(f"{(r[key] or 0) / MIB:.1f}" for key in ("least", "budget", "peak", "planned")),
    ]
    columns = ["configuration", "outcome", "least, MiB:", "budget:", "resident:", "planned:"]
    text += "\nThe worst:\n\n" + table(columns, [line(r) for r in bad + worst])
    return text, len(bad) + len(above)


if __name__ == "__main__":
    environment("memory", PACKAGES)
    if sys.argv[1:2] == ["--convert"]:
        convert(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        stoppable(main, "stopped")
