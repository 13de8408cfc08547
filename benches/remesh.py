"""Remeshes of tesserae beside those of pyacvd and CGAL: topology, distance to the input, angles, time.

    python remesh.py BINARY OUT_DIR MESH_DIR [--cgal DRIVER]       writes OUT_DIR/remesh.md and OUT_DIR/remesh.json

DRIVER is benches/cgal_remesh.cpp, compiled (`make bench-remesh` does that where the headers of CGAL 6.1 or later are found);
without it, CGAL is left out. Rows are the meshes of MESH_DIR; without one of them, a sample of tesserae.

| column | meaning |
|---|---|
| vertices | vertices that triangles use |
| distance | mean distance of 60,000 points on each surface to the other, in 10⁻⁴ of the diagonal of the input's bounding box |
| angle | mean over the triangles of the smallest angle, degrees |
| bad edges | edges of more than two triangles, and of two that run along it in one direction |
| bad vertices | vertices whose triangles are not one fan, beyond the first of each |
| topology | Euler number, boundary circles and components; the input's in the first row of each mesh |
| ms | tesserae: the remesh from labels, written as PLY; pyacvd: `create_mesh`; CGAL: all, clustering included |
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "scripts"))

import numpy as np
import pyacvd
import pyvista
import score
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

SAMPLES = 60_000

# mesh, number of clusters, sample in its place
ROWS = [
    ("stanford-bunny.obj", 1000, ("knot", 69_000)),
    ("horse.obj", 300, None),
    ("horse.obj", 2000, ("knot", 97_000)),
    ("fandisk.obj", 1000, ("cube", 13_000)),
    ("rocker-arm.obj", 1000, ("torus", 20_000)),
    ("cheburashka.obj", 500, ("sphere", 13_000)),
    ("nefertiti.obj", 2000, ("terrain", 100_000)),
    ("armadillo-172k.glb", 3000, None),
]


def welded(path):
    """Positions that triangles use, and triangles: equal positions are one, polygons are fans, none has two equal corners.

    pyacvd crashes on a position without a triangle.
    """
    vertices, corners, first = score.load(path)
    triangles, _ = score.fans(corners, first)
    points, number = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    triangles = number.reshape(-1)[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    used, number = np.unique(triangles, return_inverse=True)
    return points[used], number.reshape(-1, 3)


def components(pairs, count):
    pairs = np.asarray(pairs).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)


def topology(triangles):
    """Counts of a mesh that is cut where it is no oriented manifold."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, 1).ravel()
    halves = np.arange(len(starts))
    after = halves - halves % 3 + (halves + 1) % 3
    edge = np.unique(np.sort(np.stack([starts, ends], 1), axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    count = np.bincount(edge)
    upward = np.bincount(edge, weights=starts < ends)
    is_joined = (count == 2) & (upward == 1)
    order = np.argsort(edge, kind="stable")
    pairs = order[is_joined[edge[order]]].reshape(-1, 2)
    one, other = pairs.T
    fans, fan = components(np.concatenate([np.stack([one, after[other]], 1), np.stack([after[one], other], 1)]), len(starts))
    parts = components(pairs // 3, len(triangles))[0]
    boundary = np.flatnonzero(~is_joined[edge])
    circles = components(np.stack([fan[boundary], fan[after[boundary]]], 1), fans)[1]
    vertices = len(np.unique(triangles))
    return {
        "vertices": vertices,
        "bad edges": int((count > 2).sum() + ((count == 2) & (upward != 1)).sum()),
        "bad vertices": int(fans - vertices),
        "topology": [int(fans - (len(starts) - len(pairs)) + len(triangles)),
                     len(np.unique(circles[fan[boundary]])), int(parts)],
    }


def points_on(points, triangles, seed):
    """Random points, as many on equal areas."""
    random = np.random.default_rng(seed)
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    at = random.choice(len(triangles), SAMPLES, p=area / area.sum())
    u, v = random.random((2, SAMPLES, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[at] + u * (b - a)[at] + v * (c - a)[at]


def distance(one, other):
    """Mean distance of points on one surface to the other."""
    surface = pyvista.PolyData.from_regular_faces(*other)
    points = points_on(*one, seed=1)
    _, nearest = surface.find_closest_cell(points, return_closest_point=True)
    return np.linalg.norm(points - nearest, axis=1).mean()


def smallest_angle(points, triangles):
    corners = points[triangles]
    angles = []
    for corner in range(3):
        to = [corners[:, (corner + step) % 3] - corners[:, corner] for step in (1, 2)]
        lengths = np.linalg.norm(to[0], axis=1) * np.linalg.norm(to[1], axis=1)
        cosine = (to[0] * to[1]).sum(1) / np.maximum(lengths, 1e-300)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return float(np.min(angles, axis=0).mean())


def judged(mesh, remesh):
    points, triangles = remesh
    size = np.linalg.norm(np.ptp(mesh[0], axis=0))
    between = (distance(mesh, remesh) + distance(remesh, mesh)) / 2
    return {**topology(triangles), "distance": between / size * 1e4, "angle": smallest_angle(points, triangles)}


def of_polydata(mesh):
    return np.asarray(mesh.points, dtype=float), np.asarray(mesh.regular_faces)


def ours(binary, path, clusters, folder, *more):
    out, report = folder / "remesh.ply", folder / "report.json"
    command = [binary, "cluster", path, "-k", clusters, "--device", "cpu", "--remesh", out, "--report", report, *more]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return of_polydata(pyvista.read(out)), json.loads(report.read_text())["timings_ms"]["write"]


def by_pyacvd(mesh, clusters):
    clustering = pyacvd.Clustering(pyvista.PolyData.from_regular_faces(*mesh))
    clustering.cluster(clusters)
    started = time.perf_counter()
    made = clustering.create_mesh()
    return of_polydata(made), (time.perf_counter() - started) * 1e3


def by_cgal(driver, mesh, clusters, folder, *more):
    given, out = folder / "mesh.ply", folder / "cgal.ply"
    pyvista.PolyData.from_regular_faces(*mesh).save(given)
    done = subprocess.run([driver, given, out, str(clusters), *more], check=True, capture_output=True, text=True)
    return of_polydata(pyvista.read(out)), float(done.stdout)


def rows_of(arguments, path, clusters, folder):
    mesh = welded(path)
    makers = {
        "tesserae": lambda: ours(arguments.binary, path, clusters, folder),
        "tesserae, subdivided": lambda: ours(arguments.binary, path, clusters, folder, "--subdivide", "1"),
        "pyacvd": lambda: by_pyacvd(mesh, clusters),
    }
    if arguments.cgal:
        makers["CGAL"] = lambda: by_cgal(arguments.cgal, mesh, clusters, folder)
        makers["CGAL, quadrics"] = lambda: by_cgal(arguments.cgal, mesh, clusters, folder, "qem")
    before = topology(mesh[1])
    yield {"mesh": path.stem, "clusters": clusters, "program": "input", **before}
    for program, make in makers.items():
        remesh, ms = make()
        row = {"mesh": path.stem, "clusters": clusters, "program": program, **judged(mesh, remesh), "ms": ms}
        if program.startswith("tesserae"):
            assert row["bad edges"] == row["bad vertices"] == 0, row
            assert before["bad edges"] or row["topology"] == before["topology"], (row, before)
        yield row


COLUMNS = {"vertices": "d", "distance": ".2f", "angle": ".1f", "bad edges": "d", "bad vertices": "d", "topology": "", "ms": ".0f"}


def markdown(rows):
    lines = ["| mesh, clusters | program | " + " | ".join(COLUMNS) + " |", "|---|---|" + "--:|" * len(COLUMNS)]
    for row in rows:
        cells = [format(row[name], form) if form and name in row else str(row.get(name, "")) for name, form in COLUMNS.items()]
        lines.append(f"| {row['mesh']}, {row['clusters']} | {row['program']} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("meshes", type=pathlib.Path, nargs="?")
    parser.add_argument("--cgal")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory(prefix="tesserae-bench-") as folder:
        folder = pathlib.Path(folder)
        for name, clusters, sample in ROWS:
            path = arguments.meshes / name if arguments.meshes else None
            if not path or not path.exists():
                if not sample:
                    continue
                path = folder / f"{sample[0]}.obj"
                subprocess.run([arguments.binary, "sample", sample[0], "--faces", str(sample[1]), path], check=True)
            for row in rows_of(arguments, path, clusters, folder):
                rows.append(row)
                print({name: row.get(name) for name in ("mesh", "program", *COLUMNS)}, flush=True)
    (arguments.out / "remesh.json").write_text(json.dumps(rows, indent=1) + "\n")
    table = __doc__[__doc__.index("| column"):]
    (arguments.out / "remesh.md").write_text(f"# Remeshes of tesserae and its peers\n\n{table}\n{markdown(rows)}")
    print(f"written to {arguments.out / 'remesh.md'}")


if __name__ == "__main__":
    main()
