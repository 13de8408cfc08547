"""One mesh on many machines: what tiles cost, simulated (docs/one-mesh-many-machines.md). Needs numpy only.

    python tiles.py [FACES [CLUSTERS…]]

A bumpy torus is clustered by the boundary phase of src/cluster/flat.rs, in integers: once as a whole, and in tiles,
which are ranges of the order along a Morton curve.

exact     Tiles iterate together. After each iteration a tile learns the labels that changed next to it, and the proxies
          of clusters that it sees and others changed. Its labels are checked against those of the whole after every
          iteration; the bytes are counted.
apart     Each tile converges by itself, as if nothing were beside it. Then all iterate together, as above.
"""

import sys

import numpy as np

# Bytes of messages: a face and its label; a cluster with its changes (weight, three sums, faces, those that want to
# leave and the first of them), as a tile sends it; a cluster with its proxy, as a tile gets it.
LABEL, CHANGE, PROXY = 8, 4 + 8 + 24 + 12, 4 + 12
NONE = np.iinfo(np.int64).max
FREE = -1


def torus(faces):
    """Centroids and weights on a lattice, and neighbours, in the order along a Morton curve."""
    n = int((faces / 6) ** 0.5)
    m = faces // (2 * n)
    u, v = np.meshgrid(np.arange(m) * (2 * np.pi / m), np.arange(n) * (2 * np.pi / n), indexing="ij")
    r = 1 + 0.15 * np.cos(5 * u) * np.sin(4 * v) + 0.05 * np.cos(23 * u + 11 * v)
    points = np.stack([(3 + r * np.cos(v)) * np.cos(u), (3 + r * np.cos(v)) * np.sin(u), r * np.sin(v)], -1)
    points = points.reshape(-1, 3)
    i, j = (part.ravel() for part in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    at = lambda i, j: (i % m) * n + j % n
    cell = at(i, j)
    triangles = np.empty((2 * m * n, 3), np.int64)
    triangles[0::2] = np.stack([cell, at(i + 1, j), at(i + 1, j + 1)], -1)
    triangles[1::2] = np.stack([cell, at(i + 1, j + 1), at(i, j + 1)], -1)
    beside = np.empty_like(triangles)
    beside[0::2] = np.stack([2 * cell + 1, 2 * at(i + 1, j) + 1, 2 * at(i, j - 1) + 1], -1)
    beside[1::2] = np.stack([2 * cell, 2 * at(i, j + 1), 2 * at(i - 1, j)], -1)
    corners = points[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    g = np.rint(corners.mean(axis=1) * 2**18).astype(np.int64)
    w = np.maximum(1, np.rint(area / area.max() * 2**12).astype(np.int64))
    key = np.zeros(len(g), np.int64)
    for bit in range(20):
        for axis in range(3):
            key |= ((g[:, axis] + 2**20 >> bit + 1) & 1) << (3 * bit + axis)
    order = np.argsort(key, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return g[order], w[order], place[beside][order]


class Part:
    """Faces of a range, those beside it, and what a machine knows of clusters: all of it for the whole mesh."""

    def __init__(self, mesh, first, last):
        self.g, self.w = (array[first:last] for array in mesh[:2])
        beside = mesh[2][first:last]
        self.first, self.last = first, last
        # neighbours by their place among the own faces and, after these, the faces beside them
        outside = np.unique(beside[(beside < first) | (beside >= last)])
        self.outside = outside
        inside = (beside >= first) & (beside < last)
        self.beside = np.where(inside, beside - first, last - first + np.searchsorted(outside, beside))

    def wishes(self, labels, proxies):
        """Where each face wants to go: to the nearest cluster beside it, if that is nearer than its own."""
        own = labels[:len(self.w)]
        best, target = np.full(len(own), NONE), own.copy()
        for column in range(3):
            label = labels[self.beside[:, column]]
            distance = np.where(label == FREE, NONE, ((self.g - proxies[label]) ** 2).sum(axis=1))
            nearer = (distance < best) | (distance == best) & (label < target)
            best, target = np.where(nearer, distance, best), np.where(nearer, label, target)
        return np.where(best < ((self.g - proxies[own]) ** 2).sum(axis=1), target, own)

    def sums(self, labels, faces, clusters):
        """What faces add to the sums of clusters: weight, three sums, number of faces."""
        columns = [self.w[faces], *(self.w[faces] * self.g[faces].T), np.ones_like(self.w[faces])]
        sums = np.zeros((clusters, 5), np.int64)
        for at, column in enumerate(columns):
            np.add.at(sums[:, at], labels, column)
        return sums


def proxies_of(sums):
    weight = np.maximum(1, sums[:, :1])
    return (2 * sums[:, 1:4] + weight) // (2 * weight)


def grown(beside, labels):
    """Free faces take the smallest label beside them, all at once, as long as one has one."""
    while True:
        found = labels[beside]
        smallest = np.where(found == FREE, NONE, found).min(axis=1)
        takes = (labels == FREE) & (smallest < NONE)
        if not takes.any():
            return labels
        labels = np.where(takes, smallest, labels)


def energy(mesh, labels, proxies):
    return int((mesh[1] * ((mesh[0] - proxies[labels]) ** 2).sum(axis=1)).sum())


def leaves(labels, target):
    """Faces that want to leave, and of each cluster their number and the first of them."""
    leaving = np.flatnonzero(target != labels)
    clusters, first, number = np.unique(labels[leaving], return_index=True, return_counts=True)
    return leaving, clusters, leaving[first], number


def together(mesh, labels, clusters, tiles, whole=None):
    """Iterates to convergence in tiles; gives labels, iterations, bytes, and the energy after some iterations."""
    bounds = [len(mesh[1]) * tile // tiles for tile in range(tiles + 1)]
    parts = [Part(mesh, *pair) for pair in zip(bounds, bounds[1:])]
    local = [np.concatenate([labels[part.first:part.last], labels[part.outside]]) for part in parts]
    sums = sum(part.sums(own[:len(part.w)], np.arange(len(part.w)), clusters) for part, own in zip(parts, local))
    iterations, bytes, energies = 0, 0, []
    while True:
        proxies = proxies_of(sums)
        energies.append(energy(mesh, labels, proxies))
        # every tile by what it knows
        wanted = [part.wishes(own, proxies) for part, own in zip(parts, local)]
        left, first = np.zeros(clusters, np.int64), np.full(clusters, NONE)
        found = []
        for part, own, target in zip(parts, local, wanted):
            leaving, gone, earliest, number = leaves(own[:len(part.w)], target)
            left[gone] += number
            first[gone] = np.minimum(first[gone], earliest + part.first)
            found.append(leaving)
        stays = first[(left == sums[:, 4]) & (left > 0)]
        moved, changed = [], np.zeros_like(sums)
        touched = np.zeros(clusters, np.int64)
        for part, own, target, leaving in zip(parts, local, wanted, found):
            leaving = leaving[~np.isin(leaving + part.first, stays)]
            old, new = own[leaving], target[leaving]
            changed += part.sums(new, leaving, clusters) - part.sums(old, leaving, clusters)
            here = np.unique(np.concatenate([old, new]))
            touched[here] += 1
            # only what another tile sees goes there
            bytes += CHANGE * int((seen_by(local, clusters)[here] > 1).sum()) if tiles > 1 else 0
            moved.append(leaving + part.first)
            own[leaving] = new
            labels[leaving + part.first] = new
        if not sum(map(len, moved)):
            return labels, iterations, bytes, energies
        sums += changed
        iterations += 1
        moved = np.concatenate(moved)
        for part, own in zip(parts, local):
            heard = np.isin(part.outside, moved)
            bytes += LABEL * int(heard.sum())
            own[len(part.w):] = labels[part.outside]
            if tiles > 1:
                seen = np.unique(own)
                bytes += PROXY * int(((touched[seen] > 0) & (seen_by(local, clusters)[seen] > 1)).sum())
        if whole is not None:
            assert (labels == whole[iterations]).all(), "the labels are others than those of one machine"


def seen_by(local, clusters):
    """Number of tiles that have a face of each cluster, or one beside them. Cached for an iteration."""
    key = sum(int(own.sum()) for own in local)
    if seen_by.key != key:
        seen_by.key, seen_by.count = key, sum(np.bincount(np.unique(own), minlength=clusters) for own in local)
    return seen_by.count


seen_by.key = None


def alone(mesh, labels, clusters):
    """The labels after every iteration on one machine, and the energies."""
    part = Part(mesh, 0, len(mesh[1]))
    history, energies = [labels.copy()], []
    sums = part.sums(labels, np.arange(len(labels)), clusters)
    while True:
        proxies = proxies_of(sums)
        energies.append(energy(mesh, labels, proxies))
        target = part.wishes(labels, proxies)
        leaving, gone, earliest, number = leaves(labels, target)
        leaving = np.setdiff1d(leaving, earliest[number == sums[gone, 4]])
        if not len(leaving):
            return history, energies
        sums += part.sums(target[leaving], leaving, clusters) - part.sums(labels[leaving], leaving, clusters)
        labels = labels.copy()
        labels[leaving] = target[leaving]
        history.append(labels)


def apart(mesh, seeds, clusters, tiles):
    """The labels of tiles that converge by themselves, and the largest number of iterations."""
    bounds = [len(mesh[1]) * tile // tiles for tile in range(tiles + 1)]
    labels, most = np.empty(len(mesh[1]), np.int64), 0
    for first, last in zip(bounds, bounds[1:]):
        part = Part(mesh, first, last)
        own = np.flatnonzero((seeds >= first) & (seeds < last))
        start = np.full(last - first + len(part.outside), FREE)
        start[seeds[own] - first] = np.arange(len(own))
        inside = np.where(part.beside < last - first, part.beside, np.arange(last - first)[:, None])
        tile = (part.g, part.w, inside)
        # pieces of the tile without a seed are a cluster that nothing is beside, and free in the end
        start = grown(inside, start[:last - first])
        history, _ = alone(tile, np.where(start == FREE, len(own), start), len(own) + 1)
        labels[first:last], most = np.append(own, FREE)[history[-1]], max(most, len(history) - 1)
    return grown(mesh[2], labels), most


def main():
    faces = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    mesh = torus(faces)
    faces = len(mesh[1])
    print("| faces | clusters | tiles | | iterations together | MB in all | KB an iteration "
          "| energy above that of one |")
    print("|--:|--:|--:|---|--:|--:|--:|--:|")
    for clusters in map(int, sys.argv[2:] or ["200", "2000"]):
        seeds = (np.arange(clusters) * 2 + 1) * faces // (2 * clusters)
        start = np.full(faces, FREE)
        start[seeds] = np.arange(clusters)
        history, energies = alone(mesh, grown(mesh[2], start), clusters)
        for tiles in (4, 16, 64):
            row = f"| {faces:,} | {clusters:,} | {tiles} |"
            labels, iterations, bytes, ends = together(mesh, history[0].copy(), clusters, tiles, history)
            assert (labels == history[-1]).all() and ends == energies
            traffic = f"{iterations} | {bytes / 1e6:.1f} | {bytes / 1e3 / iterations:.1f}"
            print(f"{row} exact | {traffic} | 0, equal labels |")
            labels, most = apart(mesh, seeds, clusters, tiles)
            labels, iterations, bytes, ends = together(mesh, labels, clusters, tiles)
            above = [100 * (ends[min(at, len(ends) - 1)] / energies[-1] - 1) for at in (0, 10, len(ends) - 1)]
            traffic = f"{iterations} | {bytes / 1e6:.1f} | {bytes / 1e3 / max(1, iterations):.1f}"
            energy_of = "{:+.2f} % at first, {:+.2f} % after 10, {:+.2f} % in the end".format(*above)
            print(f"{row} apart ({most} at most) | {traffic} | {energy_of} |", flush=True)


main()
