#!/usr/bin/env python3
"""Opens the rasters that asra-stream writes with GDAL (rasterio), and compares them cell by cell with NumPy's own gridding of the points,
and with those of gdal_grid and PDAL's writers.gdal where these are on the path.

    python3 -m venv v && v/bin/pip install rasterio 'laspy[lazrs]' numpy
    v/bin/python tools/rasters.py target/release/asra-stream TILE.laz [OPTION ...]

Prints size, reference system, block size, overviews and no-data of each raster, and the largest difference to the highest and to the mean
of the points of each cell. gdal_grid looks round a node, not into a square: it is given each point in the middle of its cell. Exit code 1 if a raster differs, or GDAL reads anything else than was asked for.
"""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

import laspy
import numpy
import rasterio

SIDE = 1.0


def gridded(x, y, z, top, left, shape):
    """The highest and the mean of each cell, row 0 in the north."""
    row, column = top - numpy.floor(y / SIDE).astype(int), numpy.floor(x / SIDE).astype(int) - left
    highest, total, count = numpy.full(shape, -numpy.inf), numpy.zeros(shape), numpy.zeros(shape)
    numpy.maximum.at(highest, (row, column), z)
    numpy.add.at(total, (row, column), z)
    numpy.add.at(count, (row, column), 1)
    with numpy.errstate(invalid="ignore"):
        return numpy.where(count > 0, highest, numpy.nan), total / count


def by_gdal_grid(folder, x, y, z, left, top, shape, which):
    """What gdal_grid makes of the points, each in the middle of its cell."""
    columns = numpy.floor(numpy.column_stack([x, y]) / SIDE) * SIDE + SIDE / 2
    numpy.savetxt(folder / "points.csv", numpy.column_stack([columns, z]), fmt="%.6f", delimiter=",", header="x,y,z", comments="")
    layer = '<OGRVRTLayer name="points"><SrcDataSource>points.csv</SrcDataSource><GeometryType>wkbPoint</GeometryType>'
    fields = '<GeometryField encoding="PointFromColumns" x="x" y="y" z="z"/></OGRVRTLayer>'
    (folder / "points.vrt").write_text(f"<OGRVRTDataSource>{layer}{fields}</OGRVRTDataSource>")
    rows, columns = shape
    command = ["gdal_grid", "-q", "-l", "points", "-zfield", "z", "-ot", "Float64", "-outsize", columns, rows]
    command += ["-txe", left, left + columns * SIDE, "-tye", top, top - rows * SIDE]
    command += ["-a", f"{('maximum', 'average')[which]}:radius1={SIDE / 4}:radius2={SIDE / 4}:nodata=-9999", "points.vrt", "grid.tif"]
    subprocess.run(list(map(str, command)), check=True, cwd=folder)
    return folder / "grid.tif"


def by_pdal(folder, x, y, z, left, top, shape, which):
    """What PDAL's writers.gdal makes of the points."""
    numpy.savetxt(folder / "points.txt", numpy.column_stack([x, y, z]), fmt="%.6f", delimiter=",", header="X,Y,Z", comments="")
    rows, columns = shape
    writer = {"type": "writers.gdal", "filename": "pdal.tif", "resolution": SIDE, "binmode": True, "data_type": "double", "output_type": ("max", "mean")[which]}
    writer |= {"origin_x": left, "origin_y": top - rows * SIDE, "width": columns, "height": rows}
    (folder / "grid.json").write_text(json.dumps(["points.txt", writer]))
    subprocess.run(["pdal", "pipeline", "grid.json"], check=True, cwd=folder)
    return folder / "pdal.tif"


def main(program, tile, *options):
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        line = [program, tile, "--surface", "ground", "--classes", "2,9", "--raster-size", str(SIDE), "--max-hole", "0c", "-q", *options]
        subprocess.run([*line, "--dsm", folder / "dsm.tif", "--dtm", folder / "dtm.tif", "-o", folder / "m.ply"], check=True)
        points = laspy.read(tile)
        classes, withheld = numpy.asarray(points.classification), numpy.asarray(points.withheld) != 0
        x, y, z = (numpy.asarray(c) for c in (points.x, points.y, points.z))
        for name, chosen, which in (("dsm", ~withheld, 0), ("dtm", ~withheld & numpy.isin(classes, [2, 9]), 1)):
            with rasterio.open(folder / f"{name}.tif") as raster:
                found, transform = raster.read(1), raster.transform
                print(f"{name}: {raster.width} x {raster.height}, {raster.crs}, blocks {raster.block_shapes[0]}, overviews {raster.overviews(1)}, "
                      f"no data {raster.nodata}, {raster.dtypes[0]}, {raster.compression}")
                if raster.dtypes[0] != "float32" or not numpy.isnan(raster.nodata) or raster.block_shapes[0] != (256, 256):
                    wrong.append(f"{name}: not as asked for")
                if max(found.shape) > 256 and not raster.overviews(1):
                    wrong.append(f"{name}: no overviews")
            top, left = round(transform.f / SIDE) - 1, round(transform.c / SIDE)
            expected = gridded(x[chosen], y[chosen], z[chosen], top, left, found.shape)[which]
            same = numpy.isnan(found) == numpy.isnan(expected)
            difference = numpy.nanmax(numpy.abs(found - expected))
            print(f"     {numpy.count_nonzero(~numpy.isnan(found)):,} cells known, {numpy.count_nonzero(~same)} of them or others differ in that; "
                  f"heights differ by {difference:.2g} at most")
            if not same.all() or difference > 1e-4:
                wrong.append(f"{name}: other heights")
            for other, made in (("gdal_grid", by_gdal_grid), ("pdal", by_pdal)):
                if not shutil.which(other):
                    continue
                place = transform.c, transform.f, found.shape
                with rasterio.open(made(folder, x[chosen], y[chosen], z[chosen], *place, which)) as raster:
                    theirs = raster.read(1)
                    # gdal_grid numbers rows as it was asked to, from the north.
                    theirs = numpy.where(theirs == -9999, numpy.nan, theirs)
                same = numpy.isnan(found) == numpy.isnan(theirs)
                difference = numpy.nanmax(numpy.abs(found - theirs))
                print(f"     {other}: {numpy.count_nonzero(~same)} cells are known to one alone; heights differ by {difference:.2g} at most")
                if not same.all() or difference > 1e-4:
                    wrong.append(f"{name}: {other} has other heights")
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
