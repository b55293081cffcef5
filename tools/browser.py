#!/usr/bin/env python3
"""Opens tilesets and reports in a real browser, and compares what is seen with `asra-stream render` and with what the tileset says of itself.

    cargo build --release
    tools/browser.py                                    a classified, coloured piece of land of 160,000 points
    tools/browser.py --cloud "tile.laz --surface terrain --cell-size auto"      and clouds of one's own, with options for them
    tools/browser.py --keep pictures                    keeps the pictures of the browser in a folder, to be looked at
    tools/browser.py --program PATH                     another build

It takes chromium (on Debian: apt-get install chromium), node and npm. Playwright, three.js, 3d-tiles-renderer, CesiumJS and esbuild are fetched by npm into the
user's cache, numpy and Pillow by pip; nothing of it goes into the repository. The browser draws without a graphics card (SwiftShader), so times are upper bounds.
`cargo test` does not run this.

What must hold, or else the exit code is 1:

* `view`: the first picture comes; no error or warning in the console; no request leaves the page's own address; no hole while tiles load.
* The mesh's outline, unless it stands on Earth, from several directions in parallel view, is that of `render` (intersection over union of what is covered, and the height and width of both).
* With `--compress meshopt` as many triangles are shown, and the outline is the same.
* Turning turns, `h` goes back to the bit, colours by class are those of the classes that are there, wires show, a click tells a vertex within the mesh's box,
  two clicks a distance, the narrow page does not scroll sideways, and a browser without WebGL 2 is told so.
* Every tile loads in three.js with 3d-tiles-renderer and in CesiumJS, and has as many triangles there as its file; by level they are those of tileset.json.
* Reports of a run, `check` and `compare` open from file://, show the mesh, and ask for nothing.
"""

import argparse
import json
import os
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from urllib.parse import urlparse

from shared import CACHE, ROOT, built, commit, environment, table

PACKAGES = ["numpy", "pillow"]
NPM = ["playwright-core@1.65.1", "three@0.187.0", "3d-tiles-renderer@0.5.3", "cesium@1.145.0", "esbuild@0.28.2"]
DIRECTIONS = [(305, 30), (125, 30), (270, 90), (0, 15)]
# Distances in radii of the bounding sphere, from afar to near.
CLOSENESS = [3.0, 1.2, 0.5]
# Colours of classes as the viewer and `render` have them.
CLASSES = {1: (206, 206, 206), 2: (190, 140, 92), 3: (188, 214, 130), 4: (122, 180, 84), 5: (50, 124, 66), 6: (214, 94, 40), 9: (46, 110, 190)}
BACKGROUND = (238, 241, 244)
# What 3d-tiles-renderer says of every tileset of version 1.1, which it reads.
OF_VERSION = "tiles versions at 1.1 or higher have limited support"


def modules():
    """The folder in which node finds what npm fetched, with the pages for other people's readers."""
    for name in ("node", "npm"):
        if not shutil.which(name):
            sys.exit(f"{name} is not there")
    folder = CACHE / "browser-modules"
    folder.mkdir(parents=True, exist_ok=True)
    whole = folder / "packages.txt"
    if not whole.exists() or whole.read_text().split() != NPM:
        subprocess.run(["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", folder, *NPM], check=True)
        whole.write_text("\n".join(NPM))
    own = ROOT / "tools/browser"
    esbuild = folder / "node_modules/.bin/esbuild"
    paths = os.environ | {"NODE_PATH": str(folder / "node_modules")}
    for name in ("three.js", "cesium.js"):
        command = [esbuild, own / name, "--bundle", "--minify", "--log-level=warning", f"--outfile={folder / 'built' / name}"]
        subprocess.run(command, check=True, env=paths)
    # Where its imports are found.
    shutil.copy(own / "check.mjs", folder / "check.mjs")
    return folder


def land(path, side=400):
    """A piece of land with houses and trees: places, colours, classes, intensity."""
    import numpy

    x, y = (axis.ravel() for axis in numpy.meshgrid(numpy.arange(side) * 0.5, numpy.arange(side) * 0.5))
    z = 6 * numpy.sin(x / 31) * numpy.cos(y / 23) + 0.4 * numpy.sin(x / 3.1) * numpy.sin(y / 2.7)
    classes = numpy.full(x.size, 2, "u1")
    for i in range(9):
        left, low = 15 + 60 * (i % 3), 20 + 60 * (i // 3)
        house = (x >= left) & (x < left + 18) & (y >= low) & (y < low + 12)
        z[house] = 14 + 0.3 * abs(y[house] - low - 6)
        classes[house] = 6
        tree = (x - left - 30) ** 2 + (y - low - 20) ** 2
        z += numpy.where(tree < 36, 8 * (1 - tree / 36), 0)
        classes[tree < 36] = 5
    rows = numpy.zeros(x.size, [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("r", "u1"), ("g", "u1"), ("b", "u1"), ("c", "u1"), ("i", "<u2")])
    rows["x"], rows["y"], rows["z"] = 512_000 + x, 5_403_000 + y, 300 + z
    rows["r"], rows["g"], rows["b"] = (numpy.clip(c, 0, 255) for c in (x, y, 8 * z + 60))
    rows["c"], rows["i"] = classes, (x * 100).astype("u2")
    names = ["double x", "double y", "double z", "uchar red", "uchar green", "uchar blue", "uchar classification", "ushort intensity"]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {x.size}", *(f"property {name}" for name in names), "end_header", ""]
    path.write_bytes("\n".join(lines).encode() + rows.tobytes())


def run(program, *words):
    subprocess.run([program, *map(str, words), "-q"], check=True)


def counted(path):
    """The triangles of a tile: its own, and what overlaps others, its skirt included."""
    data = path.read_bytes()
    scene = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    own = [scene["accessors"][part["indices"]]["count"] // 3 for mesh in scene["meshes"] for part in mesh["primitives"]]
    return own[0], sum(own[1:])


def mask(path, numpy, image):
    """Where a picture is not background, cut to what is covered."""
    pixels = numpy.asarray(image.open(path).convert("RGBA")).astype(int)
    behind = pixels[..., 3] < 128
    behind |= (abs(pixels[..., :3] - BACKGROUND) <= 3).all(axis=2) if (pixels[..., 3] == 255).all() else False
    rows, columns = (numpy.flatnonzero((~behind).any(axis=axis)) for axis in (1, 0))
    return (~behind)[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def overlap(a, b, image, numpy):
    """How much of what either covers both do, once they are as large as each other; and how much their proportions differ."""
    size = (a.shape[1], a.shape[0])
    other = numpy.asarray(image.fromarray((b * 255).astype("u1")).resize(size)) > 127
    proportions = (a.shape[1] / a.shape[0]) / (b.shape[1] / b.shape[0])
    return (a & other).sum() / (a | other).sum(), abs(proportions - 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--program", type=Path)
    parser.add_argument("--cloud", help="a cloud and options for it")
    parser.add_argument("--keep", type=Path, help="a folder for the browser's pictures")
    parser.add_argument("--chromium", default=shutil.which("chromium") or shutil.which("google-chrome"))
    arguments = parser.parse_args()
    if not arguments.chromium:
        sys.exit("chromium is not there; on Debian: apt-get install chromium")
    environment("browser", PACKAGES)
    import numpy
    from PIL import Image

    folder, program = modules(), built(arguments.program)
    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        pictures = (arguments.keep or work / "pictures").resolve()
        pictures.mkdir(parents=True, exist_ok=True)
        if arguments.cloud:
            cloud = shlex.split(arguments.cloud)
        else:
            land(work / "land.ply")
            cloud = [work / "land.ply", "--surface", "terrain", "--cell-size", "1"]
        packed = work / "packed/tileset.json"
        tree, mesh, hostile = work / "land/tileset.json", work / "mesh.ply", work / "<img src=x onerror=alert(1)>.ply"
        pages = [work / f"{name}.html" for name in ("run", "check", "compare")]
        run(program, *cloud, "-o", tree)
        run(program, *cloud, "-o", packed, "--compress", "meshopt")
        run(program, *cloud, "-o", mesh, "--html", pages[0])
        shutil.copy(mesh, hostile)
        run(program, "check", hostile, "--open", "--html", pages[1])
        run(program, "compare", mesh, cloud[0], "--html", pages[2])
        asked = {
            "program": str(program), "chromium": arguments.chromium, "pictures": str(pictures), "tileset": str(tree.parent), "tree": str(tree), "packed": str(packed), "mesh": str(mesh),
            "pages": [str(page) for page in pages], "directions": DIRECTIONS, "closeness": CLOSENESS, "built": str(folder / "built"),
            "cesium": str(folder / "node_modules/cesium/Build/Cesium"),
        }
        told = subprocess.run(["node", folder / "check.mjs", json.dumps(asked)], stdout=subprocess.PIPE, text=True)
        if told.returncode:
            sys.exit("the browser's part has failed")
        seen = json.loads(told.stdout)
        wrong = []

        def must(holds, words):
            if not holds:
                wrong.append(words)

        print(f"asra-stream {commit()}; {subprocess.run([arguments.chromium, '--version'], capture_output=True, text=True).stdout.strip()}; {seen['begun']['renderer']}\n")
        levels = json.loads(tree.read_text())["asset"]["extras"]["levels"]
        first = seen["first"]
        print(f"Tileset of {levels[0]['triangles']:,} triangles in {len(levels)} levels: `view` answers after {first['ready']:.0f} ms, the first picture after {first['picture']:.0f} ms.")
        print(f"Mesh file: `view` answers after {seen['mesh']['ready']:.0f} ms, the first picture after {seen['mesh']['picture']:.0f} ms.\n")

        # The outline. Of a tileset on Earth north is another than the map's: it is seen turned by a few degrees, and told only.
        on_earth = "site" in json.loads(tree.read_text())["asset"]["extras"]
        rows = []
        for direction in seen["directions"]:
            azimuth, elevation = direction["azimuth"], direction["elevation"]
            picture = work / "seen.png"
            run(program, "render", mesh, "-o", picture, "--overwrite", "--views", f"{azimuth}:{elevation}", "--size", "900x700", "--no-legend", "--background", "transparent", "--color-by", "none")
            both, proportions = overlap(mask(pictures / direction["name"], numpy, Image), mask(picture, numpy, Image), Image, numpy)
            level, count = direction["stats"]["level"], direction["stats"]["triangles"]
            rows.append([f"{azimuth}:{elevation}", f"{100 * both:.2f} %", f"{100 * proportions:.2f} %", f"{count:,}", f"{level}"])
            if on_earth:
                continue
            must(both > 0.98, f"from {azimuth}:{elevation} only {100 * both:.2f} % is covered by both")
            must(proportions < 0.015, f"from {azimuth}:{elevation} proportions differ by {100 * proportions:.2f} %")
        print(table(["view", "covered by both", "proportions differ by", "triangles", "levels"], rows), "\n")

        # Encoded, it is seen as it is.
        encoded, plain = seen["packed"], seen["directions"][0]
        both, proportions = overlap(mask(pictures / plain["name"], numpy, Image), mask(pictures / encoded["name"], numpy, Image), Image, numpy)
        must(not encoded["errors"] and encoded["stats"]["failed"] == 0, f"encoded: {encoded['errors'][:3]}")
        must(encoded["stats"]["triangles"] == plain["stats"]["triangles"], f"encoded, there are {encoded['stats']['triangles']:,} triangles, not {plain['stats']['triangles']:,}")
        must(both > 0.998 and proportions < 0.005, f"encoded, only {100 * both:.2f} % is covered by both")
        print(f"With `--compress meshopt` {encoded['stats']['triangles']:,} triangles are shown; {100 * both:.2f} % is covered by both.\n")

        # What the page does.
        host = urlparse(seen["address"]).netloc
        heard = seen["heard"]
        must(not heard["errors"], f"the console says {heard['errors'][:3]}")
        must(all(urlparse(url).netloc == host or url.startswith("data:") for url in heard["requests"]), "a request leaves the page's address")
        must(seen["begun"]["failed"] == 0, "tiles did not load")
        must(seen["turned"]["changed"] and abs(seen["turned"]["eye"]["azimuth"] - 270) < 1, f"turning does not turn: {seen['turned']}")
        must(seen["home"]["same"] and seen["home"]["eye"]["azimuth"] == 305, "`h` does not go back")
        must(seen["wires"], "no wires show")
        must(all(count > 0 for number in (0, 1) for count in seen[f"near{number}"]["meanwhile"]), "nothing was drawn while tiles loaded")
        must(seen["near1"]["stats"]["error"] <= seen["begun"]["error"], "nearer is not finer")
        must(seen["code"] == 0, f"Ctrl-C ends `view` with {seen['code']}")
        vertex, low, high = seen["vertex"], *json.loads(subprocess.run([program, "check", mesh, "--open", "--no-intersections", "--report", "/dev/stdout", "-q"], stdout=subprocess.PIPE, text=True).stdout)["bounds"]
        must(vertex is not None, "a click into the middle finds nothing")
        if vertex:
            rows = dict(map(tuple, vertex["rows"]))
            # On the Earth, it is told otherwise.
            place = [float(c) for c in rows.get("x y z", "nan nan nan").split()]
            must("x y z" not in rows or all(a - 1e-3 <= c <= b + 1e-3 for a, c, b in zip(low, place, high)), f"the vertex {place} is not within the mesh's box {low} {high}")
            print("A click tells:", "; ".join(f"{name} {value}" for name, value in vertex["rows"]), "\n")
        must(seen["distance"] and seen["distance"]["lines"] > 0 and any(name == "distance" for name, _ in seen["distance"]["rows"]), "two clicks measure no distance")
        must(seen["narrow"]["wide"] <= 360 and not seen["narrow"]["open"] and seen["narrow"]["touched"] and not seen["narrow"]["errors"], f"narrow: {seen['narrow']}")
        must(seen["none"]["shown"] and "WebGL 2" in seen["none"]["words"] and not seen["none"]["errors"], f"without WebGL 2: {seen['none']}")

        # Colours: as many pixels of each class's hue as make it seen.
        colours = seen["colours"]
        must(len({(pictures / colour["name"]).read_bytes() for colour in colours.values()}) == len(colours), "colours do not change the picture")
        if "_CLASSIFICATION" in colours:
            legend = colours["_CLASSIFICATION"]["legend"]
            pixels = numpy.asarray(Image.open(pictures / colours["_CLASSIFICATION"]["name"]).convert("RGB")).astype(float).reshape(-1, 3)
            pixels = pixels[(abs(pixels - BACKGROUND) > 3).any(axis=1)]
            linear = lambda c: numpy.where(c <= 0.04045 * 255, c / 255 / 12.92, ((c / 255 + 0.055) / 1.055) ** 2.4)
            hues = linear(pixels) / linear(pixels).sum(axis=1, keepdims=True).clip(1e-9)
            known = {number: linear(numpy.array(colour, float)) for number, colour in CLASSES.items()}
            nearest = numpy.argmin([abs(hues - colour / colour.sum()).sum(axis=1) for colour in known.values()], axis=0)
            shares = {number: float((nearest == i).mean()) for i, number in enumerate(known)}
            if not arguments.cloud:
                must(all(word in legend for word in ("ground", "building", "high vegetation")), f"the legend says {legend}")
                must(all(shares[number] > 0.02 for number in (2, 5, 6)), f"classes are seen as {shares}")
        # Other people's readers.
        files = {path.name: counted(path) for path in tree.parent.glob("*.glb")}
        by_level = [sum(own for name, (own, _) in files.items() if name.startswith(f"{number}-")) for number in range(len(levels))]
        must(by_level == [level["triangles"] for level in levels], f"tiles have {by_level} triangles by level")
        rows = []
        for reader, count in (("three", list), ("cesium", None)):
            found = seen[reader]
            heard = [words for words in found["heard"]["errors"] if OF_VERSION not in words]
            must(not found["errors"] and not heard, f"{reader}: {found['errors'][:3]} {heard[:3]}")
            must(all(urlparse(url).hostname == "127.0.0.1" or url.startswith(("data:", "blob:")) for url in found["heard"]["requests"]), f"{reader}: a request leaves this machine")
            missing = sorted(set(files) - set(found["triangles"]))
            must(not missing, f"{reader}: {len(missing)} of {len(files)} tiles were not loaded: {missing[:5]}")
            for name, there in found["triangles"].items():
                own, others = files[name]
                must(there == (own + others if reader == "cesium" else [part for part in (own, others) if part]), f"{reader}: {name} has {there} triangles, not {own} and {others}")
            rows.append([f"{reader} {found['version']}", f"{len(found['triangles'])} of {len(files)}", ", ".join(f"{look['drawn']:,}" for look in found["found"])])
        print(table(["reader", "tiles loaded", f"triangles drawn from {', '.join(map(str, CLOSENESS))} radii"], rows), "\n")

        # Reports.
        rows = []
        for page in seen["pages"]:
            path = Path(page["file"])
            must(not page["heard"]["errors"], f"{path.name}: {page['heard']['errors'][:3]}")
            must(all(url.startswith(("file://", "data:")) for url in page["heard"]["requests"]) and sum(url.startswith("file://") for url in page["heard"]["requests"]) == 1, f"{path.name}: asks for {page['heard']['requests'][:4]}")
            must(all(page["images"]) and page["images"], f"{path.name}: has no picture")
            must(page["stats"]["triangles"] > 0 and page["stats"]["failed"] == 0, f"{path.name}: shows no mesh")
            rows.append([path.name, f"{path.stat().st_size / 1e6:.2f} MB", f"{page['stats']['triangles']:,}", f"{page['bars']}"])
        print(table(["report", "size", "triangles", "bars of charts"], rows))
        for words in wrong:
            print("WRONG:", words)
        sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
