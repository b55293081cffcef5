"""What people pass by mistake: each is told in words that name it, and nothing is taken for what it is not."""

import copy
import pickle
import threading

import numpy as np
import pytest

import asra_stream
from asra_stream import reconstruct


def records(points, names="xyz", dtype="f8"):
    out = np.zeros(len(points), dtype=[(name, dtype) for name in names])
    for name, column in zip(names, points.T):
        out[name] = column
    return out


@pytest.fixture
def points(sphere):
    return sphere(3_000)


def test_things_that_are_no_clouds_are_named(points):
    both = np.zeros(9, dtype=[("x", "f8"), ("X", "f8"), ("y", "f8"), ("z", "f8")])
    for wrong, kind, words in [
        (np.array(3.0), ValueError, r"found \(\)"),
        (np.zeros((3, 3, 3)), ValueError, r"found \(3, 3, 3\)"),
        (points.astype(object), TypeError, "found object"),
        (np.zeros((9, 3), "M8[s]"), TypeError, "found datetime64"),
        (bytearray(b"abc"), TypeError, "found bytearray"),
        ({"x": points[:, 0]}, TypeError, "found dict"),
        ([[1, 2, 3], [1, 2]], ValueError, "points: expected rows of three numbers"),
        ([["a", "b", "c"]], ValueError, "points: expected rows of three numbers"),
        (["a.ply", points], ValueError, "points: expected rows of three numbers"),
        (both, ValueError, "x in small and in capital letters"),
        (np.zeros(9, dtype=[("x", "U3"), ("y", "f8"), ("z", "f8")]), TypeError, "points: x: expected numbers, found <U3"),
        (np.zeros(9, dtype=[("x", "f8", (2,)), ("y", "f8"), ("z", "f8")]), TypeError, "one dimension"),
        (iter(points), ValueError, r"points: piece 0: expected an array of shape \(n, 3\), found \(3,\)"),
        (iter([points, points, points[:, :2]]), ValueError, "points: piece 2: expected"),
        (iter([points, {}]), TypeError, "points: piece 1: .* found dict"),
        (points * 1e-310, ValueError, "cells of side [0-9.]+e-31"),
        ("\udcff.ply", asra_stream.NoInputError, "cannot open"),
        (b"none.ply", asra_stream.NoInputError, "none.ply"),
    ]:
        with pytest.raises(kind, match=words):
            reconstruct(wrong)


def test_what_can_be_a_cloud_is_one(points):
    vertices = reconstruct(points).vertices
    trimesh = pytest.importorskip("trimesh")
    for cloud in [
        list(points),
        memoryview(points),
        np.asmatrix(points),
        np.ma.masked_array(points),
        [trimesh.PointCloud(points[:1_000]), trimesh.PointCloud(points[1_000:])],
        type("Cloud", (), {"__array__": lambda self, dtype=None, copy=None: points})(),
    ]:
        assert np.array_equal(reconstruct(cloud).vertices, vertices), type(cloud)


def test_tables_have_their_columns_by_name(points):
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"name": ["a"] * 3_000, "Z": points[:, 2], "intensity": np.arange(3_000, dtype="u2"), "X": points[:, 0], "Y": points[:, 1]})
    mesh = reconstruct(table)
    assert np.array_equal(mesh.vertices, reconstruct(points).vertices) and list(mesh.attributes) == ["intensity"]
    with pytest.raises(ValueError, match="have no y; their fields are name, Z, intensity, X$"):
        reconstruct(table.drop(columns="Y"))


def test_masked_values_are_not_taken_for_numbers(points):
    masked = np.ma.masked_array(np.round(points * 1000), mask=np.zeros(points.shape, bool))
    masked[:600, 1] = np.ma.masked
    for cloud in [masked, masked.astype(np.int32)]:
        found = reconstruct(cloud).report["points"]
        assert found["count"] == 2_400 and found["dropped"] == 600
    heights = np.ma.masked_less(points[:, 2], 0.0)
    values = reconstruct(points, attributes={"height": heights}).attributes["height"]
    assert np.isnan(values).any() and np.nanmin(values) >= 0.0
    with pytest.raises(ValueError, match="attribute 'class': values of int64 are masked"):
        reconstruct(points, attributes={"class": np.ma.masked_equal(np.arange(3_000), 7)})


def test_attributes_need_names_of_their_own(points):
    zeros = np.zeros(3_000)
    for wrong, kind, words in [
        ({"x": zeros}, ValueError, "is the name of a coordinate"),
        ({" Z ": zeros}, ValueError, "is the name of a coordinate"),
        ({"": zeros}, ValueError, "is no name"),
        ({"a": zeros, "A": zeros}, ValueError, "is there twice"),
        ({"rgb": np.zeros((3_000, 3)), "red": zeros}, ValueError, "is there twice"),
        ({1: zeros}, TypeError, "attribute 1: expected a name of type str, found int"),
        ([("a", zeros)], TypeError, "attributes: expected a dict"),
        ({"a": 3}, ValueError, r"found the shape \(\)"),
        ({"a": zeros[:-1]}, ValueError, "2999 values for 3000 points"),
        ({"a": zeros.astype(complex)}, TypeError, "found complex"),
        ({"a": ["x"] * 3_000}, TypeError, "found <U1"),
    ]:
        with pytest.raises(kind, match=words):
            reconstruct(points, attributes=wrong)
    with pytest.raises(ValueError, match="pieces have their own"):
        reconstruct(iter([points]), attributes={"a": zeros})
    long = "n" * 100_000
    assert list(reconstruct(points, attributes={long: zeros}).attributes) == [long]
    assert list(reconstruct(points, attributes={"Höhe über\nNN": zeros}).attributes) == ["höhe_über_nn"]
    # What is no number is no colour.
    assert not reconstruct(points, attributes={"rgb": np.full((3_000, 3), np.nan)}).colors.any()


@pytest.mark.filterwarnings("error")
def test_numbers_of_numpy_are_options_too(points):
    plain = reconstruct(points, cell_size=0.125, max_memory=64 << 20, threads=2, keep_outliers=True)
    for number in (np.float32, np.float64):
        mesh = reconstruct(points, cell_size=number(0.125), max_memory=np.int64(64 << 20), threads=np.uint8(2), keep_outliers=np.True_)
        assert np.array_equal(mesh.vertices, plain.vertices)
    box = np.array([-1, -1, 0, 1, 1, 1])
    assert reconstruct(points, bounds=box).vertices[:, 2].min() > -0.2


def test_wrong_options_are_told_without_the_command_s_advice(points):
    for wrong, words in [
        ({"cell_size": 0}, "invalid value '0' for '--cell-size <W|auto>': expected a length above 0"),
        ({"max_memory": float("nan")}, "expected a size such as 512M or 2G"),
        ({"max_memory": float("inf")}, "expected a size such as 512M or 2G"),
        ({"max_memory": True}, "a value is required for '--max-memory"),
        ({"zzz": 1}, "unexpected argument '--zzz' found$"),
        ({"help": True}, "the command's own"),
        ({"output": "a.ply"}, "output: is for run"),
        ({"report": "a.json"}, "report: is for run"),
    ]:
        with pytest.raises(asra_stream.UsageError, match=words) as told:
            reconstruct(points, **wrong)
        assert told.value.exit_code == 2 and "--help" not in str(told.value) and not str(told.value).startswith("error")
    with pytest.raises(TypeError, match="progress: expected a callable"):
        reconstruct(points, progress="yes")


def test_names_that_look_like_options_or_commands_are_names(points, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mesh = reconstruct(points)
    for name in ["-x.ply", "--help.ply", "höhe ☃.ply"]:
        mesh.save(name)
        assert asra_stream.info(name)["points"] == len(mesh.vertices) and asra_stream.check(name)["closed"]
    (tmp_path / "info").write_bytes((tmp_path / "-x.ply").read_bytes())
    assert asra_stream.run("info", "a.ply")["inputs"][0]["path"] == "info"
    mesh.save(b"bytes.ply")
    assert asra_stream.run(b"bytes.ply", tmp_path / "b.glb")["output"]["triangles"] > 0
    for nothing in (None, 3, points):
        with pytest.raises(TypeError):
            asra_stream.info(nothing)


def test_a_report_that_is_asked_for_is_written(points, tmp_path):
    import json

    np.save(tmp_path / "points.npy", points)
    report = asra_stream.run(tmp_path / "points.npy", tmp_path / "a.ply", report=tmp_path / "run.json")
    assert json.loads((tmp_path / "run.json").read_text())["points"] == report["points"]
    found = asra_stream.check(tmp_path / "a.ply", report=tmp_path / "check.json")
    assert json.loads((tmp_path / "check.json").read_text()) == found
    with pytest.raises(asra_stream.CannotFitError):
        asra_stream.run(tmp_path / "points.npy", tmp_path / "b.ply", max_memory=1000, report=tmp_path / "failed.json")
    assert json.loads((tmp_path / "failed.json").read_text())["error"]["kind"] == "cannot-fit"


def test_a_mesh_stands_for_a_file_on_either_side(points, tmp_path):
    mesh = reconstruct(points)
    mesh.save(tmp_path / "a.ply")
    both = [(tmp_path / "a.ply", mesh), (mesh, tmp_path / "a.ply"), (mesh, mesh)]
    found = [asra_stream.compare(*pair)["mesh_to_reference"] for pair in both]
    assert found[0] == found[1] == found[2]
    told = []
    assert asra_stream.check(mesh, no_intersections=True, progress=told.append)["intersections"] is None and told
    with pytest.raises(asra_stream.UsageError):
        asra_stream.check(mesh, no_such=3)
    for wrong in (points, None):
        with pytest.raises(TypeError):
            asra_stream.compare(mesh, wrong)


def test_a_mesh_is_copied_but_not_pickled(points):
    mesh = reconstruct(points)
    for other in (copy.copy(mesh), copy.deepcopy([mesh])[0]):
        mesh.vertices[0] = 7.0
        assert other.vertices[0].max() < 1.5 and np.array_equal(other.triangles, mesh.triangles)
    with pytest.raises(TypeError, match="save"):
        pickle.dumps(mesh)
    for wrong in ("UsageError", "CannotFitError"):
        error = pickle.loads(pickle.dumps(getattr(asra_stream, wrong)("words", needed=3, code=2)))
        assert str(error) == "words" and error.needed == 3 and type(error).__name__ == wrong


def test_options_of_what_was_not_checked(points):
    mesh = reconstruct(points, no_check=True)
    assert mesh.report["check"] is None
    with pytest.raises(asra_stream.UsageError, match="not checked"):
        mesh.is_closed


def test_an_array_that_gets_another_shape_meanwhile_is_read_as_it_was(sphere):
    points = sphere(8_000)
    expected = reconstruct(points).vertices

    def reshape(update):
        points.shape = (-1,)

    assert np.array_equal(reconstruct(points, progress=reshape).vertices, expected) and points.shape == (24_000,)


def test_whatever_ends_a_generator_ends_the_run(points):
    for wrong in (KeyError, KeyboardInterrupt, SystemExit):

        def pieces():
            yield points
            raise wrong("now")

        with pytest.raises(wrong, match="now"):
            reconstruct(pieces())
    with pytest.raises(SystemExit):
        reconstruct(points, progress=lambda update: exit(3))
    # A run within a run's generator, and within its progress.
    inner = (reconstruct(points).vertices for _ in range(2))
    assert len(reconstruct(inner)) > 0
    assert len(reconstruct(points, progress=lambda update: reconstruct(points[:500]))) > 0


def test_threads_share_a_mesh_and_an_array(points, tmp_path):
    made, wrong = [], []

    def work(number):
        try:
            mesh = reconstruct(points, progress=lambda update: None)
            mesh.save(tmp_path / f"{number}.ply")
            made.append(mesh)
            made[0].vertices, made[0].report, made[0].render(size="32x32")
        except BaseException as error:
            wrong.append(error)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert not wrong and len({(tmp_path / f"{number}.ply").read_bytes() for number in range(4)}) == 1
