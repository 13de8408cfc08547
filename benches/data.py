"""Points with neighbours: tesserae beside peers, on data that comes with the packages.

    python data.py BINARY OUT_DIR [MESH_DIR]       writes OUT_DIR/data.md and OUT_DIR/data.json

Ours and the peers' runs alternate; times are minima: passed, and of the processors, of all threads. Those of tesserae are of
the whole command, which reads a file and writes one; those of peers of the call alone, without the graph. All have the same
columns and number of clusters, and the same graph if they take one; OpenCV takes the image and the size of superpixels. A peer
that takes SLOW seconds runs once. Energies are those of labels, Σ over items of the squared distance to the mean of the
cluster, by numpy; pieces are counted by scipy.

PACKAGES, geopandas, nibabel and tesserae_mesh must be installed. RUNS is the number of runs (3), PARTS chooses data:
images,voxels,clouds,tables,maps.
"""

import datetime
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from importlib import metadata

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

BINARY = pathlib.Path(sys.argv[1]).resolve()
OUT = pathlib.Path(sys.argv[2])
MESHES = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="tesserae-data-"))
RUNS = int(os.environ.get("RUNS", 3))
PARTS = os.environ.get("PARTS", "images,voxels,clouds,tables,maps").split(",")
OURS = {
    "fast": ["--quality", "fast"],
    "default": [],
    "pml": ["--algorithm", "pml"],
    "hr": ["--algorithm", "hr"],
}
PACKAGES = ["numpy", "scipy", "scikit-image", "opencv-contrib-python-headless", "scikit-learn", "higra", "nilearn",
            "faiss-cpu", "spopt", "libpysal"]
SLOW = 20
"""Seconds from which on a peer runs once."""


def energy(points, labels):
    clusters = labels.max() + 1
    items = np.bincount(labels, minlength=clusters)
    sums = np.stack([np.bincount(labels, column, minlength=clusters) for column in points.T], 1)
    return float((points**2).sum() - (sums**2 / items[:, None]).sum())


def pieces(graph, labels):
    graph = graph.tocoo()
    same = labels[graph.row] == labels[graph.col]
    kept = sp.coo_matrix((same[same], (graph.row[same], graph.col[same])), graph.shape)
    return connected_components(kept, directed=False)[0]


def grid(shape, mask=None):
    """Neighbours in a grid, of the items that take part."""
    mask = np.ones(shape, bool) if mask is None else mask
    number = np.full(shape, -1)
    number[mask] = np.arange(mask.sum())
    ends = []
    for axis in range(len(shape)):
        a, b = np.moveaxis(number, axis, 0)[:-1].ravel(), np.moveaxis(number, axis, 0)[1:].ravel()
        both = (a >= 0) & (b >= 0)
        ends.append((a[both], b[both]))
    a, b = (np.concatenate(side) for side in zip(*ends))
    graph = sp.coo_matrix((np.ones(len(a)), (a, b)), (mask.sum(),) * 2)
    return (graph + graph.T).tocsr()


def seconds():
    """Passed, and of the processors: of this process and those that it has run."""
    of = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return np.array([time.perf_counter(), sum(usage.ru_utime + usage.ru_stime for usage in of)])


class Table:
    def __init__(self):
        self.rows = []

    def compare(self, name, points, graph, clusters, arguments, peers, ours=("fast", "default", "pml"), take=None):
        """Runs ours and the peers in turns. `take` gives the labels of the items of `points` from those in a file."""
        take = take or np.ravel
        best = {}
        for _ in range(RUNS):
            for label in ours:
                out = FOLDER / "labels.npy"
                command = [BINARY, "cluster", *arguments, "-k", str(clusters), *OURS[label], "-q", "-o", out]
                began = seconds()
                subprocess.run(command, check=True)
                took = seconds() - began
                best[label] = (np.minimum(took, best.get(label, (np.inf,))[0]), take(np.load(out)))
            for label, call in peers.items():
                if label in best and best[label][0][0] > SLOW:
                    continue
                began = seconds()
                labels = call()
                took = seconds() - began
                labels = np.unique(np.ravel(labels), return_inverse=True)[1]
                best[label] = (np.minimum(took, best.get(label, (np.inf,))[0]), labels)
        for label, (took, labels) in best.items():
            row = {
                "data": name,
                "items": len(points),
                "columns": points.shape[1],
                "wanted": clusters,
                "what": f"tesserae {label}" if label in OURS else label,
                "clusters": int(labels.max()) + 1,
                "pieces": int(pieces(graph, labels)),
                "energy": energy(points, labels),
                "seconds": took[0],
                "processor_seconds": took[1],
            }
            if label in OURS:
                assert row["clusters"] == row["pieces"] == clusters, row
            self.rows.append(row)
            print(row, flush=True)


def save(name, points):
    path = FOLDER / name
    np.save(path, np.ascontiguousarray(points))
    return path


def ward(points, graph, clusters):
    from sklearn.cluster import AgglomerativeClustering

    return lambda: AgglomerativeClustering(clusters, connectivity=graph, linkage="ward").fit(points).labels_


def higra_ward(points, graph, clusters):
    import higra

    edges = sp.triu(graph).tocoo()
    of_items = higra.UndirectedGraph(len(points))
    of_items.add_edges(edges.row, edges.col)

    def labels():
        tree, _ = higra.binary_partition_tree_ward_linkage(of_items, points, np.ones(len(points)))
        parents, top = tree.parents(), np.arange(tree.num_vertices())
        # a node below the last merges has the label of the one above it
        first = len(parents) - (clusters - 1)
        for node in reversed(range(first)):
            if parents[node] < first:
                top[node] = top[parents[node]]
        return top[: len(points)]

    return labels


def faiss_kmeans(points, clusters):
    import faiss

    points = points.astype(np.float32)

    def labels():
        model = faiss.Kmeans(points.shape[1], clusters, niter=25, seed=1, max_points_per_centroid=len(points))
        model.train(points)
        return model.index.search(points, 1)[1]

    return labels


def opencv_slic(image, side):
    import cv2

    def labels():
        lab = cv2.cvtColor(image, cv2.COLOR_RGB2Lab)
        slic = cv2.ximgproc.createSuperpixelSLIC(lab, cv2.ximgproc.SLIC, int(side), 10.0)
        slic.iterate(10)
        slic.enforceLabelConnectivity(25)
        return slic.getLabels()

    return labels


def kmeans(points, clusters, starts=1):
    from sklearn.cluster import KMeans

    return lambda: KMeans(clusters, n_init=starts, random_state=0).fit(points).labels_


def images(table):
    import skimage.color
    import skimage.data
    import skimage.segmentation

    for name, image, clusters in (("astronaut", skimage.data.astronaut(), 184), ("chelsea", skimage.data.chelsea(), 227)):
        # as many clusters as `slic` makes of 250 that it is asked for
        height, width = image.shape[:2]
        side = np.sqrt(height * width / clusters)
        rows, columns = np.mgrid[:height, :width]
        cells = np.dstack([skimage.color.rgb2lab(image) / 10, columns / side, rows / side])
        slic = lambda: skimage.segmentation.slic(image, n_segments=250, compactness=10, start_label=0)
        arguments = [save(f"{name}.npy", cells), "--graph", "grid"]
        points, graph = cells.reshape(-1, 5), grid((height, width))
        peers = {
            "scikit-image slic": slic,
            "OpenCV SLIC": opencv_slic(image, side),
            "higra Ward": higra_ward(points, graph, clusters),
            "scikit-learn KMeans": kmeans(points, clusters),
        }
        table.compare(f"{name}, M 10", points, graph, clusters, arguments, peers)


def voxels(table):
    import nibabel
    import nilearn
    import tesserae_mesh
    from nilearn.regions import ReNA
    from scipy.ndimage import gaussian_filter, label

    folder = pathlib.Path(nilearn.__file__).parent / "datasets" / "data"
    read = lambda what: nibabel.load(folder / f"mni_icbm152_{what}_tal_nlin_sym_09a_converted.nii.gz").get_fdata()[::2, ::2, ::2]
    intensity, grey = read("t1"), read("gm")
    numbers, _ = label(grey > 0.4 * grey.max())
    mask = numbers == np.argmax(np.bincount(numbers.ravel())[1:]) + 1
    clusters, graph = 400, grid(mask.shape, mask)
    place = np.argwhere(mask) / (mask.sum() / clusters) ** (1 / 3)
    standard = lambda values: ((values - values.mean()) / values.std())[:, None]
    noise = np.random.default_rng(0)
    maps = np.stack([gaussian_filter(noise.standard_normal(mask.shape), 2)[mask] for _ in range(40)], 1)
    image = nibabel.Nifti1Image(mask.astype(np.int8), np.eye(4))
    for name, points in (
        ("grey matter", np.concatenate([place, standard(intensity[mask]), standard(grey[mask])], 1)),
        ("grey matter, 40 smooth maps", (maps / maps.std(0)).astype(np.float32)),
    ):
        whole = np.zeros((*mask.shape, points.shape[1]), points.dtype)
        whole[mask] = points
        path = FOLDER / "voxels.npz"
        np.savez(path, X=whole, mask=mask)
        points = points.astype(float)
        rena = lambda: ReNA(image, n_clusters=clusters, scaling=False).fit(points.T).labels_
        call = lambda: tesserae_mesh.cluster_points(whole, clusters, graph="grid", mask=mask, quality="fast").labels[mask]
        peers = {"nilearn ReNA": rena, "tesserae_mesh fast, the call alone": call}
        if points.shape[1] == 5:
            peers["higra Ward"] = higra_ward(points, graph, clusters)
            peers["scikit-learn Ward"] = ward(points, graph, clusters)
            # its own place of a voxel, as it has no columns for it
            peers["scikit-image slic"] = lambda: slic_of_voxels(whole[..., 3:], mask, clusters)
        table.compare(name, points, graph, clusters, [path, "--graph", "grid"], peers, take=lambda labels: labels[mask])


def slic_of_voxels(values, mask, clusters):
    import skimage.segmentation

    return skimage.segmentation.slic(
        values, n_segments=clusters, compactness=1, mask=mask, channel_axis=-1, convert2lab=False, start_label=0
    )[mask]


def nearest(points, neighbours):
    from sklearn.neighbors import kneighbors_graph

    graph = kneighbors_graph(points, neighbours)
    return graph.maximum(graph.T)


def clouds(table):
    path = MESHES and MESHES / "stanford-bunny.obj"
    if not path or not path.exists():
        print("the cloud is left out: there is no folder with stanford-bunny.obj")
        return
    points = np.array([line.split()[1:4] for line in path.open() if line.startswith("v ")], float)
    graph = nearest(points, 8)
    peers = {"scikit-learn Ward": ward(points, graph, 1000), "scikit-learn KMeans": kmeans(points, 1000),
             "FAISS k-means": faiss_kmeans(points, 1000), "higra Ward": higra_ward(points, graph, 1000)}
    table.compare("vertices of a bunny", points, graph, 1000, [save("bunny.npy", points), "--graph", "knn:8"], peers)


def tables(table):
    from sklearn.datasets import load_digits

    points = load_digits().data
    graph = nearest(points, 10)
    for clusters in (10, 100):
        peers = {
            "scikit-learn Ward": ward(points, graph, clusters),
            "higra Ward": higra_ward(points, graph, clusters),
            "scikit-learn KMeans, best of 20": kmeans(points, clusters, 20),
        }
        table.compare("digits", points, graph, clusters, [save("digits.npy", points), "--graph", "knn:10"], peers)


def maps(table):
    import geopandas
    import libpysal
    from libpysal import examples
    from spopt.region import AZP, RegionKMeansHeuristic, Skater, WardSpatial

    no_columns = ("ID", "AREA", "PERIM", "CODE", "KEY", "FIPS", "X", "Y", "LAT", "LON", "CNT", "CRESS")
    for name, file, columns, clusters in (
        ("georgia", "G_utm.shp", None, 12),
        ("columbus", "columbus.shp", ["INC", "HOVAL", "CRIME"], 8),
        ("sids2", "sids2.shp", None, 8),
        ("mexico", "mexicojoin.shp", None, 6),
    ):
        frame = geopandas.read_file(examples.get_path(file))
        numbers = frame.select_dtypes("number")
        usable = lambda column: numbers[column].std() > 0 and not any(word in column.upper() for word in no_columns)
        columns = columns or [column for column in numbers.columns if usable(column)][:8]
        points = numbers[columns].to_numpy(float)
        points = (points - points.mean(0)) / points.std(0)
        weights = libpysal.weights.Queen.from_dataframe(frame, use_index=False)
        graph = sp.csr_matrix(weights.sparse)
        graph.data[:] = 1
        sp.save_npz(FOLDER / "graph.npz", graph)
        named = frame.copy()
        names = [f"z{at}" for at in range(points.shape[1])]
        named[names] = points

        def solved(model):
            np.random.seed(0)
            model.solve()
            return np.asarray(model.labels_)

        peers = {
            "spopt Ward": lambda: solved(WardSpatial(named, weights, names, n_clusters=clusters)),
            "spopt Skater": lambda: solved(Skater(named, weights, names, n_clusters=clusters, floor=1)),
            "spopt AZP": lambda: solved(AZP(named, weights, names, n_clusters=clusters, random_state=0)),
            "spopt RegionKMeans": lambda: solved(RegionKMeansHeuristic(points, clusters, weights)),
        }
        arguments = [save("map.npy", points), "--graph", FOLDER / "graph.npz"]
        table.compare(name, points, graph, clusters, arguments, peers, ("default", "pml", "hr"))


def figures(row):
    return f"{row['energy']:.5g}", f"{row['seconds']:.3f}", f"{row['processor_seconds']:.3f}"


def written(rows):
    lines = [
        f"# Points, {datetime.date.today()}",
        "",
        f"`benches/data.py`, minima of {RUNS} runs in turns, {os.cpu_count()} shared cores. "
        + ", ".join(f"{package} {metadata.version(package)}" for package in PACKAGES) + ".",
        "",
        "| data | items | columns | k | what | clusters | pieces | energy | s | cpu s |",
        "|---|--:|--:|--:|---|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [row[name] for name in ("data", "items", "columns", "wanted", "what", "clusters", "pieces")]
        lines.append("| " + " | ".join(map(str, [*cells, *figures(row)])) + " |")
    return "\n".join(lines) + "\n"


def main():
    warnings.filterwarnings("ignore")
    table = Table()
    for part in PARTS:
        {"images": images, "voxels": voxels, "clouds": clouds, "tables": tables, "maps": maps}[part](table)
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "data.md").write_text(written(table.rows))
    (OUT / "data.json").write_text(json.dumps(table.rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
