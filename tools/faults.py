#!/usr/bin/env python3
"""Faults at random moments, against every command: system calls that fail, signals, disks that fill up. What must hold afterwards:

* a run ends, by an exit code of README's table, without a panic;
* exit code 0 means that all outputs are there, with the bytes that they have without a fault;
* otherwise each output is whole, or as it was before: not there, or the older file;
* nothing else is left, in the output's folder or in that for temporary files; but of tiles, after KILL or if an older folder cannot be removed, one under a hidden
  name, which goes with the next run;
* inputs are what they were.

    python3 tools/faults.py errors 2000            # one system call fails, once or from then on (needs a C compiler, x86-64)
    python3 tools/faults.py signals 300            # INT, TERM, HUP, KILL
    python3 tools/faults.py disks 100              # small file systems in memory, for outputs or for temporary files (needs root)
    python3 tools/faults.py mutants 10000          # an input is damaged; meant for a program built with CARGO_PROFILE_RELEASE_OVERFLOW_CHECKS=true

Each trial has a number, from which alone all its choices come: `--first N` begins with number N, as a failure names it. Inputs of more formats can be named with --input, with
options for them, which may make the runs shorter: --input 'pump.e57 --cell-size 0.2'.
The program is target/release/asra-stream, or that of --program. Exit code 1 if any trial fails.
"""

import argparse
import concurrent.futures
import errno
import gzip
import hashlib
import os
import random
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
PATIENCE = 120
CODES = {0, 2, 4, 65, 66, 69, 71, 73, 74, 75, 76}
ERRORS = {"EIO": errno.EIO, "ENOSPC": errno.ENOSPC, "EINTR": errno.EINTR, "EACCES": errno.EACCES, "EMFILE": errno.EMFILE, "EAGAIN": errno.EAGAIN, "ENOMEM": errno.ENOMEM}
# What the calls of the program can really fail with; EINTR and EAGAIN only once, as for ever would be for ever.
CALLS = {
    "read": ["EIO", "EINTR"], "pread64": ["EIO", "EINTR"], "write": ["EIO", "ENOSPC", "EINTR"], "pwrite64": ["EIO", "ENOSPC", "EINTR"], "writev": ["EIO", "ENOSPC", "EINTR"],
    "openat": ["EIO", "EMFILE", "EACCES", "ENOSPC", "EINTR"], "close": ["EIO", "EINTR"], "lseek": ["EIO"], "mmap": ["ENOMEM", "EACCES"], "madvise": ["EIO", "ENOMEM"],
    "fsync": ["EIO", "ENOSPC", "EINTR"], "fdatasync": ["EIO", "ENOSPC"], "ftruncate": ["EIO", "ENOSPC"], "fallocate": ["EIO", "ENOSPC"], "rename": ["EIO", "ENOSPC", "EACCES"],
    "renameat2": ["EIO", "ENOSPC", "EACCES"], "linkat": ["EIO", "ENOSPC", "EACCES"], "mkdir": ["EIO", "ENOSPC", "EACCES"], "statx": ["EIO", "EACCES"], "fstat": ["EIO"],
    "newfstatat": ["EIO", "EACCES"], "fstatfs": ["EIO"], "statfs": ["EIO"], "getdents64": ["EIO"], "fcntl": ["EIO", "EMFILE"], "flock": ["EIO", "EINTR", "EAGAIN"], "fchmod": ["EIO", "EACCES"],
    "fadvise64": ["EIO"], "clone3": ["EAGAIN"], "poll": ["EINTR"], "readlink": ["EIO"],
}
# An older folder of tiles goes when the new one has its place. If these calls fail, that cannot be done, and it stays under a hidden name until the next run.
REMOVING = {"openat", "getdents64", "fcntl"}
OLDER_FOLDER = "cannot remove the older folder"


def digest(path):
    if path.is_dir():
        return tuple(sorted((str(p.relative_to(path)), digest(p)) for p in path.rglob("*") if p.is_file()))
    return hashlib.sha256(path.read_bytes()).hexdigest()


class Scenario:
    """A command, the files it reads, and what it writes: outputs whose bytes are known, and reports, which tell times."""

    def __init__(self, line, inputs, outputs=(), reports=(), codes=(0,), stdin=None):
        self.line, self.inputs, self.outputs, self.reports, self.codes, self.stdin = line, inputs, outputs, reports, codes, stdin
        self.right, self.older, self.calls = {}, {}, {}
        self.lock = threading.Lock()


class Bench:
    def __init__(self, program, points, more):
        self.program, self.root = str(program), Path(tempfile.mkdtemp(prefix="asra-faults-"))
        self.stock = self.root / "stock"
        self.stock.mkdir()
        self.scenarios = []
        self.make(points, more)

    def run(self, line, folder, **more):
        return subprocess.run([self.program, *line.split()], cwd=folder, capture_output=True, check=True, **more)

    def make(self, points, more):
        stock = self.stock
        make = lambda line: self.run(line, stock)
        make(f"generate knot {points} -o k.ply -q")
        make(f"generate sphere {points} -o s.bin -q")
        make(f"generate terrain {points} -o t.xyz -q")
        raw = (stock / "s.bin").read_bytes()
        count = len(raw) // 12
        (stock / "s.npy").write_bytes(self.npy(raw, count))
        fields = f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA binary\n"
        (stock / "s.pcd").write_bytes(fields.encode() + raw)
        (stock / "k.ply.gz").write_bytes(gzip.compress((stock / "k.ply").read_bytes(), 1, mtime=0))
        (stock / "s.las").write_bytes(self.las(raw, count))
        (stock / "c.wkt").write_text("POLYGON ((-2 -2, 2 -2, 2 2, -2 2, -2 -2))\n")
        for name in ("m.ply", "m.obj", "m.stl", "m.glb"):
            make(f"k.ply -o {name} -q")
        for line, inputs, outputs, reports, *rest in [
            ("k.ply -o o.ply --report o.json --preview=o.png", ["k.ply"], ["o.ply", "o.png"], ["o.json"]),
            ("k.ply -o o.glb --max-memory 32M", ["k.ply"], ["o.glb"], []),
            ("s.bin -o o.stl --fit sphere", ["s.bin", "s.bin.json"], ["o.stl"], []),
            ("t.xyz --surface terrain --cell-size auto -o o.obj", ["t.xyz"], ["o.obj"], []),
            ("t.xyz --surface terrain --cell-size auto --tile 0.5 -o o.ply", ["t.xyz"], ["o.tiles"], []),
            ("s.npy -o o.ply", ["s.npy"], ["o.ply"], []),
            ("s.pcd -o o.ply", ["s.pcd"], ["o.ply"], []),
            ("s.las -o o.ply --no-check", ["s.las"], ["o.ply"], []),
            ("k.ply.gz -o o.ply", ["k.ply.gz"], ["o.ply"], []),
            ("- -o o.ply", ["k.ply"], ["o.ply"], [], (0,), "k.ply"),
            ("check m.ply --report o.json", ["m.ply"], [], ["o.json"]),
            ("check m.obj", ["m.obj"], [], []),
            ("check m.stl", ["m.stl"], [], []),
            ("check m.glb", ["m.glb"], [], []),
            ("compare m.ply k.ply --heatmap o.ply --report o.json", ["m.ply", "k.ply"], ["o.ply"], ["o.json"]),
            ("densify m.glb k.ply -o o.bin", ["m.glb", "k.ply"], ["o.bin", "o.bin.json"], []),
            ("render m.ply -o o.png --views iso,top --size 400x300", ["m.ply"], ["o.png"], []),
            ("k.ply -o o.ply --simplify 0.25c --report o.json", ["k.ply"], ["o.ply"], ["o.json"]),
            ("simplify m.ply 0.5c -o o.ply --report o.json", ["m.ply"], ["o.ply"], ["o.json"]),
            ("simplify m.glb 1% --max-triangles 2000 -o o.glb", ["m.glb"], ["o.glb"], []),
            ("t.xyz --surface ground --cell-size auto -o o.ply --dtm d.tif --dsm s.tif --raster-size 0.05", ["t.xyz"], ["o.ply", "d.tif", "s.tif"], []),
            ("s.las --surface ground --classes none --cell-size auto --clip c.wkt -o o.ply --write-classes w.laz", ["s.las", "c.wkt"], ["o.ply", "w.laz"], []),
            ("info k.ply.gz", ["k.ply.gz"], [], []),
            ("plan s.las", ["s.las"], [], []),
            ("generate torus 20000 -o o.bin", [], ["o.bin", "o.bin.json"], []),
        ] + [(f"{path.name} {' '.join(options)} -o o.ply", [path.name], ["o.ply"], []) for path, *options in more]:
            self.scenarios.append(Scenario(line, inputs, outputs, reports, *rest))
        for path, *_ in more:
            shutil.copy(path, stock)
        for number, scenario in enumerate(self.scenarios):
            folder = self.folder(f"right{number}", scenario)
            done = self.start(scenario, [self.program], folder, []).wait()
            if done not in scenario.codes:
                sys.exit(f"{scenario.line}: exit code {done} without a fault")
            scenario.right = {name: digest(folder / name) for name in scenario.outputs}
            shutil.rmtree(folder)

    @staticmethod
    def npy(raw, count):
        head = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({count}, 3), }}".encode()
        head += b" " * (117 - len(head)) + b"\n"
        return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + raw

    @staticmethod
    def las(raw, count):
        points = list(struct.iter_unpack("<3f", raw))
        scale = 1e-4
        body = b"".join(struct.pack("<3i", *(round(c / scale) for c in p)) + struct.pack("<HBBbBH", 9, 0x11, 2, 0, 0, 1) for p in points)
        low, high = [min(p[a] for p in points) for a in range(3)], [max(p[a] for p in points) for a in range(3)]
        head = b"LASF" + struct.pack("<HH16sBB32s32sHHHIIBHI5I", 0, 0, bytes(16), 1, 2, b"tests", b"tests", 1, 2026, 227, 227, 0, 0, 20, count, count, 0, 0, 0, 0)
        head += struct.pack("<12d", scale, scale, scale, 0, 0, 0, high[0], low[0], high[1], low[1], high[2], low[2])
        return head + body

    def folder(self, name, scenario, where=None):
        """A folder with the inputs in it, and a folder `temp` for temporary files."""
        folder = (where or self.root) / name
        folder.mkdir()
        (folder / "temp").mkdir()
        for input in scenario.inputs:
            shutil.copy(self.stock / input, folder / input)
        return folder

    def start(self, scenario, before, folder, after, errors=subprocess.DEVNULL):
        # Python ignores SIGPIPE only; nothing else is handed down.
        stdin = open(folder / scenario.stdin, "rb") if scenario.stdin else subprocess.DEVNULL
        words = [*before, *scenario.line.split(), *after]
        if scenario.line.split()[0] not in ("info", "generate"):
            words += ["-j", "2"]
        env = dict(os.environ, TMPDIR=str(folder / "temp"))
        return subprocess.Popen(words, cwd=folder, stdin=stdin, stdout=subprocess.DEVNULL, stderr=errors, env=env)

    def counts(self, number, call):
        """How often a scenario makes a call, and how often before its first own one: loading the program cannot be made to fail in a way that is its own."""
        scenario = self.scenarios[number]
        with scenario.lock:
            if call not in scenario.calls:
                words = scenario.line.split()
                own = self.count(number, call, words + ["-j", "2"] if words[0] not in ("info", "generate") else words)
                scenario.calls[call] = [own, self.count(number, call, ["--version"])]
            return scenario.calls[call]

    def count(self, number, call, line):
        scenario = self.scenarios[number]
        folder = self.folder(f"count{number}", scenario)
        stdin = open(folder / scenario.stdin, "rb") if scenario.stdin else subprocess.DEVNULL
        env = dict(os.environ, TMPDIR=str(folder / "temp"))
        subprocess.run([str(self.root / "inject"), call, "0", "0", "once", str(folder / "log"), self.program, *line], cwd=folder, stdin=stdin, capture_output=True, env=env)
        found = int((folder / "log").read_text())
        shutil.rmtree(folder)
        return found

    def verdict(self, scenario, folder, code, words, codes, older, removes=False):
        """What is wrong after a run, as a list of words."""
        wrong = []
        if code not in codes:
            wrong.append(f"exit code {code}")
        if "panicked" in words or "report this" in words:
            wrong.append("a panic or a defect")
        for name in scenario.inputs:
            if not (folder / name).exists() or digest(folder / name) != digest(self.stock / name):
                wrong.append(f"input {name} changed")
        for name in scenario.outputs:
            there = (folder / name).exists()
            now = digest(folder / name) if there else None
            if now == scenario.right[name] or (code != 0 and now == older.get(name)):
                continue
            wrong.append(f"{name} {'is neither whole nor as before' if there else 'is missing'}")
        for name in scenario.reports:
            text = (folder / name).read_text() if (folder / name).exists() else ""
            if (code == 0 and not text) or (text and not text.rstrip().endswith("}")):
                wrong.append(f"{name} is not whole")
        known = {*scenario.inputs, *scenario.outputs, *scenario.reports, "temp"}
        left = [p.name for p in folder.iterdir() if p.name not in known] + [f"temp/{p.name}" for p in (folder / "temp").iterdir()]
        if removes and left and all(name.startswith(".o.tiles.") and name.endswith(".tmp") for name in left):
            wrong += self.again(scenario, folder)
        elif left:
            wrong.append(f"left behind: {' '.join(left)}")
        return wrong

    def again(self, scenario, folder):
        """What is wrong after another run, without a fault: what the first one left must go."""
        process = self.start(scenario, [self.program], folder, ["--overwrite"], subprocess.PIPE)
        code, words = self.finish(process)
        wrong = ["hangs"] if code is None else self.verdict(scenario, folder, code, words, scenario.codes, {})
        return [f"after another run: {what}" for what in wrong]

    def old_outputs(self, scenario, folder, chance):
        """In half of the trials there are older outputs, and --overwrite."""
        if not scenario.outputs or scenario.line.startswith("check") or chance.random() < 0.5:
            return {}, []
        older = {}
        for name in scenario.outputs:
            path = folder / name
            if name.endswith(".tiles"):
                path.mkdir()
                (path / "index.json").write_text("{}")
            else:
                path.write_text("older\n")
            older[name] = digest(path)
        return older, ["--overwrite"]

    def finish(self, process, patience=PATIENCE):
        try:
            _, words = process.communicate(timeout=patience)
            return process.returncode, (words or b"").decode(errors="replace")
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return None, ""


def errors(bench, number):
    chance = random.Random(f"errors {number}")
    at = chance.randrange(len(bench.scenarios))
    scenario = bench.scenarios[at]
    for _ in range(50):
        call = chance.choice(list(CALLS))
        calls, loading = bench.counts(at, call)
        if calls > loading:
            break
    nth = chance.randint(loading + 1, calls)
    name = chance.choice(CALLS[call])
    how = "once" if name in ("EINTR", "EAGAIN") and call != "clone3" else chance.choice(["once", "always"])
    folder = bench.folder(f"t{number}", scenario)
    older, after = bench.old_outputs(scenario, folder, chance)
    before = [str(bench.root / "inject"), call, str(nth), str(ERRORS[name]), how, str(bench.root / f"log{number}"), bench.program]
    process = bench.start(scenario, before, folder, after, subprocess.PIPE)
    code, words = bench.finish(process)
    told = f"{call} {nth} of {calls} {name} {how}: {scenario.line} {' '.join(after)}"
    wrong = ["hangs"] if code is None else bench.verdict(scenario, folder, code, words, CODES, older, removes=call in REMOVING and OLDER_FOLDER in words)
    stayed = ", an older folder of tiles stays until the next run" if OLDER_FOLDER in words else ""
    shutil.rmtree(folder)
    (bench.root / f"log{number}").unlink(missing_ok=True)
    return f"exit {code}{stayed}", wrong, told + "\n      " + words.strip()[-300:]


SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129, signal.SIGKILL: -9}


def signals(bench, number):
    chance = random.Random(f"signals {number}")
    scenario = chance.choice(bench.scenarios)
    which = chance.choice(list(SIGNALS))
    folder = bench.folder(f"t{number}", scenario)
    older, after = bench.old_outputs(scenario, folder, chance)
    begin = time.monotonic()
    took = scenario.calls.setdefault("seconds", [])
    process = bench.start(scenario, [bench.program], folder, after, subprocess.PIPE)
    usual = sorted(took)[len(took) // 2] if took else 0.3
    time.sleep(chance.random() * 1.1 * usual)
    sent = process.poll() is None
    if sent:
        process.send_signal(which)
    code, words = bench.finish(process)
    if code == 0:
        took.append(time.monotonic() - begin)
    told = f"{which.name}: {scenario.line} {' '.join(after)}"
    # Before the handler is there, the signal itself ends the program.
    codes = {0, SIGNALS[which], -which} if sent else {0}
    hidden = any(p.name.startswith(".") for p in folder.iterdir())
    wrong = ["hangs"] if code is None else bench.verdict(scenario, folder, code, words, codes, older, removes=which == signal.SIGKILL)
    if which == signal.SIGKILL and code == -9:
        code = "KILL" + (", hidden folder of tiles until the next run" if hidden else "")
    shutil.rmtree(folder)
    return f"{which.name} exit {code}", wrong, told + "\n      " + words.strip()[-300:]


def disks(bench, number):
    chance = random.Random(f"disks {number}")
    scenario = chance.choice([s for s in bench.scenarios if s.outputs])
    kib = int(4 * 2 ** (chance.random() * 11))
    which = chance.choice(["outputs", "temporary files"])
    folder = bench.folder(f"t{number}", scenario)
    place = folder / ("temp" if which == "temporary files" else "out")
    place.mkdir(exist_ok=True)
    inodes = chance.choice(["", "", "", ",nr_inodes=3"])
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kib}k{inodes}", "tmpfs", str(place)], check=True)
    try:
        moved = scenario
        if which == "outputs":
            line = " ".join(f"out/{word}" if word in (*scenario.outputs, *scenario.reports) else word.replace("=o.", "=out/o.") for word in scenario.line.split())
            line = line.replace(" -o o.ply", " -o out/o.ply") if "--tile" in line else line
            moved = Scenario(line, scenario.inputs, (), (), scenario.codes, scenario.stdin)
        process = bench.start(moved, [bench.program], folder, ["--max-memory", "32M"] if chance.random() < 0.5 and "generate" not in scenario.line and "render" not in scenario.line and "--max-memory" not in scenario.line else [], subprocess.PIPE)
        code, words = bench.finish(process)
        wrong = []
        if code is None:
            wrong.append("hangs")
        elif which == "outputs":
            if code not in CODES or "panicked" in words:
                wrong.append(f"exit code {code}")
            names = {p.name for p in place.iterdir()}
            for name in scenario.outputs:
                if name in names and digest(place / name) != scenario.right[name]:
                    wrong.append(f"{name} is not whole")
                if name not in names and code == 0:
                    wrong.append(f"{name} is missing")
            left = names - {*scenario.outputs, *scenario.reports}
            if left:
                wrong.append(f"left behind: {' '.join(left)}")
        else:
            wrong = bench.verdict(scenario, folder, code, words, CODES, {})
    finally:
        subprocess.run(["umount", str(place)], check=True)
    shutil.rmtree(folder)
    return f"{which}, exit {code}", wrong, f"{kib} KiB{inodes} for {which}: {moved.line}\n      {words.strip()[-300:]}"


def damaged(raw, chance):
    """The bytes of a file with one to three places changed, most of them in its head, where most is decided."""
    raw = bytearray(raw)
    for _ in range(chance.randint(1, 3)):
        if not raw:
            break
        at = chance.randrange(min(len(raw), 512) if chance.random() < 0.6 else len(raw))
        run = min(chance.randint(1, 8), len(raw) - at)
        match chance.randrange(8):
            case 0:
                raw[at] ^= 1 << chance.randrange(8)
            case 1:
                raw[at] = chance.randrange(256)
            case 2:
                raw[at : at + run] = b"\xff" * run
            case 3:
                raw[at : at + run] = bytes(run)
            case 4:
                raw[at : at + run] = chance.randbytes(run)
            case 5:
                del raw[at:]
            case 6:
                del raw[at : at + run]
            case 7:
                to = chance.randint(0, len(raw))
                raw[to:to] = raw[at : at + run]
    return bytes(raw)


def mutants(bench, number):
    chance = random.Random(f"mutants {number}")
    scenario = chance.choice([s for s in bench.scenarios if s.inputs])
    name = chance.choice(scenario.inputs)
    folder = bench.folder(f"t{number}", scenario)
    (folder / name).write_bytes(damaged((folder / name).read_bytes(), chance))
    inputs = {name: digest(folder / name) for name in scenario.inputs}
    process = bench.start(scenario, [bench.program], folder, [], subprocess.PIPE)
    # Coordinates that a damaged byte throws far away are many slices.
    code, words = bench.finish(process, 5 * PATIENCE)
    wrong = ["hangs"] if code is None else []
    if code is not None and code not in CODES:
        wrong.append(f"exit code {code}")
    if "panicked" in words or "report this" in words:
        wrong.append("a panic or a defect")
    wrong += [f"input {name} changed" for name, was in inputs.items() if digest(folder / name) != was]
    there = {name for name in scenario.outputs if (folder / name).exists()}
    if there and code not in (0, 4):
        wrong.append(f"made nevertheless: {' '.join(sorted(there))}")
    if code == 0 and there != set(scenario.outputs):
        wrong.append(f"made only: {' '.join(sorted(there))}")
    known = {*scenario.inputs, *scenario.outputs, *scenario.reports, "temp"}
    left = [p.name for p in folder.iterdir() if p.name not in known] + [f"temp/{p.name}" for p in (folder / "temp").iterdir()]
    if left:
        wrong.append(f"left behind: {' '.join(left)}")
    shutil.rmtree(folder)
    return f"{Path(name).suffix} exit {code}", wrong, f"{name} damaged: {scenario.line}\n      {words.strip()[-300:]}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=["errors", "signals", "disks", "mutants"])
    parser.add_argument("trials", type=int)
    parser.add_argument("--first", type=int, default=0, help="the number of the first trial")
    parser.add_argument("--points", type=int, default=20_000, help="points of the clouds")
    parser.add_argument("--program", type=Path, default=HERE.parent / "target/release/asra-stream")
    parser.add_argument("--input", action="append", default=[], metavar="'FILE OPTIONS'", help="one more cloud to reconstruct, of any format, and options")
    parser.add_argument("--at-once", type=int, default=2, help="trials at a time")
    given = parser.parse_args()
    bench = Bench(given.program.resolve(), given.points, [[Path(path).resolve(), *options] for path, *options in map(shlex.split, given.input)])
    if given.kind == "errors":
        subprocess.run(["cc", "-O1", "-o", str(bench.root / "inject"), str(HERE / "inject.c")], check=True)
    trial = {"errors": errors, "signals": signals, "disks": disks, "mutants": mutants}[given.kind]
    outcomes, failed = Counter(), 0
    try:
        with concurrent.futures.ThreadPoolExecutor(given.at_once) as pool:
            numbers = range(given.first, given.first + given.trials)
            for number, (outcome, wrong, told) in zip(numbers, pool.map(lambda number: trial(bench, number), numbers)):
                outcomes[outcome] += 1
                if wrong:
                    failed += 1
                    print(f"trial {number}: {'; '.join(wrong)}: {told}", flush=True)
    finally:
        shutil.rmtree(bench.root, ignore_errors=True)
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:6} {outcome}")
    print(f"{given.trials} trials, {failed} not as they should be")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
