#!/usr/bin/env python3
"""`asra-stream simplify` beside others that leave triangles out: MeshLab, Open3D, fast-simplification, meshoptimizer, libigl's qslim.

    tools/simplifiers.py MESH.ply ...                 each mesh at 50, 20, 10, 5 and 1 per cent of its triangles; tables in Markdown
    tools/simplifiers.py MESH.ply --shares 20,10      at others
    tools/simplifiers.py MESH.ply --only Open3D,asra  of some
    tools/simplifiers.py MESH.ply --also NAME=PROGRAM  a program that you have built, too; it is called as PROGRAM MESH.ply TRIANGLES OUT.ply

Distances are measured from 300,000 places sampled on one surface to the nearest place of the other, both ways, in cells, or where the mesh does not say how long a cell is, in
thousandths of its box's diagonal. Whether the result is sound is for `asra-stream check` to say. A Python environment is made in the user's cache.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shared import built, environment

PACKAGES = ["numpy", "open3d", "pymeshlab", "fast-simplification", "meshoptimizer", "libigl"]
SAMPLES = 300_000


def cell_of(path):
    """The side of the cells that a mesh of ours was made with."""
    with open(path, "rb") as file:
        for line in file:
            if line.startswith(b"comment cell_size "):
                return float(line.split()[2])
            if line.startswith(b"end_header"):
                return None


def ours(program, path, wanted, out, *options):
    subprocess.run([program, "simplify", path, "--max-triangles", str(wanted), "-o", out, "--overwrite", "-q", "--no-intersections", *options], check=True)


def work(program, paths, shares, only, also):
    import fast_simplification
    import igl
    import meshoptimizer
    import numpy as np
    import open3d as o3d
    import pymeshlab

    def meshlab(vertices, triangles, wanted):
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(vertices, triangles))
        meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=wanted)
        return meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix()

    def open3d(vertices, triangles, wanted):
        mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(triangles))
        mesh = mesh.simplify_quadric_decimation(wanted)
        return np.asarray(mesh.vertices), np.asarray(mesh.triangles)

    def fast(vertices, triangles, wanted):
        return fast_simplification.simplify(vertices.astype(np.float32), triangles, target_count=wanted)

    def meshopt(vertices, triangles, wanted):
        indices, left = triangles.astype(np.uint32).ravel(), np.zeros(3 * len(triangles), np.uint32)
        places = np.ascontiguousarray(vertices, np.float32)
        count = meshoptimizer.simplify(left, indices, places, target_index_count=3 * wanted, target_error=1.0)
        return vertices, left[:count].reshape(-1, 3)

    def qslim(vertices, triangles, wanted):
        left = igl.qslim(np.asfortranarray(vertices), np.asfortranarray(triangles.astype(np.int32)), wanted)
        return left[0], left[1]

    def read(path):
        mesh = o3d.io.read_triangle_mesh(str(path))
        return np.asarray(mesh.vertices), np.asarray(mesh.triangles)

    others = {"MeshLab": meshlab, "Open3D": open3d, "fast-simplification": fast, "meshoptimizer": meshopt, "libigl, qslim": qslim}
    # Within a tolerance that binds nothing, what matters least goes; without, it is the least tolerance.
    own = {"asra-stream, with `--simplify 100%`": ("100%",), "asra-stream, with `--simplify 100% --move-vertices`": ("100%", "--move-vertices"), "asra-stream": ()}

    def scene(vertices, triangles):
        made = o3d.t.geometry.RaycastingScene()
        made.add_triangles(o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(triangles.astype(np.uint32)))
        return made

    def sampled(vertices, triangles):
        random = np.random.default_rng(1)
        a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        chosen = random.choice(len(triangles), SAMPLES, p=areas / areas.sum())
        s, t = random.random((2, SAMPLES, 1))
        s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
        return a[chosen] + s * (b - a)[chosen] + t * (c - a)[chosen]

    def figures(reference, places, vertices, triangles):
        away = scene(vertices, triangles).compute_distance(o3d.core.Tensor(places.astype(np.float32))).numpy()
        back = reference.compute_distance(o3d.core.Tensor(sampled(vertices, triangles).astype(np.float32))).numpy()
        return [np.sqrt((back**2).mean()), np.sqrt((away**2).mean()), back.max(), away.max()]

    def check(folder, vertices, triangles):
        path = Path(folder) / "checked.ply"
        used, triangles = np.unique(triangles, return_inverse=True)
        mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices[used]), o3d.utility.Vector3iVector(triangles.reshape(-1, 3)))
        o3d.io.write_triangle_mesh(str(path), mesh)
        report = Path(folder) / "checked.json"
        subprocess.run([program, "check", path, "--open", "-q", "--report", report], check=False)
        found = json.loads(report.read_text())
        pairs = found["intersections"]["pairs"] if found["intersections"] else 0
        edges = found["nonmanifold_edges"] + found["nonmanifold_vertices"]
        return f"{'yes' if edges == 0 and found['oriented'] else f'no ({edges})'} | {pairs}"

    for path in paths:
        vertices, triangles = read(path)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, cell = (low + high) / 2, cell_of(path)
        unit, word = (cell, "cells") if cell else (np.linalg.norm(high - low) / 1000, "thousandths of the diagonal")
        scaled = (vertices - middle) / unit
        reference, places = scene(scaled, triangles), sampled(scaled, triangles)
        print(f"\n## {path.name}: {len(triangles):,} triangles, distances in {word}\n")
        print("| % | by | triangles | mesh to reference, RMS | reference to mesh, RMS | most | most | manifold | pairs that intersect | s |")
        print("|--:|---|--:|--:|--:|--:|--:|---|--:|--:|")
        with tempfile.TemporaryDirectory() as folder:
            for share in shares:
                wanted = int(len(triangles) * share / 100)
                for name in [*own, *others, *also]:
                    if only and not any(word in name for word in only):
                        continue
                    start, out = time.monotonic(), Path(folder) / "out.ply"
                    if name in others:
                        v, t = others[name](vertices, triangles, wanted)
                        took = time.monotonic() - start
                    else:
                        if name in own:
                            ours(program, path, wanted, out, *own[name])
                        else:
                            subprocess.run([also[name], path, str(wanted), out], check=True)
                        took = time.monotonic() - start
                        v, t = read(out)
                    v = np.asarray(v, np.float64)
                    errors = " | ".join(f"{error:.4f}" for error in figures(reference, places, (v - middle) / unit, np.asarray(t)))
                    print(f"| {share:g} | {name} | {len(t):,} | {errors} | {check(folder, v, np.asarray(t))} | {took:.1f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", type=Path)
    parser.add_argument("--shares", default="50,20,10,5,1", help="per cents of the triangles")
    parser.add_argument("--only", help="names, or parts of names")
    parser.add_argument("--also", action="append", default=[], metavar="NAME=PROGRAM", help="a program that you have built")
    parser.add_argument("--program", type=Path, help="the program [default: this repository's, built]")
    arguments = parser.parse_args()
    shares = [float(share) for share in arguments.shares.split(",")]
    also = dict(one.split("=", 1) for one in arguments.also)
    work(built(arguments.program), arguments.meshes, shares, arguments.only and arguments.only.split(","), also)


if __name__ == "__main__":
    environment("simplifiers", PACKAGES)
    main()
