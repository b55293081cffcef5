#!/usr/bin/env python3
"""The paper's Tables 1 to 6 and Figs. 7 and 8, made anew by asra-stream on the models there are, beside the paper's own figures.

    tools/paper.py --models DIR              writes benches/results/DATE-paper.md, DATE-paper-k.png and DATE-paper-n.png
    tools/paper.py --models DIR --out DIR    writes them somewhere else

Builds the program for release first, unless --program names one. The models are not in this repository; --models names the folder where they are,
as .ply or .ply.gz: stanford_bunny, horse, rocker_arm, armadillo_points, stanford_dragon, and, who has them, santa, golf_ball, happy_buddha,
hand_and_ball, blade, xyzrgb_dragon. What is not there is marked missing. Takes a few minutes; makes itself a Python environment with matplotlib and
Open3D.

    tools/paper.py --models DIR --references DIR    Table 5 alone, to standard output, against the meshes that the paper measured by: Tight Cocone's

--references names the folder of bunny_tight_cocone and armadillo_tight_cocone, as .ply or .ply.gz.
"""

import argparse
import datetime
import json
import statistics
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from bench import machine
from shared import PACKAGES, ROOT, built, commit, digits, environment, measured, model, must_import, stoppable, table

MEASURES = {"nearest": "nearest", "off_holes": "off the holes", "along_normal": "along normal", "nearest_point": "nearest point"}
# The paper's 2.4, 3.2, 4.0 and 4.8, what lies between, and beyond.
SWEEP = [round(1.6 + 0.4 * step, 1) for step in range(13)]
DEFAULT_K = 4.0
# A triangle bridges a hole if its centroid is farther than so many sampling distances from any point.
BRIDGED = 3


class Model(NamedTuple):
    """A model of the paper, with what the paper says of it; None is not known to us."""

    name: str
    file: str
    axis: str
    points: int | None = None
    slices: int | None = None
    raster: str | None = None
    seconds: float | None = None
    # The genus of the body, if it is known.
    genus: int | None = None
    # (MSE, AVR) by k.
    errors: dict = {}
    # MSE with random diagonals, and with Delaunay's.
    diagonals: tuple | None = None
    note: str = ""


MODELS = [
    Model("Rocker arm", "rocker_arm.ply", "z", 30_133, 124, "64×38", 2.15, genus=1, note="ours is the version of 10,044 points"),
    Model(
        "Bunny",
        "stanford_bunny.ply",
        "y",
        35_947,
        132,
        "134×104",
        5.48,
        genus=0,
        errors={2.4: (0.285, 21.88), 3.2: (0.099, 0.47), 4.0: (0.044, 0.21), 4.8: (0.020, 0.16)},
        diagonals=(0.0441, 0.0440),
        note="the reference is open: five holes",
    ),
    Model("Horse", "horse.ply", "z", 48_487, 145, "80×174", 4.60, genus=0, note="ours has 48,485 points"),
    Model("Santa", "santa.ply", "longest", 75_782, 169, "188×159", 6.78),
    Model("Golf ball", "golf_ball.ply", "longest", 122_882, 198, "198×199", 16.10),
    Model(
        "Armadillo",
        "armadillo_points.ply",
        "y",
        172_975,
        222,
        "187×170",
        12.59,
        genus=0,
        errors={2.4: (0.207, 0.98), 3.2: (0.090, 0.83), 4.0: (0.048, 0.64), 4.8: (0.026, 0.26)},
        diagonals=(0.0484, 0.0482),
        note="points only; a Poisson reconstruction stands in for the surface",
    ),
    Model("Happy Buddha", "happy_buddha.ply", "longest", 543_652, 326, "134×135", 26.50),
    Model("Hand and ball", "hand_and_ball.ply", "longest", 654_651, 347, "262×166", 21.39),
    Model("Blade", "blade.ply", "longest", 1_765_913, 483, "363×315", 87.17),
    Model("Dragon", "xyzrgb_dragon.ply", "longest", 3_609_601, 613, "341×408", 103.18),
    Model("Stanford dragon", "stanford_dragon.ply", "longest", note="not in the paper, whose dragon has eight times as many points"),
]


class Tool:
    """The program, and the folder it works in."""

    def __init__(self, program, work):
        self.program, self.work = program, work

    def run(self, *words):
        log = self.work / "log.txt"
        told = measured([self.program, *words], log)
        if told["outcome"] != "ok":
            raise SystemExit(f"{' '.join(map(str, words))}: {told['outcome']}\n{log.read_text(errors='replace')}")
        return told

    def reconstruct(self, cloud, axis, *options):
        """The mesh, the program's report, and what the process took."""
        mesh, report = self.work / "mesh.ply", self.work / "run.json"
        told = self.run(cloud, "--axis", axis, *options, "-q", "-o", mesh, "--overwrite", "--report", report, "--temp-dir", self.work)
        return mesh, json.loads(report.read_text()), told

    def compare(self, mesh, reference):
        report = self.work / "compare.json"
        self.run("compare", mesh, reference, "-q", "--report", report, "--temp-dir", self.work)
        return json.loads(report.read_text())


def errors_of(tool, mesh, cloud, surface):
    """All that is measured of a mesh, against the model's points and its surface."""
    told = tool.compare(mesh, surface)
    reference = told["reference"]
    points = told if surface == cloud else tool.compare(mesh, cloud)
    return {
        **told["mse"],
        "nearest_point": points["mse"]["nearest_point"],
        "off_holes": off_holes(mesh, surface),
        "avr": told["avr"],
        # That of an open surface is not a body's.
        "truth": reference["volume"] if reference["closed"] else None,
    }


def off_holes(mesh, surface):
    """MSE as `nearest`, without triangles whose nearest place lies on the surface's boundary: where a hole of it was closed, there is no error to
    measure. None if it has no boundary."""
    import numpy
    import open3d

    vertices, faces = load(surface, numpy)
    # Vertices at one place are one.
    places, number = numpy.unique(vertices, axis=0, return_inverse=True)
    faces = number.ravel()[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    # Edge i lies opposite to corner i.
    edges = numpy.sort(faces[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2), axis=1)
    _, edge, uses = numpy.unique(edges, axis=0, return_inverse=True, return_counts=True)
    open_edges = (uses == 1)[edge.ravel()].reshape(-1, 3)
    if not open_edges.any():
        return None
    rim = numpy.zeros(len(places), bool)
    rim[edges[open_edges.ravel()].ravel()] = True
    corner, side = vertices.min(axis=0), (vertices.max(axis=0) - vertices.min(axis=0)).max()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(((places - corner) / side).astype("f4"), faces.astype("u4"))
    corners, triangles = load(mesh, numpy)
    middles = ((corners[triangles].mean(axis=1) - corner) / side).astype("f4")
    found = scene.compute_closest_points(middles)
    face, (u, v) = found["primitive_ids"].numpy(), found["primitive_uvs"].numpy().T
    weights = numpy.stack([1 - u - v, u, v], axis=1)
    on_rim = ((weights < 1e-4) & open_edges[face]) | ((weights > 1 - 1e-4) & rim[faces[face]])
    distances = 100 * numpy.linalg.norm(found["points"].numpy() - middles, axis=1)[~on_rim.any(axis=1)].astype(float)
    return 100 * float((distances**2).mean())


def surface_of(cloud, path):
    """Open3D's Poisson reconstruction of the points, which stands in for the surface of a model that has points only."""
    import open3d

    points = open3d.io.read_point_cloud(str(cloud))
    points.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
    points.orient_normals_consistent_tangent_plane(30)
    surface, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=10)
    open3d.io.write_triangle_mesh(str(path), surface, write_vertex_normals=False)
    return path


def has_faces(path):
    with open(path, "rb") as file:
        header = file.read(4096).split(b"end_header")[0].decode()
    return any(line.split()[:2] == ["element", "face"] and int(line.split()[2]) > 0 for line in header.splitlines())


def load(path, numpy):
    """Vertices and triangles of a binary PLY file whose faces are triangles."""
    data = path.read_bytes()
    header, body = data.split(b"end_header\n", 1)
    types = {"double": "<f8", "float": "<f4", "uchar": "u1", "int": "<i4", "uint": "<u4", "ushort": "<u2"}
    counts, fields, element = {}, {}, None
    for words in (line.split() for line in header.decode().splitlines()):
        if words[0] == "element":
            element = words[1]
            counts[element], fields[element] = int(words[2]), []
        elif words[0] == "property" and words[1] == "list":
            fields[element] += [("sides", types[words[2]]), ("corners", types[words[3]], 3)]
        elif words[0] == "property":
            fields[element].append((words[2], types[words[1]]))
    records = numpy.frombuffer(body, fields["vertex"], counts["vertex"])
    vertices = numpy.stack([records[axis] for axis in "xyz"], axis=1).astype(float)
    if not counts.get("face"):
        return vertices, numpy.empty((0, 3), int)
    faces = numpy.frombuffer(body, fields["face"], counts["face"], records.nbytes)
    return vertices, faces["corners"].astype(int)


def timed(tool, cloud, axis, runs, *options):
    """The medians of so many runs: the report of the last, wall and processor seconds."""
    told = [tool.reconstruct(cloud, axis, *options) for _ in range(runs)]
    mesh, report, _ = told[-1]
    return mesh, report, {key: statistics.median(one[2][key] for one in told) for key in ("wall", "cpu")}


def stages(report):
    return ", ".join(f"{name} {digits(1000 * seconds, 2)}" for name, seconds in report["seconds"])


def sweep(tool, one, cloud, surface):
    """A record for each k: errors, what the check found."""
    found = []
    for k in SWEEP:
        mesh, report, _ = tool.reconstruct(cloud, one.axis, "--k", str(k))
        check = {key: report["check"][key] for key in ("volume", "closed", "components", "genus", "triangles")}
        found.append({"k": k, **errors_of(tool, mesh, cloud, surface), **check, "sealed": report["closing"]["sealed"]})
    volume = abs(found[0]["truth"] or statistics.median(record["volume"] for record in found))
    for record in found:
        record["ratio"] = record["volume"] / volume
        body = record["closed"] and record["components"] == 1 and abs(record["ratio"] - 1) <= 0.01
        record["sound"] = body and one.genus in (None, record["genus"])
    return found


def error_of(record):
    """The MSE that is set beside the paper's: to the nearest place, off the holes of an open reference."""
    return record["nearest"] if record["off_holes"] is None else record["off_holes"]


def told(ks):
    return ", ".join(f"{k:g}" for k in ks) or "none"


def verdict(swept, names):
    """Whether k = 4 is the choice for these models, by the criterion that the text states."""
    at = SWEEP.index(DEFAULT_K)
    everywhere = [k for number, k in enumerate(SWEEP) if all(swept[name][number]["sound"] for name in names)]
    better = [
        k for k in everywhere if k > DEFAULT_K and all(error_of(swept[name][SWEEP.index(k)]) < error_of(swept[name][at]) for name in names)
    ]
    if not names:
        return "none of them is there."
    if DEFAULT_K not in everywhere:
        found = f"**k = 4 is not confirmed**: it is not sound on {', '.join(name for name in names if not swept[name][at]['sound'])}."
    elif better:
        found = f"**k = 4 is confirmed as sound, but not as the best**: {told(better)}, too, sound on all, and with a smaller MSE on each."
    else:
        found = "**k = 4 is confirmed**: sound on all, and no larger k is that and has a smaller MSE on each."
    return f"{found} Sound on all: {told(everywhere)}."


def verdicts(swept):
    """The verdict on the paper's models, that on all, since one may hide what the other shows, and where each model is sound."""
    papers = [one.name for one in MODELS if one.points and one.name in swept]
    lines = [
        f"* The paper's models: {verdict(swept, papers)}",
        f"* With the Stanford dragon, if it is there: {verdict(swept, list(swept))}",
    ]
    lines += [f"* {name} is sound at {told([record['k'] for record in found if record['sound']])}." for name, found in swept.items()]
    return "\n".join(lines)


def pictures(swept, timings, stem):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    papers = {one.name: one.errors for one in MODELS}
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for number, (name, found) in enumerate(swept.items()):
        colour = f"C{number}"
        axes[0].semilogy(SWEEP, [error_of(one) for one in found], "-", color=colour, label=name)
        axes[0].semilogy(SWEEP, [error_of(one) if one["sound"] else None for one in found], "o", color=colour)
        if found[0]["avr"] is not None:
            axes[1].semilogy(SWEEP, [one["avr"] for one in found], "-o", color=colour, label=name)
        axes[2].semilogy(SWEEP, [one["triangles"] for one in found], "-o", color=colour, label=name)
        for which in (0, 1):
            if papers[name]:
                axes[which].semilogy(
                    list(papers[name]),
                    [pair[which] for pair in papers[name].values()],
                    "x--",
                    color=colour,
                    alpha=0.6,
                    label=f"{name}, paper",
                )
    for axis, name in zip(axes, ("MSE (dots: sound)", "AVR, %", "triangles")):
        axis.axvline(DEFAULT_K, color="grey", linewidth=0.7)
        axis.set(xlabel="k", title=name)
        axis.grid(True, alpha=0.3)
    axes[0].legend(fontsize=7)
    axes[1].legend(fontsize=7)
    figure.savefig(f"{stem}-k.png", dpi=120)

    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    for number, (name, found) in enumerate(timings.items()):
        axis.loglog([n for n, _ in found], [seconds for _, seconds in found], "o-", label=name)
    theirs = sorted((one.points, one.seconds) for one in MODELS if one.seconds)
    axis.loglog(*zip(*theirs), "x--", color="grey", label="paper, 2012")
    axis.set(xlabel="points", ylabel="processor seconds at k = 4")
    axis.grid(True, alpha=0.3)
    axis.legend(fontsize=7)
    figure.savefig(f"{stem}-n.png", dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, metavar="DIR", help="where the models are; without it, all are missing")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "benches/results", metavar="DIR", help="where to write [default: benches/results]"
    )
    parser.add_argument("--references", type=Path, metavar="DIR", help="where Tight Cocone's meshes are: Table 5 against these, and nothing else")
    parser.add_argument("--runs", type=int, default=3, help="runs that a time is the median of [default: 3]")
    parser.add_argument("--rounds", type=int, default=2, help="rounds of densification [default: 2]")
    parser.add_argument("--program", type=Path, help="the program, instead of one built here")
    arguments = parser.parse_args()
    environment("peers", PACKAGES)
    must_import("open3d")
    program = built(arguments.program)
    if arguments.references:
        with tempfile.TemporaryDirectory(prefix="asra-stream-paper-") as work:
            against_references(arguments, Tool(program, Path(work)))
        return
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="asra-stream-paper-") as work:
        write(arguments, Tool(program, Path(work)))


def against_references(arguments, tool):
    """Table 5 against the meshes that the paper measured by, bridged triangles apart."""
    rows = []
    for one in MODELS:
        cloud = model(arguments.models, one.file, tool.work)
        surface = model(arguments.references, f"{one.name.lower()}_tight_cocone.ply", tool.work)
        if not (one.errors and cloud and surface):
            continue
        tool.run("info", cloud, "--json")
        told = (tool.work / "log.txt").read_text()
        # Progress comes before.
        reach = BRIDGED * json.loads(told[told.index("{\n") :])["sampling_distance"]
        for k, (mse, avr) in one.errors.items():
            mesh, report, _ = tool.reconstruct(cloud, one.axis, "--k", str(k))
            found, check = tool.compare(mesh, surface), report["check"]
            apart = bridges(mesh, surface, cloud, reach)
            rows.append(
                [
                    one.name,
                    f"{k:g}",
                    *(digits(value) for value in (mse, avr, found["mse"]["nearest"], apart["near"], apart["share"], apart["area"])),
                    f"{apart['triangles']:,}",
                    digits(found["avr"]),
                    f"{check['triangles']:,}",
                    check["components"],
                    check["genus"],
                ]
            )
    if not rows:
        sys.exit("neither the bunny's nor the armadillo's points and reference are there")
    told = ["paper's MSE:", "AVR %:", "MSE:", "without bridged:", "bridged, % of the squares:", "% of the area:", "triangles:", "AVR %:"]
    print(table(["model", "k:", *told, "all triangles:", "components:", "genus:"], rows))


def bridges(mesh, surface, cloud, reach):
    """The MSE without the triangles whose centroids are farther than this from any point; and how many these are, their share of the squares and of the area in per cent."""
    import numpy
    import open3d

    vertices, faces = load(surface, numpy)
    corner, side = vertices.min(axis=0), (vertices.max(axis=0) - vertices.min(axis=0)).max()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(((vertices - corner) / side).astype("f4"), faces.astype("u4"))
    corners, triangles = load(mesh, numpy)
    middles = corners[triangles].mean(axis=1)
    squares = (100 * scene.compute_distance(((middles - corner) / side).astype("f4")).numpy().astype(float)) ** 2
    places = [open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz)) for xyz in (middles, load(cloud, numpy)[0])]
    far = numpy.asarray(places[0].compute_point_cloud_distance(places[1])) > reach
    sides = corners[triangles[:, 1:]] - corners[triangles[:, :1]]
    areas = numpy.linalg.norm(numpy.cross(sides[:, 0], sides[:, 1]), axis=1)
    return {
        "near": 100 * squares[~far].mean(),
        "share": 100 * squares[far].sum() / squares.sum(),
        "area": 100 * areas[far].sum() / areas.sum(),
        "triangles": int(far.sum()),
    }


def write(arguments, tool):
    date = datetime.date.today()
    stem = arguments.out / f"{date}-paper"
    clouds = {one.name: path for one in MODELS if (path := model(arguments.models, one.file, tool.work))}
    here = [one for one in MODELS if one.name in clouds]
    one_of, swept, timings = {}, {}, {}
    tables = {number: [] for number in (2, 3, 6)}
    for one in here:
        print(one.name, flush=True)
        cloud = clouds[one.name]
        mesh, report, took = timed(tool, cloud, one.axis, arguments.runs)
        one_of[one.name] = report
        timings[one.name] = [(report["points"]["count"], took["cpu"])]
        tables[2].append(
            [one.name, f"{report['points']['count']:,}", digits(one.seconds), digits(took["cpu"]), digits(took["wall"]), stages(report)]
        )
        surface = cloud if has_faces(cloud) else surface_of(cloud, tool.work / "surface.ply")
        dense(tool, one, cloud, surface, (mesh, report, took), arguments, tables[3], timings[one.name])
        swept[one.name] = sweep(tool, one, cloud, surface)
        errors = {}
        for way in ("random", "delaunay"):
            mesh, _, _ = tool.reconstruct(cloud, one.axis, "--diagonals", way)
            errors[way] = errors_of(tool, mesh, cloud, surface)
        # The paper's figures stand beside the measure that is compared with them.
        main = "nearest" if errors["random"]["off_holes"] is None else "off_holes"
        for key, name in MEASURES.items():
            if errors["random"][key] is not None:
                theirs = one.diagonals if one.diagonals and key == main else (None, None)
                both = [*theirs, *(errors[way][key] for way in ("random", "delaunay"))]
                tables[6].append([one.name, name, *(digits(value, 4) for value in both)])
    if here:
        pictures(swept, timings, stem)
    stem.with_name(f"{stem.name}.md").write_text(text(date, arguments, one_of, swept, tables))
    print(f"{stem}.md")
    if not here:
        print("no models: give --models DIR")


def dense(tool, one, cloud, surface, first, arguments, rows, times):
    """Rounds of densification by the centroids of the mesh's triangles; a row for each."""
    current, (mesh, report, took) = cloud, first
    for turn in range(arguments.rounds + 1):
        if turn:
            # Each round has a file of its own: the program refuses to write over what it reads.
            denser = tool.work / f"dense-{turn}.ply"
            tool.run("densify", mesh, current, "-o", denser, "--overwrite")
            current = denser
            mesh, report, took = timed(tool, current, one.axis, arguments.runs)
            times.append((report["points"]["count"], took["cpu"]))
        errors = errors_of(tool, mesh, cloud, surface)
        rows.append(
            [
                one.name if turn == 0 else "",
                turn,
                f"{report['points']['count']:,}",
                report["grid"]["slices"],
                f"{report['output']['triangles']:,}",
                digits(took["cpu"]),
                digits(took["wall"]),
                *(digits(errors[key]) for key in MEASURES),
                digits(errors["avr"]),
            ]
        )


def text(date, arguments, one_of, swept, tables):
    """The whole report in Markdown."""
    first = []
    for one in MODELS:
        ours = one_of.get(one.name)
        if ours:
            grid = ours["grid"]
            mine = [f"{ours['points']['count']:,}", grid["axis"], grid["slices"], f"{grid['raster'][0]}×{grid['raster'][2]}"]
        else:
            mine = ["missing", "", "", ""]
        theirs = [f"{one.points:,}" if one.points else "–", one.slices or "–", one.raster or "–"]
        first.append([one.name, *theirs, *mine, one.note])
    missing = [
        [one.name, f"{one.points:,}" if one.points else "–", digits(one.seconds), "missing", "", ""]
        for one in MODELS
        if one.name not in one_of
    ]
    fourth, fifth = [], []
    for one in MODELS:
        for record in swept.get(one.name, []):
            k = record["k"]
            theirs = one.errors.get(k, (None, None))
            row = [*(digits(record[key]) for key in MEASURES), digits(record["avr"])]
            if k == DEFAULT_K:
                fourth.append([one.name, *row, record["along_normal_missed"], record["components"], record["genus"]])
            fifth.append(
                [
                    one.name if k == SWEEP[0] else "",
                    f"{k:g}",
                    *(digits(v) for v in theirs),
                    *row,
                    f"{record['triangles']:,}",
                    "yes" if record["sealed"] else "no",
                    digits(record["ratio"], 4),
                    record["components"],
                    record["genus"],
                    "yes" if record["sound"] else "no",
                ]
            )
    errors = [*(f"MSE {name}:" for name in MEASURES.values()), "AVR %:"]
    stem = f"{date}-paper"
    return f"""# {date}: the paper's tables

Repnik and Žalik, *A fast algorithm for approximate surface reconstruction from sampled points*, Advances in Engineering Software 53, 2012. Made by
`tools/paper.py`; asra-stream at {commit()}; {machine()}. k = {DEFAULT_K:g} where nothing else is said; input in the system's cache; times are of
whole processes, check and writing included, medians of {arguments.runs}. The paper's machine had 2.6 GHz, in 2012. A dash: not known, or there is
none.

MSE = 100 · mean(d²), d in per cent of the reference's longest side, at the centroids of the mesh's triangles. *Nearest*: d to the nearest place on
the reference's triangles. *Off the holes*: the same, without triangles whose nearest place lies on the reference's boundary: a hole was closed
there. *Along normal*: Eq. 5 by its letter, without the rays that meet nothing. *Nearest point*: d to the nearest vertex of the reference; most of
that is the distance between vertices, and it has not the magnitude of the paper's figures. So *nearest*, and off the holes where there are any, is
what we set beside the paper's: the choice rests on that magnitude, and Eq. 5 by its letter does not give it, for less than 1 % of the rays, which
meet the surface elsewhere, make up more than 99 % of it (horse, bunny and armadillo at k = 4). AVR: Eq. 6; the bunny's surface is open, its volume
depends on where it is measured from, and so does its AVR. Of the armadillo there are points only: all but *nearest point* is against Open3D's
Poisson reconstruction of them (depth 10), which is not the truth.

What we know of the paper are single figures, not all its columns. Where a table's columns are not known, that is said, and ours stand alone.

## Table 1: models

Points n, slices s = ⌊k ∛n⌋, raster.

{table(["model", "paper's n:", "s:", "raster:", "our n:", "axis", "s:", "raster:", "note"], first)}
## Table 2: processor seconds

The paper's total; how it was split by phases is not known to us.

{table(["model", "n:", "paper, s:", "ours, processor s:", "wall, s:", "stages, wall ms"], tables[2] + missing)}
## Table 3: denser by centroids

The centroids of the mesh's triangles are added to the cloud (`asra-stream densify`), which is reconstructed again, round by round. The paper's
figures are not known to us. Errors are against the model as it was.

{table(["model", "round:", "n:", "s:", "triangles:", "processor, s:", "wall, s:", *errors], tables[3])}
## Table 4: errors at k = 4

What the paper's Table 4 holds is not known to us beyond errors; these are ours, of all models. *Missed*: rays along the normal that met nothing.

{table(["model", *errors, "missed:", "components:", "genus:"], fourth)}
## Table 5, Fig. 7: errors by k

*Radius*: of the closing ball, in cells. *Volume*: the mesh's by the reference's (an open reference's: by the median over k).

{table(["model", "k:", "paper's MSE:", "AVR %:", *errors, "triangles:", "sealed:", "volume:", "components:", "genus:", "sound"], fifth)}
A k is *sound* on a model if the mesh is closed, has one component, the body's genus (bunny, horse, armadillo 0, rocker arm 1; of the others it is
not asked) and a volume within 1 % of the reference's. k = 4 counts as confirmed if it is sound on all models, and no
larger k of the sweep is sound on all of them and has a smaller MSE (nearest, off the holes) on each. The verdict is given twice: for the models of
the paper, and with the Stanford dragon, which is not one of them.

{verdicts(swept)}

![Errors and triangles by k]({stem}-k.png)

## Table 6: diagonals

{table(["model", "MSE", "paper, random:", "Delaunay:", "ours, random:", "Delaunay:"], tables[6])}
## Fig. 8: time by n

What the paper's Figs. 7 and 8 plot is known to us only as errors or time against k or n. Ours: the models and their densified clouds.

![Processor time by number of points]({stem}-n.png)
"""


if __name__ == "__main__":
    stoppable(main, "stopped")
