#!/usr/bin/env python3
"""Writes small files of every format to fuzz/corpus, for the targets to begin with. Needs Python, and for Zstandard the command zstd."""
import gzip
import pathlib
import random
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


# Of LAZ, an item's type and size by what it holds; of LAS, what is in a record of each point format.
ITEMS = {"point": (6, 20), "time": (7, 8), "colours": (8, 6), "wave": (9, 29),
         "point14": (10, 30), "colours14": (11, 6), "colours and nir": (12, 8), "wave14": (13, 29)}
FORMATS = [["point"], ["point", "time"], ["point", "colours"], ["point", "time", "colours"], ["point", "time", "wave"],
           ["point", "time", "colours", "wave"], ["point14"], ["point14", "colours14"], ["point14", "colours and nir"],
           ["point14", "wave14"], ["point14", "colours and nir", "wave14"]]


def coded(number):
    """A number as LAZ's table of chunks has its first one, 128 to 65535: of uniform models, none of which has changed yet."""
    base, length, shifted = 0, 0xFFFFFFFF, 4
    bits = (number - 1).bit_length()
    corrected = number - 1
    low = bits - 8
    for symbol, symbols in [(bits, 33), (corrected >> low, 256), (corrected & (1 << low) - 1, 1 << low)]:
        start = [(0x80000000 // symbols * s) >> 16 for s in (symbol, symbol + 1)]
        part = length >> 15
        base += start[0] * part
        length = (length if symbol + 1 == symbols else start[1] * part) - start[0] * part
        while length < 1 << 24:
            base, length, shifted = base << 8, length << 8, shifted + 1
    return (base + length // 2).to_bytes(shifted, "big") + bytes(8)


def las():
    def vlr(user, number, content):
        return struct.pack("<H16sHH32s", 0, user, number, len(content), b"") + content

    def file(point_format, extra=b"", vlrs=(), points=b"", laz=False):
        layered, length = point_format >= 6, sum(ITEMS[item][1] for item in FORMATS[point_format]) + len(extra)
        head = 375 if layered else 227
        start, packed = head + sum(map(len, vlrs)), 128 if laz else 0
        out = struct.pack("<4s20xBB68xHIIBHI", b"LASF", 1, 4 if layered else 2, head, start, len(vlrs), point_format | packed, length,
                          0 if layered else 12).ljust(131, b"\0")
        out += struct.pack("<6d", 0.01, 0.01, 0.001, 5e5, 4e6, 0)
        out = out.ljust(247, b"\0") + struct.pack("<Q", 12) if layered else out
        return out.ljust(head, b"\0") + b"".join(vlrs) + points

    def records(point_format, extra=b""):
        length = sum(ITEMS[item][1] for item in FORMATS[point_format])
        return [struct.pack("<3iHB", i, -7 * i, 100 * i, i, 0x11).ljust(length, bytes([i])) + extra for i in range(12)]

    noise = random.Random(1)
    described = struct.pack("<HBB32s76xd16xd48x", 0, 4, 24, b"Deviation", 0.5, 10)
    place = vlr(b"LASF_Projection", 34735, struct.pack("<8H", 1, 1, 0, 1, 3072, 0, 1, 25832))
    for point_format, items in enumerate(FORMATS):
        extra = b"ab" if point_format in [1, 7] else b""
        vlrs = [vlr(b"LASF_Spec", 4, described), place] if extra else []
        yield f"plain{point_format}", file(point_format, extra, vlrs, b"".join(records(point_format, extra)))
        # Streams of noise decode as any other, until they end.
        layered, first = point_format >= 6, records(point_format, extra)[0]
        described_items = [(*ITEMS[item], 3 if layered else 1 if item == "wave" else 2) for item in items]
        described_items += [(14 if layered else 0, len(extra), 3 if layered else 2)] if extra else []
        layers = {10: 9, 12: 2, 14: len(extra)}
        many = sum(layers.get(kind, 1) for kind, _, _ in described_items)
        for name, kind, size in [("listed", 3 if layered else 2, 50), ("unlisted", 3 if layered else 2, 5), ("one", 1, 50)]:
            if layered and name == "one":
                continue
            chunks = b""
            for points in [12] if size == 50 else [5, 5, 2]:
                streams = [b"\0" + noise.randbytes(60) for _ in range(many)] if layered else [b"\0" + noise.randbytes(399)]
                sizes = struct.pack(f"<{1 + many}I", points, *map(len, streams)) if layered else b""
                chunks += first + sizes + b"".join(streams)
            content = struct.pack("<HHBBHIIqqH", kind, 0, 2, 2, 0, 0, size, -1, -1, len(described_items))
            content += b"".join(struct.pack("<3H", *item) for item in described_items)
            laszip = [*vlrs, vlr(b"laszip encoded", 22204, content)]
            start = len(file(point_format, extra, laszip)) + 8
            table = struct.pack("<II", 0, 1) + coded(len(chunks))
            packed = {"listed": struct.pack("<q", start + len(chunks)) + chunks + table, "unlisted": struct.pack("<q", -1) + chunks, "one": chunks}
            yield f"{name}{point_format}", file(point_format, extra, laszip, packed[name], True)


def e57():
    def place(at):
        return at // 1020 * 1024 + at % 1020

    def file(scans, more=""):
        """What is in the pages. A scan has fields, each with a description and a stream, and a description of its own."""
        sections, described = b"", ""
        for fields, own in scans:
            streams = [stream for _, _, stream in fields]
            packet = struct.pack(f"<{1 + len(streams)}H", len(streams), *map(len, streams)) + b"".join(streams)
            packet += bytes(-len(packet) % 4)
            at = 48 + len(sections)
            sections += struct.pack("<B7xQQQ", 1, 36 + len(packet), place(at + 32), 0)
            sections += struct.pack("<BBH", 1, 0, len(packet) + 3) + packet
            prototype = "".join(f"<{name} type={kind}/>" for name, kind, _ in fields)
            described += f'<s>{own}<points fileOffset="{place(at)}" recordCount="4"><prototype>{prototype}</prototype></points></s>'
        xml = f'<?xml version="1.0"?><e57Root>{more}<data3D>{described}</data3D></e57Root>'.encode()
        return struct.pack("<8sIIQQQQ", b"ASTM-E57", 1, 0, 4096, place(48 + len(sections)), len(xml), 1024) + sections + xml

    def floats(*names):
        return [(name, '"Float" precision="single"', FLOATS[4 * i:][:16]) for i, name in enumerate(names)]

    scaled = [(f"cartesian{axis}", f'"ScaledInteger" minimum="-9" maximum="{most}" scale="0.1" offset="2"', bytes(range(size)))
              for axis, most, size in [("X", 1000, 5), ("Y", -9, 0), ("Z", 99999, 9)]]
    colours = [(f"color{name}", '"Integer" minimum="0" maximum="255"', b"\1\2\3\4") for name in ["Red", "Green", "Blue"]]
    rest = [("cartesianInvalidState", '"Integer" minimum="0" maximum="2"', b"\x10"), ("intensity", '"Float"', bytes(32)),
            ("returnIndex", '"Integer" minimum="0" maximum="6"', b"\x11\2"), ("isColorInvalid", '"Integer" minimum="0" maximum="1"', b"\4")]
    pose = "<pose><rotation><w>0.8</w><x>0.6</x></rotation><translation><x>1e3</x><y/></translation></pose>"
    limits = "<colorLimits><colorRedMinimum>5</colorRedMinimum><colorRedMaximum>99</colorRedMaximum></colorLimits>"
    plain = (floats("cartesianX", "cartesianY", "cartesianZ"), "")
    many = (scaled + colours + rest, pose + limits)
    round = (floats("sphericalRange", "sphericalAzimuth", "sphericalElevation"), pose)
    yield "plain", file([plain])
    yield "many", file([many], "<coordinateMetadata>EPSG:25832</coordinateMetadata>")
    yield "scans", file([plain, many, round], "<!-- a --><b><![CDATA[<c>]]>&lt;</b>")


for target in [ply, text, raw, pcd, npy, obj, stl, packed, las, e57]:
    for name, content in target():
        seed(target.__name__, name, content)
