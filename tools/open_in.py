#!/usr/bin/env python3
"""Opens asra-stream's meshes in other people's software, and compares counts, places and colours.

    cargo build --release
    tools/open_in.py                     makes meshes of a coloured cloud in every format; --program PATH for another build

PLY, OBJ, STL and GLB are loaded with trimesh, open3d and pymeshlab (each as far as it reads the format); GLB also goes through the glTF validator of
the Khronos group, if there is node. A Python environment with these is made in the user's cache; npm fetches the validator there, too.
"""

import argparse
import json
import math
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from shared import CACHE, ROOT, environment

PACKAGES = ["numpy", "trimesh", "open3d", "pymeshlab"]
VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2]))).then(report => console.log(JSON.stringify(report)));
"""


def cloud(path, points):
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


class Findings:
    def __init__(self):
        self.wrong = 0

    def say(self, what, right):
        print(f"{'ok' if right else 'WRONG':6}{what}")
        self.wrong += not right


def compare(findings, what, vertices, triangles, colours, expected, numpy, vertices_are="as they were"):
    """Counts; places, to single precision; colours, to a step of 1/255. Some loaders give a corner to each triangle, some put vertices in another order."""
    if vertices_are == "corners":
        findings.say(f"{what}: {len(triangles)} triangles", len(triangles) == expected["triangles"])
        return
    counts = len(vertices) == expected["vertices"] and len(triangles) == expected["triangles"]
    findings.say(f"{what}: {len(vertices)} vertices, {len(triangles)} triangles", counts)
    if not counts:
        return
    vertices, places = numpy.asarray(vertices), expected["places"]
    wanted = expected["colours"]
    if vertices_are == "in another order":
        vertices, places, wanted = (numpy.sort(values, axis=0) for values in (vertices, places, wanted))
        colours = None if colours is None else numpy.sort(numpy.asarray(colours)[:, :3], axis=0)
    off = numpy.abs(vertices - places).max()
    findings.say(f"{what}: places differ by up to {off:.2g}", off < 2e-6 * numpy.abs(places).max() + 1e-9)
    if colours is not None:
        off = numpy.abs(numpy.asarray(colours)[:, :3].astype(float) - wanted).max()
        findings.say(f"{what}: colours differ by up to {off:.3g} of 255", off <= 1)


def plain_ply(path, numpy):
    """Our own look at the file, from its header."""
    data = path.read_bytes()
    header, body = data.split(b"end_header\n", 1)
    types = {"double": "f8", "float": "f4", "uchar": "u1", "ushort": "u2"}
    words = [line.split() for line in header.decode().splitlines()]
    counts = {w[1]: int(w[2]) for w in words if w[0] == "element"}
    record = numpy.dtype([(w[2], "<" + types[w[1]]) for w in words if w[0] == "property" and w[1] != "list"])
    vertices = numpy.frombuffer(body, record, counts["vertex"])
    origin = next(([float(v) for v in w[2:]] for w in words if w[:2] == ["comment", "origin"]), [0, 0, 0])
    return {
        "vertices": counts["vertex"],
        "triangles": counts["face"],
        "places": numpy.stack([vertices[a] for a in "xyz"], 1).astype(float),
        "colours": numpy.stack([vertices[c] for c in ("red", "green", "blue")], 1).astype(float),
        "intensity": vertices["intensity"],
        "origin": numpy.array(origin),
    }


def validate(findings, path):
    if not shutil.which("npm"):
        print("skip  glTF validator: there is no npm")
        return
    folder = CACHE / "gltf-validator"
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "node_modules").exists():
        subprocess.run(["npm", "install", "--silent", "--prefix", folder, "gltf-validator"], check=True)
    script = folder / "validate.js"
    script.write_text(VALIDATE)
    report = json.loads(subprocess.run(["node", script, path], check=True, capture_output=True).stdout)
    issues = report["issues"]
    told = ", ".join(f"{issues[kind]} {kind[3:].lower()}" for kind in ("numErrors", "numWarnings", "numInfos"))
    findings.say(f"glTF validator: {told}", issues["numErrors"] == 0 and issues["numWarnings"] == 0)
    for message in issues["messages"][:5]:
        print(f"      {message['code']}: {message['message']}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=ROOT / "target" / "release" / "asra-stream")
    parser.add_argument("--points", type=int, default=50_000)
    arguments = parser.parse_args()
    environment("open-in", PACKAGES)

    import numpy
    import open3d
    import pymeshlab
    import trimesh

    findings = Findings()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        cloud(folder / "ball.bin", arguments.points)
        layout = "xyz:f64,rgb:u8,intensity:u16"
        for name in ("m.ply", "m.obj", "m.stl", "m.glb"):
            command = [arguments.program, folder / "ball.bin", "-q", "--layout", layout, "-o", folder / name, "--overwrite"]
            subprocess.run(command, check=True)
        expected = plain_ply(folder / "m.ply", numpy)

        for name in ("m.ply", "m.obj", "m.stl", "m.glb"):
            path, kind = str(folder / name), name[2:]
            # GLB's node moves the mesh to where it lies; loaders apply that.
            placed = dict(expected, places=expected["places"] + (expected["origin"] if kind == "glb" else 0))
            mesh = trimesh.load(path, force="mesh", process=False)
            colours = mesh.visual.vertex_colors if kind != "stl" else None
            are = "corners" if kind == "stl" else "as they were"
            compare(findings, f"trimesh {kind}", mesh.vertices, mesh.faces, colours, placed, numpy, are)
            mesh = open3d.io.read_triangle_mesh(path)
            colours = numpy.asarray(mesh.vertex_colors) * 255 if kind in ("ply", "obj") and mesh.has_vertex_colors() else None
            are = "as they were" if kind == "ply" else "corners" if kind == "stl" else "in another order"
            compare(findings, f"open3d {kind}", mesh.vertices, mesh.triangles, colours, placed, numpy, are)
            loaded = pymeshlab.MeshSet()
            loaded.load_new_mesh(path)
            mesh = loaded.current_mesh()
            colours = mesh.vertex_color_matrix() * 255 if kind in ("ply", "obj") else None
            are = "corners" if kind in ("stl", "glb") else "as they were"
            compare(findings, f"pymeshlab {kind}", mesh.vertex_matrix(), mesh.face_matrix(), colours, placed, numpy, are)

        scene = trimesh.load(str(folder / "m.glb"), process=False)
        attributes = next(iter(scene.geometry.values())).vertex_attributes
        intensity = attributes.get("_INTENSITY")
        same = intensity is not None and bool((numpy.asarray(intensity).ravel() == expected["intensity"]).all())
        findings.say("trimesh glb: _INTENSITY is that of the PLY file", same)
        offset = [float(v) for v in (folder / "m_offset.xyz").read_text().split()]
        findings.say(f"side-car: origin {offset}", offset == list(expected["origin"]))
        validate(findings, folder / "m.glb")
    sys.exit(findings.wrong > 0)


if __name__ == "__main__":
    main()
