"""Runs asra-stream and judges a mesh: pieces, genus, open edges, volume, distances from a truth. For the tools that measure."""

import dataclasses
import hashlib
import json
import time
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from shared import last_line, measured

# Samples of each surface for distances.
SAMPLES = 200_000
NAMES = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
TYPES = dict(zip(NAMES.split(), "i1 u1 i2 u2 i4 u4 f4 f8 i1 u1 i2 u2 i4 u4 f4 f8".split(), strict=True))


@dataclasses.dataclass
class Body:
    """What a closed or open surface is: numbers that say whether it is the right one."""

    components: int
    # Summed over components; handles only, boundaries are not counted.
    genus: int
    # Edges of one triangle, and of more than two.
    open_edges: int
    tangled_edges: int
    # Of the flux through the triangles; none if there are open edges.
    volume: float | None
    triangles: int
    # Triangles of the largest component.
    largest: int


@dataclasses.dataclass
class Made:
    """What came of a run of the program."""

    outcome: str
    seconds: float
    sealed: bool = False
    digest: str = ""
    body: Body | None = None
    mesh: tuple | None = None
    words: str = ""


def read_ply(path):
    """Positions in the input's coordinates, and triangles, of a PLY file whose lists all have three entries; ASCII or binary."""
    with open(path, "rb") as file:
        elements, offset, form = [], np.zeros(3), None
        while True:
            line = file.readline()
            if not line:
                raise ValueError(f"{path}: no end of a PLY header")
            words = line.decode(errors="replace").split()
            match words:
                case ["end_header"]:
                    break
                case ["format", form, _]:
                    pass
                case ["comment", "origin", x, y, z]:
                    offset = np.array([float(x), float(y), float(z)])
                case ["element", name, count]:
                    elements.append((name, int(count), []))
                case ["property", "list", count, index, name]:
                    elements[-1][2].append((name, TYPES[count], TYPES[index]))
                case ["property", kind, name]:
                    elements[-1][2].append((name, TYPES[kind]))
        order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(form)
        vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        for name, count, fields in elements:
            if order is None:
                flat = [item for field in fields for item in ([field[0]] if len(field) == 2 else ["count", "a", "b", "c"])]
                rows = np.loadtxt(file, max_rows=count, ndmin=2) if count else np.zeros((0, len(flat)))
                column = {field: rows[:, i] for i, field in enumerate(flat)}
            else:
                kinds = []
                for field in fields:
                    kinds += [(field[0], order + field[1])] if len(field) == 2 else [("count", field[1]), ("abc", order + field[2], 3)]
                rows = np.frombuffer(file.read(count * np.dtype(kinds).itemsize), np.dtype(kinds))
                column = {field: rows[field] for field in rows.dtype.names}
                if "abc" in column:
                    column["a"], column["b"], column["c"] = column["abc"].T
            if len(rows) != count or ("count" in column and np.any(column["count"] != 3)):
                raise ValueError(f"{path}: {name}: cut off, or not of triangles")
            if name == "vertex":
                vertices = np.column_stack([column[axis].astype(float) for axis in "xyz"]) + offset
            elif name == "face":
                faces = np.column_stack([column[corner] for corner in "abc"]).astype(np.int64)
    return vertices, faces


def write_ply(path, vertices, faces=None):
    """Points of 32 bits, and triangles if there are any."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
    if faces is not None:
        head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    part = Path(f"{path}.part")
    with open(part, "wb") as out:
        out.write(f"{head}end_header\n".encode())
        out.write(np.ascontiguousarray(vertices, "<f4").tobytes())
        if faces is not None:
            rows = np.empty(len(faces), np.dtype([("count", "u1"), ("abc", "<i4", 3)]))
            rows["count"], rows["abc"] = 3, faces
            out.write(rows.tobytes())
    part.rename(path)


def volume(vertices, faces):
    """The volume that the triangles enclose, positive if they face outwards."""
    if not len(faces):
        return 0.0
    centred = vertices - vertices[faces[0, 0]]
    a, b, c = (centred[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def examine(vertices, faces):
    """The body that triangles with shared vertices make. Every speck counts as a component."""
    if not len(faces):
        return Body(0, 0, 0, 0, None, 0, 0)
    used, corners = np.unique(faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    count = len(used)
    begin, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    keys, uses = np.unique(np.minimum(begin, end) * count + np.maximum(begin, end), return_counts=True)
    low, high = keys // count, keys % count
    graph = coo_matrix((np.ones(len(keys), np.int8), (low, high)), shape=(count, count))
    components, label = connected_components(graph, directed=False)
    single = uses == 1
    loops = 0
    if single.any():
        rim, ends = np.unique(np.concatenate([low[single], high[single]]), return_inverse=True)
        first, second = np.split(ends, 2)
        graph = coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(len(rim), len(rim)))
        loops = connected_components(graph, directed=False)[0]
    # Euler's number of a component is 2 - 2 genus - loops.
    euler = count - len(keys) + len(faces)
    return Body(
        components=int(components),
        genus=(2 * int(components) - euler - loops) // 2,
        open_edges=int(single.sum()),
        tangled_edges=int((uses > 2).sum()),
        volume=None if single.any() else volume(vertices, faces),
        triangles=len(faces),
        largest=int(np.bincount(label[corners[:, 0]]).max()),
    )


def labelled(vertices, faces):
    """The component of each vertex; the edges, as one number, and how many triangles use each."""
    count = len(vertices)
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    keys, uses = np.unique(np.minimum(begin, end) * count + np.maximum(begin, end), return_counts=True)
    graph = coo_matrix((np.ones(len(keys), np.int8), (keys // count, keys % count)), shape=(count, count))
    return connected_components(graph, directed=False)[1], keys, uses


def closed_part(vertices, faces):
    """The triangles of the components that have no open edges."""
    label, keys, uses = labelled(vertices, faces)
    return vertices, faces[~np.isin(label[faces[:, 0]], label[keys[uses == 1] // len(vertices)])]


def without_specks(vertices, faces, share=0.01):
    """The triangles of the components that have at least this share of all."""
    label = labelled(vertices, faces)[0][faces[:, 0]]
    return vertices, faces[np.bincount(label)[label] >= share * len(faces)]


def surface_samples(vertices, faces, count, rng, weight=None):
    """Points spread evenly over the triangles by area (times a weight of each), and the triangle of each."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    share = np.linalg.norm(np.cross(b - a, c - a), axis=1) * (1 if weight is None else weight)
    total = np.cumsum(share)
    chosen = np.searchsorted(total, rng.random(count) * total[-1]).clip(0, len(faces) - 1)
    root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return a[chosen] * (1 - root) + b[chosen] * (root * (1 - along)) + c[chosen] * (root * along), chosen


class Truth:
    """A surface that distances are measured from, in per cent of its box's diagonal."""

    def __init__(self, vertices, faces):
        self.vertices, self.faces = vertices, faces
        corners = vertices[faces]
        self.low = corners.min((0, 1))
        self.diagonal = float(np.linalg.norm(corners.max((0, 1)) - self.low))

    def scene(self, vertices, faces):
        import open3d

        scene = open3d.t.geometry.RaycastingScene()
        scene.add_triangles(((vertices - self.low) / self.diagonal).astype(np.float32), faces.astype(np.uint32))
        return scene

    def root_mean_squares(self, vertices, faces):
        """From the truth to the mesh, and from the mesh to the truth."""
        if not len(faces):
            return [float("inf")] * 2
        found = []
        for (v, f), (w, g) in [((self.vertices, self.faces), (vertices, faces)), ((vertices, faces), (self.vertices, self.faces))]:
            points = (surface_samples(v, f, SAMPLES, np.random.default_rng(1))[0] - self.low) / self.diagonal
            distance = self.scene(w, g).compute_distance(points.astype(np.float32)).numpy()
            found.append(100 * float(np.sqrt(np.mean(distance.astype(float) ** 2))))
        return found


def inside(vertices, faces, points):
    """Which points the closed mesh encloses."""
    import open3d

    if not len(faces):
        return np.zeros(len(points), bool)
    low, size = vertices.min(0), np.ptp(vertices, axis=0).max()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(((vertices - low) / size).astype(np.float32), faces.astype(np.uint32))
    return scene.compute_occupancy(((points - low) / size).astype(np.float32), nsamples=3).numpy() > 0.5


def says_sealed(report):
    """Whether a run's report claims that the mesh encloses the inside. The one place that knows the field."""
    closing = report.get("closing")
    return bool(isinstance(closing, dict) and closing.get("sealed", False))


def run(program, cloud, folder, name, window="default", options=(), seconds=None, keep=False):
    """Runs the program on a cloud, and examines the mesh. Files go to the folder under the name; the mesh is removed unless it is to be kept."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh, report, log = (folder / f"{name}.{ending}" for ending in ("mesh.ply", "report.json", "log"))
    for path in (mesh, report):
        path.unlink(missing_ok=True)
    words = [] if window == "default" else ["--window", window]
    clouds = cloud if isinstance(cloud, list) else [cloud]
    began = time.monotonic()
    told = measured([program, *clouds, "-o", mesh, "--report", report, *words, *options], log, seconds)
    made = Made(told["outcome"], time.monotonic() - began)
    if made.outcome != "ok":
        made.words = last_line(log)
    if report.exists():
        made.sealed = made.outcome == "ok" and says_sealed(json.loads(report.read_text()))
    if made.outcome == "ok":
        made.digest = hashlib.sha256(mesh.read_bytes()).hexdigest()
        made.mesh = read_ply(mesh)
        made.body = examine(*made.mesh)
        if not keep:
            mesh.unlink()
    return made
