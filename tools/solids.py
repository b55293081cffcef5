"""Bodies whose components, genus and volume are known, samples of them, and what Open3D's Poisson makes of these. For the tools that measure."""

import dataclasses
import json
import math

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from judge import examine, surface_samples, volume, write_ply

# Changes when a body or its samples change, so that nothing old is taken from the work folder.
VERSION = 1
AXIS = np.array([0.36, 0.48, 0.8])
DEPTH = 8


@dataclasses.dataclass
class Solid:
    """Triangles that face outwards, and the width of the narrowest wall or slot."""

    vertices: np.ndarray
    faces: np.ndarray
    narrow: float = math.inf
    # A sphere on a floor: the points within the first radius lie in the body, those above the second do not.
    floor: float | None = None

    def __post_init__(self):
        self.truth = examine(self.vertices, self.faces)

    @property
    def area(self):
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    def spacing(self, points):
        """The sampling distance of so many points."""
        return math.sqrt(self.area / points)

    def normals(self):
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)

    def turned(self, degrees):
        return dataclasses.replace(self, vertices=self.vertices @ rotation(degrees).T)


def rotation(degrees, axis=AXIS):
    """About an axis that is none of the grid's."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(degrees)
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


# -- Parts, as manifold3d has them


def block(size, centre=(0, 0, 0)):
    from manifold3d import Manifold

    return Manifold.cube(size, True).translate(centre)


def rod(radius, height, centre=(0, 0, 0), turn=(0, 0, 0), top=None):
    from manifold3d import Manifold

    return Manifold.cylinder(height, radius, radius if top is None else top, 128, True).rotate(turn).translate(centre)


def ball(radius, centre=(0, 0, 0)):
    from manifold3d import Manifold

    return Manifold.sphere(radius, 256).translate(centre)


def ring(radius, tube):
    from manifold3d import CrossSection

    return CrossSection.circle(tube, 96).translate((radius, 0)).revolve(192)


def solid(part, narrow=math.inf):
    mesh = part.to_mesh64()
    vertices, faces = np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64)
    # Vertices that only differ by properties count as one.
    merged = np.arange(len(vertices))
    merged[np.asarray(mesh.merge_from_vert, dtype=np.int64)] = np.asarray(mesh.merge_to_vert, dtype=np.int64)
    return Solid(vertices, merged[faces], narrow)


# -- The bodies of the matrix


def sphere():
    return solid(ball(1))


def box():
    return solid(block((1, 0.7, 0.5)))


def torus():
    return solid(ring(1, 0.35))


def knot():
    """A trefoil's tube."""
    along, around = 600, 48
    t = np.linspace(0, 2 * math.pi, along, endpoint=False)[:, None]
    centre = np.hstack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)])
    first = np.hstack([np.cos(t) + 4 * np.cos(2 * t), -np.sin(t) + 4 * np.sin(2 * t), -3 * np.cos(3 * t)])
    second = np.hstack([-np.sin(t) - 8 * np.sin(2 * t), -np.cos(t) + 8 * np.cos(2 * t), 9 * np.sin(3 * t)])
    tangent = first / np.linalg.norm(first, axis=1, keepdims=True)
    binormal = np.cross(first, second)
    binormal /= np.linalg.norm(binormal, axis=1, keepdims=True)
    normal = np.cross(binormal, tangent)
    angle = np.linspace(0, 2 * math.pi, around, endpoint=False)[None, :, None]
    vertices = centre[:, None] + 0.4 * (np.cos(angle) * normal[:, None] + np.sin(angle) * binormal[:, None])
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    k, m = (i + 1) % along, (j + 1) % around
    a, b, c, d = (x.ravel() * around + y.ravel() for x, y in ((i, j), (k, j), (k, m), (i, m)))
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    vertices = vertices.reshape(-1, 3)
    return Solid(vertices, faces if volume(vertices, faces) > 0 else faces[:, ::-1], 0.4)


def gauge():
    """A plate with four slots and three bores right through it."""
    part = block((2, 0.7, 0.2))
    for x, width in zip((-0.8, -0.55, -0.25, 0.1), (0.08, 0.1, 0.13, 0.16), strict=True):
        part -= block((width, 0.4, 1), (x, 0, 0))
    for x, radius in zip((0.38, 0.58, 0.83), (0.05, 0.07, 0.08), strict=True):
        part -= rod(radius, 1, (x, 0, 0))
    return solid(part, 0.08)


def cad():
    """A block with a fin, a boss, a cone, a wedge, a bore and a groove."""
    from manifold3d import Manifold

    wedge = Manifold.hull_points(np.array([(1, -0.25, 0.0), (1, 0.25, 0), *((0.45, y, z) for y in (-0.25, 0.25) for z in (-0.12, 0.12))]))
    part = block((1, 0.7, 0.3)) + block((0.5, 0.08, 0.4), (0.2, 0.2, 0.3)) + rod(0.12, 0.3, (0.3, -0.15, 0.25)) + wedge
    part += rod(0.14, 0.35, (-0.28, 0.14, 0.315), top=0)
    part -= rod(0.12, 2, (-0.25, -0.14, 0))
    return solid(part - block((0.08, 2, 0.2), (0.03, 0, 0.15)), 0.08)


def plate():
    return solid(block((1, 0.7, 0.06)), 0.06)


def two():
    """Two bodies apart: a ball and a torus."""
    return solid(ball(0.7, (-1.2, 0, 0.1)) + ring(0.8, 0.28).rotate((70, 0, 20)).translate((1.1, 0.2, 0)), 0.5)


def nested():
    """A sphere in a sphere: a hollow ball."""
    return solid(ball(1) - ball(0.55), 0.45)


def on_floor(gap):
    """A sphere over a square of floor. The floor is no part of the truth."""
    body = solid(ball(1))
    lowest = body.vertices[:, 2].min() - gap
    corners = np.array([(x, y, lowest) for x in (-2.2, 2.2) for y in (-2.2, 2.2)])
    floor = Solid(np.vstack([body.vertices, corners]), np.vstack([body.faces, np.array([(0, 2, 3), (0, 3, 1)]) + len(body.vertices)]))
    floor.floor, floor.truth = lowest, body.truth
    return floor


BODIES = {body.__name__: body for body in (sphere, box, torus, knot, gauge, cad, plate, two, nested)} | {
    "floor": lambda: on_floor(0),
    "hover": lambda: on_floor(0.35),
}


def sample(body, points, rng, uneven=1.0):
    """Points on the body and their normals, as 32 bits hold them. Density uneven by a factor, along a direction."""
    weight = None
    if uneven > 1:
        middle = body.vertices[body.faces].mean(1) @ rng.normal(size=3)
        weight = uneven ** ((middle - middle.min()) / np.ptp(middle))
    where, face = surface_samples(body.vertices, body.faces, points, rng, weight)
    return where.astype(np.float32), body.normals()[face]


# -- Holes


def smoothed_normals(body, rounds=10):
    """Normals of faces, each mean of those round it, so many times."""
    normal = body.normals()
    for _ in range(rounds):
        corner = np.zeros_like(body.vertices)
        for i in range(3):
            np.add.at(corner, body.faces[:, i], normal)
        normal = corner[body.faces].sum(1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return normal


class Cutter:
    """Cuts holes of a share of the surface into a body: what lies in a ball about a place on it, hangs together with the place, and faces
    as the place does, so that the far side of a thin limb stays."""

    def __init__(self, body):
        self.faces, corners = body.faces, body.vertices[body.faces]
        self.centres, self.normals = corners.mean(1), smoothed_normals(body)
        self.areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        begin, end = body.faces.ravel(), np.roll(body.faces, -1, axis=1).ravel()
        keys = np.minimum(begin, end) * len(body.vertices) + np.maximum(begin, end)
        order = np.argsort(keys, kind="stable")
        same = np.flatnonzero(keys[order][1:] == keys[order][:-1])
        self.pairs = order[same] // 3, order[same + 1] // 3

    def patch(self, chosen, start):
        """Those of the chosen faces that hang together with the first."""
        label = self.pieces(chosen)
        return chosen & (label == label[start])

    def pieces(self, chosen):
        first, second = self.pairs
        both = chosen[first] & chosen[second]
        shape = (len(self.faces), len(self.faces))
        graph = coo_matrix((np.ones(both.sum(), np.int8), (first[both], second[both])), shape=shape)
        return connected_components(graph, directed=False)[1]

    def cut(self, share, rng):
        """Which faces a hole takes. Places where it would cut a part off are passed over."""
        wanted = share * self.areas.sum()
        for _ in range(500):
            start = rng.choice(len(self.faces), p=self.areas / self.areas.sum())
            distance = np.linalg.norm(self.centres - self.centres[start], axis=1)
            facing = self.normals @ self.normals[start] > 0
            low, high = 0.0, float(distance.max())
            if self.areas[self.patch(facing, start)].sum() < wanted:
                continue
            for _ in range(24):
                middle = (low + high) / 2
                enough = self.areas[self.patch(facing & (distance <= middle), start)].sum() >= wanted
                low, high = (low, middle) if enough else (middle, high)
            taken = self.patch(facing & (distance <= high), start)
            left = np.bincount(self.pieces(~taken)[~taken], self.areas[~taken])
            if left.max() > 0.99 * left.sum() and abs(self.areas[taken].sum() / wanted - 1) < 0.1:
                return taken
        raise ValueError(f"no place for a hole of {share} of the surface")


# -- Bodies that no list names


def smooth_body(rng):
    """Balls, rings and bars, blended."""
    from manifold3d import Manifold

    parts = []
    for _ in range(rng.integers(2, 5)):
        turn = rotation(rng.uniform(0, 360), rng.normal(size=3))
        parts.append((rng.integers(3), rng.uniform(-0.55, 0.55, 3), turn.tolist(), rng.uniform(0.3, 0.5), rng.uniform(0.14, 0.2)))
    parts = [(kind, centre.tolist(), turn, large, small) for kind, centre, turn, large, small in parts]

    def depth(x, y, z):
        total = 0.0
        for kind, (u, v, w), turn, large, small in parts:
            dx, dy, dz = x - u, y - v, z - w
            a, b, c = (row[0] * dx + row[1] * dy + row[2] * dz for row in turn)
            if kind == 0:
                far = math.sqrt(a * a + b * b + c * c) - large
            elif kind == 1:
                far = math.hypot(math.hypot(a, b) - large, c) - small
            else:
                far = math.hypot(math.hypot(a, b), max(abs(c) - large, 0)) - small
            total += math.exp(min(-far / 0.06, 60))
        return 0.06 * math.log(max(total, 1e-30))

    return solid(Manifold.level_set(depth, (-1.5, -1.5, -1.5, 1.5, 1.5, 1.5), 0.045))


def edged_body(rng):
    """Balls, boxes, rods and rings, joined, and bores through them."""
    part, centre = None, np.zeros(3)
    for _ in range(rng.integers(2, 6)):
        kind, turn, place = rng.integers(4), rng.uniform(0, 360, 3), centre.tolist()
        if kind == 0:
            new = ball(rng.uniform(0.3, 0.6))
        elif kind == 1:
            new = block(rng.uniform(0.4, 1.1, 3).tolist())
        elif kind == 2:
            new = rod(rng.uniform(0.2, 0.45), rng.uniform(0.5, 1.4))
        else:
            new = ring(rng.uniform(0.45, 0.7), rng.uniform(0.15, 0.22))
        new = new.rotate(turn.tolist()).translate(place)
        part = new if part is None else part + new
        way = rng.normal(size=3)
        centre = centre + rng.uniform(0.4, 0.7) * way / np.linalg.norm(way)
    for _ in range(rng.integers(0, 4)):
        low, high = np.array(part.bounding_box()).reshape(2, 3)
        place = (low + high) / 2 + rng.uniform(-0.2, 0.2, 3) * (high - low)
        part -= rod(rng.uniform(0.1, 0.2), 10, turn=rng.uniform(0, 360, 3).tolist()).translate(place.tolist())
    return solid(part)


def random_body(rng):
    """One piece, of any genus."""
    while True:
        body = smooth_body(rng) if rng.random() < 0.4 else edged_body(rng)
        if body.truth.components == 1 and not body.truth.open_edges and not body.truth.tangled_edges and body.truth.volume > 0.05:
            return body


# -- What has no inside


def sheet(name, points, rng):
    """Samples of an open surface, about 1 wide."""
    u, v = rng.uniform(-1, 1, (2, points))
    angle, spacing = math.pi * v, 2 / math.sqrt(points)
    zero = np.zeros(points)
    match name:
        case "flat":
            found = [u, v, zero]
        case "noisy":
            found = [u, v, rng.normal(scale=0.5 * spacing, size=points)]
        case "tilted":
            return (np.column_stack([u, v, zero]) @ rotation(35).T).astype(np.float32)
        case "half-bowl" | "dome":
            z = (u + 1) / 2 * (1 if name == "dome" else -1)
            found = [np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z]
        case "shallow-bowl":
            radius = np.sqrt((u + 1) / 2)
            found = [radius * np.cos(angle), radius * np.sin(angle), 0.3 * radius**2]
        case "wavy":
            found = [u, v, 0.12 * np.sin(5 * u) * np.cos(4 * v)]
        case "ell":
            kept = (u < 0) | (v < 0)
            found = [u[kept], v[kept], zero[kept]]
        case "floor-and-wall":
            floor = np.arange(points) < points // 2
            found = [u, np.where(floor, v, 1), np.where(floor, 0, v + 1)]
        case "room-corner":
            which = np.arange(points) % 3
            found = [np.where(which == 0, -1, u), np.where(which == 1, -1, np.where(which == 0, u, v)), np.where(which == 2, -1, v)]
        case "pipe" | "cup":
            z = u.copy()
            floor = np.arange(points) < (points // 9 if name == "cup" else 0)
            radius = np.where(floor, 0.5 * np.sqrt((u + 1) / 2), 0.5)
            z[floor] = -1
            found = [radius * np.cos(angle), radius * np.sin(angle), z]
    return np.column_stack(found).astype(np.float32)


SHEETS = "flat noisy tilted half-bowl dome shallow-bowl wavy ell floor-and-wall room-corner pipe cup".split()


# -- Poisson


def poisson(points, normals=None):
    """Open3D's surface at depth 8; without normals, of those that it estimates and orients itself. Faces outwards."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.asarray(points, float)))
    if normals is None:
        cloud.estimate_normals()
        cloud.orient_normals_consistent_tangent_plane(30)
    else:
        cloud.normals = open3d.utility.Vector3dVector(normals)
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=DEPTH, n_threads=1)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)
    return vertices, faces if volume(vertices, faces) >= 0 else faces[:, ::-1]


def remembered(path, make):
    """What `make` gives, as JSON, from the file if it is there."""
    if path.exists():
        return json.loads(path.read_text())
    made = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(made))
    part.rename(path)
    return made


def stored(path, points):
    """The file of these points, written if it is not there."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_ply(path, points)
    return path
