#!/usr/bin/env python3
"""Writes small files of every format to fuzz/corpus, for the targets to begin with. Needs Python, and for Zstandard the command zstd."""
import gzip
import pathlib
import struct
import subprocess

CORPUS = pathlib.Path(__file__).parent / "corpus"
POINTS = [(0.0, 0.5, 1.0), (1.5, -2.0, 3.25), (1e3, 0.0, float("nan")), (-4.0, 5.0, 6.0)]
FLOATS = b"".join(struct.pack("<3f", *p) for p in POINTS)


def seed(target, name, content):
    folder = CORPUS / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def lines(points=POINTS, before="", between=" ", after="\n"):
    return "".join(before + between.join(map(str, p)) + after for p in points)


def ply():
    head = "ply\nformat {} 1.0\ncomment c\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    yield "ascii", (head + "property list uchar int l\nproperty uchar red\nend_header\n").format("ascii") + lines(after=" 2 1 1 7\n")
    yield "binary", (head + "end_header\n").format("binary_little_endian").encode() + FLOATS
    yield "big", (head + "property uchar red\nend_header\n").format("binary_big_endian").encode() + b"".join(
        struct.pack(">3fB", *p, 7) for p in POINTS)
    yield "lists", (head + "property list uchar ushort l\nend_header\n").format("binary_little_endian").encode() + b"".join(
        struct.pack("<3fBH", *p, 1, 5) for p in POINTS)


def text():
    yield "blanks", lines()
    yield "commas", "x,y,z,intensity\n" + lines(between=",", after=",7\n")
    yield "counts", "4\n" + lines()
    yield "semicolons", "// a comment\n" + lines(between=";").replace(".", ",")


def raw():
    yield "plain", b'{"fields":[["x","f4"],["y","f4"],["z","f4"]]}\0\0' + FLOATS
    yield "scaled", (b'{"version":1,"fields":[["x","<i4"],["y","<i4"],["z","<i4"],["intensity","<u2"],["_","V2"]],"endian":"le","skip":2,'
                     b'"scale":[0.01,1,1],"offset":[1,2,3],"srs":"a","count":2}\0\0ab') + struct.pack("<3iHH3iHH", 1, 2, 3, 4, 5, 6, 7, 8, 9, 0)


def pcd():
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F {}\nCOUNT 1 1 1 1\nWIDTH {}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA {}\n"
    yield "ascii", head.format("U", 4, 4, "ascii") + lines(after=" 4294901760\n")
    yield "binary", head.format("F", 4, 4, "binary").encode() + b"".join(struct.pack("<3fI", *p, 0x010203) for p in POINTS)
    columns = struct.pack("<4f", 0, 0, 1, 1) * 4
    packed = bytes([15]) + columns[:16] + bytes([0xE0, 39, 15])
    yield "compressed", head.format("F", 4, 4, "binary_compressed").encode() + struct.pack("<II", len(packed), 64) + packed
    yield "old", "COLUMNS x y z n\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 2\nWIDTH 4\nDATA ascii\n" + lines(after=" 1 2\n")


def npy():
    def file(descr, fortran, shape, data, version=1):
        head = f"{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}\n".encode()
        return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", len(head)) + head + data
    yield "plain", file("'<f4'", False, (4, 3), FLOATS)
    yield "fortran", file("'>f8'", True, (4, 3), struct.pack(">12d", *range(12)), 2)
    fields = "[('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('i', '<u2', (2,)), ('c', '|u1'), (('t', 'n'), '|S3')]"
    yield "records", file(fields, False, (4,), b"".join(struct.pack("<3f2HB3s", *p, 1, 2, 3, b"abc") for p in POINTS), 3)


def obj():
    yield "plain", "# a\no thing\n" + lines(before="v ") + "vn 0 0 1\nf 1/1/1 2 3\n"
    yield "colours", lines(before="v ", after=" 0.5 0 1\n") + "f -1 -2 -3\n"


def stl():
    facet = "facet normal 0 0 1\nouter loop\n" + lines(POINTS[:3], before="vertex ") + "endloop\nendfacet\n"
    yield "ascii", "solid a\n" + facet + "endsolid a\n"
    yield "binary", bytes(80) + struct.pack("<I", 2) + (struct.pack("<3f", 0, 0, 1) + FLOATS[:36] + b"\0\0") * 2


def packed():
    yield "gzip", gzip.compress(FLOATS * 4, mtime=0)
    yield "members", gzip.compress(lines().encode(), mtime=0) * 2 + bytes(16)
    yield "ply", gzip.compress(dict(ply())["binary"], mtime=0)
    for name, content in {"frames": lines().encode(), "pcd": dict(pcd())["compressed"]}.items():
        frame = subprocess.run(["zstd", "-q", "-c"], input=content, stdout=subprocess.PIPE, check=True).stdout
        yield name, b"\x50\x2a\x4d\x18\x03\0\0\0abc" + frame + (frame if name == "frames" else b"")


for target in [ply, text, raw, pcd, npy, obj, stl, packed]:
    for name, content in target():
        seed(target.__name__, name, content)
