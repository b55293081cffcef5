#!/usr/bin/env python3
"""asra-stream beside others that make meshes of points: Open3D, PyMeshLab, CGAL, and PoissonRecon, Tight Cocone and Power Crust if you have them.

    tools/peers.py --models DIR                          all of them, 36 thousand to 20 million points: hours, mostly of runs that hit a cap
    tools/peers.py --models DIR --minutes 35             begins no run after 35 minutes; call it again to continue
    tools/peers.py --models DIR --only cgal-poisson --sizes horse,100K --again      repeats single runs
    tools/peers.py --models DIR --plan                   what would be run, and how long that should take
    tools/peers.py --minutes 0                           writes the tables and plots of what is there

Each run is a process of its own, under a cap of time and one of memory. Peers run at their defaults, and brought to as many triangles as
asra-stream makes at k = 4, as near as their settings allow; asra-stream runs anew at the number of triangles of each closed mesh of theirs. What
came of a run is kept in the work folder as JSON, its mesh beside it. DIR has horse.ply and stanford_bunny.ply (or .ply.gz); clouds are the vertices
of these, and samples of the horse's surface. A Python environment is made in the user's cache, and CGAL's drivers are built with g++, for which
Debian has the headers: apt-get install g++ libcgal-dev libeigen3-dev

Tight Cocone is called as PROGRAM POINTS MESH, Power Crust as PROGRAM -m 1000000 -i POINTS, in a folder of their own. POINTS is text, a point a line. The surface is read from MESH,
or from MESH.off, or, Power Crust's, from pc.off: OFF, whose polygons are cut into triangles. Where a program wants to be called otherwise, name a script that does so.
"""

import argparse
import dataclasses
import datetime
import json
import math
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from bench import UNITS, machine
from shared import PACKAGES, ROOT, built, commit, digits, environment, last_line, measured, model, must_import, stoppable, table

SEED = 1
OURS = "asra-stream"
SMALL_BUDGET = "asra-stream-256M"
# Runs shorter than this are made three times.
SHORT = 5.0
# What a run ended by, and which of the caps that is.
CAPS = {"time": 0, "memory": 1}
# Edges that may be open, of all, in a mesh that is nearly closed.
NEARLY = 1e-3


class Peer(NamedTuple):
    """Who is compared, how it is set, and what it took in earlier measurements, to foretell how long a run will take."""

    title: str
    # The setting that decides how many triangles there are: its name, its default, and the exponent by which their number goes with it ("depth": four
    # times for each step).
    setting: str | None
    default: float | None
    exponent: float | str | None
    # Microseconds and bytes for each point.
    micros: float
    bytes: float
    normals: bool = False
    # The most points that it has come to the end with.
    most: float = math.inf


PEERS = {
    OURS: Peer("asra-stream", "k", 4, 2, 1, 100),
    SMALL_BUDGET: Peer("asra-stream, 256 MiB", "k", 4, None, 1, 100),
    "open3d-poisson": Peer("Open3D, Poisson", "depth", 8, "depth", 28, 1331, True),
    "open3d-ball-pivoting": Peer("Open3D, ball pivoting", None, None, None, 20, 1145, True),
    "open3d-alpha-shape": Peer("Open3D, alpha shape", "alpha", 5, None, 48, 2965),
    "pymeshlab-poisson": Peer("PyMeshLab, screened Poisson", "depth", 8, "depth", 53, 1786, True),
    "pymeshlab-ball-pivoting": Peer("PyMeshLab, ball pivoting", None, None, None, 12, 1086, most=134_000),
    "cgal-advancing-front": Peer("CGAL, advancing front", None, None, None, 22, 1717),
    "cgal-scale-space": Peer("CGAL, scale space", None, None, None, 34, 1785),
    "cgal-poisson": Peer("CGAL, Poisson", "distance", 0.375, -1.3, 147, 5045, most=500_000),
    "cgal-alpha-wrap": Peer("CGAL, alpha wrap", "diagonal / alpha", 20, 2, 23, 348),
    "poissonrecon": Peer("PoissonRecon", "depth", 8, "depth", 46, 793, True),
    "tight-cocone": Peer("Tight Cocone", None, None, None, 100, 3000, most=500_000),
    "power-crust": Peer("Power Crust", None, None, None, 300, 5000, most=500_000),
}
# Programs that only their users can build, and what they are called with beside the points.
FOREIGN = {"tight-cocone": ["{points}", "{mesh}"], "power-crust": ["-m", "1000000", "-i", "{points}"]}
# Built by the user, and named by an option each.
OPTIONAL = ("poissonrecon", *FOREIGN)
NORMALS = Peer("Open3D, normals", None, None, None, 75, 2671)
NOTES = """\
* Open3D's Poisson, PyMeshLab's screened Poisson and PoissonRecon at depth 8, the rest at defaults. They and Open3D's ball pivoting need normals:
  Open3D's, of 30 neighbours, oriented consistently over the graph of 30 neighbours, in a process of its own. *Wall*, *processor* and the ratios
  count them, *normals* shows their wall time; memory is that of the larger of the two processes.
* Open3D has no default radii for ball pivoting, nor an alpha for shapes: 1, 2 and 4, and 5 times the mean distance to the nearest neighbour.
  PyMeshLab's ball pivoting guesses its own radius.
* CGAL: advancing front at defaults; scale space with four steps of smoothing and manifold alpha shapes; Poisson with jet-fitted normals of 18
  neighbours of its own (*normals* shows their part), angle 20, radius 30, distance .375; alpha wrap with alpha a twentieth of the box's diagonal
  and the offset a thirtieth of alpha, as in its manual. Built with -O3, without TBB.
* Tight Cocone and Power Crust, where they are there: at defaults; Power Crust with coordinates in whole numbers up to a million. The points are
  written as text before the clock starts, the mesh is cut into triangles while it runs.
* Times are of whole processes, reading and writing PLY included, but for Python's own start and imports, which are taken off the peers' time (not
  off memory). Ours count from the process's start.
* Memory: maximum resident size of the process, as the system counts it for a child. Python with Open3D is {open3d:.0f} MiB of that before it reads
  a point, with PyMeshLab {pymeshlab:.0f}.
* *Solid*: closed, and of the truth's volume to a tenth. Triangles count as matched to a tenth."""


@dataclasses.dataclass
class Run:
    """What came of one run. Seconds and bytes."""

    cloud: str
    points: int
    peer: str
    # "default", "matched" (a peer brought to our number of triangles), or "as PEER PURPOSE" (ours, brought to theirs).
    purpose: str
    value: float | None
    outcome: str = ""
    wall: float = 0
    cpu: float = 0
    peak: int = 0
    # What Python's start and imports took, and is not in `wall`; how large the process was after that.
    imports: float = 0
    imported: int = 0
    # Wall time of normals that is counted in `wall`.
    normals: float | None = None
    repeats: int = 1
    caps: tuple = ()
    date: str = ""
    check: dict | None = None
    compare: dict | None = None

    @property
    def key(self):
        return f"{self.cloud}.{self.peer}.{self.purpose.replace(' ', '+')}"

    @property
    def triangles(self):
        return self.check["triangles"] if self.check else 0

    @property
    def nearly_closed(self):
        return self.triangles > 0 and self.check["boundary_edges"] + self.check["nonmanifold_edges"] <= NEARLY * self.check["edges"]

    @property
    def solid(self):
        """Closed, and of the volume of the truth but for a tenth."""
        return bool(self.check and self.check["closed"] and self.compare and abs(ratio_of_volumes(self) - 1) < 0.1)


def ratio_of_volumes(run):
    """Without signs: some scans are stored inside out."""
    return abs(run.compare["mesh"]["volume"] / run.compare["reference"]["volume"])


def near(count, wanted):
    """To a tenth, numbers of triangles count as matched."""
    return abs(math.log(count / wanted)) < 0.1


# -- What runs in processes of their own, with Python's packages


def work(name, cloud, mesh, value):
    """One run of a peer in Python."""
    import numpy

    if name.startswith("pymeshlab"):
        import pymeshlab

        imported()
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.load_new_mesh(cloud)
        if name == "pymeshlab-poisson":
            meshes.generate_surface_reconstruction_screened_poisson(depth=int(value))
        else:
            meshes.generate_surface_reconstruction_ball_pivoting()
        meshes.save_current_mesh(mesh, save_vertex_normal=False, save_vertex_quality=False, save_vertex_color=False)
        return
    import open3d

    imported()
    points = open3d.io.read_point_cloud(cloud)
    if name == "normals":
        points.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
        points.orient_normals_consistent_tangent_plane(30)
        write_cloud(mesh, [numpy.hstack([numpy.asarray(points.points), numpy.asarray(points.normals)])], len(points.points))
        return
    if name == "open3d-poisson":
        made, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=int(value))
    else:
        spacing = numpy.mean(points.compute_nearest_neighbor_distance())
        if name == "open3d-ball-pivoting":
            made = open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(
                points, open3d.utility.DoubleVector(spacing * numpy.array([1, 2, 4]))
            )
        else:
            made = open3d.geometry.TriangleMesh.create_from_point_cloud_alpha_shape(points, float(value) * spacing)
    open3d.io.write_triangle_mesh(mesh, made, write_vertex_normals=False, write_vertex_colors=False)


def foreign(name, program, cloud, mesh):
    """One run of a program that reads and writes text."""
    import numpy
    from paper import load

    points = load(Path(cloud), numpy)[0]
    with tempfile.TemporaryDirectory(prefix="asra-stream-peers-") as folder:
        source, made = Path(folder) / "points.txt", Path(folder) / "mesh"
        numpy.savetxt(source, points, "%.9g")
        imported()
        words = [word.format(points=source, mesh=made) for word in FOREIGN[name]]
        subprocess.run([program, *words], cwd=folder, check=True)
        found = next((path for path in (made, made.with_suffix(".off"), made.with_name("pc.off")) if path.is_file()), None)
        if found is None:
            sys.exit(f"{name}: no mesh; there are {', '.join(sorted(path.name for path in Path(folder).iterdir()))}")
        vertices, faces = read_off(found.read_text())
    write_mesh(mesh, vertices, faces)


def read_off(text):
    """Vertices, and the polygons cut into triangles, of a mesh in OFF. Vertices that no polygon uses stay."""
    words = [line.partition("#")[0].split() for line in text.splitlines()]
    words = [line for line in words if line]
    if words[0][0] != "OFF":
        raise ValueError(f"not OFF: it begins with {words[0][0]!r}")
    words = words[1:] if len(words[0]) == 1 else [words[0][1:], *words[1:]]
    vertices, polygons = (int(count) for count in words[0][:2])
    if len(words) < 1 + vertices + polygons:
        raise ValueError(f"cut off: {len(words) - 1} lines for {vertices} vertices and {polygons} polygons")
    places = [[float(word) for word in line[:3]] for line in words[1 : 1 + vertices]]
    corners = ([int(word) for word in line[1 : 1 + int(line[0])]] for line in words[1 + vertices : 1 + vertices + polygons])
    return places, [[polygon[0], b, c] for polygon in corners for b, c in zip(polygon[1:], polygon[2:])]


def write_mesh(path, vertices, faces):
    import numpy

    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
    rows = numpy.empty(len(faces), [("sides", "u1"), ("corners", "<i4", 3)])
    rows["sides"], rows["corners"] = 3, numpy.array(faces, int).reshape(-1, 3)
    part = Path(f"{path}.part")
    with open(part, "wb") as out:
        out.write(f"{head}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        out.write(numpy.array(vertices, "<f4").reshape(-1, 3).tobytes())
        out.write(rows.tobytes())
    part.rename(path)


def imported():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    print("imported", time.monotonic(), usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024, flush=True)


def make_cloud(source, path, count):
    """The vertices of a mesh, or so many points of its surface: the same for the same numpy."""
    import numpy
    from paper import load

    vertices, faces = load(Path(source), numpy)
    if not count:
        write_cloud(path, [vertices], len(vertices))
        return
    corners = vertices[faces]
    doubled = numpy.linalg.norm(numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    shares = numpy.cumsum(doubled) / doubled.sum()
    random = numpy.random.default_rng(SEED)

    def batch(size):
        a, b, c = corners[numpy.minimum(numpy.searchsorted(shares, random.random(size)), len(shares) - 1)].transpose(1, 0, 2)
        u, v = random.random((2, size, 1))
        over = u + v > 1
        u, v = numpy.where(over, 1 - u, u), numpy.where(over, 1 - v, v)
        return a + u * (b - a) + v * (c - a)

    most = 10**6
    write_cloud(path, (batch(min(most, count - start)) for start in range(0, count, most)), count)


def write_cloud(path, batches, count):
    part = Path(f"{path}.part")
    with open(part, "wb") as out:
        for number, batch in enumerate(batches):
            if number == 0:
                fields = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")[: batch.shape[1]])
                out.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{fields}end_header\n".encode())
            out.write(batch.astype("<f4").tobytes())
    part.rename(path)


# -- The runs


def build_drivers(folder):
    """CGAL's drivers, where they are older than their sources."""
    source = ROOT / "tools/peers"
    missing = [
        package
        for there, package in (
            (shutil.which("g++"), "g++"),
            (Path("/usr/include/CGAL/alpha_wrap_3.h").exists(), "libcgal-dev"),
            (Path("/usr/include/eigen3").exists(), "libeigen3-dev"),
        )
        if not there
    ]
    if missing:
        sys.exit(
            f"CGAL's drivers cannot be built; on Debian 12 or newer: apt-get install {' '.join(missing)}\n"
            "(or leave them out: --only with others' names)"
        )
    folder.mkdir(exist_ok=True)
    newest = max(path.stat().st_mtime for path in source.iterdir())
    for path in sorted(source.glob("*.cpp")):
        driver = folder / path.stem
        if not driver.exists() or driver.stat().st_mtime < newest:
            print(f"building CGAL's driver {path.stem}", flush=True)
            part = driver.with_suffix(".part")
            words = ["-std=c++17", "-O3", "-DNDEBUG", "-DCGAL_EIGEN3_ENABLED", "-I/usr/include/eigen3", path, "-o", part, "-lgmp", "-lmpfr"]
            subprocess.run(["g++", *words], check=True)
            part.rename(driver)


class Bench:
    """The work folder, the runs in it, and how to make more."""

    def __init__(self, arguments):
        self.arguments, self.work = arguments, arguments.work
        self.caps = (arguments.time_cap, arguments.memory_cap)
        self.began = time.monotonic()
        self.program = None
        for folder in ("runs", "meshes", "clouds", "logs"):
            (self.work / folder).mkdir(parents=True, exist_ok=True)
        self.runs = {run.key: run for path in sorted((self.work / "runs").glob("*.json")) for run in [Run(**json.loads(path.read_text()))]}

    def out_of_time(self):
        return self.arguments.minutes is not None and time.monotonic() - self.began > 60 * self.arguments.minutes

    def truth(self, cloud):
        return model(self.arguments.models, "stanford_bunny.ply" if cloud == "bunny" else "horse.ply", self.work / "clouds")

    def cloud(self, cloud):
        path = self.work / f"clouds/{cloud}.ply"
        if not path.exists():
            count = cloud.partition("-")[2] or "0"
            subprocess.run([sys.executable, __file__, "cloud", self.truth(cloud), path, count], check=True)
        return path

    def known(self, run):
        """The run as it was made before, if it need not be made again."""
        before = self.runs.get(run.key)
        if before is None or (self.arguments.again and before.date != self.started):
            return None
        # What hit a cap is worth another try under a higher one.
        over = CAPS.get(before.outcome)
        return None if over is not None and self.caps[over] > before.caps[over] else before

    @property
    def started(self):
        return self.arguments.started

    def command(self, run, mesh):
        cloud = self.cloud(run.cloud)
        if run.peer in (OURS, SMALL_BUDGET):
            budget = ["--max-memory", "256M"] if run.peer == SMALL_BUDGET else []
            return [self.program, cloud, "-q", "--k", run.value, *budget, "-o", mesh, "--overwrite", "--temp-dir", self.work]
        source = self.normals_of(run.cloud) if run.peer in PEERS and PEERS[run.peer].normals else cloud
        if run.peer.startswith("cgal-"):
            value = [] if run.value is None else [run.value]
            return [self.work / "drivers" / run.peer.removeprefix("cgal-").replace("-", "_"), source, mesh, *value]
        if run.peer == "poissonrecon":
            return [self.arguments.programs[run.peer], "--in", source, "--out", mesh, "--depth", run.value]
        if run.peer in FOREIGN:
            return [sys.executable, __file__, "foreign", run.peer, self.arguments.programs[run.peer], source, mesh]
        return [sys.executable, __file__, "work", run.peer, source, mesh, run.value]

    def normals_of(self, cloud):
        return self.work / f"clouds/{cloud}.normals.ply"

    def make(self, run):
        """Makes the run, unless it is known, and measures its mesh."""
        if before := self.known(run):
            return before
        if words := self.refused(run):
            run.outcome = words
            return run
        if self.out_of_time():
            run.outcome = "not yet run"
            return run
        normals = None
        if run.peer in PEERS and PEERS[run.peer].normals:
            normals = self.make(Run(run.cloud, run.points, "normals", "default", None))
            if normals.outcome != "ok":
                run.outcome = f"normals: {normals.outcome}"
                return run
        self.process(run)
        if normals:
            run.normals = normals.wall
            run.wall, run.cpu, run.peak = run.wall + normals.wall, run.cpu + normals.cpu, max(run.peak, normals.peak)
        self.keep(run)
        return run

    def keep(self, run):
        run.date, run.caps = self.started, self.caps
        (self.work / f"runs/{run.key}.json").write_text(json.dumps(dataclasses.asdict(run), indent=1) + "\n")
        self.runs[run.key] = run
        found = f", {run.triangles:,} triangles" if run.check else ""
        print(f"{run.cloud}, {run.peer}, {run.purpose}: {run.outcome}, {run.wall:.2f} s, {run.peak / 2**20:,.0f} MiB{found}", flush=True)

    def process(self, run):
        mesh = self.normals_of(run.cloud) if run.peer == "normals" else self.work / f"meshes/{run.key}.ply"
        log = self.work / f"logs/{run.key}.txt"
        mesh.unlink(missing_ok=True)
        told = []
        while not told or (told[-1]["outcome"] == "ok" and told[0]["wall"] < SHORT and len(told) < 3):
            told.append(measured(self.command(run, mesh), log, *self.caps))
            for line in log.read_text(errors="replace").splitlines():
                words = line.split()
                if words[:1] == ["imported"]:
                    told[-1]["imports"] = float(words[1]) - told[-1]["started"]
                    told[-1]["imported"] = int(words[3])
                    told[-1]["wall"] -= told[-1]["imports"]
                    told[-1]["cpu"] -= float(words[2])
                elif words[:2] == ["step", "normals"]:
                    run.normals = float(words[2])
        run.outcome, run.repeats = told[-1]["outcome"], len(told)
        for key in ("wall", "cpu", "peak", "imports", "imported"):
            setattr(run, key, statistics.median(one.get(key, 0) for one in told))
        if run.outcome.startswith("exit"):
            run.outcome += f" ({last_line(log)})"
        elif run.outcome == "ok" and not mesh.exists():
            run.outcome = "no mesh"
        elif run.outcome == "ok" and run.peer != "normals":
            self.measure(run, mesh)

    def measure(self, run, mesh):
        """What `check` and `compare` say of the mesh. A check that takes too long is made without intersections."""
        report, log = self.work / "report.json", self.work / "logs/measure.txt"
        for words in ([], ["--no-intersections"]):
            report.unlink(missing_ok=True)
            told = measured([self.program, "check", mesh, "-q", "--report", report, "--temp-dir", self.work, *words], log, self.caps[0])
            # Exit code 4 says that the mesh is not closed, or intersects itself.
            if told["outcome"] != "time":
                break
        if not report.exists():
            run.outcome = f"no mesh ({last_line(log)})"
            return
        run.check = json.loads(report.read_text())
        if run.triangles == 0:
            run.outcome = "empty mesh"
            return
        report.unlink()
        told = measured(
            [self.program, "compare", mesh, self.truth(run.cloud), "-q", "--report", report, "--temp-dir", self.work], log, self.caps[0]
        )
        if told["outcome"] == "ok":
            run.compare = json.loads(report.read_text())
        else:
            print(f"compare: {told['outcome']}: {last_line(log)}", file=sys.stderr)

    def refused(self, run):
        """Why the run is not worth its time: with fewer points it hit a cap, or came so near to it that in proportion to the points it will; that is
        the best case."""
        if self.arguments.force:
            return None
        for before in self.runs.values():
            if before.peer != run.peer or before.purpose != "default" or before.points >= run.points:
                continue
            over = CAPS.get(before.outcome)
            if over is not None and self.caps[over] <= before.caps[over]:
                return f"not run: cap of {before.outcome} at {before.points:,} points"
            more = run.points / before.points
            # Small clouds say little: starting up is most of it. Normals that are made apart have a cap of their own.
            alone = before.wall - (before.normals if before.normals and PEERS[run.peer].normals else 0)
            if before.outcome == "ok" and alone > 10 and alone * more > self.caps[0]:
                return f"not run: {alone:.0f} s at {before.points:,} points"
            if before.outcome == "ok" and before.peak > 2**30 and before.peak * more > self.caps[1]:
                return f"not run: {before.peak / 2**30:.1f} GiB at {before.points:,} points"
        return None

    def triangles_with(self, cloud, k):
        """How many triangles asra-stream makes with this k; not measured."""
        mesh, report = self.work / "meshes/search.ply", self.work / "report.json"
        words = ["-q", "--k", k, "--no-check", "-o", mesh, "--overwrite", "--report", report, "--temp-dir", self.work]
        told = measured([self.program, self.cloud(cloud), *words], self.work / "logs/search.txt", *self.caps)
        return json.loads(report.read_text())["output"]["triangles"] if told["outcome"] == "ok" else None

    def k_for(self, ours, triangles):
        """The k that makes so many triangles, to 3 % or as near as a few tries come; None if that is not near: no two vertices are on one point, so
        there is a most."""
        tried = [(ours.value, ours.triangles)]
        while len(tried) < 5:
            k, count = min(tried, key=lambda one: abs(math.log(one[1] / triangles)))
            if abs(math.log(count / triangles)) < 0.03:
                break
            k = float(digits(k * math.sqrt(triangles / count), 4).replace(",", ""))
            if k in [one[0] for one in tried] or not (count := self.triangles_with(ours.cloud, k)):
                break
            tried.append((k, count))
        k, count = min(tried, key=lambda one: abs(math.log(one[1] / triangles)))
        return k if near(count, triangles) else None

    def matched(self, run):
        """The runs at the same numbers of triangles: the peer's at ours, and ours at the peer's."""
        ours, peer = self.runs.get(f"{run.cloud}.{OURS}.default"), PEERS[run.peer]
        if run.peer in (OURS, SMALL_BUDGET) or not ours or not ours.triangles or run.outcome != "ok" or not run.triangles:
            return
        theirs = [run]
        if peer.exponent:
            want = ours.triangles / run.triangles
            value = (
                round(run.value + math.log(want, 4))
                if peer.exponent == "depth"
                else float(digits(run.value * want ** (1 / peer.exponent), 4).replace(",", ""))
            )
            if value != run.value and not 0.95 < want < 1.05:
                theirs.append(self.make(Run(run.cloud, run.points, run.peer, "matched", value)))
        for one in theirs:
            if one.nearly_closed:
                purpose = f"as {one.peer} {one.purpose}"
                again = Run(one.cloud, one.points, OURS, purpose, None)
                if not self.known(again) and not self.out_of_time():
                    again.value = self.k_for(ours, one.triangles)
                    if again.value is None:
                        again.outcome = "no k makes so many triangles"
                        self.keep(again)
                    elif again.value == ours.value:
                        again = dataclasses.replace(ours, purpose=purpose)
                        self.keep(again)
                    else:
                        self.make(again)


def plan(arguments):
    """Clouds and peers in the order that they are run: what probably hits a cap goes last. With the seconds that the run at defaults should take."""
    found, normals = [], set()
    for cloud, points in arguments.sizes:
        for name in arguments.only:
            peer = PEERS[name]
            parts = [peer, NORMALS] if peer.normals else [peer]
            hopeless = points > peer.most or any(
                p.micros * 1e-6 * points > arguments.time_cap or p.bytes * points > arguments.memory_cap for p in parts
            )
            seconds = peer.micros * 1e-6 * points
            if peer.normals and cloud not in normals:
                normals.add(cloud)
                seconds += NORMALS.micros * 1e-6 * points
            found.append((hopeless, points, cloud, name, arguments.time_cap if hopeless else seconds))
    return sorted(found, key=lambda one: one[:2])


# -- Tables and plots


def cells(run, ours=None):
    """A row of the tables, without its name."""
    size = digits(run.value) if run.value is not None else ""
    took = [digits(run.wall), digits(run.normals) if run.normals else "", digits(run.cpu), f"{run.peak / 2**20:,.0f}"]
    if run.outcome != "ok":
        return [size, *(took if run.wall and run.outcome in ("time", "memory") else [""] * 4), f"*{run.outcome}*", *[""] * 12]
    check = run.check
    found = check["intersections"]

    def yes(key, count):
        return "yes" if check[key] else f"no ({count:,})"

    marks = [
        yes("closed", check["boundary_edges"] + check["nonmanifold_edges"]),
        yes("manifold", check["nonmanifold_edges"] + check["nonmanifold_vertices"]),
        "inside out" if check["oriented"] and check["closed"] and check["volume"] < 0 else yes("oriented", check["inconsistent_edges"]),
        f"{check['components']:,}",
        "not counted" if found is None else ("" if found["complete"] else "≥ ") + f"{found['triangles']:,}",
    ]
    errors = ["–"] * 5
    if run.compare:
        there, back = run.compare["mesh_to_reference"], run.compare["reference_to_mesh"]
        rms = [part["centroids"]["rms"]["percent_of_diagonal"] for part in (there, back)]
        largest = [max(one["max"]["percent_of_diagonal"] for one in part.values()) for part in (there, back)]
        errors = [digits(value) for value in (ratio_of_volumes(run), *rms, *largest)]
    times = [digits(run.wall / ours.wall, 2), digits(run.peak / ours.peak, 2)] if ours and ours is not run and ours.wall else ["", ""]
    return [size, *took, f"{run.triangles:,}", *marks, *errors, *times]


COLUMNS = [
    "setting:",
    "wall, s:",
    "normals:",
    "processor, s:",
    "MiB:",
    "triangles:",
    "closed",
    "manifold",
    "oriented",
    "components:",
    "intersecting:",
    "volume:",
    "RMS to truth:",
    "from truth:",
    "largest to truth:",
    "from truth:",
    "× our time:",
    "× our memory:",
]


def sections(runs, refused):
    """The tables of each cloud."""
    text = []
    clouds = sorted({(run.points, run.cloud) for run in runs.values()})
    for points, cloud in clouds:
        ours = runs.get(f"{cloud}.{OURS}.default")
        defaults, pairs = [], []
        for name, peer in PEERS.items():
            run = runs.get(f"{cloud}.{name}.default") or refused.get((cloud, name))
            if run:
                defaults.append([peer.title, *cells(run, ours if ours and ours.outcome == "ok" else None)])
            for purpose in ("default", "matched"):
                theirs, again = runs.get(f"{cloud}.{name}.{purpose}"), runs.get(f"{cloud}.{OURS}.as+{name}+{purpose}")
                if theirs and again:
                    pairs += [[peer.title, *cells(theirs, again if again.outcome == "ok" else None)], ["asra-stream", *cells(again)]]
                elif theirs and purpose == "matched":
                    pairs.append([peer.title, *cells(theirs)])
        text.append(f"## {cloud.partition('-')[0].capitalize()}, {points:,} points\n\nAt defaults:\n\n{table(['', *COLUMNS], defaults)}")
        if pairs:
            text.append(f"At matched numbers of triangles:\n\n{table(['', *COLUMNS], pairs)}")
    return "\n".join(text)


def in_short(runs):
    """For each cloud, the peers that come nearest to us."""
    rows = []
    for points, cloud in sorted({(run.points, run.cloud) for run in runs.values()}):
        ours = runs.get(f"{cloud}.{OURS}.default")
        if not ours or ours.outcome != "ok":
            continue
        theirs = [
            run
            for run in runs.values()
            if run.cloud == cloud and run.peer in PEERS and run.peer not in (OURS, SMALL_BUDGET) and run.outcome == "ok"
        ]
        defaults = [run for run in theirs if run.purpose == "default"]
        matched = []
        for run in theirs:
            again = runs.get(f"{cloud}.{OURS}.as+{run.peer}+{run.purpose}")
            if again and again.outcome == "ok" and near(again.triangles, run.triangles):
                matched.append((run, again))

        def least(pairs, key):
            found = min(((getattr(run, key) / getattr(mine, key), run) for run, mine in pairs), key=lambda one: one[0], default=None)
            return f"{digits(found[0], 2)} ({PEERS[found[1].peer].title})" if found else "–"

        def error(run):
            return max(run.compare[way]["centroids"]["rms"]["percent_of_diagonal"] for way in ("mesh_to_reference", "reference_to_mesh"))

        solids = [(error(run), run, mine) for run, mine in matched if run.solid and mine.compare]
        best = min(solids, key=lambda one: one[0], default=None)
        told = f"{digits(best[0])} ({PEERS[best[1].peer].title}), {digits(error(best[2]))}" if best else "–"
        every = [(run, ours) for run in defaults]
        solid = "yes" if ours.solid else "no"
        rows.append(
            [
                f"{cloud.partition('-')[0]}, {points:,}",
                digits(ours.wall),
                f"{ours.peak / 2**20:,.0f}",
                solid,
                sum(run.solid for run in defaults),
                len(defaults),
                least(every, "wall"),
                least([pair for pair in every if pair[0].solid], "wall"),
                least(matched, "wall"),
                least(every, "peak"),
                told,
            ]
        )
    return table(
        [
            "cloud",
            "our s:",
            "our MiB:",
            "ours solid",
            "solid peers:",
            "of:",
            "fastest peer, × our time",
            "fastest that is solid",
            "fastest at matched triangles",
            "least memory, × ours",
            "RMS %: best solid peer, ours at its triangles",
        ],
        rows,
    )


def plots(runs, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    def error(run, way):
        return run.compare[way]["centroids"]["rms"]["percent_of_diagonal"] if run.compare else None

    figure, axes = plt.subplots(2, 2, figsize=(12, 9), layout="constrained")
    wanted = (
        (axes[0][0], "wall seconds, normals included", lambda run: run.wall),
        (axes[0][1], "resident, MiB", lambda run: run.peak / 2**20),
        (axes[1][0], "RMS, mesh to truth, % of the diagonal", lambda run: error(run, "mesh_to_reference")),
        (axes[1][1], "RMS, truth to mesh, % of the diagonal", lambda run: error(run, "reference_to_mesh")),
    )
    for number, (name, peer) in enumerate(PEERS.items()):
        found = sorted(
            (
                run
                for run in runs.values()
                if run.peer == name and run.purpose == "default" and run.outcome == "ok" and run.cloud != "bunny"
            ),
            key=lambda run: run.points,
        )
        for axis, title, value in wanted:
            dots = [(run.points, value(run), run.solid) for run in found if value(run)]
            if dots:
                ours = name in (OURS, SMALL_BUDGET)
                style = {
                    "color": "black" if ours else f"C{number - 2}",
                    "linewidth": 2 if ours else 1,
                    "linestyle": ":" if name == SMALL_BUDGET else "-",
                }
                axis.loglog([x for x, _, _ in dots], [y for _, y, _ in dots], label=peer.title, **style)
                for solid in (True, False):
                    some = [(x, y) for x, y, is_solid in dots if is_solid == solid]
                    axis.loglog(
                        [x for x, _ in some],
                        [y for _, y in some],
                        "o",
                        color=style["color"],
                        markerfacecolor=style["color"] if solid else "white",
                    )
            axis.set(xlabel="points", title=title)
            axis.grid(True, alpha=0.3)
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize=8)
    figure.suptitle("The horse and samples of it, at defaults; full dots: closed, and the volume is right to a tenth", fontsize=9)
    figure.savefig(path, dpi=120)


def write(bench, refused):
    runs = {key: run for key, run in bench.runs.items() if run.peer != "normals"}
    if not runs:
        sys.exit("there are no runs yet")
    bench.arguments.out.mkdir(parents=True, exist_ok=True)
    stem = bench.arguments.out / f"{datetime.date.today()}-peers"
    dates = sorted({run.date[:10] for run in runs.values()})
    caps = sorted({(run.caps[0], run.caps[1]) for run in runs.values()})
    told = "; ".join(f"{seconds:g} s and {memory / 2**30:g} GiB" for seconds, memory in caps)
    imports = {}
    for name in ("open3d", "pymeshlab"):
        sizes = [run.imported / 2**20 for run in runs.values() if run.peer.startswith(name) and run.imported]
        imports[name] = statistics.median(sizes or [0])
    Path(f"{stem}.md").write_text(f"""# {stem.name[:10]}: asra-stream and others

Made by `tools/peers.py`; runs of {", ".join(dates)}; asra-stream at {commit()}; {machine()}; {versions(bench)}. Caps of a run: {told}. Medians of
three where a run takes less than {SHORT:g} s, else one run.

The truth of the bunny is its scan, which has five holes: a mesh that closes them is off there, and its volume is only nearly comparable. Points of
the horse are its mesh's vertices, or samples of its surface by area (seed {SEED}). Distances in per cent of the truth's diagonal: root mean square
*to truth* from the centroids of the mesh's triangles, *from truth* from those of the truth's; the largest also of vertices. *Intersecting*:
triangles that meet another, as `check` counts them. *Volume*: by the truth's. *×*: by ours, in the same table at defaults, and of the row below at
matched triangles.

{NOTES.format(**imports)}

{in_short(runs)}
![Time, memory and error by number of points]({stem.name}.png)

{sections(runs, refused)}""")
    plots(runs, f"{stem}.png")
    print(f"{stem}.md")


def versions(bench):
    told = []
    for package in ("open3d", "pymeshlab"):
        words = [sys.executable, "-c", f"from importlib.metadata import version; print(version('{package}'))"]
        told.append(f"{package} {subprocess.run(words, capture_output=True, text=True).stdout.strip()}")
    header = Path("/usr/include/CGAL/version.h")
    if header.exists():
        told.append("CGAL " + next(line.split()[2] for line in header.read_text().splitlines() if line.startswith("#define CGAL_VERSION ")))
    return ", ".join(told)


def size(text):
    """A cloud's name and its number of points, from what was given with --sizes."""
    if text in ("bunny", "horse"):
        return text, {"bunny": 35_947, "horse": 48_485}[text]
    text = text.upper()
    points = int(float(text[:-1]) * UNITS[text[-1]]) if text[-1] in UNITS else int(text)
    return f"horse-{points}", points


def amount(text):
    return int(float(text[:-1]) * 2 ** {"M": 20, "G": 30}[text[-1]])


def arguments_of():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, epilog="names: " + ", ".join(PEERS)
    )
    parser.add_argument("--models", type=Path, metavar="DIR", help="where horse.ply and stanford_bunny.ply are")
    parser.add_argument(
        "--sizes", default="bunny,horse,100K,500K,2M,20M", help="clouds: bunny, horse, or numbers of samples [default: %(default)s]"
    )
    parser.add_argument("--only", metavar="NAMES", help="run these peers only, by the names below; asra-stream itself need not be named")
    parser.add_argument("--time-cap", type=float, default=300, metavar="S", help="seconds that a run may take [default: 300]")
    parser.add_argument("--memory-cap", type=amount, default="16G", metavar="SIZE", help="memory that a run may take [default: 16G]")
    parser.add_argument("--minutes", type=float, help="begin no run after so many minutes")
    parser.add_argument("--poissonrecon", type=Path, metavar="PROGRAM", help="the PoissonRecon program, if there is one")
    parser.add_argument("--tight-cocone", type=Path, metavar="PROGRAM", help="the Tight Cocone program, if there is one")
    parser.add_argument("--power-crust", type=Path, metavar="PROGRAM", help="the Power Crust program, if there is one")
    parser.add_argument("--again", action="store_true", help="make runs again that were made before")
    parser.add_argument("--force", action="store_true", help="run also what hit a cap with fewer points, or certainly will")
    parser.add_argument("--plan", action="store_true", help="say what would be run, and stop")
    parser.add_argument(
        "--work",
        type=Path,
        default=ROOT / "target/peers",
        metavar="DIR",
        help="where clouds, meshes and runs are kept [default: target/peers]",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=ROOT / "benches/results",
        metavar="DIR",
        help="where tables and plots are written [default: benches/results]",
    )
    parser.add_argument("--program", type=Path, help="asra-stream, instead of one built here")
    arguments = parser.parse_args()
    arguments.sizes = [size(text) for text in arguments.sizes.split(",")]
    there = {name: getattr(arguments, name.replace("-", "_")) for name in OPTIONAL}
    arguments.programs = {name: path.resolve() for name, path in there.items() if path}
    names = arguments.only.split(",") if arguments.only else [name for name in PEERS if name not in OPTIONAL or name in arguments.programs]
    for name in names:
        if name not in PEERS:
            parser.error(f"no peer {name}; there are {', '.join(PEERS)}")
    for name in OPTIONAL:
        if name in names and name not in arguments.programs:
            parser.error(f"where is {PEERS[name].title}? --{name} PROGRAM")
    for name, path in arguments.programs.items():
        if not path.is_file():
            parser.error(f"--{name} {path}: there is no such program")
    arguments.only = list(dict.fromkeys([OURS, *names]))
    arguments.work = arguments.work.resolve()
    arguments.started = datetime.datetime.now().isoformat(timespec="seconds")
    return arguments


def main():
    if sys.argv[1:2] == ["work"]:
        return work(*sys.argv[2:])
    if sys.argv[1:2] == ["foreign"]:
        return foreign(*sys.argv[2:])
    if sys.argv[1:2] == ["cloud"]:
        return make_cloud(sys.argv[2], sys.argv[3], int(sys.argv[4]))
    arguments = arguments_of()
    todo = plan(arguments)
    if arguments.plan:
        for hopeless, points, cloud, name, seconds in todo:
            print(f"{points:>12,}  {name:26}{seconds:8.1f} s{'  probably hits a cap' if hopeless else ''}")
        print(
            f"{sum(one[4] for one in todo if not one[0]) / 60:.0f} minutes without those; "
            "runs at matched triangles and measuring come on top: as much again"
        )
        return
    environment("peers", PACKAGES)
    bench, refused = Bench(arguments), {}
    if not bench.out_of_time():
        if not arguments.models:
            sys.exit("where are the models? --models DIR")
        for cloud, _ in arguments.sizes:
            if not bench.truth(cloud):
                sys.exit(f"{arguments.models} has no model for {cloud}: horse.ply and stanford_bunny.ply are needed, or the same with .gz")
        for package in ("open3d", "pymeshlab"):
            if any(name.startswith(package) or (package == "open3d" and PEERS[name].normals) for name in arguments.only):
                must_import(package)
        bench.program = built(arguments.program)
        if any(name.startswith("cgal-") for name in arguments.only):
            build_drivers(arguments.work / "drivers")
        for _, points, cloud, name, _ in todo:
            run = bench.make(Run(cloud, points, name, "default", PEERS[name].default))
            refused[cloud, name] = run
            bench.matched(run)
    write(bench, refused)


if __name__ == "__main__":
    stoppable(main, "stopped; what is done is kept, call it again to continue")
