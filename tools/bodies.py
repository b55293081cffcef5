#!/usr/bin/env python3
"""Whether asra-stream makes the body that was scanned: pieces, genus and volume on bodies whose truth is known, and whether what it calls sealed is.

    cargo build --release
    tools/bodies.py matrix PROGRAM --work DIR      simple bodies, sampled, turned: --sizes, --turns, --axes, --bodies
    tools/bodies.py scans PROGRAM --work DIR --data DIR      simulated scans beside Open3D's Poisson on normals that it estimates
    tools/bodies.py holes PROGRAM --work DIR --data DIR      holes of shares of the surface: --places, --shares, --bodies
    tools/bodies.py clouds PROGRAM --work DIR --data DIR     real bodies, the same whatever the window
    tools/bodies.py raw PROGRAM --work DIR --data DIR        raw scans: told, not judged
    tools/bodies.py open PROGRAM --work DIR [--data DIR]     what has no inside must never be called sealed
    tools/bodies.py family PROGRAM --work DIR --seed N --count M      bodies at random

Prints a line for each case, then how many were wrong. A matrix case is excused where Open3D's Poisson with the true normals of the same points has
not the right pieces and genus either; one of the family where Poisson, without its specks, has not of the points without their noise. Bodies,
samples and what Poisson made of them are kept in the work folder. A Python environment is made in the user's cache.
"""

import argparse
import concurrent.futures
import dataclasses
import json
import os
import re
import shlex
import shutil
import sys
import zlib
from pathlib import Path

from shared import environment, model, must_import, stoppable

PACKAGES = ["numpy", "scipy", "open3d", "manifold3d"]
WINDOWS = ["default", "3"]
EVERY = ["default", "3", "5", "7"]
# From so many points on, volumes are judged, if walls and slots are so many sampling distances wide.
VOLUME_POINTS = 3000
VOLUME_SPACINGS = 2
VOLUME = 0.02
# How much farther off than Poisson's a scan's volume and distances may be.
SCAN_VOLUME = 0.005
SCAN_DISTANCE = 1.02
FAMILY_VOLUME = 0.03
# Holes of less than a tenth of the surface, and of a tenth and more.
HOLE_VOLUME = 0.03
LARGE_HOLE_VOLUME = 0.05
HOLE_SAMPLES = 50_000
# Of what lies clearly in a body on a floor, and clearly out of it.
FLOOR_SHARE = 0.98


@dataclasses.dataclass
class Case:
    """One run, and what is held against it."""

    name: str
    window: str
    cloud: object
    options: list = dataclasses.field(default_factory=list)
    # Takes what was made and measured, gives the reasons why it is wrong.
    judge: object = None
    # More numbers to tell and to keep.
    measure: object = None
    excused: bool = False
    # Whether only a claim to be sealed can be wrong.
    told_only: bool = False


def amount(ratio):
    return "–" if ratio is None else f"{ratio:.4f}"


def against(truth, tolerance):
    """Judges pieces, genus and, if there is a tolerance, volume."""

    def judge(made, _):
        body, reasons = made.body, []
        if body.components != truth.components:
            reasons.append(f"{body.components} pieces, not {truth.components}")
        if body.genus != truth.genus:
            reasons.append(f"genus {body.genus}, not {truth.genus}")
        if body.open_edges or body.tangled_edges:
            reasons.append(f"{body.open_edges} open and {body.tangled_edges} tangled edges")
        if tolerance and body.volume is not None and abs(body.volume / truth.volume - 1) > tolerance:
            reasons.append(f"volume {body.volume / truth.volume:.4f}")
        return reasons

    return judge


def measuring(truth):
    def measure(made):
        return {"volume_ratio": made.body.volume / truth.volume if made.body.volume is not None else None}

    return measure


def number_of(text):
    return zlib.crc32(text.encode())


# -- What is run


def carried_out(case, arguments):
    """Runs a case and gives its record."""
    import judge

    folder = arguments.runs
    name = re.sub(r"[^A-Za-z0-9.]+", "-", f"{arguments.what}-{case.name}-{case.window}")
    options = case.options + shlex.split(arguments.options)
    made = judge.run(arguments.program, case.cloud, folder, name, case.window, options, arguments.seconds, arguments.keep)
    more, reasons = {}, []
    if made.outcome != "ok":
        if not case.told_only:
            reasons.append(f"{made.outcome}: {made.words}")
    else:
        if case.measure:
            more = case.measure(made)
        if case.judge:
            reasons = case.judge(made, more)
    verdict = "right" if not reasons else "excused" if case.excused else "wrong"
    if case.told_only and not case.judge:
        verdict = "told"
    record = {"what": arguments.what, "case": case.name, "window": case.window, "outcome": made.outcome, "verdict": verdict}
    record |= {"reasons": reasons, "sealed": made.sealed, "seconds": round(made.seconds, 2), "digest": made.digest}
    return record | (dataclasses.asdict(made.body) if made.body else {}) | more


def line(record):
    parts = []
    if "components" in record:
        parts.append(f"{record['components']} pieces, genus {record['genus']}")
        parts += [f"{record['open_edges']} open edges"] if record["open_edges"] else []
        if "volume_ratio" in record:
            parts.append(f"volume {amount(record['volume_ratio'])}")
        elif record["volume"] is not None:
            parts.append(f"volume {record['volume']:.6g}")
        parts.append(f"{record['triangles']:,} triangles")
    parts += [f"{key} {value}" for key, value in record.get("tell", {}).items()]
    if record["sealed"]:
        parts.append("says sealed")
    if record["reasons"]:
        parts.append("BECAUSE " + "; ".join(record["reasons"]))
    elif record["outcome"] != "ok":
        parts.append(record["outcome"])
    return f"{record['verdict']:8}{record['case']} [{record['window']}]: {', '.join(parts)} ({record['seconds']:.1f} s)"


def run_all(cases, arguments, after=None):
    """Runs the cases in turn, tells of each and of all."""
    if arguments.prepare:
        return
    wanted = [case for case in cases if arguments.only in case.name] if arguments.only else cases
    records = []
    if arguments.output:
        arguments.output.write_text("")

    def tell(record):
        records.append(record)
        print(line(record), flush=True)
        if arguments.output:
            with open(arguments.output, "a") as out:
                out.write(json.dumps(record) + "\n")

    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for record in pool.map(lambda case: carried_out(case, arguments), wanted):
            tell(record)
    for record in after(records) if after else []:
        tell(record)
    sealed = [record for record in records if record["sealed"]]
    false = [record for record in sealed if record["reasons"]]
    pardoned = sum(1 for record in false if record["verdict"] == "excused")
    judged = [record for record in records if record["verdict"] != "told"]
    wrong = sum(1 for record in judged if record["verdict"] == "wrong")
    excused = sum(1 for record in judged if record["verdict"] == "excused")
    print(
        f"wrong {wrong} of {len(judged)} ({excused} more excused); says sealed and is wrong: {len(false)} of {len(sealed)} ({pardoned} of them excused)"
    )


# -- Simple bodies


def of_poisson(key, points, normals, work, specks=True):
    """What Poisson makes of the points and the true normals, with its specks or without. Kept under the key."""
    import judge
    import solids

    def make():
        vertices, faces = solids.poisson(points, normals)
        return dataclasses.asdict(judge.examine(*((vertices, faces) if specks else judge.without_specks(vertices, faces))))

    return solids.remembered(work / f"poisson.{solids.VERSION}" / f"{key}.json", make)


def same_shape(found, truth):
    return (found["components"], found["genus"]) == (truth.components, truth.genus)


def judge_floor(body, points, turn):
    """A sphere on a floor is one closed body; the floor is left out, a sheet, or a slab that it may stand on."""
    import numpy as np

    import judge
    import solids

    rng = np.random.default_rng(5)
    way = rng.normal(size=(8000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    core = way[:4000] * rng.uniform(0, 0.9, (4000, 1))
    air = way[4000:] * rng.uniform(1.15, 1.6, (4000, 1))
    air = air[air[:, 2] > body.floor + 0.5]
    turning = solids.rotation(turn).T

    def verdict(made, _):
        reasons = []
        if made.body.components not in (1, 2):
            reasons.append(f"{made.body.components} pieces, not 1 or 2")
        if made.body.genus:
            reasons.append(f"genus {made.body.genus}, not 0")
        if points >= VOLUME_POINTS:
            vertices, faces = judge.closed_part(*made.mesh)
            full = judge.inside(vertices, faces, core @ turning).mean()
            free = 1 - judge.inside(vertices, faces, air @ turning).mean()
            if full < FLOOR_SHARE or free < FLOOR_SHARE:
                reasons.append(f"{full:.2f} of the sphere is inside, {free:.2f} of the air outside")
        return reasons

    return verdict


def matrix(arguments):
    import numpy as np

    import solids

    cases = []
    for name in arguments.bodies or solids.BODIES:
        upright = solids.BODIES[name]()
        for points in arguments.sizes:
            for turn in arguments.turns:
                body = upright.turned(turn)
                where, normals = solids.sample(body, points, np.random.default_rng([number_of(name), points]))
                key = f"{name}-{points}-{turn:g}"
                cloud = solids.stored(arguments.work / f"clouds.{solids.VERSION}" / f"{key}.ply", where)
                if upright.floor is None:
                    excused = not same_shape(of_poisson(key, where, normals, arguments.work), upright.truth)
                    volumes = points >= VOLUME_POINTS and upright.narrow >= VOLUME_SPACINGS * body.spacing(points)
                    judge, measure = against(upright.truth, VOLUME if volumes else None), measuring(upright.truth)
                else:
                    excused, judge, measure = False, judge_floor(upright, points, turn), None
                for axis in arguments.axes:
                    for window in arguments.window:
                        title = f"{name} {points} turn {turn:g} axis {axis}"
                        cases.append(Case(title, window, cloud, ["--axis", axis], judge, measure, excused))
    run_all(cases, arguments)


# -- Scans


def truth_of(path):
    """A closed mesh, facing outwards."""
    import judge
    import solids

    vertices, faces = judge.read_ply(path)
    return solids.Solid(vertices, faces if judge.volume(vertices, faces) > 0 else faces[:, ::-1])


def seen_from(arguments, cloud):
    """The option that names the file of the scan's positions."""
    positions = json.loads((arguments.data / "scans/positions.json").read_text())[cloud.stem]
    file = arguments.work / f"positions-{cloud.stem}.txt"
    file.write_text("".join(f"{scan} {x} {y} {z}\n" for scan, (x, y, z) in enumerate(positions)))
    return ["--seen-from", str(file)]


def scans(arguments):
    import judge
    import solids

    cases = []
    for body, file in (("horse", "horse.ply"), ("rocker", "rocker_arm.ply")):
        truth = truth_of(arguments.data / file)
        distances = judge.Truth(truth.vertices, truth.faces)
        for cloud in sorted((arguments.data / "scans").glob(f"{body}_*.ply")):

            def make(cloud=cloud, truth=truth, distances=distances):
                vertices, faces = solids.poisson(judge.read_ply(cloud)[0])
                # What is open would have no volume; the flux through it tells enough.
                ratio = judge.volume(vertices, faces) / truth.truth.volume
                found = dataclasses.asdict(judge.examine(vertices, faces))
                return found | {"volume_ratio": ratio, "rms": distances.root_mean_squares(vertices, faces)}

            peer = solids.remembered(arguments.work / f"poisson.{solids.VERSION}" / f"scan-{cloud.stem}.json", make)

            def measure(made, truth=truth, distances=distances, peer=peer):
                rms = distances.root_mean_squares(*made.mesh)
                beside = f"{rms[0]:.3f} and {rms[1]:.3f} %"
                theirs = f"{peer['components']} pieces, genus {peer['genus']}, volume {peer['volume_ratio']:.4f}, "
                theirs += f"RMS {peer['rms'][0]:.3f} and {peer['rms'][1]:.3f} %"
                found = measuring(truth.truth)(made)
                return found | {"rms": rms, "poisson": peer, "tell": {"RMS": beside, "| Poisson": theirs}}

            def verdict(made, more, truth=truth, peer=peer):
                reasons = against(truth.truth, None)(made, more)
                ratio = more["volume_ratio"]
                if ratio is not None and abs(ratio - 1) > abs(peer["volume_ratio"] - 1) + SCAN_VOLUME:
                    reasons.append(f"volume {ratio:.4f} beside {peer['volume_ratio']:.4f}")
                for way, ours, theirs in zip(("to the mesh", "to the truth"), more["rms"], peer["rms"], strict=True):
                    if ours > SCAN_DISTANCE * theirs:
                        reasons.append(f"RMS {way} {ours:.3f} beside {theirs:.3f} %")
                return reasons

            options = seen_from(arguments, cloud) if arguments.positions else []
            cases += [Case(cloud.stem, window, cloud, options, verdict, measure) for window in arguments.window]
    run_all(cases, arguments)


# -- Holes


def holes(arguments):
    import numpy as np

    import judge
    import solids

    makers = {
        "horse": lambda: truth_of(arguments.data / "horse.ply"),
        "rocker": lambda: truth_of(arguments.data / "rocker_arm.ply"),
        # The bunny's own triangles leave holes; these are of the same points, and closed.
        "bunny": lambda: truth_of(model(arguments.data / "reference", "bunny_tight_cocone.ply", arguments.work)),
        "sphere": solids.sphere,
    }

    cases = []
    for name in arguments.bodies or makers:
        body = makers[name]()
        cutter = None
        for share in arguments.shares:
            for place in range(arguments.places):
                cloud = arguments.work / f"clouds.{solids.VERSION}" / f"hole-{name}-{share:g}-{place}.ply"
                if not cloud.exists():
                    cutter = cutter or solids.Cutter(body)
                    rng = np.random.default_rng([number_of(name), int(1000 * share), place])
                    taken = cutter.cut(share / 100, rng)
                    if name == "sphere":
                        where, face = judge.surface_samples(body.vertices, body.faces, HOLE_SAMPLES, rng)
                        where = where[~taken[face]]
                    else:
                        where = body.vertices[np.unique(body.faces[~taken])]
                    solids.stored(cloud, where)
                tolerance = HOLE_VOLUME if share < 10 else LARGE_HOLE_VOLUME
                for window in arguments.window:
                    title = f"{name} hole {share:g} % place {place}"
                    cases.append(Case(title, window, cloud, [], against(body.truth, tolerance), measuring(body.truth)))
    run_all(cases, arguments)


# -- Real clouds

# Pieces and genus, where they are known.
CLOUDS = {
    "bunny": ("stanford_bunny.ply", 1, 0),
    "horse": ("horse.ply", 1, 0),
    "rocker": ("rocker_arm.ply", 1, 1),
    "armadillo": ("armadillo_points.ply", 1, 0),
    "dragon": ("stanford_dragon.ply", 1, None),
    "kitten": ("cgal_kitten.xyz", 1, 1),
    "building": ("cgal_building.ply", None, None),
}


def clouds(arguments):
    cases = []
    for name, (file, components, genus) in CLOUDS.items():

        def verdict(made, _, components=components, genus=genus):
            reasons = []
            if components is not None and made.body.components != components:
                reasons.append(f"{made.body.components} pieces, not {components}")
            if genus is not None and made.body.genus != genus:
                reasons.append(f"genus {made.body.genus}, not {genus}")
            if made.body.open_edges or made.body.tangled_edges:
                reasons.append(f"{made.body.open_edges} open and {made.body.tangled_edges} tangled edges")
            return reasons

        cloud = model(arguments.data, file, arguments.work)
        cases += [Case(name, window, cloud, [], verdict) for window in arguments.window]

    def agreement(records):
        for name in CLOUDS:
            same = [record for record in records if record["case"] == name and record["outcome"] == "ok"]
            if len(same) < 2:
                continue
            kinds = {"genus": "genus", "digest": "bytes"}
            reasons = [f"{word} differ by window" for key, word in kinds.items() if len({record[key] for record in same}) > 1]
            verdict = "wrong" if reasons else "right"
            record = {"what": "clouds", "case": f"{name} over windows", "window": "all", "outcome": "ok", "verdict": verdict}
            yield record | {"reasons": reasons, "sealed": False, "seconds": 0.0}

    run_all(cases, arguments, agreement)


def raw(arguments):
    cases = []
    for file in ("raw_bunny_scans.ply", "raw_dragon_scans.ply", "pump_scan.e57"):
        cloud = model(arguments.data, file, arguments.work)
        cases += [Case(file, window, cloud, told_only=True) for window in arguments.window]
    run_all(cases, arguments)


# -- What has no inside


def open_surfaces(arguments):
    import numpy as np

    import solids

    def verdict(made, _):
        return ["says sealed"] if made.sealed else []

    files = {}
    for name in solids.SHEETS:
        for points in arguments.sizes:
            where = solids.sheet(name, points, np.random.default_rng([number_of(name), points]))
            files[f"{name} {points}"] = solids.stored(arguments.work / f"clouds.{solids.VERSION}" / f"open-{name}-{points}.ply", where)
    if arguments.data:
        town = sorted(arguments.data.glob("lidarhd_770*.laz"))
        real = ["Topography.laz", "bcts_2.laz", "TLS_Clip.laz", "lone-star.copc.laz", "lidarhd_0292_6833.laz"]
        files |= {name: arguments.data / name for name in real + [path.name for path in town]}
        files["lidarhd town, six tiles"] = town
        if arguments.large:
            files["autzen_10M.laz"] = arguments.data / "autzen_10M.laz"
    cases = [Case(name, window, cloud, [], verdict, told_only=True) for name, cloud in files.items() for window in arguments.window]
    run_all(cases, arguments)


# -- Bodies that no list names


def family(arguments):
    import numpy as np

    import solids

    cases = []
    for number in range(arguments.count):
        rng = np.random.default_rng([arguments.seed, number])
        body = solids.random_body(rng)
        points = round(10 ** rng.uniform(3, np.log10(50_000)))
        turn, noise, uneven = rng.uniform(0, 360), rng.uniform(0, 0.5), rng.uniform(1, 4)
        body = body.turned(turn)
        where, normals = solids.sample(body, points, rng, uneven)
        noisy = (where + rng.normal(scale=noise * body.spacing(points), size=where.shape)).astype(np.float32)
        key = f"family-{arguments.seed}-{number}"
        cloud = solids.stored(arguments.work / f"clouds.{solids.VERSION}" / f"{key}.ply", noisy)
        # Noise gives Poisson handles and specks; whether samples are too few for the shape is told by those without noise.
        excused = not same_shape(of_poisson(f"{key}-clean", where, normals, arguments.work, specks=False), body.truth)
        peer = of_poisson(key, noisy, normals, arguments.work)
        # What no one can tell from these points is not asked for.
        told = peer["volume"] is not None and abs(peer["volume"] / body.truth.volume - 1) <= FAMILY_VOLUME
        judge = against(body.truth, FAMILY_VOLUME if told else None)
        title = f"{key} genus {body.truth.genus}, {points} points, noise {noise:.2f}, uneven {uneven:.1f}"
        cases += [Case(title, window, cloud, [], judge, measuring(body.truth), excused) for window in arguments.window]
    run_all(cases, arguments)


COMMANDS = {
    "matrix": matrix,
    "scans": scans,
    "holes": holes,
    "clouds": clouds,
    "raw": raw,
    "open": open_surfaces,
    "family": family,
}


def words(kind):
    return lambda text: [kind(word) for word in text.split(",")]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="what", required=True)
    for name, function in COMMANDS.items():
        command = commands.add_parser(name)
        command.set_defaults(function=function)
        command.add_argument("program", type=Path)
        command.add_argument("--work", type=Path, required=True, help="keeps clouds, truths and what Poisson made")
        command.add_argument("--data", type=Path, required=name in ("scans", "holes", "clouds", "raw"), help="folder of scans and models")
        command.add_argument(
            "--window", type=words(str), default=EVERY if name == "clouds" else WINDOWS, help="windows to run with; 'default' gives none"
        )
        command.add_argument("--options", default="", help="more options of the program, in one word")
        command.add_argument("--only", help="only cases whose name has this")
        command.add_argument("--jobs", type=int, default=1, choices=(1, 2), help="runs at a time")
        command.add_argument("--seconds", type=float, default=1200, help="cap of a run")
        command.add_argument("--prepare", action="store_true", help="only make what the work folder keeps")
        command.add_argument("--keep", action="store_true", help="keep the meshes, in runs/ of the work folder")
        command.add_argument("-o", "--output", type=Path, help="a file for the records, a line of JSON each")
        match name:
            case "matrix":
                command.add_argument("--sizes", type=words(int), default=[300, 1000, 3000, 10_000])
                command.add_argument("--turns", type=words(float), default=[0, 17, 33])
                command.add_argument("--axes", type=words(str), default=["y"])
                command.add_argument("--bodies", type=words(str))
            case "scans":
                command.add_argument("--positions", action="store_true", help="tell the program where each scan was taken from")
            case "holes":
                command.add_argument("--places", type=int, default=20)
                command.add_argument("--shares", type=words(float), default=[1, 2, 5, 10], help="per cent of the surface")
                command.add_argument("--bodies", type=words(str))
            case "open":
                command.add_argument("--sizes", type=words(int), default=[3000, 30_000])
                command.add_argument("--large", action="store_true", help="ten million points of airborne LiDAR, too")
            case "family":
                command.add_argument("--seed", type=int, default=1)
                command.add_argument("--count", type=int, default=20)
    arguments = parser.parse_args()
    environment("bodies", PACKAGES)
    must_import("open3d")
    arguments.program = arguments.program.resolve()
    arguments.work.mkdir(parents=True, exist_ok=True)
    # Two programs may be measured at a time with one work folder.
    arguments.runs = arguments.work / "runs" / ("" if arguments.keep else str(os.getpid()))
    try:
        arguments.function(arguments)
    finally:
        if not arguments.keep:
            shutil.rmtree(arguments.runs, ignore_errors=True)


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    stoppable(main, "stopped; call it again to continue")
