"""What can be taken for a cloud: arrays, and the objects of other packages by what they have in common."""

import collections.abc
import os

import numpy as np

# What a LAS file's dimensions are called that are no attributes.
_COORDINATES = {"X", "Y", "Z", "x", "y", "z"}


def is_path(points):
    """Whether it is a path, or several."""
    if isinstance(points, (str, bytes, os.PathLike)):
        return True
    return isinstance(points, (list, tuple)) and len(points) > 0 and all(isinstance(p, (str, bytes, os.PathLike)) for p in points)


def numeric(array, name):
    """An array in a type that is read where it lies, or a copy in one that is. What is masked becomes NaN."""
    array = np.asanyarray(array)
    if isinstance(array, np.ma.MaskedArray):
        array = unmasked(array, name)
    # A view of its own: whoever changes the shape of an array that is being read does not change this one's.
    array = array.view(np.ndarray)
    if array.dtype.kind == "b":
        return array.view(np.uint8)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{name}: expected numbers, found {array.dtype}")
    if array.dtype.itemsize not in ((4, 8) if array.dtype.kind == "f" else (1, 2, 4, 8)):
        return array.astype(np.float32 if array.dtype.itemsize < 4 else np.float64)
    if not array.dtype.isnative:
        return array.astype(array.dtype.newbyteorder("="))
    if not array.flags.aligned or any(stride % array.dtype.itemsize for stride in array.strides):
        # A field of packed records, whose numbers do not lie where numbers of their type do.
        return array.copy()
    return array


def unmasked(array, name):
    """The array of a masked one, with NaN in the masked places."""
    if not np.ma.is_masked(array):
        return array.data
    if array.dtype.kind != "f":
        raise ValueError(f"{name}: values of {array.dtype} are masked, a type without NaN to stand for them; fill them, or leave them out")
    return array.filled(np.nan)


def columns(name, values):
    """Names and arrays of one attribute: ``rgb`` of shape (n, 3) is red, green and blue."""
    if not isinstance(name, str):
        raise TypeError(f"attribute {name!r}: expected a name of type str, found {type(name).__name__}")
    values = numeric(values, f"attribute {name!r}")
    if values.ndim == 1:
        return [(name, values)]
    if values.ndim == 2 and name.lower() in ("rgb", "colors", "colours") and values.shape[1] in (3, 4):
        if values.dtype.kind == "f":
            values = np.round(np.clip(np.nan_to_num(values), 0.0, 1.0) * 255.0).astype(np.uint8)
        return [(part, values[:, i]) for i, part in enumerate(("red", "green", "blue"))]
    raise ValueError(f"attribute {name!r}: expected one number for each point, found the shape {values.shape}")


def xyz(array, what):
    """An array (n, 3) of points. A point with a masked coordinate is none."""
    if isinstance(array, np.ma.MaskedArray) and array.dtype.kind in "iu":
        array = array.astype(np.float64)
    array = numeric(array, what)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{what}: expected an array of shape (n, 3), found {array.shape}")
    return array


def fields(records, names, what):
    """Coordinates and attributes of what has a field for each of them: an array of records, a table."""
    own = {axis: [name for name in names if str(name).lower() == axis] for axis in "xyz"}
    listed = ", ".join(str(name) for name in names)
    missing = [axis for axis in "xyz" if not own[axis]]
    if missing:
        raise ValueError(f"{what}: the records have no {', '.join(missing)}; their fields are {listed}")
    twice = [axis for axis in "xyz" if len(own[axis]) > 1]
    if twice:
        raise ValueError(f"{what}: the records have {', '.join(twice)} in small and in capital letters; their fields are {listed}")
    coordinates = tuple(numeric(records[own[axis][0]], f"{what}: {axis}") for axis in "xyz")
    others = {name: np.asanyarray(records[name]) for name in names if [name] not in own.values()}
    return coordinates, {name: values for name, values in others.items() if values.ndim == 1 and values.dtype.kind in "iufb"}


def of(points, what="points"):
    """Coordinates, an array (n, 3) or three of shape (n,), and attributes of whatever is taken for one cloud; None if it is none."""
    if isinstance(points, np.ndarray):
        if points.dtype.names:
            return fields(points.reshape(-1), points.dtype.names, what)
        return xyz(points, what), {}
    # laspy.LasData
    if hasattr(points, "point_format") and hasattr(points, "xyz"):
        names = [name for name in points.point_format.dimension_names if name not in _COORDINATES]
        return xyz(np.asarray(points.xyz), what), {name: np.asarray(points[name]) for name in names}
    # Open3D
    if hasattr(points, "points") and hasattr(points, "has_colors"):
        attributes = {"rgb": np.asarray(points.colors)} if points.has_colors() else {}
        return xyz(np.asarray(points.points), what), attributes
    # PyVista
    if hasattr(points, "points") and hasattr(points, "point_data"):
        data = {name: np.asarray(points.point_data[name]) for name in points.point_data}
        kept = {n: a for n, a in data.items() if a.dtype.kind in "iufb" and (a.ndim == 1 or n.lower() == "rgb")}
        return xyz(np.asarray(points.points), what), kept
    # trimesh
    if hasattr(points, "vertices"):
        return xyz(np.asarray(points.vertices), what), {}
    # Tables of pandas, whose columns may stand in any order.
    if hasattr(points, "columns") and hasattr(points, "to_numpy"):
        return fields(points, list(points.columns), what)
    if hasattr(points, "__array__") or isinstance(points, memoryview):
        return of(np.asarray(points), what)
    if isinstance(points, (collections.abc.Mapping, bytes, bytearray, str)):
        raise TypeError(f"{what}: expected an array or a cloud, found {type(points).__name__}")
    if isinstance(points, collections.abc.Sequence) and len(points) > 0 and is_row(points[0]):
        try:
            rows = np.asarray(points, dtype=np.float64)
        except (TypeError, ValueError) as wrong:
            raise ValueError(f"{what}: expected rows of three numbers: {wrong}") from None
        return xyz(rows, what), {}
    return None


def is_row(thing):
    """Whether it is what rows of a nested list are, or numbers in them, and no cloud."""
    if isinstance(thing, np.ndarray):
        return thing.ndim < 2 and not thing.dtype.names
    return isinstance(thing, (collections.abc.Sequence, int, float, np.generic))
