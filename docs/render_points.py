"""Draws docs/points.png, four kinds of points in clusters: `python render_points.py TESSERAE PICTURE.png OUT.png`.

Superpixels of PICTURE, parcels of a volume (a slice of it), regions of a map, segments of a cloud. The last three are made here,
with numpy and scipy.
"""

import pathlib
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.spatial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tests" / "scripts"))
import colours  # noqa: E402
from render import png  # noqa: E402

HEIGHT, WIDTH, GAP = 320, 440, 16
HUES = np.array(colours.HUES, dtype=float)
INK = np.array([40.0, 44.0, 52.0])
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="tesserae-points-"))
RANDOM = np.random.default_rng(7)


def clusters(binary, file, *arguments):
    """The labels of a run of the command."""
    labels = FOLDER / "labels.npy"
    labels.unlink(missing_ok=True)
    subprocess.run([binary, "cluster", file, *map(str, arguments), "--labels", labels, "--quiet"], check=True)
    return np.load(labels)


def beside(labels):
    """Pairs of labels in a raster that are next to each other."""
    pairs = [(labels[1:], labels[:-1]), (labels[:, 1:], labels[:, :-1])]
    pairs = np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs])
    pairs = np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1)
    return np.unique(pairs, axis=0)


def hues(pairs, count):
    """A hue a cluster, other than those of the clusters before it that are beside it."""
    hue = np.full(count, -1)
    near = [[] for _ in range(count)]
    for a, b in pairs:
        near[b].append(a)
        near[a].append(b)
    for cluster in range(count):
        taken = {hue[other] for other in near[cluster]}
        free = [h for h in range(len(HUES)) if h not in taken]
        hue[cluster] = free[cluster % len(free)] if free else cluster % len(HUES)
    return HUES[hue]


def borders(labels):
    """Pixels whose right or lower neighbour has another label."""
    at = np.zeros(labels.shape, bool)
    at[:-1] |= labels[1:] != labels[:-1]
    at[:, :-1] |= labels[:, 1:] != labels[:, :-1]
    return at


def panel(picture, labels):
    """A picture in the size of a panel, with the borders of its clusters."""
    scale = min(HEIGHT / picture.shape[0], WIDTH / picture.shape[1])
    rows = (np.arange(int(picture.shape[0] * scale)) / scale).astype(int)
    columns = (np.arange(int(picture.shape[1] * scale)) / scale).astype(int)
    drawn = np.full((HEIGHT, WIDTH, 3), 255.0)
    top, left = (HEIGHT - len(rows)) // 2, (WIDTH - len(columns)) // 2
    part = picture[rows][:, columns]
    part[borders(labels[rows][:, columns])] = INK
    drawn[top : top + len(rows), left : left + len(columns)] = part
    return drawn


def read(path):
    """The colours of a picture that render.py wrote: rows are differences from those above."""
    data = path.read_bytes()
    width, height = struct.unpack(">II", data[16:24])
    at, packed = 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        packed += data[at + 8 : at + 8 + length] if kind == b"IDAT" else b""
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 3 * width)
    return np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8).reshape(height, width, 3).astype(float)


def means(colour, labels):
    """The mean of a colour in each cluster."""
    counts = np.bincount(labels.ravel())
    channels = [np.bincount(labels.ravel(), colour[..., channel].ravel()) / counts for channel in range(3)]
    return np.stack(channels, 1)[labels]


def superpixels(binary, picture):
    labels = clusters(binary, picture, "-k", 350)
    return panel(means(read(pathlib.Path(picture)), labels), labels)


def field(*shape, channels, smooth):
    """Smooth noise."""
    noise = RANDOM.standard_normal((*shape, channels))
    noise = scipy.ndimage.gaussian_filter(noise, (*[smooth] * len(shape), 0))
    return (noise / noise.std()).astype(np.float32)


def parcels(binary):
    """The middle slice of a volume of two channels in parcels."""
    np.save(FOLDER / "volume.npy", field(40, 64, 88, channels=2, smooth=6))
    labels = clusters(binary, FOLDER / "volume.npy", "-k", 150, "--graph", "grid")[20]
    return panel(hues(beside(labels), 150)[labels], labels)


def regions(binary):
    """A map of 500 districts with three numbers each, and 14 regions of districts that share a border."""
    sites = RANDOM.random((500, 2)) * [HEIGHT, WIDTH]
    places = np.stack(np.mgrid[:HEIGHT, :WIDTH], -1)
    district = scipy.spatial.cKDTree(sites).query(places)[1]
    numbers = field(HEIGHT, WIDTH, channels=3, smooth=40)[tuple(sites.astype(int).T)]
    np.save(FOLDER / "numbers.npy", numbers)
    pairs = beside(district)
    edges = scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(500, 500))
    scipy.sparse.save_npz(FOLDER / "borders.npz", edges.tocsr())
    labels = clusters(binary, FOLDER / "numbers.npy", "-k", 14, "--graph", FOLDER / "borders.npz")[district]
    drawn = hues(beside(labels), 14)[labels]
    drawn[borders(district)] *= 0.85
    drawn[borders(labels)] = INK
    return drawn


def segments(binary):
    """A cloud on a torus, 60 clusters of nearest neighbours."""
    around, along = RANDOM.random((2, 60_000)) * 2 * np.pi
    reach = 1 + 0.45 * np.cos(around)
    cloud = np.stack([reach * np.cos(along), reach * np.sin(along), 0.45 * np.sin(around)], 1)
    np.save(FOLDER / "cloud.npy", cloud.astype(np.float32))
    labels = clusters(binary, FOLDER / "cloud.npy", "-k", 60)
    # tilted, seen from above; the nearest point of a pixel is drawn
    tilt = np.array([[1, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]])
    x, y, z = tilt @ cloud.T
    columns, rows = (WIDTH / 2 + 140 * x).astype(int), (HEIGHT / 2 - 140 * y).astype(int)
    image = np.full((HEIGHT, WIDTH), -1)
    order = np.argsort(z)
    for down in (0, 1):
        for right in (0, 1):
            image[rows[order] + down, columns[order] + right] = labels[order]
    edges = beside(image)
    colour = hues(edges[(edges >= 0).all(1)], 60)
    return np.where(image[..., None] < 0, 255.0, colour[image])


if __name__ == "__main__":
    binary, picture, out = sys.argv[1:]
    panels = [superpixels(binary, picture), parcels(binary), regions(binary), segments(binary)]
    sheet = np.full((2 * HEIGHT + GAP, 2 * WIDTH + GAP, 3), 255.0)
    for nth, panel in enumerate(panels):
        top, left = (nth // 2) * (HEIGHT + GAP), (nth % 2) * (WIDTH + GAP)
        sheet[top : top + HEIGHT, left : left + WIDTH] = panel
    pathlib.Path(out).write_bytes(png(sheet))
