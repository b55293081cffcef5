"""A reconstruction by the workers of a Dask cluster, which share a folder.

    >>> from dask.distributed import Client, LocalCluster            # doctest: +SKIP
    >>> from asra_stream.dask import reconstruct                     # doctest: +SKIP
    >>> client = Client(LocalCluster(threads_per_worker=1))          # doctest: +SKIP
    >>> report = reconstruct(client, "tiles/*.laz", "city.ply", cell_size="auto")    # doctest: +SKIP

Dask says who does what and when. The tasks are processes of the command ``asra-stream work``; points pass between them through the work folder, and never through Dask, which
knows of each task its name and its exit code. docs/clusters.md in the source tells about clusters.
"""

import collections
import collections.abc
import contextlib
import dataclasses
import errno
import json
import os
import queue
import shutil
import subprocess
import sys
import threading
import time
import uuid
from typing import Any, cast

from dask.system import CPU_COUNT
from distributed import Client, KilledWorker, get_worker

from . import _errors
from ._options import Path, Paths, Program, as_paths, size, words

__all__ = ["reconstruct"]

# Exit codes after which a task is done again: not ready, input or output failed, a full disk, and ends by HUP, KILL and TERM. INT is somebody's wish.
_AGAIN = {69, 74, 75, 129, 137, 143, -1, -9, -15}
# What was damaged is made again by another task; more often than this it is no accident.
_DAMAGED, _DAMAGED_TRIES = 76, 3
# What a computer says that has no room for one more process.
_NO_ROOM = {errno.EAGAIN, errno.ENOMEM}
# Seconds: from a failure to the next try, at first and at most; between two looks at a task that Dask does not want any more; between two lines of progress of one task.
_PATIENCE, _LOOK, _PACE = (0.5, 30.0), 0.5, 1.0
# The share of a worker's memory that its processes may have: the rest is Python's.
_SHARE = 0.75
# Lines that are kept of what a process says.
_LAST = 20


@dataclasses.dataclass
class _Ended:
    """How a task ended: all that passes through Dask."""

    code: int
    kind: str
    message: str
    where: str


def _perform(folder: str, task: str, program: list[str] | None, more: list[str], memory: str | None, threads: int | None, topic: str | None) -> _Ended:
    """On a worker, in a thread: the program does a task."""
    worker = get_worker()
    key = worker.get_current_task()
    share = worker.state.nthreads
    limit = worker.memory_manager.memory_limit
    if memory is None and limit:
        memory = str(int(_SHARE * limit / share))
    if threads is None and share > 1:
        threads = max(1, CPU_COUNT // share)
    line = [*(program or [sys.executable, "-m", __package__]), "work", folder, task, "--die-with-parent", "--progress=json", *more]
    line += [f"--max-memory={memory}"] if memory is not None else []
    line += [f"--threads={threads}"] if threads is not None else []
    try:
        process = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace")
    except OSError as error:
        if error.errno in _NO_ROOM:
            return _Ended(75, "temporary", str(error), worker.address)
        raise

    def unwanted() -> None:
        # Dask cannot end a thread, but it says when nobody wants the task any more.
        while process.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_LOOK)
            known = worker.state.tasks.get(key)
            if known is not None and known.state == "cancelled":
                process.terminate()

    threading.Thread(target=unwanted, daemon=True).start()

    def tell(event: dict[str, Any]) -> None:
        if topic is not None:
            worker.log_event(topic, {"task": task, "worker": worker.address, **event})

    tell({"event": "start"})
    end = _listen(cast(collections.abc.Iterable[str], process.stderr), tell)
    code = process.wait()
    kind = end.kind if end.kind != "done" or code == 0 else _kind_of(code)
    message = end.message or (f"{task}: ended by signal {-code}" if code < 0 else f"{task}: exit code {code}")
    return _Ended(code, kind, message, worker.address)


def _listen(lines: collections.abc.Iterable[str], tell: collections.abc.Callable[[dict[str, Any]], None]) -> _Ended:
    """What a process says of its end, by its last object or else its last lines. What it says before is told."""
    last: collections.deque[str] = collections.deque(maxlen=_LAST)
    end: dict[str, Any] = {}
    told = 0.0
    for line in lines:
        try:
            event = json.loads(line)
            kind = event["event"]
        except (ValueError, TypeError, KeyError):
            last.append(line.rstrip())
            continue
        if kind == "end":
            end = event
        elif kind != "progress":
            tell(event)
        elif time.monotonic() - told >= _PACE:
            told = time.monotonic()
            tell(event)
    # What is said of options that are not understood goes on to show how the command is used.
    message = end.get("message") or "\n".join(last).removeprefix("asra-stream: ").split("\n\n")[0]
    return _Ended(end.get("exit_code", 0), end.get("kind", "done"), message, "")


def _kind_of(code: int) -> str:
    """The kind of failure that an exit code tells, if the process could not say more."""
    kinds = {
        2: "usage",
        65: "data",
        66: "no-input",
        69: "not-ready",
        70: "internal",
        71: "cannot-fit",
        73: "no-output",
        74: "io",
        75: "temporary",
        76: "intermediate",
    }
    return "signal" if code < 0 or code > 128 else kinds.get(code, "internal")


def _failure(ended: _Ended, note: str = "") -> _errors.AsraError:
    return _errors.of(json.dumps({"kind": ended.kind, "message": ended.message + note, "code": ended.code}))


class _Job:
    """A work folder, seen from the client."""

    def __init__(self, folder: str, program: list[str] | None, tell: collections.abc.Callable[[dict[str, Any]], None]) -> None:
        self.folder = folder
        self._program = program or [sys.executable, "-m", __package__]
        self._tell = tell

    def _command(self, line: list[str]) -> tuple[_Ended, str]:
        with subprocess.Popen(
            [*self._program, *line], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
        ) as process:
            try:
                out: list[str] = []
                # Both pipes are read, so that neither fills.
                reader = threading.Thread(target=lambda: out.append(process.stdout.read() if process.stdout else ""))
                reader.start()
                ended = _listen(cast(collections.abc.Iterable[str], process.stderr), self._tell)
                reader.join()
            except BaseException:
                process.terminate()
                raise
        code = process.returncode
        kind = ended.kind if ended.kind != "done" or code == 0 else _kind_of(code)
        return _Ended(code, kind, ended.message or f"{line[0]}: exit code {code}", ""), "".join(out)

    def tasks(self, *which: str) -> dict[str, Any] | None:
        """What is to be done, and whether the mesh is finished; None if that cannot be told now."""
        ended, told = self._command(["tasks", self.folder, *which, "--json"])
        if ended.code == 0:
            return cast(dict[str, Any], json.loads(told))
        if ended.code in _AGAIN or ended.code == _DAMAGED:
            return None
        raise _failure(ended)

    def _planned(self) -> dict[str, Any]:
        """What the folder says it was planned for: ``words`` of the command, the ``folder`` of its paths, and ``processes``; empty if it is not."""
        try:
            with open(os.path.join(self.folder, "job.json"), encoding="utf-8") as file:
                tasks = json.load(file)["value"]["job"]["tasks"]
            return {"words": tasks["command"]["words"], "folder": tasks["command"]["folder"], "processes": tasks["processes"]}
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def plan(self, inputs: list[str], options: dict[str, Any], processes: int | None, usual: int, retries: int) -> None:
        """Surveys the input and writes down the tasks, unless that is done."""
        planned = self._planned()
        # A driver that goes on may have other workers now; the tasks are cut already.
        count = processes or planned.get("processes") or usual
        line = ["plan", *words({**options, "work": self.folder, "processes": count, "progress": "json"}), "--", *inputs]
        if planned.get("words") == line and planned["folder"] == os.getcwd() and self.tasks("--ready") is not None:
            return
        for tries in range(retries + 1):
            ended, _ = self._command(line)
            if ended.code == 0:
                return
            if ended.code not in _AGAIN or tries == retries:
                raise _failure(ended)
            time.sleep(_patience(tries))


def _patience(tries: int) -> float:
    """Seconds until the next try, after so many that were in vain."""
    return cast(float, min(_PATIENCE[0] * 2.0**tries, _PATIENCE[1]))


class _Run:
    """One call: the waves of tasks."""

    perform = staticmethod(_perform)

    def __init__(self, client: Client, job: _Job, retries: int, submit: dict[str, Any], tell: collections.abc.Callable[[dict[str, Any]], None]) -> None:
        self._client, self._job, self._retries, self._submit, self._tell = client, job, retries, submit, tell
        self.name = f"asra-stream-{uuid.uuid4().hex[:12]}"
        # What futures and workers say, in the order in which it comes: it is heard in the caller's thread.
        self.heard: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._under_way: dict[str, Any] = {}
        self._starts = 0
        self._tries: collections.Counter[str] = collections.Counter()
        self._damaged: collections.Counter[str] = collections.Counter()
        self._not_before: dict[str, float] = {}

    def _start(self, task: str) -> None:
        self._starts += 1
        key = f"{self.name}-{task}-{self._starts}"
        future = self._client.submit(self.perform, self._job.folder, task, key=key, pure=False, retries=0, **self._submit)
        self._under_way[task] = future
        future.add_done_callback(lambda _: self.heard.put(("future", task)))

    def _ended(self, task: str) -> None:
        """Takes note of how a task ended."""
        future = self._under_way.pop(task)
        if future.status == "finished":
            ended = cast(_Ended, future.result())
        elif future.status == "error" and not isinstance(future.exception(), KilledWorker):
            error = future.exception()
            future.release()
            raise error
        else:
            # Workers were lost, or the scheduler forgot the task with them.
            ended = _Ended(-9, "signal", f"{task}: the workers that had it were lost", "")
        future.release()
        if ended.code == 0:
            # It shows in the folder at once, or on a shared one after a while.
            self._not_before[task] = time.monotonic() + _PATIENCE[0]
            self._tell({"event": "done", "task": task, "worker": ended.where})
            return
        if ended.code == _DAMAGED:
            self._damaged[task] += 1
            tries, most = self._damaged[task], _DAMAGED_TRIES
        elif ended.code in _AGAIN:
            self._tries[task] += 1
            tries, most = self._tries[task], self._retries
        else:
            raise _failure(ended)
        if tries > most:
            raise _failure(ended, f" ({task}: given up at try {tries})")
        self._not_before[task] = time.monotonic() + _patience(tries - 1)
        self._tell({"event": "again", "task": task, "worker": ended.where, "exit_code": ended.code, "message": ended.message})

    def _hear(self, seconds: float) -> None:
        """Waits for news, and takes all that there are."""
        try:
            news = [self.heard.get(timeout=max(0.0, seconds))]
        except queue.Empty:
            return
        with contextlib.suppress(queue.Empty):
            while True:
                news.append(self.heard.get_nowait())
        for what, of in news:
            self._ended(of) if what == "future" else self._tell(of)

    def drive(self) -> None:
        """Has tasks done until the mesh is finished."""
        try:
            blind = 0
            while True:
                before = time.monotonic()
                listed = self._job.tasks("--ready")
                took = time.monotonic() - before
                if listed is None:
                    blind += 1
                    if blind > self._retries and not self._under_way:
                        raise _errors.TemporaryError(f"{self._job.folder}: the tasks cannot be listed", code=75)
                    self._hear(_PATIENCE[0] * blind)
                    continue
                blind = 0
                if listed["finished"]:
                    return
                waits = [_PATIENCE[1]]
                for task in (entry["task"] for entry in listed["tasks"]):
                    left = self._not_before.get(task, 0.0) - time.monotonic()
                    if task in self._under_way:
                        continue
                    if left > 0:
                        waits.append(left)
                    else:
                        self._start(task)
                if not self._under_way and len(waits) == 1:
                    # Others are at work, or the folder shows late what was done.
                    waits.append(_PATIENCE[0])
                count, until = len(self._under_way), time.monotonic() + min(waits)
                while len(self._under_way) == count and time.monotonic() < until:
                    self._hear(until - time.monotonic())
                # Long lists are not asked for without pause.
                pause = time.monotonic() + 5 * took
                while self._under_way and time.monotonic() < pause:
                    self._hear(pause - time.monotonic())
        finally:
            if self._under_way:
                self._client.cancel(list(self._under_way.values()))


def _updates(progress: Any, tasks: collections.abc.Callable[[], dict[str, Any] | None]) -> collections.abc.Callable[[dict[str, Any]], None]:
    """What is told of every event: the event, and how many tasks of those that are known are done."""
    known: dict[str, Any] = {"all": None, "done": set(), "fraction": 0.0}

    def tell(event: dict[str, Any]) -> None:
        if progress is None:
            return
        if event["event"] in ("start", "done") and event.get("task") not in (known["all"] or ()):
            listed = tasks()
            if listed is not None:
                known["all"] = {entry["task"] for entry in listed["tasks"]}
                known["done"] |= {entry["task"] for entry in listed["tasks"] if entry["state"] == "done"}
        if event["event"] == "done":
            known["done"].add(event["task"])
        total = len(known["all"]) if known["all"] else None
        if total:
            # Tasks that come to be known later do not lead back.
            known["fraction"] = max(known["fraction"], min(1.0, len(known["done"]) / total))
        progress(
            {
                "stage": event.get("task", event.get("stage", "plan")),
                "unit": "tasks",
                "done": len(known["done"]),
                "total": total,
                "fraction": known["fraction"],
                "seconds_left": None,
                "ended": event["event"] == "done",
                "event": event,
            }
        )

    return tell


def reconstruct(
    client: Client,
    inputs: Paths,
    output: Path,
    *,
    work: Path | None = None,
    processes: int | None = None,
    memory: int | float | str | None = None,
    threads: int | None = None,
    retries: int = 5,
    progress: collections.abc.Callable[[dict[str, Any]], object] | bool | None = None,
    program: Program | None = None,
    resources: collections.abc.Mapping[str, float] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """From files to a mesh file, by the workers of a Dask cluster: the bytes are those of one run. Gives the report, a dict.

    Parameters
    ----------
    client : distributed.Client
        A client of any cluster, which is not asynchronous.
    inputs, output
        As of :func:`asra_stream.run`. The client's machine and all workers must reach them, and the work folder, by the same absolute paths. Addresses in object stores,
        as ``s3://bucket/tiles/*.laz``, are handed to the program as they are, and nothing looks whether something is there: the ``program`` has to be one that is built
        for them, and its settings stand in the workers' environment.
    work : path, optional
        The work folder. By default it is the output's name with ``.work``, and is removed at the end; one that is named here stays, with all that it holds. For an output
        in an object store it must be named.
        The same call made again from the same folder, after a client was killed, goes on from what is done there.
    processes : int, optional
        For so many tasks at a time the work is cut. By default the threads of all workers: a thread of a worker waits for one process. Decides no bytes.
    memory : int or str, optional
        Of one process: bytes, or as in ``"2G"``. By default three quarters of the worker's memory limit, shared by its threads; without a limit a quarter of
        the machine's memory, so that more than one worker on a machine want it given.
    threads : int, optional
        Of one process. By default the processors that the worker may use, shared by its threads.
    retries : int
        So often a task is done again that ended for what may pass: its worker or process was killed, something was not there yet, a disk was full. 0 for never.
    progress : callable or bool, optional
        Called in this thread with a dict as of :func:`asra_stream.reconstruct`, which counts tasks; ``event`` in it is what happened: an object of docs/progress.md with
        ``task`` and ``worker``, or ``start``, ``done`` or ``again``. True shows a bar. What it raises ends the run, and is raised.
    program : path or list of words, optional
        What workers and client run in the place of ``python -m asra_stream``.
    resources : dict, optional
        Of Dask: what each task takes of what workers were said to have.
    **options
        The command's options, with ``_`` for ``-``.

    Raises
    ------
    AsraError
        With the program's words: the class of the failure's kind, as of :func:`asra_stream.run`. TemporaryError, or one of its classes, when tries were in vain.

    Every task may be done more than once, on several workers, at the same time: what comes later is dropped. A worker that is killed takes its process with it; tasks that
    nobody waits for any more are ended. If this function is ended, so are its tasks.
    """
    command = None if program is None else [os.path.abspath(program)] if isinstance(program, (str, os.PathLike)) else [os.fspath(word) for word in program]
    whole = [_whole(path) for path in as_paths(inputs)]
    to = _whole(os.fsdecode(output))
    if work is None and _is_remote(to):
        raise ValueError(f"{to}: name the folder for the work of an output in an object store: work=")
    folder = _whole(os.fsdecode(work)) if work is not None else f"{to}.work"
    report = options.pop("report", None)
    if report is not None:
        report = _whole(os.fsdecode(report))
    elif not _is_remote(folder):
        # Beside the manifests, whose folder is there as long as it may be asked for.
        report = os.path.join(folder, "report.json")
    given = {**options, "output": to, **({} if report is None else {"report": report})}
    with _shown(progress) as shown:
        tell = _updates(shown, lambda: job.tasks())
        job = _Job(folder, command, tell)
        usual = max(1, sum(client.nthreads().values()))
        job.plan(whole, given, processes, usual, retries)
        more = [f"--temp-dir={options['temp_dir']}"] if "temp_dir" in options else []
        submit: dict[str, Any] = {"program": command, "more": more, "memory": None if memory is None else size(memory), "threads": threads}
        if resources is not None:
            submit["resources"] = dict(resources)
        run = _Run(client, job, retries, submit, tell)
        submit["topic"] = None if shown is None else run.name
        if shown is not None:
            client.subscribe_topic(run.name, lambda event: run.heard.put(("event", event[1])))
        try:
            run.drive()
        finally:
            if shown is not None:
                client.unsubscribe_topic(run.name)
    if report is None or _is_remote(report):
        listed = job.tasks("--ready")
        if listed is None:
            raise _errors.TemporaryError(f"{folder}: the report cannot be read", code=75)
        told = cast(dict[str, Any], listed["report"])
    else:
        with open(report, encoding="utf-8") as file:
            told = cast(dict[str, Any], json.load(file))
    if work is None:
        # Nothing is at work here any more but what nobody waits for.
        shutil.rmtree(folder, ignore_errors=True)
    return told


def _whole(path: str) -> str:
    """The path from the root; the address of an object store as it is."""
    return path if _is_remote(path) else os.path.abspath(path)


def _is_remote(path: str) -> bool:
    return "://" in path


def _shown(progress: Any) -> Any:
    if not progress:
        return contextlib.nullcontext(None)
    # Of the part in Rust, only here.
    from ._command import shown

    return shown(progress)
