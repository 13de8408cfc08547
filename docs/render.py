"""Draws a clustered mesh as a PNG, with numpy alone: `python render.py MESH.obj LABELS.npy OUT.png [REMESH.obj]`.

Neighbouring clusters have different hues, outlines are dark, and light comes from the upper left. A remesh is drawn to
the right of the mesh, with the outlines of its triangles. With `apart=0.3` in place of a remesh, clusters move away from
the middle of the mesh by that part of their distance to it. With `shapes=SHAPES.json`, what `--shapes-out` wrote, planes
are blue, spheres orange, cylinders green and cones purple. `tilt=` and `turn=` are angles in radians.
"""

import json
import pathlib
import struct
import sys
import zlib

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tests" / "scripts"))
import colours  # noqa: E402
import score  # noqa: E402

WIDTH, HEIGHT, FINER = 880, 640, 3
BACKGROUND = 255.0


def look(vertices, tilt=-0.62, turn=0.35):
    """Turned and tilted, x to the right, y up, z towards the eye."""
    c, s = np.cos(turn), np.sin(turn)
    around = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = np.cos(tilt), np.sin(tilt)
    return (vertices - vertices.mean(0)) @ (np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ around).T


HUES = np.array(colours.HUES) / 255


def palette(triangles, labels):
    """A hue a cluster, other than those of the clusters before it that share an edge with it."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    label = np.repeat(labels, 3)
    order = np.lexsort(edges.T)
    edges, label = edges[order], label[order]
    beside = (edges[1:] == edges[:-1]).all(1) & (label[1:] != label[:-1])
    neighbours = [set() for _ in range(labels.max() + 1)]
    for a, b in np.unique(np.sort(np.stack([label[:-1], label[1:]], 1)[beside], axis=1), axis=0):
        neighbours[b].add(a)
    hues = []
    for cluster, of_cluster in enumerate(neighbours):
        taken = {hues[other] for other in of_cluster}
        wanted = [(cluster * 3 + step) % len(HUES) for step in range(len(HUES))]
        hues.append(next((hue for hue in wanted if hue not in taken), wanted[0]))
    return HUES[hues]


def pulled_apart(vertices, triangles, labels, apart):
    """Vertices and triangles of their own for each triangle, moved with its cluster."""
    corners = vertices[triangles]
    count = np.bincount(labels)
    middle = np.stack([np.bincount(labels, corners.mean(1)[:, axis]) for axis in range(3)], 1) / count[:, None]
    moved = corners + apart * (middle - vertices.mean(0))[labels][:, None]
    return moved.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def draw(vertices, triangles, face, labels, colours):
    """The picture, rows × columns × 3, at FINER times the size. Each label has a row of `colours`."""
    width, height = WIDTH * FINER, HEIGHT * FINER
    size = np.ptp(vertices, axis=0)
    scale = min(0.96 * width / size[0], 0.96 * height / size[1])
    middle = (vertices.max(0) + vertices.min(0)) / 2
    pixels = (vertices - middle) * [scale, -scale, scale] + [width / 2, height / 2, 0]

    depth = np.full((height, width), -np.inf)
    owner = np.full((height, width), -1, np.int64)
    corners = pixels[triangles]
    low = np.floor(corners.min(1)[:, :2]).astype(int)
    high = np.ceil(corners.max(1)[:, :2]).astype(int)
    for number, ((a, b, c), (x0, y0), (x1, y1)) in enumerate(zip(corners, low, high)):
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if twice >= 0:  # seen from behind, y being downwards
            continue
        y, x = np.mgrid[y0 : y1 + 1, x0 : x1 + 1]
        u = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice
        v = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice
        z = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (z > depth[y, x])
        depth[y[inside], x[inside]] = z[inside]
        owner[y[inside], x[inside]] = number

    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    light = np.array([-0.45, 0.6, 0.66])
    shade = 0.42 + 0.58 * np.clip(normal @ light, 0, 1)
    colour = colours[labels[face]] * shade[:, None] * 255
    seen = owner >= 0
    picture = np.where(seen[..., None], colour[owner], BACKGROUND)

    label = np.where(seen, labels[face][owner], -1)
    edge = np.zeros_like(seen)
    for axis in (0, 1):
        for step in (-1, 1):
            edge |= label != np.roll(label, step, axis)
    picture[edge & seen] *= 0.35
    return picture


def png(picture):
    """Bytes of an RGB PNG."""
    rows = np.clip(picture.round(), 0, 255).astype(np.uint8)
    height, width, _ = rows.shape
    # Each row is stored as its difference from the one above, which packs better.
    up = np.concatenate([rows[:1], rows[1:] - rows[:-1]])
    data = b"".join(b"\x02" + row.tobytes() for row in up)

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(data, 9)) + chunk(b"IEND", b""))


def of_types(path):
    """A colour a cluster, of the type of its shape."""
    rows = json.loads(pathlib.Path(path).read_text())
    return np.array([colours.TYPES[row["type"]] for row in rows]) / 255


def drawn(mesh, labels=None, shapes=None, apart=0.0, **angles):
    """The picture of a mesh; without labels that of its triangles in one colour."""
    vertices, corners, first = score.load(mesh)
    triangles, face = score.fans(corners, first)
    if labels is None:
        labels = np.arange(len(triangles))
        colours = np.full((len(labels), 3), [0.93, 0.87, 0.76])
    else:
        _, welded = np.unique(vertices, axis=0, return_inverse=True)
        colours = of_types(shapes) if shapes else palette(welded.ravel()[triangles], labels[face])
    if apart:
        vertices, triangles = pulled_apart(vertices, triangles, labels[face], apart)
    large = draw(look(vertices, **angles), triangles, face, labels, colours)
    return large.reshape(HEIGHT, FINER, WIDTH, FINER, 3).mean((1, 3))


if __name__ == "__main__":
    mesh, labels, out, *more = sys.argv[1:]
    options = dict(word.split("=", 1) for word in more if "=" in word)
    numbers = {name: float(value) for name, value in options.items() if name != "shapes"}
    first = drawn(mesh, np.load(labels).astype(np.int64), options.get("shapes"), **numbers)
    pictures = [first, *(drawn(path) for path in more if "=" not in path)]
    pathlib.Path(out).write_bytes(png(np.concatenate(pictures, axis=1)))
