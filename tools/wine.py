#!/usr/bin/env python3
"""Runs the command as built for Windows under Wine, and compares what it does with what the command as built for this machine does.

    tools/wine.py              builds both (release), runs each of the lines below in a folder of its own, compares exit codes and the bytes of all files
    tools/wine.py --no-build   with what has been built

It needs Rust's target x86_64-pc-windows-gnu, and Debian's gcc-mingw-w64-x86-64 and wine64. Wine 8 has no bcryptprimitives.dll, from which Rust's standard
library has its random numbers; a stand-in with that one function is compiled and put beside the program.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGET = "x86_64-pc-windows-gnu"
STAND_IN = """
#include <windows.h>
BOOLEAN NTAPI SystemFunction036(PVOID, ULONG);
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE out, SIZE_T bytes) { return SystemFunction036(out, (ULONG)bytes); }
"""

# Lines, and the exit codes that they end with. All write files by relative names.
LINES = [
    ("generate knot 20k -o knot.bin", 0),
    ("knot.bin -o knot.ply --report knot.json", 0),
    ("knot.bin -o knot.ply", 2),
    ("knot.bin -o knot.ply --overwrite -j 1 --max-memory 64M", 0),
    ("knot.bin -o knot.stl", 0),
    ("knot.bin -o knot.obj", 0),
    ("knot.bin -o knot.glb --preview", 0),
    ("check knot.glb", 0),
    ("compare knot.ply knot.bin", 0),
    ("render knot.ply -o picture.png --size 320x240", 0),
    ("info knot.bin", 0),
    ("plan knot.bin", 0),
    ("generate sphere 300k -o sphere.ply", 0),
    # More than the memory: points, slices and the mesh go to temporary files.
    ("sphere.ply -o sphere.mesh.ply -j 1 --max-memory 81M --temp-dir .", 0),
    ("sphere.ply -o small.ply --max-memory 1M", 71),
    ("densify knot.ply knot.bin -o dense.ply", 0),
    ("stadium --surface terrain --cell-size auto -o stadium.ply", 0),
    ("stadium --surface terrain --cell-size auto -o stadium.glb --tile 500", 0),
    ("stadium --surface terrain --cell-size auto -o stadium.glb --tile 500", 2),
    ("stadium --surface terrain --cell-size auto -o stadium.glb --tile 500 --overwrite", 0),
    ("generate torus 5k -o höhe☃.ply", 0),
    ("höhe☃.ply -o größe.stl", 0),
    ("none.ply", 66),
    ("knot.json", 65),
    ("knot.bin -o no/such/folder.ply", 73),
    ("knot.bin --cell-size x", 2),
]


def build():
    for more in ([], ["--target", TARGET]):
        subprocess.run(["cargo", "build", "--release", "--locked", *more], cwd=ROOT, check=True)


def run(program, line, folder):
    words = [*program, *line.split(" ")]
    # The folder of temporary files is not compared.
    done = subprocess.run(words, cwd=folder, capture_output=True, stdin=subprocess.DEVNULL, text=True, errors="replace")
    return done.returncode, done.stdout, done.stderr


def files(folder):
    return {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}


def stop():
    """Ends what Wine keeps running for its next program. Asking it to has been seen to hang; then it is made to."""
    for how in ("-k", "-k9"):
        try:
            subprocess.run(["wineserver", how], check=False, timeout=30)
            return
        except subprocess.TimeoutExpired:
            print(f"wineserver {how} did not return", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--no-build", action="store_true")
    if not parser.parse_args().no_build:
        build()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    wrong = []
    # Of Wine's own files some may come and go until the last of its processes has ended.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as work:
        work = Path(work)
        here, there, program = work / "here", work / "there", work / "program"
        program.mkdir()
        shutil.copy(target / TARGET / "release/asra-stream.exe", program)
        (work / "stand-in.c").write_text(STAND_IN)
        library = ["-shared", "-O2", work / "stand-in.c", "-o", program / "bcryptprimitives.dll", "-ladvapi32"]
        subprocess.run(["x86_64-w64-mingw32-gcc", *library], check=True)
        os.environ |= {"WINEPREFIX": str(work / "wine"), "WINEDEBUG": "-all"}
        os.environ.pop("DISPLAY", None)
        for folder in (here, there):
            folder.mkdir()
            shutil.copytree(ROOT / "tests/data/stadium", folder / "stadium")
        for line, code in LINES:
            found = run([target / "release/asra-stream"], line, here), run(["wine", program / "asra-stream.exe"], line, there)
            codes = [one[0] for one in found]
            print(f"{codes[1]:3}  {line}", flush=True)
            if codes != [code, code]:
                wrong.append(f"{line}: expected the exit code {code}, found {codes[0]} here and {codes[1]} there: {found[1][2]}")
            if found[0][1] != found[1][1].replace("\r\n", "\n") and not line.startswith(("plan", "info")):
                wrong.append(f"{line}: other words: {found[0][1]!r} {found[1][1]!r}")
        ours, theirs = files(here), files(there)
        if ours.keys() != theirs.keys():
            wrong.append(f"other files: {sorted(ours.keys() ^ theirs.keys())}")
        # A report has times and places in it.
        for name in sorted(ours.keys() & theirs.keys()):
            if name != "knot.json" and ours[name].read_bytes() != theirs[name].read_bytes():
                wrong.append(f"{name}: other bytes")
        stop()
    for one in wrong:
        print(one)
    print(f"{len(LINES)} runs, {len(ours)} files the same" if not wrong else f"{len(wrong)} differences")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
