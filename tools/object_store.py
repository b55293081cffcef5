#!/usr/bin/env python3
"""Runs with inputs, folder of tasks and output in an object store: what must come out is the mesh of a run on local files, byte for byte.

    python3 tools/object_store.py                  # all trials, five times
    python3 tools/object_store.py --smoke          # each once, with few points
    python3 tools/object_store.py bounds copc      # some of them

    cluster    three tiles of LAZ, three processes, a folder of tasks and a mesh in S3
    twice      two processes do the same tasks at the same time
    killed     a process is killed in the midst of an upload: nothing is there by that name, and others finish
    bounds     with --bounds, of tiles that lie apart little more than the header is fetched
    copc       with --bounds, of a COPC file the chunks that meet the box are fetched, and few others
    changed    a tile that is another by the time it is read is told, and nothing is made of it
    refused    what must not be written, or is not there, is told at once

The store is moto's server on this machine. Between it and the program lies a proxy, which answers a share of the requests with 429, 500 or 503, lets some hang and then cuts them, cuts
others in the midst of their answer, and loses answers of what was done. The number of a round alone decides which: `--first N` begins with number N.
The program is one that is built with the feature object-store, or that of --program. Exit code 1 if any trial fails.
"""

import argparse
import collections
import contextlib
import filecmp
import http.client
import http.server
import json
import logging
import os
import random
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from shared import ROOT, environment, stoppable

PACKAGES = ["moto[server]", "boto3", "laspy", "lazrs", "copclib", "numpy"]
# A process that does not end is a failure.
PATIENCE = 900
# Exit codes after which a process is started again, as an engine does.
AGAIN = {69, 74, 75, 76}
BUCKET = "bucket"
# Of a tile that lies apart: its first bytes, and what is behind its points.
HEADERS = 80_000


class Handler(http.server.BaseHTTPRequestHandler):
    """Hands requests on to the store, but for those that are in for trouble."""

    protocol_version = "HTTP/1.1"

    def cut(self):
        self.close_connection = True
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def body(self, key):
        """What is uploaded; None if it is not whole."""
        length = int(self.headers.get("Content-Length") or 0)
        parts, left = [], length
        while left:
            piece = self.rfile.read(min(left, 64 << 10))
            if not piece:
                return None
            parts.append(piece)
            left -= len(piece)
            if self.server.slow and self.command == "PUT" and self.server.slow in key:
                self.server.uploading.set()
                time.sleep(0.1)
        return b"".join(parts)

    def handed_on(self):
        proxy = self.server
        key = self.path.split("?")[0].removeprefix(f"/{BUCKET}/")
        body = self.body(key)
        if body is None:
            return self.cut()
        trouble = proxy.trouble()
        if trouble in (429, 500, 503):
            answer = b"<Error><Code>SlowDown</Code><Message>later</Message></Error>"
            self.send_response(trouble)
            self.send_header("Content-Length", str(0 if self.command == "HEAD" else len(answer)))
            self.end_headers()
            return None if self.command == "HEAD" else self.wfile.write(answer)
        if trouble == "hang":
            time.sleep(proxy.hangs)
            return self.cut()
        connection = http.client.HTTPConnection(*proxy.upstream, timeout=120)
        connection.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
        for name, value in self.headers.items():
            connection.putheader(name, value)
        connection.endheaders(body or None)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        if trouble == "lost":
            return self.cut()
        self.send_response(answer.status)
        length = answer.headers.get("Content-Length") if self.command == "HEAD" else str(len(content))
        for name, value in answer.headers.items():
            if name.lower() not in ("content-length", "transfer-encoding", "connection", "date", "server"):
                self.send_header(name, value)
        self.send_header("Content-Length", length or "0")
        self.end_headers()
        if self.command == "HEAD":
            return None
        if trouble == "cut":
            content = content[: len(content) // 2]
        if self.command == "GET":
            proxy.count(key, len(content))
        self.wfile.write(content)
        return self.cut() if trouble == "cut" else None

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = handed_on

    def log_message(self, *_):
        pass


class Proxy(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, upstream, hangs):
        super().__init__(("127.0.0.1", 0), Handler)
        self.upstream, self.hangs = upstream, hangs
        self.lock, self.uploading = threading.Lock(), threading.Event()
        self.begin(random.Random(0), 0)
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def begin(self, chance, share):
        """From now on, this share of requests is in for trouble."""
        with self.lock:
            self.chance, self.share, self.slow = chance, share, None
            self.got, self.troubles = collections.Counter(), collections.Counter()
        self.uploading.clear()

    def trouble(self):
        with self.lock:
            if self.chance.random() >= self.share:
                return None
            what = self.chance.choice([429, 500, 503, 503, "hang", "cut", "lost"])
            self.troubles[what] += 1
            return what

    def count(self, key, length):
        with self.lock:
            self.got[key] += length

    def handle_error(self, *_):
        """Who is gone does not hear the answer."""


def tile(path, number, points):
    """A tile of hills as LAZ, 50 wide, in a row along x."""
    import laspy
    import numpy

    chance = numpy.random.default_rng(number)
    x, y = chance.uniform(0, 50, points) + 50 * number, chance.uniform(0, 50, points)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [0.0] * 3
    las = laspy.LasData(header)
    las.x, las.y, las.z = x, y, hills(numpy, chance, x, y)
    las.write(path)


def hills(numpy, chance, x, y):
    return 2 * numpy.sin(x / 9) * numpy.cos(y / 7) + chance.normal(0, 0.01, len(x))


def copc(path, points):
    """The same as COPC: a square of 100 on three levels, each node with its share of the points."""
    import copclib
    import numpy

    chance = numpy.random.default_rng(9)
    x, y = chance.uniform(0, 100, points), chance.uniform(0, 100, points)
    z = hills(numpy, chance, x, y)
    vector = copclib.Vector3
    config = copclib.CopcConfigWriter(6, vector(0.001, 0.001, 0.001), vector(0, 0, 0))
    header, info = config.las_header, config.copc_info
    header.min, header.max = vector(x.min(), y.min(), z.min()), vector(x.max(), y.max(), z.max())
    info.spacing, info.center_x, info.center_y, info.center_z, info.halfsize = 5.0, 50.0, 50.0, 0.0, 50.0
    writer = copclib.FileWriter(str(path), config)
    levels = chance.choice([0, 2, 4], points, p=[0.05, 0.15, 0.8])
    for level in (0, 2, 4):
        side, most = 100 / 2**level, 2**level - 1
        of_level = numpy.flatnonzero(levels == level)
        keys = numpy.stack([x, y, z + 50], 1)[of_level] // side
        keys = keys.clip(0, most).astype(int)
        for key in numpy.unique(keys, axis=0):
            node = copclib.Points(header)
            for number in of_level[(keys == key).all(1)]:
                point = node.CreatePoint()
                point.x, point.y, point.z = float(x[number]), float(y[number]), float(z[number])
                node.AddPoint(point)
            writer.AddNode(copclib.VoxelKey(level, *(int(place) for place in key)), node)
    writer.Close()


class Trials:
    def __init__(self, options, folder):
        import boto3
        from moto.server import ThreadedMotoServer

        for name in ("werkzeug", "botocore", "boto3"):
            logging.getLogger(name).setLevel(logging.ERROR)
        self.folder, self.share = folder, options.share
        self.program = options.program.resolve() if options.program else built()
        self.points = options.points
        server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
        server.start()
        upstream = server.get_host_and_port()
        keys = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1"}
        self.s3 = boto3.client(
            "s3",
            endpoint_url=f"http://{upstream[0]}:{upstream[1]}",
            region_name="us-east-1",
            aws_access_key_id="key",
            aws_secret_access_key="secret",
        )
        self.proxy = Proxy(upstream, options.hangs)
        address = f"http://127.0.0.1:{self.proxy.server_address[1]}"
        self.environment = os.environ | keys | {"AWS_ENDPOINT_URL": address, "AWS_ALLOW_HTTP": "true", "TMPDIR": str(folder)}
        self.tiles = folder / "tiles"
        self.tiles.mkdir()
        for number in range(3):
            tile(self.tiles / f"t{number}.laz", number, self.points)
        copc(folder / "hills.copc.laz", self.points)
        self.s3.create_bucket(Bucket=BUCKET)
        self.expected = {}

    def put(self, place, path):
        self.s3.upload_file(str(path), BUCKET, place)

    def keys(self, prefix=""):
        pages = self.s3.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=prefix)
        return {entry["Key"]: entry["Size"] for page in pages for entry in page.get("Contents", [])}

    def clear(self):
        for key in self.keys():
            self.s3.delete_object(Bucket=BUCKET, Key=key)

    def start(self, *words):
        errors = tempfile.TemporaryFile(dir=self.folder)
        line = [str(word) for word in (self.program, *words)]
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=errors, env=self.environment)

        def told():
            errors.seek(0)
            return errors.read().decode(errors="replace").strip()[-900:]

        process.told = told
        return process

    def run(self, *words):
        process = self.start(*words)
        return process.wait(PATIENCE), process.told()

    def mesh(self, name, inputs, *options):
        """The mesh that a run on local files makes."""
        key = (tuple(inputs), options)
        if key not in self.expected:
            path = self.folder / f"{name}.ply"
            code, told = self.run(*inputs, "-o", path, *OPTIONS, *options, "--quiet")
            if code != 0:
                sys.exit(f"a run on local files failed: {told}")
            self.expected[key] = path
        return self.expected[key]

    def same(self, key, expected):
        if key not in self.keys():
            return f"{key} is not there"
        path = self.folder / "fetched.ply"
        self.s3.download_file(BUCKET, key, str(path))
        return None if filecmp.cmp(path, expected, shallow=False) else f"{key} has other bytes"

    def planned(self, *more):
        self.clear()
        for path in sorted(self.tiles.iterdir()):
            self.put(f"tiles/{path.name}", path)
        words = ("plan", f"s3://{BUCKET}/tiles/*.laz", "-o", f"s3://{BUCKET}/out/city.ply", "--work", f"s3://{BUCKET}/work", "--processes", 3)
        for _ in range(5):
            code, told = self.run(*words, *OPTIONS, *more, "--quiet")
            if code not in AGAIN:
                return None if code == 0 else f"plan failed with {code}: {told}"
        return f"plan failed again and again: {told}"

    def worked(self, processes=3):
        """Processes do all tasks; one that fails and may be started again is."""
        words = [("work", f"s3://{BUCKET}/work", "--any", "--shard", f"{number}/{processes}", "-j", 1, "--quiet") for number in range(processes)]
        running, starts, end = [(self.start(*line), line) for line in words], 0, time.monotonic() + PATIENCE
        while running:
            process, line = running.pop(0)
            try:
                code = process.wait(max(0, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                [other.kill() for other, _ in [(process, line), *running]]
                return "no end"
            if code in AGAIN and starts < 20:
                starts += 1
                running.append((self.start(*line), line))
            elif code != 0:
                [other.kill() for other, _ in running]
                return f"work failed with {code}: {process.told()}"
        return None

    def local(self, *options):
        return self.mesh(f"local{len(self.expected)}", sorted(self.tiles.iterdir()), *options)

    def cluster(self, chance):
        self.proxy.begin(chance, self.share)
        return self.planned() or self.worked() or self.same("out/city.ply", self.local())

    def twice(self, chance):
        self.proxy.begin(chance, self.share)
        wrong = self.planned()
        while not wrong:
            code, told = None, ""
            listed = subprocess.run(
                [self.program, "tasks", f"s3://{BUCKET}/work", "--ready", "--json"], stdout=subprocess.PIPE, env=self.environment, check=False
            )
            if listed.returncode in AGAIN:
                continue
            if listed.returncode != 0:
                return f"tasks failed with {listed.returncode}"
            listed = json.loads(listed.stdout)
            if listed["finished"]:
                break
            task = chance.choice(listed["tasks"])["task"]
            both = [self.start("work", f"s3://{BUCKET}/work", task, "-j", 1, "--quiet") for _ in range(2)]
            for process in both:
                code, told = process.wait(PATIENCE), process.told()
                if code != 0 and code not in AGAIN:
                    wrong = f"{task} failed with {code}: {told}"
        return wrong or self.same("out/city.ply", self.local())

    def killed(self, chance):
        self.proxy.begin(chance, 0)
        wrong = self.planned()
        if wrong:
            return wrong
        self.proxy.slow = "work/data/"
        process = self.start("work", f"s3://{BUCKET}/work", "--any", "-j", 1, "--quiet")
        if not self.proxy.uploading.wait(PATIENCE):
            return "nothing was uploaded"
        time.sleep(chance.uniform(0, 0.3))
        process.kill()
        process.wait()
        # Whatever is there is whole, and nothing says that it is done.
        halves = [key for key in self.keys("work/data/bucket-") if self.keys("work/done/bucket-")]
        if halves:
            return f"a task is done that was killed: {halves}"
        self.proxy.slow = None
        return self.worked(2) or self.same("out/city.ply", self.local())

    def bounds(self, chance):
        self.proxy.begin(chance, 0)
        box = "--bounds=60,5,-10,90,45,10"
        wrong = self.planned(box)
        if wrong:
            return wrong
        self.proxy.begin(chance, 0)
        wrong = self.worked()
        if wrong:
            return wrong
        self.proxy.begin(chance, 0)
        code, told = self.run(f"s3://{BUCKET}/tiles/", "-o", f"s3://{BUCKET}/out/alone.ply", *OPTIONS, box)
        if code != 0:
            return f"a run failed with {code}: {told}"
        got = {key: count for key, count in self.proxy.got.items() if key.startswith("tiles/")}
        whole = self.keys("tiles/")
        if any(got[f"tiles/t{number}.laz"] > HEADERS for number in (0, 2)) or got["tiles/t1.laz"] < whole["tiles/t1.laz"]:
            return f"fetched {got} of {whole}"
        if "fetched" not in told:
            return f"it is not told what was fetched: {told}"
        self.figures = f"fetched {sum(got.values()):,} of {sum(whole.values()):,} bytes"
        expected = self.local(box)
        return self.same("out/city.ply", expected) or self.same("out/alone.ply", expected)

    def copc(self, chance):
        self.clear()
        self.proxy.begin(chance, 0)
        path = self.folder / "hills.copc.laz"
        self.put("hills.copc.laz", path)
        low = [chance.uniform(0, 80) for _ in range(2)]
        box = f"--bounds={low[0]},{low[1]},-20,{low[0] + 15},{low[1] + 15},20"
        code, told = self.run(f"s3://{BUCKET}/hills.copc.laz", "-o", f"s3://{BUCKET}/out.ply", *OPTIONS, box)
        if code != 0:
            return f"a run failed with {code}: {told}"
        got, whole = self.proxy.got["hills.copc.laz"], path.stat().st_size
        self.figures = f"fetched {got:,} of {whole:,} bytes"
        if got > whole * 3 // 4:
            return self.figures
        return self.same("out.ply", self.mesh(f"copc{len(self.expected)}", [path], box))

    def changed(self, chance):
        self.proxy.begin(chance, 0)
        wrong = self.planned()
        if wrong:
            return wrong
        self.put("tiles/t1.laz", self.tiles / "t0.laz")
        code, told = self.run("work", f"s3://{BUCKET}/work", "--any", "-j", 1, "--quiet")
        if code != 75 or "changed" not in told:
            return f"exit code {code}: {told}"
        return "a mesh of changed tiles" if "out/city.ply" in self.keys() else None

    def refused(self, chance):
        self.clear()
        self.proxy.begin(chance, 0)
        tile_path = self.tiles / "t0.laz"
        self.put("there.ply", tile_path)
        cases = [
            ([tile_path, "-o", f"s3://{BUCKET}/there.ply"], 2, "exists already"),
            ([tile_path, "-o", f"s3://{BUCKET}/city/tileset.json"], 2, "folder of this machine"),
            ([tile_path, "-o", f"s3://{BUCKET}/city.ply", "--tile", "10"], 2, "folder of this machine"),
            ([tile_path, "-o", f"s3://{BUCKET}/city.ply", "--preview"], 2, "folder of this machine"),
            ([tile_path, "-o", self.folder / "no.ply", "--work", f"s3://{BUCKET}/work"], 2, "asra-stream plan"),
            ([f"s3://{BUCKET}/none.laz", "-o", self.folder / "no.ply"], 66, "no such object"),
            ([f"s3://{BUCKET}/none/*.laz", "-o", self.folder / "no.ply"], 66, "matches no object"),
            (["s3://elsewhere/a.laz", "-o", self.folder / "no.ply"], 66, "NoSuchBucket"),
            (["work", f"s3://{BUCKET}/none", "--any"], 2, "no folder of tasks"),
        ]
        for words, expected, part in cases:
            code, told = self.run(*words, *([] if words[0] == "work" else OPTIONS), "--quiet")
            if code != expected or part not in told:
                return f"{' '.join(map(str, words))}: exit code {code}: {told}"
        return None


OPTIONS = ("--surface", "terrain", "--cell-size", "0.5", "--max-memory", "500M", "-j", "2")
ALL = ["cluster", "twice", "killed", "bounds", "copc", "changed", "refused"]


def built():
    """This repository's program with the feature, built for release."""
    command = ["cargo", "build", "--release", "--locked", "--features", "object-store", "--message-format=json-render-diagnostics"]
    told = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    messages = [json.loads(line) for line in told.splitlines()]
    return Path(next(m["executable"] for m in messages if m.get("executable") and m["target"]["name"] == "asra-stream"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", metavar="TRIAL", help="some of the trials [default: all]")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--points", type=int, default=400_000, help="of each tile")
    parser.add_argument("--share", type=float, default=0.08, help="of requests that are in for trouble")
    parser.add_argument("--hangs", type=float, default=3, help="seconds until a request that hangs is cut")
    parser.add_argument("--smoke", action="store_true", help="one round with few points")
    parser.add_argument("--program", type=Path)
    options = parser.parse_args()
    if not set(options.what) <= set(ALL):
        parser.error(f"trials are {', '.join(ALL)}")
    if options.smoke:
        options.rounds, options.points, options.hangs = 1, 60_000, 1
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(options, Path(folder))
        for number in range(options.first, options.first + options.rounds):
            for what in options.what or ALL:
                trials.figures, start = "", time.monotonic()
                wrong = getattr(trials, what)(random.Random(f"{what} {number}"))
                failed += wrong is not None
                troubles = ", ".join(f"{count} × {name}" for name, count in sorted(trials.proxy.troubles.items(), key=str))
                figures = "; ".join(part for part in (trials.figures, troubles) if part)
                print(f"{what} {number}: {wrong or 'good'}, {time.monotonic() - start:.1f} s" + (f" ({figures})" if figures else ""), flush=True)
    print(f"{failed} failed" if failed else "all are good")
    # The server's threads are nobody's to wait for.
    sys.stdout.flush()
    os._exit(1 if failed else 0)


if __name__ == "__main__":
    environment("object-store", PACKAGES)
    stoppable(main, "stopped")
