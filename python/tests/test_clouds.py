"""Whatever a cloud comes as, it is the same points, and gives the same mesh."""

import subprocess
import sys

import numpy as np
import pytest

import asra_stream


def same(a, b):
    return np.array_equal(a.vertices, b.vertices) and np.array_equal(a.triangles, b.triangles)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_an_array_gives_the_command_s_bytes(sphere, tmp_path, dtype):
    points = sphere(5_000, dtype=dtype)
    np.save(tmp_path / "points.npy", points)
    command = [sys.executable, "-m", "asra_stream", "points.npy", "-o", "command.ply", "-q"]
    subprocess.run(command, cwd=tmp_path, check=True)
    mesh = asra_stream.reconstruct(points, threads=3, max_memory="64M")
    assert mesh.vertices.dtype == dtype and mesh.triangles.dtype == np.uint32
    mesh.save(tmp_path / "module.ply")
    assert (tmp_path / "module.ply").read_bytes() == (tmp_path / "command.ply").read_bytes()
    asra_stream.run(tmp_path / "points.npy", tmp_path / "run.ply")
    assert (tmp_path / "run.ply").read_bytes() == (tmp_path / "command.ply").read_bytes()
    assert same(mesh, asra_stream.reconstruct(tmp_path / "points.npy"))
    assert same(mesh, asra_stream.reconstruct([str(tmp_path / "*.npy")]))


def test_steps_orders_and_locks_of_arrays_do_not_matter(sphere):
    points = sphere(5_000)
    mesh = asra_stream.reconstruct(points)
    wide = np.zeros((5_000, 7))
    wide[:, 1:6:2] = points
    strided = wide[:, 1:6:2]
    assert not strided.flags.c_contiguous and same(mesh, asra_stream.reconstruct(strided))
    assert same(mesh, asra_stream.reconstruct(np.asfortranarray(points)))
    assert same(mesh, asra_stream.reconstruct(points[::-1]))
    assert same(mesh, asra_stream.reconstruct(points.astype(">f8")))
    locked = points.copy()
    locked.flags.writeable = False
    assert same(mesh, asra_stream.reconstruct(locked))
    records = np.zeros(5_000, dtype=[("X", "f8"), ("Y", "f8"), ("Z", "f8"), ("intensity", "u2")])
    for axis, name in enumerate("XYZ"):
        records[name] = points[:, axis]
    records["intensity"] = np.arange(5_000)
    found = asra_stream.reconstruct(records)
    assert same(mesh, found) and found.attributes["intensity"].dtype == np.uint16
    assert same(mesh, asra_stream.reconstruct(points.tolist()))


def test_integers_and_half_floats_are_numbers(sphere):
    points = np.round(sphere(8_000) * 1000)
    mesh = asra_stream.reconstruct(points)
    assert same(mesh, asra_stream.reconstruct(points.astype(np.int32)))
    assert asra_stream.reconstruct(sphere(5_000).astype(np.float16)).vertices.dtype == np.float32


def test_pieces_are_one_cloud(sphere):
    points = sphere(12_000)
    values = np.arange(12_000, dtype=np.int64) << 33

    def records(part, numbers):
        out = np.zeros(len(part), dtype=[("x", "f8"), ("y", "f8"), ("z", "f8"), ("number", "i8")])
        out["x"], out["y"], out["z"], out["number"] = *part.T, numbers
        return out

    whole = asra_stream.reconstruct(points, attributes={"number": values})
    pieces = (records(points[i : i + 840], values[i : i + 840]) for i in range(0, 12_000, 840))
    mesh = asra_stream.reconstruct(pieces, max_memory="64M")
    assert same(mesh, whole) and np.array_equal(mesh.attributes["number"], whole.attributes["number"])
    assert mesh.attributes["number"].dtype == np.int64 and mesh.attributes["number"].max() > 2**40
    assert same(mesh, asra_stream.reconstruct([points[:6_000], points[6_000:]]))


def test_attributes_come_with_their_points(sphere):
    points = sphere(8_000)
    rgb = (np.abs(points) * 255).astype(np.uint8)
    values = {"rgb": rgb, "height": points[:, 2], "fresh": points[:, 0] > 0}
    mesh = asra_stream.reconstruct(points, attributes=values, fit="nearest")
    assert set(mesh.attributes) == {"red", "green", "blue", "height", "fresh"}
    assert mesh.colors.dtype == np.uint8
    rows = {tuple(row): i for i, row in enumerate(points.tolist())}
    fitted = [(v, rows[tuple(row)]) for v, row in enumerate(mesh.vertices.tolist()) if tuple(row) in rows]
    assert len(fitted) > len(mesh.vertices) // 2
    vertex, point = np.array(fitted).T
    assert np.array_equal(mesh.colors[vertex], rgb[point])
    assert np.array_equal(mesh.attributes["height"][vertex], points[point, 2])


def test_clouds_of_others(sphere, tmp_path):
    points = sphere(8_000)
    mesh = asra_stream.reconstruct(points)
    trimesh = pytest.importorskip("trimesh")
    assert same(mesh, asra_stream.reconstruct(trimesh.PointCloud(points)))
    laspy = pytest.importorskip("laspy")
    las = laspy.create(point_format=3, file_version="1.2")
    las.header.scales, las.header.offsets = [1e-4] * 3, [0.0] * 3
    las.x, las.y, las.z = points.T
    las.intensity = np.arange(8_000) % 1000
    found = asra_stream.reconstruct(las)
    assert found.attributes["intensity"].max() == 999
    las.write(tmp_path / "sphere.las")
    assert same(found, asra_stream.reconstruct(tmp_path / "sphere.las"))


COLOUR = (200, 100, 50)


def painted(sphere):
    points = sphere(8_000)
    return points, {"rgb": np.full((8_000, 3), COLOUR, np.uint8), "height": points[:, 2]}


def test_trimesh_gets_every_vertex(sphere):
    pytest.importorskip("trimesh")
    points, attributes = painted(sphere)
    mesh = asra_stream.reconstruct(points, attributes=attributes)
    other = mesh.to_trimesh()
    assert other.is_watertight and np.array_equal(other.vertices, mesh.vertices) and np.array_equal(other.faces, mesh.triangles)
    assert abs(other.volume - mesh.report["check"]["volume"]) < 1e-9
    assert (other.visual.vertex_colors[:, :3] == COLOUR).all()


def test_open3d_gets_every_vertex_and_gives_clouds(sphere):
    open3d = pytest.importorskip("open3d")
    points, attributes = painted(sphere)
    mesh = asra_stream.reconstruct(points, attributes=attributes)
    other = mesh.to_open3d()
    assert other.is_watertight() and other.is_orientable() and not other.is_self_intersecting()
    assert np.array_equal(np.asarray(other.vertices), mesh.vertices) and np.array_equal(np.asarray(other.triangles), mesh.triangles)
    assert np.allclose(255 * np.asarray(other.vertex_colors), COLOUR)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    assert same(mesh, asra_stream.reconstruct(cloud)) and not asra_stream.reconstruct(cloud).attributes
    cloud.colors = open3d.utility.Vector3dVector(attributes["rgb"] / 255)
    again = asra_stream.reconstruct(cloud)
    assert same(mesh, again) and np.array_equal(again.colors, mesh.colors)


def test_pyvista_gets_every_vertex_and_gives_clouds(sphere):
    pyvista = pytest.importorskip("pyvista")
    points, attributes = painted(sphere)
    mesh = asra_stream.reconstruct(points, attributes=attributes)
    other = mesh.to_pyvista()
    assert other.n_open_edges == 0 and other.is_manifold and other.is_all_triangles
    assert np.array_equal(other.points, mesh.vertices) and np.array_equal(other.regular_faces, mesh.triangles)
    assert set(other.point_data) == {"red", "green", "blue", "height"}
    assert np.array_equal(other.point_data["height"], mesh.attributes["height"])
    cloud = pyvista.PolyData(points)
    cloud.point_data["RGB"], cloud.point_data["height"] = attributes["rgb"], attributes["height"]
    cloud.point_data["normals"] = np.zeros((8_000, 3))
    again = asra_stream.reconstruct(cloud)
    assert same(mesh, again) and np.array_equal(again.colors, mesh.colors)
    assert np.array_equal(again.attributes["height"], mesh.attributes["height"]) and "normals" not in again.attributes


def test_far_points_have_an_origin(sphere):
    centre = (500_000.0, 5_400_000.0, 300.0)
    mesh = asra_stream.reconstruct(sphere(10_000, centre), crs="EPSG:25832")
    assert mesh.origin[1] > 5_390_000 and mesh.crs["epsg"] == 25832
    assert np.abs(mesh.vertices - centre).max() < 1.1
    assert np.allclose(mesh.local_vertices + np.array(mesh.origin), mesh.vertices, atol=1e-4)
