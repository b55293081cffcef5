#!/usr/bin/env python3
"""Runs with --work that are ended at random moments and go on: what must come out is the mesh of a run that nobody ended, byte for byte.

    python3 tools/kill.py kills 200                # KILL at a moment that is uniform over the run; half of the runs are killed again and again
    python3 tools/kill.py signals 20               # TERM and INT: the run ends within a second, with its exit code, and says how to go on
    python3 tools/kill.py tasks 20                 # four processes do the tasks of a run in one folder, and are killed and started again
    python3 tools/kill.py disks 20                 # a small file system in memory fills up, for the work folder or for the output; then it gets more room (needs root)

Each run has its own number of threads and budget, another one each time it goes on. The trial's number alone decides them: `--first N` begins with number N.
The cloud is a knot of --points points, or that of --cloud with --options; the program is target/release/asra-stream, or that of --program. Exit code 1 if any trial fails.
"""

import argparse
import hashlib
import json
import random
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shared import built, stoppable

# A run that does not end is a failure.
PATIENCE = 1200
# Ends within a second; the clock of a busy machine has some more.
PROMPT = 1.5


def digest(path):
    hasher = hashlib.sha256()
    with open(path, "rb") as file:
        while piece := file.read(1 << 20):
            hasher.update(piece)
    return hasher.hexdigest()


class Trials:
    def __init__(self, options, folder):
        self.program, self.folder = built(options.program), folder
        if options.cloud:
            self.cloud = options.cloud.resolve()
        else:
            self.cloud = folder / "knot.bin"
            subprocess.run([self.program, "generate", "knot", str(options.points), "-o", self.cloud, "--quiet"], check=True)
        self.options = shlex.split(options.options)
        start = time.monotonic()
        whole = self.run(folder / "whole.ply", ["-j", "2"])
        self.seconds = time.monotonic() - start
        if whole.wait() != 0:
            sys.exit(f"a run that nobody ended failed: {whole.words()}")
        self.seconds = time.monotonic() - start
        self.killed = 0
        self.expected = digest(folder / "whole.ply")
        print(f"a run takes {self.seconds:.1f} s", flush=True)

    def run(self, output, more, work=None):
        command = [self.program, self.cloud, "-o", output, *self.options, *more, *(["--work", work] if work else [])]
        errors = tempfile.TemporaryFile(dir=self.folder)
        process = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL, stderr=errors)

        def words():
            errors.seek(0)
            return errors.read().decode(errors="replace").strip()[-600:]

        process.words = words
        return process

    def means(self, chance):
        budget = chance.choice(["least", "1G", None])
        threads = chance.choice([1, 2, 3])
        return ["-j", str(threads), *(["--max-memory", self.budget(threads) if budget == "least" else budget] if budget else [])]

    def budget(self, threads):
        """The least budget of the cloud, from the message of a run that is refused."""
        key = f"least{threads}"
        if not hasattr(self, key):
            refused = self.run(self.folder / "refused.ply", ["--max-memory", "1M", "-j", str(threads)])
            refused.wait()
            words = refused.words().split("--max-memory ")[-1].split()[0]
            setattr(self, key, words)
        return getattr(self, key)

    def finished(self, chance, output, work, count):
        """Runs on until the end; the number of runs, or what went wrong."""
        run = self.run(output, self.means(chance), work)
        if run.wait(PATIENCE) != 0:
            return f"going on failed with {run.returncode} after {count}: {run.words()}"
        if digest(output) != self.expected:
            return f"other bytes after {count}"
        left = [p.name for p in output.parent.iterdir() if p != output]
        return f"left: {left}" if left else None

    def kill(self, chance, place):
        output, work = place / "m.ply", place / "m.work"
        kills = chance.choice([1, 1, 1, 2, 3, 5])
        for number in range(kills):
            run = self.run(output, self.means(chance), work)
            try:
                run.wait(chance.uniform(0, self.seconds * (1.3 if kills == 1 else 0.7)))
                if run.returncode != 0:
                    return f"failed with {run.returncode}: {run.words()}"
                break
            except subprocess.TimeoutExpired:
                run.kill()
                run.wait()
            # It may have had its name when the run was killed; then it is whole.
            if output.exists() and digest(output) != self.expected:
                return "an output that is not whole"
            if output.exists() and not any((work / name).exists() for name in ["job.json", "done/output.json"]):
                # It was killed when all was done.
                return None
        if run.returncode == 0:
            return None if digest(output) == self.expected else "other bytes"
        return self.finished(chance, output, work, f"{number + 1} kills")

    def tasks(self, chance, place):
        """Processes that share a folder, each with threads and a budget of its own; one is killed now and then, and another takes its place."""
        output, work = place / "m.ply", place / "m.work"
        processes = str(chance.choice([2, 4, 7]))
        plan = [self.program, "plan", self.cloud, "-o", output, *self.options, "--work", work, "--processes", processes]
        planned = subprocess.run([str(word) for word in plan], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        if planned.returncode != 0:
            return f"plan failed with {planned.returncode}: {planned.stderr.decode(errors='replace')[-600:]}"
        least = json.loads(subprocess.run([self.program, "tasks", work, "--json"], stdout=subprocess.PIPE, check=True).stdout)["least_memory"]

        def begun(number):
            means = ["-j", str(chance.choice([1, 2])), "--max-memory", chance.choice([str(2 * least), "1G"])]
            command = [self.program, "work", work, "--any", "--shard", f"{number}/4", *means, "--quiet"]
            errors = tempfile.TemporaryFile(dir=self.folder)
            return subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL, stderr=errors), errors

        running = {number: begun(number) for number in range(4)}
        kills, allowed, end = 0, chance.choice([2, 5, 10]), time.monotonic() + PATIENCE
        try:
            while running:
                if time.monotonic() > end:
                    return f"no end after {kills} kills"
                time.sleep(chance.uniform(0, self.seconds / 4))
                for number, (process, errors) in list(running.items()):
                    if process.poll() is None:
                        continue
                    if process.returncode != 0:
                        errors.seek(0)
                        return f"failed with {process.returncode} after {kills} kills: {errors.read().decode(errors='replace')[-600:]}"
                    del running[number]
                if running and kills < allowed:
                    number = chance.choice(list(running))
                    running[number][0].kill()
                    running[number][0].wait()
                    kills += 1
                    running[number] = begun(number)
        finally:
            for process, _ in running.values():
                process.kill()
                process.wait()
        self.killed += kills
        return None if digest(output) == self.expected else f"other bytes after {kills} kills"

    def signal(self, chance, place):
        output, work = place / "m.ply", place / "m.work"
        run = self.run(output, self.means(chance), work)
        number = chance.choice([signal.SIGTERM, signal.SIGINT])
        try:
            run.wait(chance.uniform(0.05, self.seconds))
            return None if run.returncode == 0 and digest(output) == self.expected else f"failed: {run.words()}"
        except subprocess.TimeoutExpired:
            sent = time.monotonic()
            run.send_signal(number)
            run.wait(PATIENCE)
        took = time.monotonic() - sent
        if run.returncode == 0:
            return None if digest(output) == self.expected else "other bytes"
        if run.returncode == -number:
            # It came before the program could hear it.
            return self.finished(chance, output, work, f"{number.name}")
        if run.returncode != 128 + number:
            return f"exit code {run.returncode} after {number.name}: {run.words()}"
        if work.exists() and "goes on from there" not in run.words():
            return f"does not say how to go on: {run.words()}"
        if took > PROMPT:
            return f"{took:.2f} s to the end after {number.name}"
        return self.finished(chance, output, work, f"{number.name}")

    def disk(self, chance, place):
        small = place / "small"
        small.mkdir()
        size = int(chance.uniform(0.05, 1.1) * 3 * self.cloud.stat().st_size) + (17 << 20)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", small], check=True)
        try:
            at_work = chance.random() < 0.6
            output = (place if at_work else small) / "m.ply"
            work = (small if at_work else place) / "m.work"
            run = self.run(output, self.means(chance), work)
            if run.wait(PATIENCE) == 0:
                return None if digest(output) == self.expected else "other bytes"
            if run.returncode not in (71, 75):
                return f"exit code {run.returncode} when full at {size}: {run.words()}"
            if output.exists():
                return "an output that is not whole"
            subprocess.run(["mount", "-o", f"remount,size={8 * self.cloud.stat().st_size + (1 << 30)}", small], check=True)
            run = self.run(output, self.means(chance), work)
            if run.wait(PATIENCE) != 0:
                return f"going on failed with {run.returncode}: {run.words()}"
            return None if digest(output) == self.expected else "other bytes"
        finally:
            subprocess.run(["umount", small], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["kills", "tasks", "signals", "disks"])
    parser.add_argument("trials", type=int)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--cloud", type=Path)
    parser.add_argument("--options", default="--k 4")
    parser.add_argument("--program", type=Path)
    parser.add_argument("--folder", type=Path, help="where the trials lie [default: the system's folder for temporary files]")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        trials = Trials(options, Path(folder))
        one = {"kills": trials.kill, "tasks": trials.tasks, "signals": trials.signal, "disks": trials.disk}[options.what]
        failed = 0
        for number in range(options.first, options.first + options.trials):
            place = Path(folder) / f"trial{number}"
            place.mkdir()
            wrong = one(random.Random(f"{options.what} {number}"), place)
            if wrong:
                failed += 1
                print(f"trial {number}: {wrong}", flush=True)
            shutil.rmtree(place)
        print(f"{options.trials - failed} of {options.trials} {options.what} went on to the same bytes" + (f", {trials.killed} kills" if trials.killed else ""))
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    stoppable(main, "stopped")
