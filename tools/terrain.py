#!/usr/bin/env python3
"""How near terrain and bare earth lie to points that they were not made of, beside a triangulation and inverse distances of the same points; and how well
the ground filter tells ground from objects, beside a cloth simulation and, where `pdal` is on the path, PDAL's filters.

    cargo build --release
    tools/terrain.py held PROGRAM TILE.laz ... --surface ground|terrain [--try NAME='OPTIONS' ...]
    tools/terrain.py filter PROGRAM TILE.laz ...

`held` leaves every tenth point out (of the ground: every tenth of class 2), meshes the others, and measures vertical distances of those that were left out
from the highest surface there: median, root mean square, 95 and 99 % of the absolute values, the mean of the signed ones, and how many have no surface.
Of terrain they are told apart: *open ground* and *open roofs* are classes 2 and 6 with no point more than 1 m higher within a radius (--open); *crowns*
are classes 3, 4, 5 (class 1 where there is no other vegetation), first returns. `filter` tells types I and II and the total error in per cent against
classes 2 and 9; how far, root mean square and at 95 %, the triangulation of the ground that was found lies from that of the classes, in the middles of squares
of a metre; and seconds (medians of --runs, in turn) and peak memory. A Python environment is made in the user's cache.
"""

import argparse
import contextlib
import json
import os
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shared import environment, measured, stoppable, table

PACKAGES = ["numpy", "scipy", "laspy[lazrs]", "cloth-simulation-filter"]
EVERY = 10
GROUND, WATER, BUILDING, PLANTS = 2, 9, 6, (3, 4, 5)
NEIGHBOURS = 12
# Rows of pairs of a triangle and a place that are looked at together.
PAIRS = 20_000_000


class Tiles:
    """The points of the tiles, as one cloud."""

    def __init__(self, paths):
        import laspy
        import numpy as np

        self.files = [laspy.read(path) for path in paths]

        def column(name):
            return np.concatenate([np.asarray(file[name]) for file in self.files])

        self.places = np.stack([column("x"), column("y"), column("z")], axis=1)
        self.classes, self.returns = column("classification"), column("return_number")

    def write(self, keep, folder):
        """Writes the points of which `keep` is true, a file for each tile."""
        paths, first = [], 0
        for number, file in enumerate(self.files):
            part = keep[first : first + len(file.points)]
            first += len(file.points)
            if part.any():
                kept = type(file)(file.header, file.points[part])
                paths.append(folder / f"{number}.laz")
                kept.write(str(paths[-1]))
        return paths


def surface_heights(vertices, faces, places):
    """The height of the highest triangle over or below each place; NaN where there is none."""
    import numpy as np

    corners = vertices[faces]
    low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    side = max(float(np.median((high - low).max(axis=1))), 1e-9)
    origin = vertices[:, :2].min(axis=0) - side
    shape = np.ceil((vertices[:, :2].max(axis=0) - origin) / side).astype(np.int64) + 2
    bin_of = np.floor((places[:, :2] - origin) / side).astype(np.int64)
    within = ((bin_of >= 0) & (bin_of < shape)).all(axis=1)
    number = np.where(within, bin_of[:, 0] * shape[1] + bin_of[:, 1], -1)
    order = np.argsort(number, kind="stable")
    starts = np.searchsorted(number[order], np.arange(shape[0] * shape[1] + 1))
    heights = np.full(len(places), -np.inf)
    first, last = np.floor((low - origin) / side).astype(np.int64), np.floor((high - origin) / side).astype(np.int64)
    for dx in range(int((last - first)[:, 0].max()) + 1):
        for dy in range(int((last - first)[:, 1].max()) + 1):
            reached = np.nonzero((first[:, 0] + dx <= last[:, 0]) & (first[:, 1] + dy <= last[:, 1]))[0]
            bins = (first[reached, 0] + dx) * shape[1] + first[reached, 1] + dy
            counts = starts[bins + 1] - starts[bins]
            reached, bins, counts = reached[counts > 0], bins[counts > 0], counts[counts > 0]
            begin = 0
            while begin < len(reached):
                end = begin + max(1, int(np.searchsorted(np.cumsum(counts[begin:]), PAIRS)))
                some, many = reached[begin:end], counts[begin:end]
                triangle = np.repeat(some, many)
                offset = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
                place = order[np.repeat(starts[bins[begin:end]], many) + offset]
                a, b, c = corners[triangle, 0], corners[triangle, 1], corners[triangle, 2]
                ab, ac, ap = (b - a)[:, :2], (c - a)[:, :2], places[place, :2] - a[:, :2]
                area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
                with np.errstate(divide="ignore", invalid="ignore"):
                    v = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / area
                    w = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / area
                    inside = (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1 + 1e-9)
                    z = a[:, 2] + v * (b - a)[:, 2] + w * (c - a)[:, 2]
                np.maximum.at(heights, place[inside], z[inside])
                begin = end
    return np.where(np.isfinite(heights), heights, np.nan)


def triangulated(points, places):
    """Heights of the Delaunay triangulation of the points' x and y."""
    import numpy as np
    from scipy.interpolate import LinearNDInterpolator

    middle = points.mean(axis=0)
    return LinearNDInterpolator(points[:, :2] - middle[:2], points[:, 2])(places[:, :2] - middle[:2]).astype(np.float64)


def inverse_distances(points, places):
    """Means of the nearest points, weighed by 1 / d²."""
    import numpy as np
    from scipy.spatial import cKDTree

    middle = points[:, :2].mean(axis=0)
    far, near = cKDTree(points[:, :2] - middle).query(places[:, :2] - middle, NEIGHBOURS)
    weights = 1 / np.maximum(far, 1e-6) ** 2
    return (weights * points[near, 2]).sum(axis=1) / weights.sum(axis=1)


def row(name, which, found, places):
    import numpy as np

    signed = found - places[:, 2]
    known = np.isfinite(signed)
    off = np.abs(signed[known])
    if not len(off):
        return [name, which, len(places)] + ["–"] * 5 + [len(places)]
    figures = [np.median(off), np.sqrt((off**2).mean()), np.quantile(off, 0.95), np.quantile(off, 0.99)]
    return [name, which, len(places), *(f"{f:.3f}" for f in figures), f"{signed[known].mean():+.3f}", int((~known).sum())]


def is_open(points, places, radius):
    """Whether no point within the radius of a place is more than 1 m higher."""
    import numpy as np
    from scipy.spatial import cKDTree

    middle = points[:, :2].mean(axis=0)
    lists = cKDTree(points[:, :2] - middle).query_ball_point(places[:, :2] - middle, radius)
    return np.array([points[near, 2].max(initial=-np.inf) <= place[2] + 1 for near, place in zip(lists, places)], dtype=bool)


def held(arguments):
    import numpy as np

    from judge import read_ply

    tiles = Tiles(arguments.tiles)
    places, classes = tiles.places, tiles.classes
    ground = arguments.surface == "ground"
    candidates = np.nonzero(classes == GROUND)[0] if ground else np.arange(len(places))
    out = np.zeros(len(places), dtype=bool)
    out[candidates[::EVERY]] = True
    counts = ~out & np.isin(classes, [GROUND, WATER]) if ground else ~out
    if ground:
        groups = {"ground": out}
    else:
        clear = np.zeros(len(places), dtype=bool)
        clear[out] = is_open(places, places[out], arguments.open)
        plants = np.isin(classes, PLANTS)
        if not plants.any():
            plants = classes == 1
        groups = {
            "open ground": out & clear & (classes == GROUND),
            "open roofs": out & clear & (classes == BUILDING),
            "crowns": out & plants & (tiles.returns == 1),
        }
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        paths = tiles.write(~out, folder)
        for name, options in arguments.tries:
            mesh = folder / "mesh.ply"
            command = [arguments.program, *paths, "--surface", arguments.surface, "--overwrite", "-q", "-o", mesh, *shlex.split(options)]
            subprocess.run(command, check=True)
            vertices, faces = read_ply(mesh)
            for which, chosen in groups.items():
                if chosen.any():
                    rows.append(row(f"{name} ({len(faces):,})", which, surface_heights(vertices, faces, places[chosen]), places[chosen]))
    for name, heights in (("TIN", triangulated), ("IDW", inverse_distances)):
        for which, chosen in groups.items():
            if chosen.any():
                rows.append(row(name, which, heights(places[counts], places[chosen]), places[chosen]))
    columns = ["mesh (triangles)", "of", "points", "median", "RMS", "95 %", "99 %", "bias", "out"]
    print(table(columns, sorted(rows, key=lambda row: list(groups).index(row[1]))))


@contextlib.contextmanager
def silent():
    """Nothing that a library writes to standard output is seen."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def errors(found, truth):
    """Types I and II and the total error, in per cent."""
    import numpy as np

    return [100 * np.mean(~found[truth]), 100 * np.mean(found[~truth]), 100 * np.mean(found != truth)]


def apart(found, truth, places):
    """How far the triangulations of two sets of the places lie apart: root mean square and 95 %, where both are."""
    import numpy as np

    if found.sum() < 3:
        return ["–", "–"]
    low, high = np.floor(places[:, :2].min(axis=0)), np.ceil(places[:, :2].max(axis=0))
    middles = np.stack(np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(low, high))), axis=-1).reshape(-1, 2)
    middles = np.column_stack([middles, np.zeros(len(middles))])
    off = np.abs(triangulated(places[found], middles) - triangulated(places[truth], middles))
    off = off[np.isfinite(off)]
    return [f"{np.sqrt((off**2).mean()):.3f}", f"{np.quantile(off, 0.95):.3f}"]


def in_turn(jobs, runs, folder):
    """Median seconds and largest resident MiB of each of the commands, which are run in turn."""
    took = {name: [] for name in jobs}
    for _ in range(runs):
        for name, command in jobs.items():
            ran = measured(command, folder / "log.txt")
            if ran["outcome"] != "ok":
                sys.exit(f"{name}: {ran['outcome']}\n{(folder / 'log.txt').read_text()}")
            took[name].append((ran["wall"], ran["peak"]))
    return {name: [f"{statistics.median(s for s, _ in of):.2f}", f"{max(r for _, r in of) / 2**20:.0f}"] for name, of in took.items()}


def filter_(arguments):
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        paths = [path.resolve() for path in arguments.tiles]
        ours = ["--surface", "ground", "--classes", "none", "--overwrite", "-q", "-o", folder / "mesh.ply"]
        jobs, told = {}, {"asra-stream, mesh included": folder / "out.laz"}
        jobs["asra-stream, mesh included"] = [arguments.program, *paths, *ours, "--write-classes", folder / "out.laz"]
        for stage in ("smrf", "csf", "pmf") if shutil.which("pdal") else ():
            # Points that a stage does not look at stay what they were; returns of number 0 are refused.
            first = [f"{name} = 1 WHERE {name} == 0" for name in ("ReturnNumber", "NumberOfReturns")]
            stages = [*map(str, paths), {"type": "filters.merge"}, {"type": "filters.assign", "value": ["Classification = 1", *first]}]
            stages += [{"type": f"filters.{stage}"}, {"type": "writers.las", "filename": str(folder / f"{stage}.laz"), "forward": "all", "minor_version": 4}]
            (folder / f"{stage}.json").write_text(json.dumps(stages))
            jobs[f"PDAL, {stage}"], told[f"PDAL, {stage}"] = ["pdal", "pipeline", folder / f"{stage}.json"], folder / f"{stage}.laz"
        # Before anything large is imported.
        took = in_turn(jobs, arguments.runs, folder)
        # The cloth's threads would spin where they wait.
        os.environ.setdefault("OMP_WAIT_POLICY", "passive")

        import CSF
        import laspy
        import numpy as np

        tiles, rows = Tiles(paths), []
        judged = tiles.classes != WATER
        truth = tiles.classes == GROUND

        def judge(name, found, took):
            wrong = errors(found[judged], truth[judged])
            rows.append([name, *(f"{e:.2f}" for e in wrong), *apart(found & judged, truth, tiles.places), *took])

        for name, path in told.items():
            file = laspy.read(path)
            # The points come back in their order.
            assert np.allclose(np.asarray(file.x), tiles.places[:, 0], atol=0.02), name
            judge(name, np.asarray(file.classification) == GROUND, took[name])
        for rigidness in (1, 2, 3):
            cloth = CSF.CSF()
            cloth.params.bSloopSmooth = rigidness < 3
            cloth.params.cloth_resolution, cloth.params.class_threshold, cloth.params.rigidness = 1.0, 0.5, rigidness
            began = time.monotonic()
            on, off = CSF.VecInt(), CSF.VecInt()
            with silent():
                cloth.setPointCloud(tiles.places - tiles.places.mean(axis=0))
                cloth.do_filtering(on, off, False)
            found = np.zeros(len(tiles.places), dtype=bool)
            found[np.array(on)] = True
            judge(f"cloth, rigidness {rigidness}", found, [f"{time.monotonic() - began:.2f}", "–"])
    print(table(["filter", "type I, %", "type II, %", "total, %", "RMS, m", "95 %, m", "seconds", "MiB"], rows))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["held", "filter"])
    parser.add_argument("program")
    parser.add_argument("tiles", nargs="+", type=Path)
    parser.add_argument("--surface", choices=["ground", "terrain"], default="ground")
    parser.add_argument("--open", type=float, default=0.5, metavar="RADIUS", help="round open points, in metres")
    parser.add_argument("--runs", type=int, default=3, help="of each program that filters")
    parser.add_argument("--try", dest="tries", action="append", type=lambda text: tuple(text.split("=", 1)), help="a name and options")
    arguments = parser.parse_args()
    environment("terrain", PACKAGES)
    arguments.tries = arguments.tries or [("default", "")]
    {"held": held, "filter": filter_}[arguments.what](arguments)


if __name__ == "__main__":
    stoppable(main, "stopped")
