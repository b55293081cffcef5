#!/usr/bin/env python3
"""How near the surface lies to a truth that is known: asra-stream beside Poisson with estimated and with true normals, advancing front and alpha wrap.

    cargo build --release
    tools/near.py PROGRAM CASE... --data DIR --work DIR [--try 'NAME=OPTIONS']... [--match R] [--peers LIST] [--equal]

A CASE is BODY:POINTS[:CHANGE...]. BODY is a mesh in DIR (horse, rocker_arm, stanford_dragon, stanford_bunny; .ply or .ply.gz), `gauge`: a block with slots and fins whose widths
are sampling distances, or `comb`: twelve fins, as wide as the slots between them, width=SAMPLING DISTANCES. POINTS is a number of samples by area, or `own` for the mesh's vertices. CHANGEs: turn=DEGREES, noise=PERCENT (of the diagonal, Gaussian),
outliers=PERCENT (more points, evenly in the box), uneven=FACTOR (of density, along a direction), shift=PERCENT (every third of the points moved along a direction of its own, as by scans
that do not fit), layer=SAMPLING DISTANCES (every third of the points in one half moved inwards so far). The body's box has a diagonal of 1.

Each --try is a set of asra-stream's options, `default=` if there is none; --match looks for the --k that makes R triangles a point. --peers has some of poisson, poisson-true, front, wrap.
--equal brings every mesh to as many triangles as the first has, by `asra-stream simplify`, and measures it once more. Distances are exact, of 200,000 places each way, in per cent of
the diagonal. Prints a table for each case; results and meshes stay in the work folder. A Python environment is made in the user's cache; CGAL's programs are built as by
tools/peers.py.
"""

import argparse
import json
import shlex
import sys
from pathlib import Path

from shared import environment, last_line, measured, model, must_import, stoppable, table

PACKAGES = ["numpy", "scipy", "open3d", "manifold3d"]
PEERS = ["poisson", "poisson-true", "front", "wrap"]
SLOTS = [2, 3, 4, 5, 6, 8, 12]
FINS = [0.5, 1, 1.5, 2, 3, 4, 6]
# Alpha of alpha wrap, in sampling distances.
WRAP = 4.8
SECONDS = 400
SAMPLES = 200_000


def gauge(points):
    """A block with slots in its top and fins on its side, and places amid each: of slots to be outside, of fins inside."""
    import numpy as np
    from solids import block, solid

    spacing = 0.01
    for _ in range(8):
        part = block((1.6, 0.5, 0.4))
        depth, probes = 20 * spacing, {"slots": {}, "fins": {}}
        along, across = np.meshgrid(np.linspace(-0.8, 0.8, 9), np.linspace(0.1, 0.9, 5))
        for widths, kind in ((SLOTS, "slots"), (FINS, "fins")):
            at = -0.7
            for width in widths:
                wide = width * spacing
                at += wide / 2
                top = 0.2 - depth if kind == "slots" else -0.2
                piece = block((wide, 0.6 if kind == "slots" else 0.4, depth), (at, 0, top + (depth / 2 if kind == "slots" else -depth / 2)))
                part = part - piece if kind == "slots" else part + piece
                low = top if kind == "slots" else top - depth
                places = np.column_stack([np.full(along.size, at), 0.2 * along.ravel(), low + depth * across.ravel()])
                probes[kind][width] = places
                at += wide / 2 + 9 * spacing
        body = solid(part)
        spacing = (spacing + body.spacing(points)) / 2
    return body, probes


def comb(points, width):
    """A block with twelve fins, as wide as the slots between them."""
    from solids import block, solid

    spacing = 0.01
    for _ in range(8):
        wide, depth = width * spacing, 40 * spacing
        part = block((23 * wide, 0.5, 0.2), (0, 0, -0.1))
        for fin in range(12):
            part += block((wide, 0.5, depth + 0.02), ((2 * fin - 11) * wide, 0, depth / 2 - 0.01))
        body = solid(part)
        spacing = (spacing + body.spacing(points)) / 2
    return body


def made(case, arguments):
    """The truth, the cloud, its true normals and the probes of a case; box at 0, diagonal 1."""
    import numpy as np
    from judge import read_ply, volume
    from solids import Solid, rotation, sample

    name, points, *changes = case.split(":")
    change = {key: float(value) for key, value in (one.split("=") for one in changes)}
    unknown = set(change) - {"turn", "noise", "outliers", "uneven", "shift", "layer", "width"}
    if unknown:
        sys.exit(f"{case}: no change is called {', '.join(sorted(unknown))}")
    probes = {}
    if name == "gauge":
        body, probes = gauge(int(points))
    elif name == "comb":
        body = comb(int(points), change.get("width", 4))
    else:
        path = model(arguments.data, f"{name}.ply", arguments.work) if arguments.data else None
        if not path:
            sys.exit(f"{case}: --data has no {name}.ply")
        vertices, faces = read_ply(path)
        # Vertices at one place are one.
        vertices, number = np.unique(vertices, axis=0, return_inverse=True)
        faces = number.ravel()[faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])]
        body = Solid(vertices, faces if volume(vertices, faces) > 0 else faces[:, ::-1])
    turn = rotation(change.get("turn", 0))
    used = body.vertices[np.unique(body.faces)] @ turn.T
    low, size = used.min(0), np.linalg.norm(np.ptp(used, axis=0))
    moved = lambda places: (places @ turn.T - low) / size  # noqa: E731
    body = Solid(moved(body.vertices).astype(np.float32).astype(float), body.faces)
    probes = {kind: {width: moved(places) for width, places in of.items()} for kind, of in probes.items()}
    rng = np.random.default_rng(1)
    if points == "own":
        used, normals = np.unique(body.faces), np.zeros_like(body.vertices)
        for corner in range(3):
            np.add.at(normals, body.faces[:, corner], body.normals())
        used = used[rng.permutation(len(used))]
        cloud, normals = body.vertices[used], normals[used]
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    else:
        cloud, normals = sample(body, int(points), rng, change.get("uneven", 1.0))
        cloud = cloud.astype(float)
    if "shift" in change:
        ways = rng.normal(size=(3, 3))
        ways *= change["shift"] / 100 / np.linalg.norm(ways, axis=1, keepdims=True)
        cloud = cloud + ways[np.arange(len(cloud)) % 3]
    if "layer" in change:
        half = np.flatnonzero(cloud[:, 0] > np.median(cloud[:, 0]))[::3]
        cloud[half] -= change["layer"] * body.spacing(len(cloud)) * normals[half]
    if "noise" in change:
        cloud = cloud + rng.normal(0, change["noise"] / 100, cloud.shape)
    if "outliers" in change:
        more = cloud.min(0) + rng.random((round(len(cloud) * change["outliers"] / 100), 3)) * np.ptp(cloud, axis=0)
        cloud, normals = np.vstack([cloud, more]), np.vstack([normals, np.tile([0.0, 0.0, 1.0], (len(more), 1))])
    return body, cloud, normals, probes


def poisson(cloud, normals, mesh, is_true):
    """Open3D's, in a process of its own: orienting normals may not end."""
    import numpy as np
    import open3d
    from judge import read_ply, write_ply

    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(read_ply(Path(cloud))[0]))
    truth = np.load(normals)
    if is_true == "true":
        points.normals = open3d.utility.Vector3dVector(truth)
    else:
        points.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(16))
        points.orient_normals_consistent_tangent_plane(16)
        if (np.einsum("ij,ij->i", np.asarray(points.normals), truth) < 0).mean() > 0.5:
            points.normals = open3d.utility.Vector3dVector(-np.asarray(points.normals))
    made, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=8, n_threads=1)
    write_ply(mesh, np.asarray(made.vertices), np.asarray(made.triangles))


class Case:
    """A cloud and its truth, and what is made and measured of them."""

    def __init__(self, case, arguments):
        import numpy as np
        from judge import Truth, write_ply

        self.case, self.arguments = case, arguments
        self.base = arguments.work / case.replace(":", "_")
        self.body, points, normals, self.probes = made(case, arguments)
        self.count, self.spacing = len(points), self.body.spacing(len(points))
        self.cloud, self.normals = Path(f"{self.base}.ply"), Path(f"{self.base}.normals.npy")
        write_ply(self.cloud, points)
        np.save(self.normals, normals)
        self.truth = Truth(self.body.vertices, self.body.faces)
        write_ply(Path(f"{self.base}.truth.ply"), self.body.vertices, self.body.faces)
        self.rows, self.results, self.first = [], [], None

    def run(self, words):
        """Seconds, or why there is no mesh."""
        log = self.arguments.work / "log.txt"
        told = measured(words, log, SECONDS)
        return told["wall"], None if told["outcome"] == "ok" else f"{told['outcome']}: {last_line(log)}"

    def ours(self, mesh, *options):
        return self.run([self.arguments.program, self.cloud, "-o", mesh, "--overwrite", "-q", "-j", "1", *options])

    def matched(self, mesh, wanted):
        """The mesh by --k with the number of triangles that is nearest to so many; and that k."""
        from judge import read_ply

        low, high, best = 1.0, 16.0, None
        part = Path(f"{self.base}.search.ply")
        for _ in range(7):
            k = (low * high) ** 0.5
            seconds, failed = self.ours(part, "--k", f"{k:.4f}", "--no-check")
            if failed:
                high = k
                continue
            count = len(read_ply(part)[1])
            if best is None or abs(count - wanted) < abs(best[0] - wanted):
                best = count, k, seconds
                part.replace(mesh)
            low, high = (k, high) if count < wanted else (low, k)
        return (best[2], None, f" (k {best[1]:.2f})") if best else (0, "no k does", "")

    def peer(self, name, mesh):
        if name.startswith("poisson"):
            is_true = "true" if name.endswith("true") else "estimated"
            return self.run([sys.executable, __file__, "poisson", self.cloud, self.normals, mesh, is_true])
        if name == "front":
            return self.run([self.arguments.work / "drivers/advancing_front", self.cloud, mesh])
        return self.run([self.arguments.work / "drivers/alpha_wrap", self.cloud, mesh, 1 / (WRAP * self.spacing)])

    def measure(self, name, mesh, seconds, failed):
        """A row of the table, kept as JSON, too."""
        import numpy as np
        from judge import examine, inside, read_ply

        if failed:
            self.rows.append([name, failed, *[""] * (7 + len(self.probes))])
            return
        vertices, faces = read_ply(mesh)
        found = examine(vertices, faces)
        back, there = self.truth.root_mean_squares(vertices, faces)
        closed = found.open_edges == 0 and found.tangled_edges == 0
        whole = self.body.truth.volume
        share = abs(found.volume) / abs(whole) if found.volume is not None and whole else None
        rates = {}
        for kind, of in self.probes.items():
            is_in = {width: inside(vertices, faces, places) for width, places in of.items()}
            rates[kind] = {width: float(np.mean(~one if kind == "slots" else one)) for width, one in is_in.items()}
        self.results.append(
            {"case": self.case, "method": name, "triangles": len(faces), "closed": closed, "components": found.components, "genus": found.genus if closed else None}
            | {"mesh_to_truth": there, "truth_to_mesh": back, "volume": share, "seconds": seconds, **rates}
        )
        state = "yes" if closed else f"no ({found.open_edges} open, {found.tangled_edges} tangled)"
        told = [f"{there:.4f} / {back:.4f}", "–" if share is None else f"{share:.4f}", f"{seconds:.1f}"]
        shown = [" ".join(f"{rate:.2f}".rstrip("0").rstrip(".") for rate in of.values()) for of in rates.values()]
        self.rows.append([name, f"{len(faces):,}", state, found.components, found.genus if closed else "–", *told, *shown])

    def all(self):
        made = []
        for words in self.arguments.tries or ["default="]:
            name, _, options = words.partition("=")
            mesh = Path(f"{self.base}.{name}.ply")
            made.append((name, mesh, *self.ours(mesh, *shlex.split(options))))
        for ratio in self.arguments.match:
            mesh = Path(f"{self.base}.{ratio:g}n.ply")
            seconds, failed, k = self.matched(mesh, ratio * self.count)
            made.append((f"{ratio:g} n{k}", mesh, seconds, failed))
        for name in self.arguments.peers:
            mesh = Path(f"{self.base}.{name}.ply")
            made.append((name, mesh, *self.peer(name, mesh)))
        for one in made:
            self.measure(*one)
        if self.arguments.equal and self.results:
            self.equal(made)
        kinds = [f"{kind} {' '.join(f'{width:g}' for width in of)}" for kind, of in self.probes.items()]
        names = ["", "triangles:", "closed", "pieces:", "genus:", "mesh→truth / truth→mesh", "volume:", "seconds:", *kinds]
        print(f"\n**{self.case}**: {self.count:,} points, sampling distance {100 * self.spacing:.3f} %\n\n{table(names, self.rows)}", flush=True)
        (self.arguments.work / f"{self.base.name}.json").write_text(json.dumps(self.results, indent=1) + "\n")

    def equal(self, made):
        """The same meshes with as many triangles as the first."""
        from judge import read_ply

        wanted = self.results[0]["triangles"]
        for name, mesh, _, failed in made[1:]:
            if failed or len(read_ply(mesh)[1]) < wanted:
                continue
            fewer = mesh.with_suffix(".equal.ply")
            words = [self.arguments.program, "simplify", mesh, "--max-triangles", str(wanted), "--unsound", "-o", fewer, "--overwrite", "-q"]
            self.measure(f"{name}, equal", fewer, *self.run(words))


def main():
    if sys.argv[1:2] == ["poisson"]:
        return poisson(*sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("cases", nargs="+", metavar="CASE")
    parser.add_argument("--data", type=Path, metavar="DIR", help="where the meshes are")
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="where clouds, meshes and results are kept")
    parser.add_argument("--try", dest="tries", action="append", default=[], metavar="NAME=OPTIONS")
    parser.add_argument("--match", action="append", type=float, default=[], metavar="R", help="as many triangles for each point, by --k")
    parser.add_argument("--peers", default="", metavar="LIST", help=",".join(PEERS))
    parser.add_argument("--equal", action="store_true", help="measure all with as many triangles as the first, too")
    arguments = parser.parse_args()
    arguments.peers = [name for name in arguments.peers.split(",") if name]
    if wrong := set(arguments.peers) - set(PEERS):
        parser.error(f"no peer {', '.join(sorted(wrong))}; there are {', '.join(PEERS)}")
    environment("near", PACKAGES)
    must_import("open3d")
    arguments.program, arguments.work = arguments.program.resolve(), arguments.work.resolve()
    arguments.work.mkdir(parents=True, exist_ok=True)
    if {"front", "wrap"} & set(arguments.peers):
        from peers import build_drivers

        build_drivers(arguments.work / "drivers")
    for case in arguments.cases:
        Case(case, arguments).all()


if __name__ == "__main__":
    stoppable(main, "stopped")
