"""A reconstruction by the workers of a Dask cluster: the bytes of one run, whatever dies on the way."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

import asra_stream

pytest.importorskip("distributed")

from distributed import Client, LocalCluster  # noqa: E402

from asra_stream.dask import reconstruct  # noqa: E402

POINTS = 400_000


def command(*line):
    subprocess.run([sys.executable, "-m", "asra_stream", *map(str, line), "--quiet"], check=True)


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "knot.bin"
    command("generate", "knot", POINTS, "-o", path)
    return path


@pytest.fixture(scope="module")
def whole(cloud):
    path = cloud.parent / "whole.ply"
    command(cloud, "-o", path, "--k", 4)
    return path.read_bytes()


@pytest.fixture
def client():
    with LocalCluster(n_workers=2, threads_per_worker=1, memory_limit=0, dashboard_address=None) as cluster, Client(cluster) as client:
        yield client


def at_work(folder):
    """The processes that have the folder among their words."""
    found = []
    for pid in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):
            words = open(f"/proc/{pid}/cmdline", "rb").read().split(b"\0")
            if os.fsencode(folder) in words:
                found.append(int(pid))
    return found


def test_bytes_are_those_of_one_run(client, cloud, whole, tmp_path):
    told = []
    report = reconstruct(client, cloud, tmp_path / "m.ply", k=4, progress=told.append, threads=1, memory="200M")
    assert (tmp_path / "m.ply").read_bytes() == whole
    assert report["output"]["bytes"] == len(whole)
    # Of the folder nothing is left.
    assert os.listdir(tmp_path) == ["m.ply"]
    assert told[-1]["ended"] and told[-1]["done"] == told[-1]["total"] and told[-1]["fraction"] == 1
    assert [one["fraction"] for one in told] == sorted(one["fraction"] for one in told)
    assert {one["event"]["event"] for one in told} >= {"start", "stage", "progress", "done"}


@pytest.mark.skipif(sys.platform != "linux", reason="who is at work is read from /proc")
def test_a_worker_and_a_process_are_killed(client, cloud, whole, tmp_path):
    kills, again, starts = [], [], []
    workers = list(client.run(os.getpid).values())

    def kill(update):
        event = update["event"]
        again.extend([event["task"]] if event["event"] == "again" else [])
        if event["event"] == "start":
            starts.append(event["task"])
            if len(starts) == 2:
                kills.append(workers[0])
                os.kill(workers[0], signal.SIGKILL)
            if len(starts) == 7:
                # This time the process alone, if it is not done meanwhile.
                for pid in at_work(tmp_path / "w"):
                    os.kill(pid, signal.SIGKILL)

    reconstruct(client, cloud, tmp_path / "m.ply", work=tmp_path / "w", k=4, progress=kill, processes=4)
    assert kills and (tmp_path / "m.ply").read_bytes() == whole
    # A named folder stays, and the same call finds all done.
    before = len(starts)
    report = reconstruct(client, cloud, tmp_path / "m.ply", work=tmp_path / "w", k=4, progress=kill, processes=4)
    assert len(starts) == before and report["output"]["bytes"] == len(whole)
    # The process of the worker that was killed ends by itself.
    end = time.monotonic() + 60
    while at_work(tmp_path / "w") and time.monotonic() < end:
        time.sleep(0.1)
    assert not at_work(tmp_path / "w")


def test_failures_have_the_program_s_words(client, cloud, tmp_path):
    with pytest.raises(asra_stream.NoInputError, match="nothing.bin"):
        reconstruct(client, tmp_path / "nothing.bin", tmp_path / "m.ply")
    with pytest.raises(asra_stream.UsageError, match="--kk") as told:
        reconstruct(client, cloud, tmp_path / "m.ply", kk=4)
    assert "Usage" not in str(told.value)
    with pytest.raises(asra_stream.CannotFitError, match="--max-memory"):
        reconstruct(client, cloud, tmp_path / "m.ply", k=4, memory="1M")
    assert not (tmp_path / "m.ply").exists()
    # What was done for another budget is still done.
    reconstruct(client, cloud, tmp_path / "m.ply", k=4, memory="300M")
    with pytest.raises(asra_stream.UsageError, match="exists already"):
        reconstruct(client, cloud, tmp_path / "m.ply", k=4)


def test_what_is_raised_by_progress_ends_the_run(client, cloud, tmp_path):
    def stop(update):
        if update["event"]["event"] == "start":
            raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        reconstruct(client, cloud, tmp_path / "m.ply", k=4, progress=stop)
    end = time.monotonic() + 60
    while at_work(f"{tmp_path / 'm.ply'}.work") and time.monotonic() < end:
        time.sleep(0.1)
    assert not at_work(f"{tmp_path / 'm.ply'}.work") and not (tmp_path / "m.ply").exists()


@pytest.mark.parametrize("code, kind", [(69, asra_stream.NotReadyError), (76, asra_stream.IntermediateError), (75, asra_stream.TemporaryError)])
def test_tries_come_to_an_end(client, cloud, tmp_path, code, kind):
    # A program that plans, and whose tasks never get further.
    program = tmp_path / "program"
    program.write_text(f'#!/bin/sh\nif [ "$1" = work ]; then echo "$3" >> {tmp_path}/tries; exit {code}; fi\nexec {sys.executable} -m asra_stream "$@"\n')
    program.chmod(0o755)
    with pytest.raises(kind, match="given up at try"):
        reconstruct(client, cloud, tmp_path / "m.ply", k=4, retries=2, program=program, processes=1)
    tries = (tmp_path / "tries").read_text().split()
    assert max(tries.count(task) for task in tries) == (4 if code == 76 else 3)
