"""What can be taken for a cloud: arrays, and the objects of other packages by what they have in common."""

import collections.abc
import os

import numpy as np

# What a LAS file's dimensions are called that are no attributes.
_COORDINATES = {"X", "Y", "Z", "x", "y", "z"}


def is_path(points):
    """Whether it is a path, or several."""
    if isinstance(points, (str, os.PathLike)):
        return True
    return isinstance(points, (list, tuple)) and len(points) > 0 and all(isinstance(p, (str, os.PathLike)) for p in points)


def numeric(array, name):
    """An array in a type that is read where it lies, or a copy in one that is."""
    array = np.asarray(array)
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


def columns(name, values):
    """Names and arrays of one attribute: ``rgb`` of shape (n, 3) is red, green and blue."""
    values = numeric(values, f"attribute {name!r}")
    if values.ndim == 1:
        return [(name, values)]
    if values.ndim == 2 and name.lower() in ("rgb", "colors", "colours") and values.shape[1] in (3, 4):
        if values.dtype.kind == "f":
            values = np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
        return [(part, values[:, i]) for i, part in enumerate(("red", "green", "blue"))]
    raise ValueError(f"attribute {name!r}: expected one number for each point, found the shape {values.shape}")


def xyz(array):
    """An array (n, 3) of points."""
    array = numeric(array, "points")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points: expected an array of shape (n, 3), found {array.shape}")
    return array


def structured(array):
    """Coordinates and attributes of an array of records."""
    lower = {name.lower(): name for name in array.dtype.names}
    missing = [name for name in "xyz" if name not in lower]
    if missing:
        raise ValueError(f"points: the records have no {', '.join(missing)}; their fields are {', '.join(array.dtype.names)}")
    flat = array.reshape(-1)
    coordinates = tuple(numeric(flat[lower[name]], name) for name in "xyz")
    others = [name for name in array.dtype.names if name.lower() not in "xyz" and array.dtype[name].kind in "iufb"]
    return coordinates, {name: flat[name] for name in others if array.dtype[name].shape == ()}


def of(points):
    """Coordinates, an array (n, 3) or three of shape (n,), and attributes of whatever is taken for one cloud; None if it is none."""
    if isinstance(points, np.ndarray):
        if points.dtype.names:
            return structured(points)
        return xyz(points), {}
    # laspy.LasData
    if hasattr(points, "point_format") and hasattr(points, "xyz"):
        names = [name for name in points.point_format.dimension_names if name not in _COORDINATES]
        return xyz(np.asarray(points.xyz)), {name: np.asarray(points[name]) for name in names}
    # Open3D
    if hasattr(points, "points") and hasattr(points, "has_colors"):
        attributes = {"rgb": np.asarray(points.colors)} if points.has_colors() else {}
        return xyz(np.asarray(points.points)), attributes
    # PyVista
    if hasattr(points, "points") and hasattr(points, "point_data"):
        data = {name: np.asarray(points.point_data[name]) for name in points.point_data}
        kept = {n: a for n, a in data.items() if a.dtype.kind in "iufb" and (a.ndim == 1 or n.lower() == "rgb")}
        return xyz(np.asarray(points.points)), kept
    # trimesh
    if hasattr(points, "vertices"):
        return xyz(np.asarray(points.vertices)), {}
    if hasattr(points, "__array__"):
        return of(np.asarray(points))
    if isinstance(points, collections.abc.Sequence) and not isinstance(points, (str, bytes, bytearray)):
        if len(points) > 0 and not isinstance(points[0], np.ndarray):
            return xyz(np.asarray(points, dtype=np.float64)), {}
    return None
