"""A finished mesh."""

import functools
import json
import os
import tempfile
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._command import executed, shown
from ._errors import UsageError
from ._options import as_paths, words


class Mesh:
    """A triangle mesh: closed, oriented and manifold, unless an open surface was asked for. It holds nothing of its cloud.

    Arrays are made when they are first asked for, and kept.
    """

    def __init__(self, core: _core.Mesh) -> None:
        self._core = core

    @functools.cached_property
    def vertices(self) -> NDArray[np.float32] | NDArray[np.float64]:
        """Vertices, an array (n, 3) in the points' coordinates: ``float32`` if the points were, else ``float64``."""
        return self._core.vertices()

    @functools.cached_property
    def local_vertices(self) -> NDArray[np.float32]:
        """Vertices less :attr:`origin`, an array (n, 3) of ``float32``: for graphics."""
        return self._core.local_vertices()

    @functools.cached_property
    def triangles(self) -> NDArray[np.uint32]:
        """Triangles, an array (m, 3) of ``uint32``: numbers of vertices, counter-clockwise seen from outside."""
        return self._core.triangles()

    @property
    def faces(self) -> NDArray[np.uint32]:
        """The same array as :attr:`triangles`."""
        return self.triangles

    @functools.cached_property
    def attributes(self) -> dict[str, NDArray[Any]]:
        """What vertices have from their points: names to arrays of n numbers, in the points' types."""
        out = {}
        for name in self._core.attribute_names():
            dtype, values = self._core.attribute(name)
            out[name] = values.view(dtype)
        return out

    @property
    def colors(self) -> NDArray[Any] | None:
        """Colours of the vertices, an array (n, 3), or None."""
        if all(name in self.attributes for name in ("red", "green", "blue")):
            return np.stack([self.attributes[name] for name in ("red", "green", "blue")], axis=1)
        return None

    @property
    def origin(self) -> tuple[float, ...]:
        """What is taken off :attr:`local_vertices`, and off vertices in formats of 32 bits: three numbers, zero but for points in double precision far from zero."""
        return tuple(self._core.origin)

    @property
    def crs(self) -> dict[str, Any] | None:
        """The reference system of the points: a dict, or None."""
        text = self._core.crs()
        return None if text is None else json.loads(text)

    @functools.cached_property
    def report(self) -> dict[str, Any]:
        """What is to be told of its making, as ``--report`` writes it: a dict."""
        return json.loads(self._core.report())

    @property
    def is_sealed(self) -> bool:
        """Whether it encloses the inside: the samples part inside and outside everywhere."""
        return self.report["closing"]["sealed"]

    @property
    def is_closed(self) -> bool:
        """Whether every edge has two triangles."""
        if self.report["check"] is None:
            raise UsageError("is_closed: the mesh was not checked, as no_check asked; check() does it", code=2)
        return self.report["check"]["closed"]

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False, coordinates: str | None = None) -> None:
        """Writes a .ply, .stl, .obj or .glb file, which appears when it is whole.

        ``coordinates`` is "input" (those of the points) or "local" (less :attr:`origin`); what is usual for the format if None. Raises UsageError for a file
        that exists, unless ``overwrite``, and for another ending; NoOutputError and IoError.
        """
        self._core.save(os.fsdecode(path), overwrite, coordinates)

    def simplify(
        self,
        tolerance: float | str | None = None,
        *,
        max_triangles: int | None = None,
        keep_borders: str | None = None,
        keep_colours: int | None = None,
        move_vertices: bool = False,
        progress: Any = None,
    ) -> "Mesh":
        """The mesh with fewer triangles: as few as can be with no place of either surface farther than ``tolerance`` from the other.

        ``tolerance`` is a length, cells as in "0.25c", or per cents of the longest side as in "0.01%"; ``max_triangles`` is a number of triangles, with the least
        tolerance that does or, within ``tolerance``, those that matter most. ``keep_borders`` is "classification" (triangles are not joined across classes) or "none".
        No channel of a colour changes by more than ``keep_colours`` steps of 255 anywhere; None: as much as it may. Every vertex that is left is one of this mesh's, with its
        attributes, unless ``move_vertices`` places them better, with attributes between those that were there. A closed mesh stays closed, and no triangles intersect.
        ``report["simplification"]`` tells the distance that was reached. Raises UsageError, CannotFitError, and what ``progress`` raises.
        """
        if tolerance is None and max_triangles is None:
            raise UsageError("simplify: expected a tolerance, max_triangles, or both", code=2)
        asked = {"simplify": tolerance, "max_triangles": max_triangles, "keep_borders": keep_borders, "keep_colours": keep_colours, "move_vertices": move_vertices}
        line = words(asked)
        with shown(progress) as tell:
            return Mesh(self._core.simplify(line, tell))

    def check(self, *, progress: Any = None, **options: Any) -> dict[str, Any]:
        """What a strict check finds, with an exact search for triangles that intersect: a dict, see :func:`check`. With ``progress`` or options it goes through a
        temporary file. Ctrl-C ends it."""
        if not progress and not options:
            return json.loads(self._core.check())
        with tempfile.TemporaryDirectory(prefix="asra-stream-") as folder:
            return executed(["check"], [self._written(folder, "mesh.ply")], options, progress)

    def compare(self, reference: "str | os.PathLike[str] | Mesh", *, progress: Any = None, **options: Any) -> dict[str, Any]:
        """How far it lies from a reference, a path or another mesh, and that from it: a dict, see :func:`compare`. Both go through temporary files."""
        return compared(self, reference, options, progress)

    def render(self, output: str | os.PathLike[str] | None = None, *, progress: Any = None, **options: Any) -> dict[str, Any] | bytes:
        """Draws a picture (PNG) to ``output``, and gives its path and triangles; without ``output``, gives the picture's bytes. Options as of :func:`render`."""
        with tempfile.TemporaryDirectory(prefix="asra-stream-") as folder:
            own = self._written(folder, "mesh.ply")
            if output is not None:
                return executed(["render"], [own], {"output": output, **options}, progress)
            picture = os.path.join(folder, "mesh.png")
            executed(["render"], [own], {"output": picture, **options}, progress)
            with open(picture, "rb") as file:
                return file.read()

    def _written(self, folder: str, name: str) -> str:
        path = os.path.join(folder, name)
        self.save(path)
        return path

    def to_trimesh(self) -> Any:
        """A ``trimesh.Trimesh`` with the same vertices (``float64``) and triangles (``int64``) in the same order, and colours of eight bits."""
        import trimesh

        return trimesh.Trimesh(self.vertices, self.triangles, vertex_colors=_eight_bits(self.colors), process=False)

    def to_open3d(self) -> Any:
        """An ``open3d.geometry.TriangleMesh`` with the same vertices (``float64``) and triangles (``int32``) in the same order, and colours from 0 to 1."""
        import open3d

        mesh = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(self.vertices.astype(np.float64)),
            open3d.utility.Vector3iVector(self.triangles.astype(np.int32)),
        )
        if self.colors is not None:
            mesh.vertex_colors = open3d.utility.Vector3dVector(_eight_bits(self.colors) / 255.0)
        return mesh

    def to_pyvista(self) -> Any:
        """A ``pyvista.PolyData`` with the same vertices and triangles in the same order, and all attributes, in their types, as point data."""
        import pyvista

        mesh = pyvista.PolyData.from_regular_faces(cast(Any, self.vertices), cast(Any, self.triangles))
        for name, values in self.attributes.items():
            mesh.point_data[name] = values
        return mesh

    def __reduce__(self) -> Any:
        raise TypeError("a Mesh lies in temporary storage, and cannot be pickled: save() it, or take its arrays")

    def __copy__(self) -> "Mesh":
        return Mesh(self._core)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Mesh":
        return Mesh(self._core)

    def __len__(self) -> int:
        """The number of triangles."""
        return self._core.triangle_count

    def __repr__(self) -> str:
        return f"<asra_stream.Mesh: {self._core.vertex_count:,} vertices, {self._core.triangle_count:,} triangles>"

    def _repr_png_(self) -> Any:
        return self.render(size="800x600")


def compared(mesh, reference, options, progress):
    """What the command says of two meshes, each a path or a Mesh."""
    with tempfile.TemporaryDirectory(prefix="asra-stream-") as folder:
        sides = [("mesh.ply", mesh), ("reference.ply", reference)]
        paths = [side._written(folder, name) if isinstance(side, Mesh) else side for name, side in sides]
        return executed(["compare"], as_paths(paths), options, progress)


def _eight_bits(colors):
    if colors is None or colors.dtype == np.uint8:
        return colors
    return (colors >> 8 if colors.max(initial=0) > 255 else colors).astype(np.uint8)
