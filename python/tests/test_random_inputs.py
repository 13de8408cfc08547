"""Random inputs: an exception of the package or a right answer, never a crash.

TESSERAE_TEST_INPUTS says how many; they run in a process of its own under faulthandler.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

import tesserae_mesh


def grid(random: Generator) -> tuple[NDArray[Any], NDArray[Any]]:
    """A bent grid of triangles."""
    n = int(random.integers(2, 7))
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    points = np.stack([x, y, random.normal(size=(n, n))], axis=-1).reshape(-1, 3)
    a = (y[:-1, :-1] * n + x[:-1, :-1]).reshape(-1)
    return points, np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)])


def strange_points(random: Generator, points: NDArray[Any]) -> Any:
    """Points of another type, layout, shape or value."""
    kinds = ["f2", "f4", ">f4", "f8", ">f8", "longdouble", "i4", "u1", "c16", "?", "O", "S4", "M8[s]"]
    choice = int(random.integers(12))
    if choice < 4:
        kind = kinds[int(random.integers(len(kinds)))]
        with np.errstate(all="ignore"):
            return points.astype("i8").astype(kind) if kind in ("M8[s]",) else points.astype(kind)
    if choice == 4:
        return points[:, :: int(random.choice([-1, 1, 2]))]
    if choice == 5:
        return np.asfortranarray(points)[:: int(random.choice([-1, 1, 2]))]
    if choice == 6:
        points[random.integers(len(points))] = random.choice([np.nan, np.inf, -np.inf, 1e308, 1e-320])
        return points
    if choice == 7:
        packed = np.zeros(len(points), dtype=[("skip", "u1"), ("point", "f8", 3)])
        packed["point"] = points
        return packed["point"]  # not aligned
    if choice == 8:
        return points.reshape(random.choice([1, 3]), -1) if len(points) % 3 == 0 else points[None]
    if choice == 9:
        return points.tolist()
    if choice == 10:
        return [None, 7, "x.obj"][int(random.integers(3))]
    points.flags.writeable = False
    return points


def strange_faces(random: Generator, faces: NDArray[Any]) -> Any:
    """Faces of another type, layout, shape or value."""
    choice = int(random.integers(14))
    if choice < 3:
        kinds = ["i1", "u1", "i2", ">i2", "i4", ">i4", "u4", "i8", ">u8", "u8", "f4", "?", "O", "S3"]
        return faces.astype(kinds[int(random.integers(len(kinds)))])
    if choice < 6:
        wrong = [-1, 1 << 31, 1 << 32, (1 << 63) - 1, -(1 << 63), len(faces) * 9]
        faces = faces.astype("i8")
        faces[random.integers(len(faces)), random.integers(3)] = wrong[int(random.integers(len(wrong)))]
        return faces
    if choice == 6:
        return np.asfortranarray(faces)[:: int(random.choice([-1, 1, 2]))]
    if choice == 7:
        return faces[:, : int(random.integers(4))]
    if choice == 8:
        padded = np.insert(faces, 0, 3, axis=1).reshape(-1)
        padded[random.integers(len(padded))] = random.integers(-3, 9)
        return padded[: int(random.integers(len(padded) + 1))]
    if choice == 9:
        offsets = np.arange(0, faces.size + 1, 3)
        offsets[random.integers(len(offsets))] = random.choice([-1, 0, 1 << 40, 5])
        return offsets, faces.reshape(-1)
    if choice == 10:
        offsets = np.unique(np.concatenate([[0], random.integers(1, faces.size, size=6), [faces.size]]))
        return offsets, faces.reshape(-1)
    if choice == 11:
        return np.sort(faces, axis=1)[random.integers(len(faces), size=len(faces))]
    if choice == 12:
        return [None, 7, "x"][int(random.integers(3))]
    return faces.reshape(2, -1, 3) if len(faces) % 2 == 0 else faces[:0]


def strange_options(random: Generator, faces: int, points: int) -> dict[str, Any]:
    """Options, some of which are wrong."""
    options: dict[str, Any] = {"clusters": random.choice([1, 2, 3, faces, faces + 1, 0, -1, 1 << 40])}
    if random.random() < 0.5:
        options["algorithm"] = str(random.choice(["bb", "pml", "ml", "hr", "acvd", "vc", "none"]))
    if random.random() < 0.2:
        options["weights"] = random.normal(1, 0.4, size=random.choice([faces, points, 3]))
    if random.random() < 0.2:
        options["seeds"] = random.integers(-1, faces + 1, size=int(random.choice([1, 2, 3])))
    if random.random() < 0.2:
        options["bridge_components"] = bool(random.random() < 0.8)
    if random.random() < 0.1:
        options["levels"] = random.integers(0, 9, size=2)
    if random.random() < 0.1:
        options["snapshots"] = random.choice([0, 1, -1])
    return options


def strange_graph(random: Generator, items: int) -> Any:
    """Neighbours of items, some of which are wrong."""
    choice = int(random.integers(6))
    if choice < 2:
        return [None, "grid", "grid:full", "knn:3", "knn:0", "none"][int(random.integers(6))]
    if choice == 2:
        return random.choice([-1, 0, 1, 3, 64, 65])
    indptr = np.linspace(0, 3 * items, items + 1).astype("i8")
    indices = random.integers(items, size=3 * items)
    if choice == 3:
        return indptr.astype("i4"), indices.astype("i4")
    if choice == 4:
        indices[random.integers(indices.size)] = random.choice([-1, 0, items, 1 << 40])
    elif random.random() < 0.5:
        indptr[random.integers(indptr.size)] = random.choice([-1, 0, 3 * items, 1 << 40])
    return indptr, indices[: random.choice([0, 3 * items - 1, 3 * items], p=[0.1, 0.1, 0.8])]


def once_points(random: Generator) -> bool:
    """Cluster points with neighbours; whether there was an answer."""
    points, _ = grid(random)
    given: Any = strange_points(random, points) if random.random() < 0.5 else points
    graph = strange_graph(random, len(points)) if random.random() < 0.7 else None
    if isinstance(graph, str) and isinstance(given, np.ndarray) and given.shape[:1] == (len(points),):
        given = given.reshape(int(np.sqrt(len(points))), -1, *given.shape[1:]) if "grid" in graph else given
    options = strange_options(random, len(points), len(points))
    options.pop("weights", None)
    k = options.pop("clusters")
    shape = np.shape(given)[:-1] if isinstance(given, np.ndarray) else (len(points),)
    for name in ("weights", "mask"):
        if random.random() < 0.3:
            options[name] = random.random(shape) if name == "weights" else random.random(shape) < 0.8
    try:
        clustering = tesserae_mesh.cluster_points(given, k, graph=graph, **options)
        labels = clustering.labels
    except tesserae_mesh.Error as error:
        assert error.kind != "internal", error
        return False
    assert labels.dtype == np.int32 and labels.shape == np.shape(given)[:-1]
    taken = options.get("mask", np.full(labels.shape, True))
    assert np.array_equal(labels < 0, ~taken)
    assert np.array_equal(np.unique(labels[taken]), np.arange(clustering.clusters))
    return True


def once(seed: int) -> bool:
    """Cluster one input; whether there was an answer."""
    random = np.random.default_rng(seed)
    if seed % 3 == 0:
        return once_points(random)
    points, faces = grid(random)
    given_points: Any = strange_points(random, points) if random.random() < 0.5 else points
    given_faces: Any = strange_faces(random, faces) if random.random() < 0.5 else faces
    options = strange_options(random, len(faces), len(points))
    try:
        clustering = tesserae_mesh.cluster(given_points, given_faces, **options)
        labels = clustering.labels
    except tesserae_mesh.Error as error:
        assert error.kind != "internal", (seed, error)
        return False
    assert labels.dtype == np.uint32 and labels.shape == (tesserae_mesh.Mesh(given_points, given_faces).n_faces,), seed
    assert np.array_equal(np.unique(labels), np.arange(clustering.clusters)), seed
    if seed % 10 == 0:
        clustering.remesh()
        clustering.centroids  # noqa: B018
    return True


def test_random_inputs_give_an_exception_or_an_answer() -> None:
    count = int(os.environ.get("TESSERAE_TEST_INPUTS", "2000"))
    words = [sys.executable, "-W", "ignore", "-X", "faulthandler", __file__, str(count)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    answers = int(done.stdout)
    # both happen often
    assert count // 10 < answers < count * 9 // 10


if __name__ == "__main__":
    print(sum(once(seed) for seed in range(int(sys.argv[1]))))
