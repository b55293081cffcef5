"""Runs from start to end: mistakes, progress, Ctrl-C, threads, memory."""

import ctypes
import gc
import os
import platform
import re
import resource
import signal
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
import weakref

import numpy as np
import pytest

import asra_stream

GLIBC = platform.libc_ver()[0] == "glibc"


def test_what_is_no_cloud_is_told(sphere):
    points = sphere(1_000)
    for wrong, kind in [
        (points[:, :2], ValueError),
        (points.ravel(), ValueError),
        (points.astype(complex), TypeError),
        (np.array([["a", "b", "c"]]), TypeError),
        (np.zeros(5, dtype=[("a", "f4"), ("y", "f4"), ("z", "f4")]), ValueError),
        (7, TypeError),
        (None, TypeError),
        (iter([7]), TypeError),
        (iter([]), asra_stream.DataError),
        (np.zeros((0, 3)), asra_stream.DataError),
        (np.full((9, 3), np.nan), asra_stream.DataError),
        ("no/such/file.ply", asra_stream.NoInputError),
    ]:
        with pytest.raises(kind):
            asra_stream.reconstruct(wrong)
    with pytest.raises(ValueError, match="99 values for 1000 points"):
        asra_stream.reconstruct(points, attributes={"a": np.zeros(99)})
    with pytest.raises(ValueError, match="shape"):
        asra_stream.reconstruct(points, attributes={"a": np.zeros((1_000, 2))})
    with pytest.raises(ValueError, match="have their own"):
        asra_stream.reconstruct("a.ply", attributes={"a": np.zeros(1_000)})
    with pytest.raises(asra_stream.DataError, match="precision"):
        asra_stream.reconstruct(iter([points.astype(np.float32), points]))


def test_some_points_that_are_no_numbers_are_left_out(sphere):
    points = np.concatenate([sphere(5_000), np.full((3, 3), np.inf)])
    mesh = asra_stream.reconstruct(points)
    assert mesh.report["points"]["dropped"] == 3 and mesh.is_closed


def test_options_are_the_command_s(sphere):
    points = sphere(5_000)
    for wrong in [{"cell_size": "x"}, {"no_such_option": 1}, {"window": 4}, {"threads": 0}, {"fit": "round"}]:
        with pytest.raises(asra_stream.UsageError) as told:
            asra_stream.reconstruct(points, **wrong)
        assert told.value.exit_code == 2 and isinstance(told.value, ValueError)
    with pytest.raises(asra_stream.CannotFitError) as told:
        asra_stream.reconstruct(points, max_memory=1000)
    assert told.value.needed > 1000 and isinstance(told.value, MemoryError)
    coarse = asra_stream.reconstruct(points, cell_size=0.2, fit="none", keep_outliers=True, min_component=None)
    assert len(coarse) < len(asra_stream.reconstruct(points))
    terrain = asra_stream.reconstruct(points, surface="terrain", max_hole="8c")
    assert not terrain.is_closed


def test_files(sphere, tmp_path):
    mesh = asra_stream.reconstruct(sphere(5_000))
    path = tmp_path / "a.ply"
    mesh.save(path)
    with pytest.raises(asra_stream.UsageError, match="exists"):
        mesh.save(path)
    mesh.save(path, overwrite=True)
    with pytest.raises(asra_stream.UsageError):
        mesh.save(tmp_path / "a.xyz")
    assert asra_stream.check(path)["genus"] == mesh.check()["genus"] == 0
    assert asra_stream.info(path, layout=None)["points"] == len(mesh.vertices)
    assert asra_stream.plan(path)["points"] == len(mesh.vertices)
    distances = mesh.compare(mesh)
    assert distances["mesh_to_reference"] and asra_stream.compare(path, path).keys() == distances.keys()
    assert asra_stream.render(path, tmp_path / "a.png", size="200x100")["triangles"] > 0
    assert mesh.render(size="64x64").startswith(b"\x89PNG")
    assert mesh._repr_png_().startswith(b"\x89PNG")
    report = asra_stream.run(path, tmp_path / "b.glb", overwrite=True)
    assert report["output"]["path"].endswith("b.glb") and report["output"]["triangles"] > 0


def test_a_mesh_outlives_its_cloud(sphere):
    points = sphere(20_000)
    watched = weakref.ref(points)
    mesh = asra_stream.reconstruct(points)
    del points
    gc.collect()
    assert watched() is None
    vertices = mesh.vertices
    del mesh
    gc.collect()
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.05


def test_progress_is_told_and_its_exceptions_are_raised(sphere):
    told = []
    asra_stream.reconstruct(sphere(10_000), progress=told.append)
    assert [update["stage"] for update in told if update["ended"]] == ["survey", "bucket", "raster", "seal", "reopen", "surface", "check"]
    fractions = [update["fraction"] for update in told]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0

    def stop(update):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        asra_stream.reconstruct(sphere(10_000), progress=stop)


def test_progress_true_is_a_bar_or_lines(sphere, monkeypatch, capsys):
    pytest.importorskip("tqdm")
    points = sphere(20_000)
    asra_stream.reconstruct(points, progress=True)
    shown = capsys.readouterr()
    assert "100%" in shown.err and shown.out == ""
    # As where it is not installed.
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    asra_stream.reconstruct(points, progress=True)
    shown = capsys.readouterr()
    lines = shown.err.splitlines()
    assert [line.split("%  ")[1].split(":")[0] for line in lines] == ["survey", "bucket", "raster", "seal", "reopen", "surface", "check"]
    assert lines[0].endswith("survey: 20,000 points") and lines[-1].startswith(" 100 %") and shown.out == ""
    asra_stream.reconstruct(points, progress=False)
    assert capsys.readouterr() == ("", "")


def test_progress_is_told_of_files_and_pieces_too(sphere, tmp_path):
    np.save(tmp_path / "points.npy", sphere(5_000))
    for work in [
        lambda told: asra_stream.reconstruct(tmp_path / "points.npy", progress=told),
        lambda told: asra_stream.reconstruct(iter([sphere(5_000)]), progress=told),
        lambda told: asra_stream.run(tmp_path / "points.npy", tmp_path / "mesh.ply", progress=told),
        lambda told: asra_stream.check(tmp_path / "mesh.ply", progress=told),
    ]:
        updates = []
        work(updates.append)
        assert updates[-1]["fraction"] == 1.0
        for update in updates:
            assert set(update) == {"stage", "unit", "done", "total", "fraction", "seconds_left", "ended"}


def test_a_file_that_is_cut_meanwhile_is_an_exception(sphere, tmp_path):
    path = tmp_path / "points.npy"
    np.save(path, sphere(1_000_000))

    def cut(update):
        os.truncate(path, 5_000_000)

    with pytest.raises(asra_stream.AsraError) as told:
        asra_stream.reconstruct(path, progress=cut)
    assert isinstance(told.value, asra_stream.TemporaryError) and "points.npy" in str(told.value)


def test_pieces_must_be_alike(sphere):
    points = sphere(1_000)
    records = np.zeros(1_000, dtype=[("x", "f8"), ("y", "f8"), ("z", "f8"), ("number", "i8")])
    with pytest.raises(asra_stream.DataError, match="other attributes"):
        asra_stream.reconstruct(iter([points, records]))
    with pytest.raises(TypeError, match="piece 1: expected an array or a cloud, found str"):
        asra_stream.reconstruct(iter([points, "a.ply"]))
    with pytest.raises(ValueError, match=r"expected an array of shape \(n, 3\), found \(1000, 2\)"):
        asra_stream.reconstruct(iter([points, points[:, :2]]))

    def broken():
        yield points
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        asra_stream.reconstruct(broken())


def test_every_kind_of_failure_has_its_class(sphere, tmp_path):
    points = sphere(5_000)
    mesh = asra_stream.reconstruct(points)
    with pytest.raises(asra_stream.NoOutputError) as told:
        mesh.save(tmp_path / "no" / "such" / "mesh.ply")
    assert told.value.exit_code == 73 and isinstance(told.value, PermissionError)
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nend_header\n1\n")
    with pytest.raises(asra_stream.DataError) as told:
        asra_stream.reconstruct(tmp_path / "bad.ply")
    assert told.value.exit_code == 65 and str(told.value.path).endswith("bad.ply")
    with pytest.raises(asra_stream.UsageError, match="local"):
        mesh.save(tmp_path / "mesh.ply", coordinates="global")
    for cls in ("UsageError", "DataError", "NoInputError", "InternalError", "CannotFitError", "NoOutputError", "IoError", "TemporaryError"):
        assert issubclass(getattr(asra_stream, cls), asra_stream.AsraError)


def run_python(program, **options):
    return subprocess.Popen([sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, text=True, **options)


def test_ctrl_c_ends_a_run_within_half_a_second():
    process = run_python("""
        import numpy, time, asra_stream
        points = numpy.random.default_rng(0).random((6_000_000, 3), dtype=numpy.float32)
        points[:, 2] *= 0.001
        print("begun", flush=True)
        try:
            asra_stream.reconstruct(points)
        except KeyboardInterrupt:
            print(time.monotonic(), flush=True)
    """)
    assert process.stdout.readline() == "begun\n"
    time.sleep(1.0)
    sent = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0 and float(out) - sent < 0.5, (out, sent)


def test_another_thread_counts_on(sphere):
    counted, over = [0], threading.Event()

    def count():
        while not over.is_set():
            counted[0] += 1
            time.sleep(0.001)

    counting = threading.Thread(target=count)
    counting.start()
    start = time.monotonic()
    asra_stream.reconstruct(sphere(1_000_000, dtype=np.float32))
    seconds, found = time.monotonic() - start, counted[0]
    over.set()
    counting.join()
    # It sleeps a thousandth of a second each time; a lock that is held would leave it at next to nothing.
    assert found > 100 * seconds, (found, seconds)


def test_two_runs_at_once_share_nothing(sphere):
    clouds = [sphere(8_000), sphere(6_000, centre=(5, 5, 5))]
    alone = [asra_stream.reconstruct(cloud) for cloud in clouds]
    made = [None, None]

    def make(i):
        made[i] = asra_stream.reconstruct(clouds[i])

    threads = [threading.Thread(target=make, args=(i,)) for i in range(2)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    for a, b in zip(alone, made):
        assert np.array_equal(a.vertices, b.vertices) and np.array_equal(a.triangles, b.triangles)


def test_runs_leave_nothing_behind(sphere):
    points = sphere(2_000)

    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * resource.getpagesize()

    def taken():
        """Bytes that programs have of the C library, in all its arenas: what it keeps for the next is not among them."""
        with tempfile.NamedTemporaryFile() as file:
            libc = ctypes.CDLL(None)
            libc.fopen.restype = ctypes.c_void_p
            stream = ctypes.c_void_p(libc.fopen(file.name.encode(), b"w"))
            libc.malloc_info(0, stream)
            libc.fclose(stream)
            told = file.read().decode().rsplit("</heap>", 1)[1]
        free = sum(int(size) for size in re.findall(r'<total type="(?:fast|rest)" count="\d+" size="(\d+)"', told))
        return int(re.search(r'<system type="current" size="(\d+)"', told)[1]) - free

    def runs(count):
        for i in range(count):
            mesh = asra_stream.reconstruct(points, threads=2)
            assert len(mesh.vertices) > 0
            if i % 10 == 0:
                with pytest.raises(ValueError):
                    asra_stream.reconstruct(points, cell_size=-1)
        gc.collect()

    runs(int(os.environ.get("ASRA_STREAM_WARM_UP", "30")))
    before, had, files = resident(), taken() if GLIBC else 0, len(os.listdir("/proc/self/fd"))
    runs(int(os.environ.get("ASRA_STREAM_RUNS", "100")))
    assert len(os.listdir("/proc/self/fd")) == files
    assert resident() - before < 24 << 20, (before, resident())
    if GLIBC:
        # A hundred vertices that stay of each of a hundred runs would be more.
        assert taken() - had < 256 << 10, (had, taken())
