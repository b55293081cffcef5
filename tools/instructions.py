#!/usr/bin/env python3
"""Instructions that a run executes, by source file: the same on a busy machine, so that noise cannot hide a regression.

    cargo build --release
    tools/instructions.py             compares with benches/results/instructions.json; exit code 1 if a file takes 3 % more
    tools/instructions.py --write     replaces these figures

Needs valgrind. Runs on 100,000 points of a knot with one thread; takes a minute. What is inlined counts where it was written; what is inlined from the
standard library and other crates, with the lines of ours before it. Figures hold for one compiler and one kind of machine; compare two builds on the same.
"""

import argparse
import collections
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KNOWN = ROOT / "benches/results/instructions.json"
# Files below this share of all instructions are not compared: some thousands of instructions are noise.
SHARE = 0.002
MORE = 1.03


def ours(name):
    """The file's name within the repository, if it is one of its sources."""
    match = re.search(r"(?:^|/)(src/.*\.rs)$", name)
    return match[1] if match and "/rustc/" not in name and "/registry/" not in name else None


def own_costs(path):
    """Instructions of each source file, without what it calls, from callgrind's output."""
    names, costs, current, called = {}, collections.Counter(), "libraries", False
    for line in path.open():
        if match := re.match(r"(fl|fi|fe)=\((\d+)\)(?: (.*))?", line):
            kind, key, name = match.groups()
            if name:
                names[key] = name.strip()
            # A function begins with its own file.
            before = "libraries" if kind == "fl" else current
            current = ours(names[key]) or before
        elif match := re.match(r"cf[il]=\((\d+)\) (.*)", line):
            names[match[1]] = match[2].strip()
        elif line.startswith("calls="):
            called = True
        elif re.match(r"[+*\-\d]", line):
            # The line after a call has the cost of what was called.
            if not called:
                costs[current] += int(line.split()[1])
            called = False
    return costs


def count(program):
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        subprocess.run([program, "generate", "knot", "100000", "-q", "-o", folder / "knot.bin"], check=True)
        out = folder / "callgrind.out"
        run = [program, folder / "knot.bin", "-q", "-j", "1", "--max-memory", "1G", "-o", folder / "mesh.ply"]
        subprocess.run(["valgrind", "-q", "--tool=callgrind", f"--callgrind-out-file={out}", *run], check=True)
        costs = own_costs(out)
    return dict(costs.most_common())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/asra-stream")
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    found = count(arguments.program.resolve())
    total = sum(found.values())
    known = json.loads(KNOWN.read_text()) if KNOWN.exists() else {}
    worse = False
    print("| file | million instructions | share | before |\n|---|--:|--:|--:|")
    for name, cost in {"all": total, **found}.items():
        if cost < SHARE * total:
            continue
        before = known.get(name)
        ratio = cost / before if before else None
        worse |= ratio is not None and ratio > MORE
        words = f"{ratio:.3f}" if ratio else "new"
        print(f"| {name} | {cost / 1e6:,.1f} | {cost / total:.1%} | {words} |")
    if arguments.write:
        KNOWN.write_text(json.dumps({"all": total, **found}, indent=1) + "\n")
    sys.exit(1 if worse and not arguments.write else 0)


if __name__ == "__main__":
    main()
