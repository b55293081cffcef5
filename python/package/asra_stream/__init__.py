"""Point clouds to watertight triangle meshes, without normals, in bounded memory.

    >>> import asra_stream, numpy
    >>> z = numpy.linspace(-0.999, 0.999, 20000)
    >>> angle = 2.399963 * numpy.arange(20000)
    >>> r = numpy.sqrt(1 - z * z)
    >>> points = numpy.stack([r * numpy.cos(angle), r * numpy.sin(angle), z], axis=1)
    >>> mesh = asra_stream.reconstruct(points)
    >>> mesh.is_sealed, mesh.report["check"]["genus"]
    (True, 0)
    >>> mesh.vertices.shape[1], mesh.triangles.dtype
    (3, dtype('uint32'))

Keywords are the command's options with ``_`` for ``-``; ``asra-stream --help`` lists them, and docs/cli.md in the source.
"""

from ._core import __version__
from ._errors import (
    AsraError,
    CannotFitError,
    DataError,
    IntermediateError,
    InternalError,
    IoError,
    NoInputError,
    NoOutputError,
    NotReadyError,
    StoppedError,
    TemporaryError,
    UsageError,
)
from ._mesh import Mesh
from ._run import check, compare, info, plan, reconstruct, render, run, simplify

__all__ = [
    "AsraError",
    "CannotFitError",
    "DataError",
    "IntermediateError",
    "InternalError",
    "IoError",
    "Mesh",
    "NoInputError",
    "NoOutputError",
    "NotReadyError",
    "StoppedError",
    "TemporaryError",
    "UsageError",
    "__version__",
    "check",
    "compare",
    "info",
    "plan",
    "reconstruct",
    "render",
    "run",
    "simplify",
]
