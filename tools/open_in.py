#!/usr/bin/env python3
"""Opens asra-stream's meshes in other people's software, and compares counts, places and colours with the mesh, and places with the cloud.

    cargo build --release
    tools/open_in.py                                        a coloured ball that lies in a UTM zone, with WKT
    tools/open_in.py --cloud "tile.laz --surface terrain"   and clouds of one's own, LAS or LAZ, with options for them
    tools/open_in.py --program PATH                         another build

PLY, OBJ, STL and GLB are opened in CloudCompare (not GLB), Open3D, PyMeshLab, PyVista and trimesh, GLB in three.js, too; each in a process of its own, so
that one that crashes is found out. GLB also goes through the glTF validator of the Khronos group. A Python environment with these is made in the user's
cache; npm fetches three.js and the validator there, if there is npm; CloudCompare is used if it is installed (on Debian: apt-get install cloudcompare).

Prints a table in Markdown, and what is wrong. Exit code 1 if anything is.

* *Bits*: how the program holds places: 64; `32 local`, less an origin that the file, its side-car or the program takes off; `32`, the whole coordinates, in
  which at 6,000 km a step is half a metre.
* *Off*: the largest distance from a vertex of the mesh to the nearest that the program has, or back. It may be a step of the bits along each axis.
* *On the cloud*: of all vertices, those that lie on a point of the cloud, as the program has them (only where the bits tell points apart).
"""

import argparse
import json
import math
import os
import re
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from shared import CACHE, ROOT, commit, environment, table

PACKAGES = ["numpy", "scipy", "trimesh", "open3d", "pymeshlab", "pyvista", "laspy[lazrs]"]
SECONDS = 300
FORMATS = ("ply", "obj", "stl", "glb")
# How programs hold places; "local" is less an origin.
LOCAL, WHOLE, DOUBLE = "32 local", "32", "64"
PROGRAMS = {
    # CloudCompare takes an origin of its own off what is far away.
    "cloudcompare": {"ply": LOCAL, "obj": LOCAL, "stl": LOCAL},
    "open3d": {"ply": DOUBLE, "obj": LOCAL, "stl": LOCAL, "glb": WHOLE},
    "pymeshlab": {"ply": DOUBLE, "obj": LOCAL, "stl": LOCAL, "glb": LOCAL},
    "pyvista": {"ply": WHOLE, "obj": LOCAL, "stl": LOCAL, "glb": WHOLE},
    "three": {"glb": LOCAL},
    "trimesh": {"ply": DOUBLE, "obj": DOUBLE, "stl": LOCAL, "glb": LOCAL},
}
WKT = (
    'PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["European_Terrestrial_Reference_System_1989",SPHEROID["GRS 1980",6378137,298.257222101,'
    'AUTHORITY["EPSG","7019"]],TOWGS84[0,0,0,0,0,0,0],AUTHORITY["EPSG","6258"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4258"]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],'
    'PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH],AUTHORITY["EPSG","25832"]]'
)
VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2]))).then(report => console.log(JSON.stringify(report)));
"""
# The loader as a page has it, but for the canvas.
THREE = """
import { REVISION, Vector3 } from 'three';
import { GLTFLoader } from 'three/examples/jsm/loaders/GLTFLoader.js';
import fs from 'fs';
globalThis.self ??= globalThis;
const file = fs.readFileSync(process.argv[2]);
const [places, colours] = [[], []];
let triangles = 0;
function done(gltf) {
    gltf.scene.updateMatrixWorld(true);
    gltf.scene.traverse(object => {
        if (!object.isMesh) return;
        const { position, color } = object.geometry.attributes;
        triangles += object.geometry.index.count / 3;
        for (let i = 0; i < position.count; i++) {
            places.push(...new Vector3().fromBufferAttribute(position, i).applyMatrix4(object.matrixWorld).toArray());
            if (color) colours.push(color.getX(i), color.getY(i), color.getZ(i));
        }
    });
    fs.writeFileSync(process.argv[3] + '.places', Buffer.from(new Float64Array(places).buffer));
    fs.writeFileSync(process.argv[3] + '.colours', Buffer.from(new Float64Array(colours).buffer));
    console.log(JSON.stringify({ triangles, version: REVISION }));
}
new GLTFLoader().parse(file.buffer.slice(file.byteOffset, file.byteOffset + file.length), '', done, error => { throw error; });
"""


def ball(path, points):
    """A ball far from zero, in millimetres and doubles, red from left to right and green from front to back."""
    golden = math.pi * (3 - math.sqrt(5))
    with open(path, "wb") as out:
        for i in range(points):
            z = 1 - 2 * (i + 0.5) / points
            r = math.sqrt(1 - z * z)
            place = [r * math.cos(golden * i), r * math.sin(golden * i), z]
            colour = [round(127.5 + 127.5 * c) for c in place]
            far = [round(c * 10_000) * 1e-3 + offset for c, offset in zip(place, [512_000, 5_403_000, 300])]
            out.write(struct.pack("<3d3BH", *far, *colour, i % 1000))


def modules(name, packages):
    """A folder in the cache in which node finds packages, or None without npm."""
    if not shutil.which("npm") or not shutil.which("node"):
        return None
    folder = CACHE / name
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "node_modules").exists():
        subprocess.run(["npm", "install", "--silent", "--prefix", folder, *packages], check=True)
    return folder


# What opens a file in each program: vertices as an array of rows; the number of triangles; colours from 0 to 255, or None; the program's version.


def in_cloudcompare(path, numpy):
    # It writes beside what it reads, and has no other way to tell places than a file of points.
    folder = Path(tempfile.mkdtemp(dir=path.parent))
    own = folder / path.name
    shutil.copy(path, own)
    words = "-SILENT -LOG_FILE log -AUTO_SAVE OFF -C_EXPORT_FMT ASC -PREC 9 -NO_TIMESTAMP -O -GLOBAL_SHIFT AUTO".split()
    environment = dict(os.environ, QT_QPA_PLATFORM="offscreen")
    done = subprocess.run(["CloudCompare", *words, own.name, "-EXTRACT_VERTICES", "-SAVE_CLOUDS"], cwd=folder, env=environment, capture_output=True, timeout=SECONDS)
    log = (folder / "log").read_text(errors="replace")
    found = re.search(r"Found one mesh with (\d+) faces and (\d+) vertices", log)
    if done.returncode != 0 or not found:
        sys.exit(f"exit code {done.returncode}: {log.strip().splitlines()[-1:]}")
    rows = numpy.loadtxt(next(folder.glob("*.asc")), ndmin=2)
    about = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", "cloudcompare"], capture_output=True, text=True)
    return rows[:, :3], int(found[1]), rows[:, 3:6] if path.suffix == ".ply" and rows.shape[1] >= 6 else None, about.stdout


def in_open3d(path, numpy):
    import open3d

    mesh = open3d.io.read_triangle_mesh(str(path))
    colours = numpy.asarray(mesh.vertex_colors) * 255 if mesh.has_vertex_colors() and path.suffix in (".ply", ".obj") else None
    return numpy.asarray(mesh.vertices), len(mesh.triangles), colours, open3d.__version__


def in_pymeshlab(path, numpy):
    from importlib.metadata import version

    import pymeshlab

    loaded = pymeshlab.MeshSet()
    loaded.load_new_mesh(str(path))
    mesh = loaded.current_mesh()
    # It keeps GLB's node apart.
    matrix = numpy.asarray(mesh.transform_matrix())
    vertices = mesh.vertex_matrix() @ matrix[:3, :3].T + matrix[:3, 3]
    colours = mesh.vertex_color_matrix()[:, :3] * 255 if mesh.has_vertex_color() and path.suffix in (".ply", ".obj") else None
    return vertices, mesh.face_number(), colours, version("pymeshlab")


def in_pyvista(path, numpy):
    import pyvista

    mesh = pyvista.read(path)
    if isinstance(mesh, pyvista.MultiBlock):
        mesh = mesh.combine().extract_surface()
    colours = mesh.point_data["RGB"] if path.suffix == ".ply" and "RGB" in mesh.point_data else None
    return mesh.points.astype(float), mesh.n_cells, colours, f"{pyvista.__version__}, VTK {pyvista.vtk_version_info}"


def in_three(path, numpy):
    folder = modules("three", ["three"])
    (folder / "open.mjs").write_text(THREE)
    told = subprocess.run(["node", folder / "open.mjs", path, path], capture_output=True, text=True, timeout=SECONDS)
    if told.returncode != 0:
        sys.exit(told.stderr.strip()[-500:])
    told = json.loads(told.stdout)
    places, colours = (numpy.fromfile(f"{path}.{what}").reshape(-1, 3) for what in ("places", "colours"))
    if len(colours):
        colours = numpy.where(colours <= 0.0031308, colours * 12.92, 1.055 * colours ** (1 / 2.4) - 0.055) * 255
    return places, told["triangles"], colours if len(colours) else None, f"r{told['version']}"


def in_trimesh(path, numpy):
    import trimesh

    mesh = trimesh.load(path, force="mesh", process=False)
    colours = numpy.asarray(mesh.visual.vertex_colors)[:, :3] if path.suffix in (".ply", ".obj") and mesh.visual.kind == "vertex" else None
    return numpy.asarray(mesh.vertices), len(mesh.faces), colours, trimesh.__version__


def read(program, path, out):
    """One program opens one file; what it has goes into `out`."""
    import numpy

    vertices, triangles, colours, version = globals()[f"in_{program}"](Path(path), numpy)
    if Path(path).suffix == ".glb":
        # There, y is up.
        vertices = numpy.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], 1)
    numpy.savez(out, vertices=vertices, triangles=triangles, version=version, colours=numpy.zeros((0, 3)) if colours is None else colours)


def plain_ply(path, numpy):
    """Our own look at the file, from its header."""
    data = path.read_bytes()
    header, body = data.split(b"end_header\n", 1)
    types = {"double": "f8", "float": "f4", "uchar": "u1", "ushort": "u2", "char": "i1", "short": "i2", "uint": "u4", "int": "i4"}
    words = [line.split() for line in header.decode().splitlines()]
    counts = {w[1]: int(w[2]) for w in words if w[0] == "element"}
    record = numpy.dtype([(w[2], "<" + types[w[1]]) for w in words if w[0] == "property" and w[1] != "list"])
    vertices = numpy.frombuffer(body, record, counts["vertex"])
    colours = None
    if "red" in record.names:
        colours = numpy.stack([vertices[c] for c in ("red", "green", "blue")], 1).astype(float)
        # Of 16 bits, programs keep eight.
        colours /= 1 if record["red"].itemsize == 1 else 257
    return {
        "vertices": counts["vertex"],
        "triangles": counts["face"],
        "places": numpy.stack([vertices[a] for a in "xyz"], 1).astype(float),
        "colours": colours,
        "intensity": vertices["intensity"] if "intensity" in record.names else None,
    }


def cloud_places(path, numpy):
    """The points of the cloud, without our program."""
    if path.suffix == ".bin":
        return numpy.frombuffer(path.read_bytes(), numpy.dtype([("p", "<3f8"), ("rest", "V5")]))["p"]
    import laspy

    return numpy.asarray(laspy.read(path).xyz)


class Findings:
    def __init__(self):
        self.rows, self.wrong = [], []

    def judge(self, right, words):
        if not right:
            self.wrong.append(words)
        return right


def opened(findings, label, program, path, expected, origin, cloud, scipy, numpy):
    kind = path.suffix[1:]
    bits = PROGRAMS[program][kind]
    what = f"{label}, {kind}, {program}"
    out = path.parent / "read.npz"
    out.unlink(missing_ok=True)
    try:
        command = [sys.executable, __file__, "--read", program, path, out]
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, env=os.environ | {"ASRA_STREAM_TOOLS": "1"})
        words = f"exit code {done.returncode}: {(done.stderr.strip().splitlines() or ['no words'])[-1]}"
    except subprocess.TimeoutExpired:
        words = f"not done after {SECONDS} s"
    if not findings.judge(out.exists(), f"{what}: does not open: {words}"):
        findings.rows.append([label, kind.upper(), program, "no", "–", "–", bits, "–", "–", "–"])
        return None
    loaded = numpy.load(out)
    places, triangles = loaded["vertices"], int(loaded["triangles"])
    # STL has corners only; some programs join all that are at one place, some few or none.
    most = 3 * expected["triangles"] if kind == "stl" else expected["vertices"]
    least = expected["vertices"]
    if bits == WHOLE:
        # Some join vertices that 32 bits put on one place.
        least = len(numpy.unique(expected["places"].astype(numpy.float32), axis=0))
    right = triangles == expected["triangles"] and least <= len(places) <= most
    findings.judge(right, f"{what}: {len(places)} vertices and {triangles} triangles, expected {expected['vertices']} and {expected['triangles']}")
    # GLB says itself where it lies; of OBJ and STL, the side-car says it.
    if kind in ("obj", "stl"):
        places = places + origin
    whole = expected["places"]
    largest = numpy.abs(whole if bits == WHOLE else whole - origin).max()
    if program == "cloudcompare":
        # Its own origin is a round one, some kilometres off at most.
        largest = max(largest, 1e4)
    step = 1e-9 * max(1.0, numpy.abs(whole).max() / 1e6) if bits == DOUBLE else float(numpy.spacing(numpy.float32(largest)))
    there, back = scipy.KDTree(places).query(whole)[0].max(), scipy.KDTree(whole).query(places)[0].max()
    off = float(max(there, back))
    findings.judge(off <= math.sqrt(3) * step, f"{what}: {off:.3g} off, where a step is {step:.3g}")
    share = "–"
    # Of corners, more belong to a vertex that has many triangles.
    if bits != WHOLE and len(places) == expected["vertices"]:
        near = cloud.query(places)[0]
        share = float((near <= 2 * step + 1e-9).mean())
        findings.judge(abs(share - expected["share"]) < 1e-3, f"{what}: {share:.2%} of the vertices on the cloud's points, expected {expected['share']:.2%}")
        share = f"{share:.1%}"
    colours = "–"
    if expected["colours"] is not None and len(loaded["colours"]):
        nearest = scipy.KDTree(whole).query(places)[1]
        error = numpy.abs(loaded["colours"].astype(float) - expected["colours"][nearest])
        colours = f"{error.max():.2g}"
        # Where 32 bits put vertices on another's place, colours are another's, too.
        findings.judge(bits == WHOLE or error.max() <= 1.01, f"{what}: colours differ by up to {error.max():.3g} of 255")
    findings.rows.append([label, kind.upper(), program, "yes", f"{len(places):,}", f"{triangles:,}", bits, f"{off:.2g}", share, colours])
    return str(loaded["version"])


def validate(findings, label, path):
    folder = modules("gltf-validator", ["gltf-validator"])
    if not folder:
        return "glTF validator: skipped, there is no npm"
    script = folder / "validate.js"
    script.write_text(VALIDATE)
    report = json.loads(subprocess.run(["node", script, path], check=True, capture_output=True).stdout)
    issues = report["issues"]
    told = ", ".join(f"{issues[kind]} {kind[3:].lower()}" for kind in ("numErrors", "numWarnings", "numInfos"))
    messages = [f"{message['code']}: {message['message']}" for message in issues["messages"][:3]]
    findings.judge(issues["numErrors"] == 0 and issues["numWarnings"] == 0, f"{label}: glTF validator: {told}: {'; '.join(messages)}")
    return f"{label}: glTF validator: {told}" + (f" ({messages[0]})" if messages else "")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=ROOT / "target" / "release" / "asra-stream")
    parser.add_argument("--points", type=int, default=50_000, help="points of the ball")
    parser.add_argument("--cloud", action="append", default=[], metavar="'FILE OPTIONS'", help="one more cloud, LAS or LAZ, and options of the run")
    parser.add_argument("--read", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    environment("open-in", PACKAGES)
    if arguments.read:
        return read(*arguments.read)

    import numpy
    import scipy.spatial as scipy

    programs = [program for program in PROGRAMS if program != "cloudcompare" or shutil.which("CloudCompare")]
    programs = [program for program in programs if program != "three" or modules("three", ["three"])]
    findings, versions, notes = Findings(), {}, []
    for program in sorted(set(PROGRAMS) - set(programs)):
        notes.append(f"{program}: skipped, it is not installed")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        ball(folder / "ball.bin", arguments.points)
        (folder / "utm.wkt").write_text(WKT)
        clouds = [("ball", folder / "ball.bin", ["--layout", "xyz:f64,rgb:u8,intensity:u16", "--crs", folder / "utm.wkt"])]
        for cloud in arguments.cloud:
            path, *options = shlex.split(cloud)
            clouds.append((Path(path).stem, Path(path), options))
        for number, (label, path, options) in enumerate(clouds):
            place = folder / str(number)
            place.mkdir()
            for kind in FORMATS:
                subprocess.run([arguments.program, path, "-q", *options, "--overwrite", "-o", place / f"m.{kind}"], check=True)
            expected = plain_ply(place / "m.ply", numpy)
            offset = place / "m_offset.xyz"
            origin = numpy.array([float(v) for v in offset.read_text().split()]) if offset.exists() else numpy.zeros(3)
            cloud = scipy.KDTree(cloud_places(path, numpy))
            expected["share"] = float((cloud.query(expected["places"])[0] <= 1e-6).mean())
            notes.append(f"{label}: origin {origin.tolist()}; {expected['share']:.1%} of the mesh's vertices on points of the cloud")
            findings.judge((place / "m.prj").exists(), f"{label}: no .prj beside the OBJ")
            for kind in FORMATS:
                for program in programs:
                    if kind in PROGRAMS[program]:
                        version = opened(findings, label, program, place / f"m.{kind}", expected, origin, cloud, scipy, numpy)
                        versions[program] = version or versions.get(program, "?")
            if expected["intensity"] is not None:
                import trimesh

                scene = trimesh.load(str(place / "m.glb"), process=False)
                intensity = next(iter(scene.geometry.values())).vertex_attributes.get("_INTENSITY")
                same = intensity is not None and bool((numpy.asarray(intensity).ravel() == expected["intensity"]).all())
                findings.judge(same, f"{label}: _INTENSITY of the GLB file is not that of the PLY file")
            notes.append(validate(findings, label, place / "m.glb"))
    print(f"At {commit()}; " + ", ".join(f"{program} {version}" for program, version in sorted(versions.items())) + ".\n")
    print(table(["cloud", "format", "program", "opens", "vertices:", "triangles:", "bits", "off:", "on the cloud:", "colours off, of 255:"], findings.rows))
    for line in notes:
        print(f"* {line}")
    for line in findings.wrong:
        print(f"* WRONG: {line}")
    sys.exit(bool(findings.wrong))


if __name__ == "__main__":
    main()
