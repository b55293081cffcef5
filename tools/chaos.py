#!/usr/bin/env python3
"""Reconstructions by a Dask cluster on this machine, whose workers are killed: what must come out is the mesh of a plain run, byte for byte.

    python3 tools/chaos.py --runs 20               # four workers, a random one killed every ten seconds, and the client once, at a random moment; then it is started again

Of each run it tells how often workers were killed, how many tasks there were and how many were started. A run fails if its mesh has other bytes, if more tasks were started than
tasks + 2 × kills + workers, or if a process is left ten seconds after its end. The run's number alone decides which are killed and when: `--first N` begins with number N.
The cloud is a knot of --points points; the program is target/release/asra-stream, or that of --program. Exit code 1 if any run fails.

The driver is the package's own file, asra_stream/dask.py, without the part in Rust: its workers run the program.
"""

import argparse
import contextlib
import filecmp
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import types
from pathlib import Path

from shared import ROOT, built, environment, stoppable

# Workers, which are started by importing this file, find the package like that, too.
sys.modules["asra_stream"] = types.ModuleType("asra_stream")
sys.modules["asra_stream"].__path__ = [str(ROOT / "python/package/asra_stream")]

PACKAGES = ["distributed"]
WORKERS = 4
# Seconds: a run that does not end is a failure; so is a process that outlives its run.
PATIENCE, OUTLIVES = 1200, 10
# All processes of a run inherit this variable.
MARK = "ASRA_STREAM_CHAOS"


def drive(folder):
    """The client: it may be killed at any moment."""
    import dask
    from asra_stream.dask import reconstruct
    from distributed import Client, LocalCluster

    # LocalCluster takes a worker for lost for good that is not back after 15 seconds, which a busy machine may need to start one.
    dask.config.set({"distributed.deploy.lost-worker-timeout": "1 hour"})
    told = json.loads((folder / "run.json").read_text())
    with LocalCluster(n_workers=WORKERS, threads_per_worker=1, memory_limit=0, dashboard_address=None) as cluster, Client(cluster) as client:

        def write():
            # A worker that was killed comes back under another number.
            while True:
                pids = [nanny.pid for nanny in list(cluster.workers.values())]
                part = folder / f"pids.{os.getpid()}"
                part.write_text(json.dumps([pid for pid in pids if pid]))
                part.rename(folder / "pids.json")
                time.sleep(0.1)

        threading.Thread(target=write, daemon=True).start()
        reconstruct(client, told["cloud"], folder / "m.ply", work=folder / "work", processes=told["processes"], threads=1, program=folder / "program", k=4)


def marked(mark):
    """The processes of a run, with their words; those that have ended, and only wait for somebody to ask how, do not count."""
    found = {}
    for pid in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):
            place = Path("/proc") / pid
            if f"{MARK}={mark}".encode() in place.joinpath("environ").read_bytes().split(b"\0"):
                found[int(pid)] = place.joinpath("cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")[:200]
    return found


def kill_a_worker(chance, folder, client):
    """Kills one of the workers, which are children of the client and of nobody else; whether there was one."""
    with contextlib.suppress(OSError, ValueError):
        pids = json.loads((folder / "pids.json").read_text())
        chance.shuffle(pids)
        for pid in pids:
            with contextlib.suppress(OSError):
                if int(Path(f"/proc/{pid}/stat").read_text().rsplit(")")[1].split()[1]) == client.pid:
                    os.kill(pid, signal.SIGKILL)
                    return True
    return False


def one_run(number, options, program, cloud, whole, folder, usual):
    """Words about a run, seconds it took, and whether all is as it must be."""
    chance, mark = random.Random(f"chaos {number}"), f"{os.getpid()}-{number}"
    # Every start of a task leaves a line.
    script = f'#!/bin/sh\nif [ "$1" = work ]; then echo "$3" >> "{folder}/starts"; fi\nexec "{program}" "$@"\n'
    (folder / "program").write_text(script)
    (folder / "program").chmod(0o755)
    (folder / "run.json").write_text(json.dumps({"cloud": str(cloud), "processes": options.processes}))

    def started():
        with contextlib.suppress(OSError):
            (folder / "pids.json").unlink()
        with open(folder / "log", "ab") as log:
            words = [sys.executable, __file__, "--drive", str(folder)]
            return subprocess.Popen(words, env=os.environ | {MARK: mark}, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    begin = time.monotonic()
    client, kills, clients = started(), 0, 0
    client_dies, worker_dies = begin + chance.uniform(0, usual), begin + options.every
    try:
        while client.poll() is None or (client.returncode != 0 and clients == 0):
            now = time.monotonic()
            if now - begin > PATIENCE:
                return "does not end", now - begin, False
            if clients == 0 and now >= client_dies:
                client.kill()
                client.wait()
                clients += 1
                client = started()
            elif client.poll() is not None:
                break
            elif now >= worker_dies:
                kills += kill_a_worker(chance, folder, client)
                worker_dies = now + options.every
            time.sleep(0.02)
    finally:
        client.kill()
        client.wait()
    seconds = time.monotonic() - begin
    if client.returncode != 0:
        last = (folder / "log").read_text(errors="replace").strip()[-1500:]
        return f"the client ended with {client.returncode}: {last}", seconds, False
    end = time.monotonic() + OUTLIVES
    while (left := marked(mark)) and time.monotonic() < end:
        time.sleep(0.1)
    listed = json.loads(subprocess.run([program, "tasks", folder / "work", "--json"], stdout=subprocess.PIPE, check=True).stdout)
    tasks, starts = len(listed["tasks"]), len((folder / "starts").read_text().split())
    same = filecmp.cmp(whole, folder / "m.ply", shallow=False)
    fine = same and not left and starts - tasks <= 2 * kills + WORKERS
    words = f"{kills} workers and {clients} clients killed, {tasks} tasks, {starts} starts, {'same' if same else 'OTHER'} bytes, {len(left)} processes left"
    return words + "".join(f"\n  {pid}: {line}" for pid, line in left.items()), seconds, fine


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--points", type=int, default=20_000_000)
    parser.add_argument("--processes", type=int, default=8, help="for how many at a time the work is cut [default: 8]")
    parser.add_argument("--every", type=float, default=10, help="seconds from one kill of a worker to the next [default: 10]")
    parser.add_argument("--program", type=Path)
    parser.add_argument("--folder", type=Path, help="where the runs lie [default: the system's folder for temporary files]")
    parser.add_argument("--drive", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    environment("chaos", PACKAGES)
    if options.drive:
        drive(options.drive)
        return
    program = built(options.program)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        place = Path(name)
        cloud, whole = place / "knot.bin", place / "whole.ply"
        subprocess.run([program, "generate", "knot", str(options.points), "-o", cloud, "--quiet"], check=True)
        begin = time.monotonic()
        subprocess.run([program, cloud, "-o", whole, "--k", "4", "--quiet"], check=True)
        # With kills a run takes longer than this, so that the client is always killed before it is done.
        usual, failed = time.monotonic() - begin, 0
        print(f"a plain run takes {usual:.1f} s", flush=True)
        for number in range(options.first, options.first + options.runs):
            folder = place / f"run{number}"
            folder.mkdir()
            words, seconds, fine = one_run(number, options, program, cloud, whole, folder, usual)
            print(f"run {number}: {words}, {seconds:.0f} s{'' if fine else ': FAILED'}", flush=True)
            failed += not fine
            shutil.rmtree(folder)
        print(f"{options.runs - failed} of {options.runs} runs as they must be")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    stoppable(main, "stopped")
