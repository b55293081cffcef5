"""Reconstructions, and what else the command does."""

import collections.abc
import tempfile
from typing import Any, cast

import numpy as np

from . import _clouds, _core
from ._command import Progress, executed, shown
from ._errors import UsageError
from ._mesh import Mesh, compared
from ._options import Path, Paths, as_paths, words

# What is said of a file; a mesh in memory has none.
_OF_FILES = {"output", "overwrite", "tile", "batch", "preview", "html", "coordinates", "report", "quiet", "verbose", "write_classes", "dtm", "dsm"}

# Of points in pieces, what stays in memory, if nobody says how much memory there is.
_PIECES_IN_MEMORY = 64 << 20


def reconstruct(
    points: Any, *, attributes: collections.abc.Mapping[str, Any] | None = None, progress: Progress = None, **options: Any
) -> Mesh:
    """Makes a closed mesh, or with ``surface="terrain"`` or ``"sheet"`` an open one, of points without normals.

    Parameters
    ----------
    points
        One of: an array of shape (n, 3), of ``float32`` or ``float64``, read where it lies, whatever its strides (other numbers are converted);
        an array of records with fields x, y, z, whose other fields are attributes; ``laspy.LasData``; a cloud of Open3D, trimesh or PyVista;
        a path, a pattern such as ``"tiles/*.laz"``, a folder, or a list of these; or an iterable of arrays as above, which together may be
        larger than memory: they are kept in temporary storage.
    attributes : dict, optional
        Names to arrays of n numbers; ``"rgb"`` to an array (n, 3). The mesh's vertices get them from their points. Names are in lower case, with ``_`` for spaces.
        Not with iterables. With paths, the command's words: ``"none"``, or names such as ``"rgb,intensity"``.
    progress : callable or bool, optional
        Called about ten times a second with a dict: stage, unit, done, total, fraction (of the whole run), seconds_left, ended. True shows a bar.
        What it raises ends the run, and is raised.
    **options
        The command's options, with ``_`` for ``-``: ``cell_size="auto"``, ``surface="terrain"``, ``max_memory="2G"``, ``threads=4`` ...
        Lengths are in the points' unit. Options of files (``output``, ``tile``, ``report`` ...) are for :func:`run`.

    Returns
    -------
    Mesh

    Raises
    ------
    AsraError
        A class of its own for each kind of failure, UsageError (a ValueError) for options; TypeError and ValueError for what is no cloud;
        KeyboardInterrupt within half a second of Ctrl-C.

    The points are not copied as a whole, and must not change meanwhile. Other threads of Python go on.
    """
    for name in (name for name in options if name in _OF_FILES):
        raise UsageError(f"{name}: is for run(), which writes files; save() writes this mesh", code=2)
    line = words(options)
    with shown(progress) as tell:
        if _clouds.is_path(points):
            if isinstance(attributes, (str, list, tuple)):
                line, attributes = line + words({"attributes": attributes}), None
            _no_attributes(attributes, "files have")
            return Mesh(_core.reconstruct_files(as_paths(points), line, tell))
        cloud = _clouds.of(points)
        if cloud is None:
            if not isinstance(points, collections.abc.Iterable):
                raise TypeError(f"points: expected an array, a cloud, a path or an iterable of arrays, found {type(points).__name__}")
            _no_attributes(attributes, "pieces have")
            return Mesh(_core.reconstruct_spool(_spooled(points, options), line, tell))
        coordinates, own = cloud
        if attributes is not None and not isinstance(attributes, collections.abc.Mapping):
            raise TypeError(f"attributes: expected a dict of names and arrays, found {type(attributes).__name__}")
        named = {**own, **(attributes or {})}
        columns = [column for name, values in named.items() for column in _clouds.columns(name, values)]
        if isinstance(coordinates, tuple):
            return Mesh(_core.reconstruct_columns(list(coordinates), columns, line, tell))
        if coordinates.flags.c_contiguous and coordinates.dtype in (np.float32, np.float64):
            return Mesh(_core.reconstruct_rows(coordinates, columns, line, tell))
        return Mesh(_core.reconstruct_columns([coordinates[:, axis] for axis in range(3)], columns, line, tell))


def _no_attributes(attributes, what):
    if attributes:
        raise ValueError(f"attributes: {what} their own; pass them with the points")


def _spooled(pieces, options):
    spool = _core.PointSpool(_PIECES_IN_MEMORY, options.get("temp_dir"))
    for number, piece in enumerate(pieces):
        what = f"points: piece {number}"
        cloud = _clouds.of(piece, what)
        if cloud is None:
            raise TypeError(f"{what}: expected an array or a cloud, found {type(piece).__name__}")
        coordinates, own = cloud
        if not isinstance(coordinates, tuple):
            coordinates = [coordinates[:, axis] for axis in range(3)]
        columns = [column for name, values in own.items() for column in _clouds.columns(name, values)]
        spool.append(list(coordinates), columns)
    return spool


def run(inputs: Paths, output: Path | None = None, *, progress: Progress = None, **options: Any) -> dict[str, Any]:
    """From files to a mesh file, as the command does: the mesh is never held in memory. Gives the report, a dict.

    ``inputs`` is a path, a pattern, a folder or a list of these; ``output`` ends in .ply, .stl, .obj or .glb. Keywords as of :func:`reconstruct`, and
    ``overwrite``, ``tile``, ``preview`` ... Raises what :func:`reconstruct` raises, UsageError for an output that exists, and NoOutputError.
    """
    return executed([], as_paths(inputs), {"output": output, **options}, progress)


def info(inputs: Paths, *, progress: Progress = None, **options: Any) -> dict[str, Any]:
    """What is in files: layout, points, box, density, reference system, classes and returns, grid. A dict, see docs/info-and-plan.md.

    Lengths are in the unit of the coordinates. Raises NoInputError, DataError, and UsageError for options.
    """
    return executed(["info"], as_paths(inputs), options, progress)


def plan(inputs: Paths, *, progress: Progress = None, **options: Any) -> dict[str, Any]:
    """What a run would take: memory, disk, slices, triangles, tiles. A dict, see docs/info-and-plan.md.

    Memory and disk are in bytes. Raises NoInputError, DataError, CannotFitError, and UsageError for options.
    """
    return executed(["plan"], as_paths(inputs), options, progress)


def check(mesh: Path | Mesh, *, progress: Progress = None, **options: Any) -> dict[str, Any]:
    """What a strict check of a mesh file, or a :class:`Mesh`, finds. A dict: ``closed``, ``oriented``, ``manifold``, ``genus``, ``components``, ``area`` and ``volume``
    (in the unit of the coordinates, squared and cubed), ``intersections`` and more.

    A mesh that is not closed is no error. Raises NoInputError, DataError, and UsageError for options.
    """
    if isinstance(mesh, Mesh):
        return mesh.check(progress=progress, **options)
    return executed(["check"], as_paths(mesh), options, progress)


def compare(mesh: Path | Mesh, reference: Path | Mesh, *, progress: Progress = None, **options: Any) -> dict[str, Any]:
    """How far a mesh lies from a reference, a mesh or a cloud, and the reference from it. A dict.

    ``mesh_to_reference`` and ``reference_to_mesh`` hold, for vertices and centroids, the mean, the root mean square, the 95th percentile and the maximum, in the unit of the
    coordinates and in per cent of the reference's longest side and diagonal. Raises NoInputError, DataError, and UsageError for options.
    """
    return compared(mesh, reference, options, progress)


def simplify(mesh: Path | Mesh, output: Path, tolerance: float | str | None = None, *, progress: Progress = None, **options: Any) -> dict[str, Any]:
    """Leaves out triangles of a mesh file, or a :class:`Mesh`, and writes what is left to ``output``: .ply, .stl, .obj or .glb.

    ``tolerance`` and ``max_triangles`` as of :meth:`Mesh.simplify`. Gives a dict: ``simplification`` holds the triangles ``before`` and ``after``, and the distance that was
    ``reached``, in the unit of the coordinates; ``before`` and ``after`` what a check finds. Raises DataError for a mesh that is no oriented manifold or intersects itself,
    unless ``unsound=True``; UsageError for a file that exists, unless ``overwrite=True``, and for options; NoInputError, NoOutputError, CannotFitError.
    """
    with tempfile.TemporaryDirectory(prefix="asra-stream-") as folder:
        path = mesh._written(folder, "mesh.ply") if isinstance(mesh, Mesh) else mesh
        positional = as_paths(path) + ([] if tolerance is None else [str(tolerance)])
        return executed(["simplify"], positional, {"output": output, **options}, progress)


def render(mesh: Path | Mesh, output: Path, *, progress: Progress = None, **options: Any) -> dict[str, Any]:
    """Draws a picture (PNG) of a mesh file, or a :class:`Mesh`: ``views="iso,top"``, ``size="1600x1200"``, ``color_by="height"`` ...

    Gives a dict of its ``path`` and the ``triangles`` drawn. Raises UsageError for a file that exists, unless ``overwrite=True``, and for options; NoInputError, DataError,
    NoOutputError.
    """
    if isinstance(mesh, Mesh):
        return cast(dict[str, Any], mesh.render(output, progress=progress, **options))
    return executed(["render"], as_paths(mesh), {"output": output, **options}, progress)
