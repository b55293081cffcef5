#!/usr/bin/env python3
"""Checks what `asra-stream compare` finds against trimesh, open3d and scipy, to four digits.

    cargo build --release
    tools/verify_compare.py CLOUD.ply ...      makes a mesh of each file and compares it with the file: --program PATH for another build
    tools/verify_compare.py MESH=REFERENCE ... compares these

Files are PLY. Nearest points come from scipy; nearest places on triangles and rays from open3d, whose single precision is made good by looking
once more, in double, at the triangles round the one it names; of small pairs from trimesh as well. A Python environment with these is made in the user's cache.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from shared import ROOT, environment

PACKAGES = ["numpy", "scipy", "trimesh", "rtree", "open3d"]
# Queries for which trimesh, which is slow, is asked as well.
FEW = 25_000
# What both sides are made as long as.
SIZE = 1000.0


class Surface:
    """Vertices where they lie, and triangles."""

    def __init__(self, path):
        import numpy
        import trimesh

        loaded = trimesh.load(path, process=False)
        self.vertices = numpy.asarray(loaded.vertices, dtype=float)
        self.faces = numpy.asarray(getattr(loaded, "faces", numpy.zeros((0, 3))), dtype=int).reshape(-1, 3)
        head = Path(path).read_bytes()[:65536].split(b"end_header")[0].decode(errors="replace")
        for line in head.splitlines():
            if line.startswith("comment origin "):
                self.vertices = self.vertices + [float(word) for word in line.split()[2:]]
        self.scene = None

    def triangles(self):
        return self.vertices[self.faces]

    def move(self, corner, scale):
        self.vertices = (self.vertices - corner) * scale

    def mesh(self):
        import trimesh

        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    def cast(self):
        import open3d

        if self.scene is None:
            self.scene = open3d.t.geometry.RaycastingScene()
            vertices, faces = self.vertices.astype("float32"), self.faces.astype("uint32")
            self.scene.add_triangles(open3d.core.Tensor(vertices), open3d.core.Tensor(faces))
            # Triangles at each place, one after the other: some files have several vertices at one place.
            import numpy

            places, numbers = numpy.unique(self.vertices, axis=0, return_inverse=True)
            self.places = numbers.ravel()[self.faces]
            self.order = numpy.argsort(self.places.ravel(), kind="stable")
            self.starts = numpy.searchsorted(self.places.ravel()[self.order], numpy.arange(len(places) + 1))
        return self.scene

    def round(self, primitives):
        """The triangles that share a corner with each of those given: pairs (query, triangle)."""
        import numpy

        queries, triangles = [], []
        for k in range(3):
            place = self.places[primitives, k]
            first, count = self.starts[place], self.starts[place + 1] - self.starts[place]
            query = numpy.repeat(numpy.arange(len(primitives)), count)
            within = numpy.arange(count.sum()) - numpy.repeat(count.cumsum() - count, count)
            queries.append(query)
            triangles.append(self.order[numpy.repeat(first, count) + within] // 3)
        return numpy.concatenate(queries), numpy.concatenate(triangles)

    def nearest(self, points, normals=None):
        """Distances to the nearest places; and the least angle to the normals of the nearest triangles."""
        import numpy
        import open3d
        import trimesh

        distances, angles = numpy.empty(len(points)), numpy.full(len(points), numpy.inf)
        own = unit_normals(self.triangles())
        for first in range(0, len(points), 20_000):
            part = points[first : first + 20_000]
            found = self.cast().compute_closest_points(open3d.core.Tensor(part.astype("float32")))
            query, triangle = self.round(found["primitive_ids"].numpy().astype(int))
            places = trimesh.triangles.closest_point(self.triangles()[triangle], part[query])
            distance = numpy.linalg.norm(places - part[query], axis=1)
            least = numpy.full(len(part), numpy.inf)
            numpy.minimum.at(least, query, distance)
            distances[first : first + len(part)] = least
            if normals is not None:
                # As near but for rounding, of the distance and of the place.
                near = (distance <= least[query] * (1 + 1e-9) + 1e-13 * self.size()) & numpy.isfinite(own[triangle, 0])
                query, triangle = query[near], triangle[near]
                a, b = normals[first + query], own[triangle]
                angle = numpy.degrees(numpy.arctan2(numpy.linalg.norm(numpy.cross(a, b), axis=1), (a * b).sum(1)))
                least = numpy.full(len(part), numpy.inf)
                numpy.fmin.at(least, query, angle)
                angles[first : first + len(part)] = least
        return distances, angles

    def along(self, points, normals):
        """Distances to the first triangle along the normals, either way; infinite if there is none."""
        import numpy
        import open3d

        best = numpy.full(len(points), numpy.inf)
        usable = numpy.isfinite(normals[:, 0])
        corners = self.triangles()
        own = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        for way in (1, -1):
            # From a little behind, so that what lies at the very place is met as well.
            back = 1e-4 * self.size()
            start = points - way * back * normals
            rays = numpy.concatenate([start, way * normals], axis=1)[usable].astype("float32")
            found = self.cast().list_intersections(open3d.core.Tensor(rays))
            query = numpy.flatnonzero(usable)[found["ray_ids"].numpy().astype(int)]
            triangle = found["primitive_ids"].numpy().astype(int)
            # Where the line meets the triangle's plane, in double.
            n, p = own[triangle], points[query]
            with numpy.errstate(divide="ignore", invalid="ignore"):
                t = (n * (corners[triangle, 0] - p)).sum(1) / (n * normals[query]).sum(1)
            numpy.fmin.at(best, query, numpy.abs(t))
        return best

    def size(self):
        return float((self.vertices.max(0) - self.vertices.min(0)).max())


def unit_normals(triangles):
    import numpy

    normals = numpy.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    with numpy.errstate(divide="ignore", invalid="ignore"):
        return normals / numpy.linalg.norm(normals, axis=1)[:, None]


class Findings:
    def __init__(self):
        self.wrong = 0

    def same(self, what, ours, theirs, digits=4, least=0.0):
        """Equal to so many digits, or both below what single precision in a file, or rounding, makes of nothing."""
        close = abs(ours - theirs) <= 0.5 * 10.0 ** (1 - digits) * abs(theirs) + least
        print(f"{'ok' if close else 'WRONG':6}{what:48}{ours:<22.12g} {theirs:.12g}")
        self.wrong += not close


def check_spread(findings, what, ours, distances, scale=1.0):
    import numpy

    distances = distances / scale
    rank = -(-95 * len(distances) // 100)
    theirs = {
        "mean": distances.mean(),
        "rms": numpy.sqrt((distances**2).mean()),
        "p95": numpy.partition(distances, rank - 1)[rank - 1],
        "max": distances.max(),
    }
    if "count" in ours:
        findings.same(f"{what}: count", ours["count"], len(distances), digits=16)
    for name, value in theirs.items():
        found = ours[name]["units"] if isinstance(ours[name], dict) else ours[name]
        findings.same(f"{what}: {name}", found, value, least=1e-12 * SIZE / scale)


def check_pair(findings, program, mesh_path, reference_path):
    import numpy
    from scipy.spatial import cKDTree

    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "r.json"
        subprocess.run([program, "compare", mesh_path, reference_path, "-q", "--report", report, "--temp-dir", folder], check=True)
        ours = json.loads(report.read_text())
    print(f"\n{mesh_path} against {reference_path} ({ours['reference']['kind']})")
    mesh, reference = Surface(mesh_path), Surface(reference_path)
    corner = reference.vertices.min(0)
    extent = reference.vertices.max(0) - corner
    size = extent.max()
    findings.same("longest side", ours["longest_side"], size, digits=12)
    findings.same("diagonal", ours["diagonal"], numpy.linalg.norm(extent), digits=12)
    # trimesh takes products of coordinates below a fixed limit for nothing, which would spoil small models: they are measured a thousand long.
    scale = SIZE / size
    mesh.move(corner, scale), reference.move(corner, scale)
    centroids, normals = mesh.triangles().mean(1), unit_normals(mesh.triangles())

    def mse(distances):
        return 100 * ((100 * distances / SIZE) ** 2).mean()

    tree = cKDTree(reference.vertices)
    to_points = tree.query(centroids)[0]
    findings.same("MSE to the nearest point (scipy)", ours["mse"]["nearest_point"], mse(to_points), least=1e-20)
    back, _ = mesh.nearest(reference.vertices)
    check_spread(findings, "reference's points to mesh", ours["reference_to_mesh"]["points"], back, scale)
    if ours["reference"]["kind"] == "cloud":
        check_spread(findings, "mesh's centroids to points", ours["mesh_to_reference"]["centroids"], to_points, scale)
        to_points = tree.query(mesh.vertices)[0]
        check_spread(findings, "mesh's vertices to points", ours["mesh_to_reference"]["vertices"], to_points, scale)
        return

    a, b, volumes = mesh.mesh(), reference.mesh(), []
    for name, one, side in (("mesh", a, ours["mesh"]), ("reference", b, ours["reference"])):
        used = one.vertices[numpy.unique(one.faces)]
        # Of an open mesh the volume depends on where it is taken from, and trimesh does not say.
        corners = one.triangles - (used.min(0) + used.max(0)) / 2
        volumes.append((numpy.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum() / 6)
        findings.same(f"area of {name} (trimesh)", side["area"], one.area / scale**2)
        if side["closed"]:
            findings.same(f"volume of {name}", side["volume"], volumes[-1] / scale**3)
        if one.is_watertight:
            findings.same(f"volume of {name} (trimesh)", side["volume"], one.volume / scale**3)
    if ours["avr"] is None:
        assert not (ours["mesh"]["closed"] and ours["reference"]["closed"])
    ratios = [one.area / abs(volume) for one, volume in zip((a, b), volumes)]
    if ours["avr"] is not None:
        findings.same("AVR", ours["avr"], 100 * abs(ratios[0] / ratios[1] - 1), digits=4)

    inside_out = [side["closed"] and side["volume"] < 0 for side in (ours["mesh"], ours["reference"])]
    turned = -normals if inside_out[0] != inside_out[1] else normals
    distances, angles = reference.nearest(centroids, turned)
    check_spread(findings, "mesh's centroids to triangles", ours["mesh_to_reference"]["centroids"], distances, scale)
    findings.same("MSE to the nearest place", ours["mse"]["nearest"], mse(distances), least=1e-20)
    check_spread(findings, "angle between normals", ours["normal_deviation"], angles[numpy.isfinite(angles)])
    vertices, _ = reference.nearest(mesh.vertices)
    check_spread(findings, "mesh's vertices to triangles", ours["mesh_to_reference"]["vertices"], vertices, scale)
    theirs, _ = mesh.nearest(reference.triangles().mean(1))
    check_spread(findings, "reference's centroids to mesh", ours["reference_to_mesh"]["centroids"], theirs, scale)
    along = reference.along(centroids, normals)
    met = numpy.isfinite(along)
    findings.same("MSE along the normals", ours["mse"]["along_normal"], mse(along[met]), least=1e-20)
    findings.same("normals that meet nothing", ours["mse"]["along_normal_missed"], len(along) - met.sum(), digits=16)
    if len(centroids) <= FEW:
        import trimesh

        distances = trimesh.proximity.closest_point(reference.mesh(), centroids)[1]
        check_spread(findings, "the same, trimesh alone", ours["mesh_to_reference"]["centroids"], distances, scale)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", nargs="+", metavar="CLOUD.ply or MESH=REFERENCE")
    parser.add_argument("--program", type=Path, default=ROOT / "target" / "release" / "asra-stream")
    arguments = parser.parse_args()
    environment("verify-compare", PACKAGES)
    findings = Findings()
    with tempfile.TemporaryDirectory() as folder:
        for number, pair in enumerate(arguments.pairs):
            mesh, separator, reference = pair.partition("=")
            if not separator:
                reference, mesh = mesh, str(Path(folder) / f"{number}.ply")
                subprocess.run([arguments.program, reference, "-q", "-o", mesh, "--temp-dir", folder], check=True)
            check_pair(findings, arguments.program, mesh, reference)
    print(f"\n{findings.wrong} wrong" if findings.wrong else "\nall the same")
    sys.exit(findings.wrong > 0)


if __name__ == "__main__":
    main()
