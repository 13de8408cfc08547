"""Tesserae beside the peers that install from a package index, in alternation, in one run.

    python peers.py BINARY OUT_DIR [MESH_DIR]       writes OUT_DIR/peers.md and OUT_DIR/peers.json

Times are minima over the runs, in milliseconds, from positions and indices in memory to labels in memory: for tesserae the
stages `topology`, `upload`, `cluster` and `download` of the report, of a process that does this and nothing else or, where that
is said, of a service that has done it before, as the peers' process has; for pyacvd the making of its clustering object and
`cluster`; for higra and scikit-learn the call alone, without the graph of the faces. Whole processes are timed from outside.
Energies are of face labels, scored by tests/scripts/score.py; pyacvd labels vertices, and a face takes the label that most of
its corners have (of three different ones the first). Rows "in process" and "drop-in" are of the Python package, called by
the process that calls pyacvd; milliseconds of the processors, of all threads, are there too.

PARTS chooses rows: `PARTS=python` measures the package alone.

The real meshes are used where MESH_DIR has them; samples of tesserae otherwise.
"""

import datetime
import http.client
import json
import os
import pathlib
import platform
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "scripts"))

import higra
import numpy as np
import pyacvd
import pyvista
import score
import tesserae_mesh as package
from linkage import dual_edges
from points import points_scored
from scipy.sparse import coo_matrix
from service import Service
from sklearn.cluster import AgglomerativeClustering
from tesserae_mesh import pyacvd as drop_in

BINARY = pathlib.Path(sys.argv[1]).resolve()
OUT = pathlib.Path(sys.argv[2])
MESHES = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="tesserae-bench-"))
RUNS = int(os.environ.get("RUNS", 7))
PARTS = os.environ.get("PARTS", "flat,python,hierarchies,http,whole,growth").split(",")


LAUNCH = """
import os, resource, sys, time
started = time.perf_counter()
status = os.spawnv(os.P_WAIT, sys.argv[1], sys.argv[1:])
took = time.perf_counter() - started
print(took * 1e3, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
sys.exit(status)
"""


def real(name, shape, faces):
    """A real mesh, or a sample where there is none."""
    if MESHES and (MESHES / name).exists():
        return MESHES / name
    path = FOLDER / f"{shape}-{faces}.glb"
    subprocess.run([BINARY, "sample", shape, "--faces", str(faces), path], check=True, stderr=subprocess.DEVNULL)
    return path


def subdivided(path, times):
    """The mesh with every triangle in four, so many times."""
    vertices, corners, _ = score.load(path)
    faces = corners.reshape(-1, 3)
    for _ in range(times):
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        ends, middle = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = middle.reshape(3, -1) + len(vertices)
        vertices = np.concatenate([vertices, (vertices[ends[:, 0]] + vertices[ends[:, 1]]) / 2])
        p, q, r = faces.T
        faces = np.concatenate([np.stack(s, 1) for s in [(p, a, c), (a, q, b), (c, b, r), (a, b, c)]])
    out = FOLDER / f"{path.stem}-{len(faces)}.obj"
    with open(out, "w") as file:
        np.savetxt(file, vertices, "v %.9g %.9g %.9g")
        np.savetxt(file, faces + 1, "f %d %d %d")
    return out


def tesserae(path, clusters, *arguments):
    """One run: milliseconds from memory to memory, milliseconds of the whole process, labels, report, peak in bytes."""
    labels, report = FOLDER / "labels.npy", FOLDER / "report.json"
    k = ["--clusters", str(clusters)] if clusters else []
    out = ["--labels", labels] if clusters else []
    command = [BINARY, "cluster", path, *k, *out, "--report", report, "--device", "cpu", *arguments]
    # from a small process: one inherits the peak of the process that it is forked from
    told = subprocess.run([sys.executable, "-S", "-c", LAUNCH, *map(str, command)], check=True, capture_output=True, text=True)
    whole, peak = map(float, told.stdout.splitlines()[-1].split())
    report = json.loads(report.read_text())
    return from_memory(report), whole, np.load(labels) if clusters else None, report, peak


def from_memory(report):
    """Milliseconds from memory to memory."""
    return sum(report["timings_ms"][stage] for stage in ("topology", "upload", "cluster", "download"))


class Client:
    """One connection to a service."""

    def __init__(self, service):
        self.connection = http.client.HTTPConnection(service.url.removeprefix("http://"))

    def answer(self, method, path, body=None, **headers):
        self.connection.request(method, path, body, headers)
        answer = self.connection.getresponse()
        read = answer.read()
        assert answer.status == 200, read[:500]
        return read

    def job(self, body, kind, clusters, quality):
        """Has a mesh clustered, and waits for it; the path of the job."""
        # a new one: the service closes a connection that waits while peers have their turns
        self.connection.close()
        job = self.answer("POST", f"/v1/jobs?clusters={clusters}&quality={quality}", body,
                          **{"Content-Type": kind, "Prefer": "wait=120"})
        return f"/v1/jobs/{json.loads(job)['id']}"


KINDS = {".obj": "model/obj", ".glb": "model/gltf-binary"}


def faces_of(vertex_labels, faces):
    a, b, c = vertex_labels[faces].T
    labels = np.where(b == c, b, a)
    return np.unique(labels, return_inverse=True)[1]


class Mesh:
    """A mesh as the peers want it."""

    def __init__(self, path):
        self.path = path
        self.scored = score.load(path)
        vertices, corners, first = self.scored
        unique, weld = np.unique(vertices[corners] + 0.0, axis=0, return_inverse=True)
        self.faces = weld.reshape(-1, 3)
        quads = np.column_stack([np.full(len(self.faces), 3), self.faces]).ravel()
        self.poly = pyvista.PolyData(unique, quads)

    def pyacvd(self, clusters):
        started = time.perf_counter()
        clustering = pyacvd.Clustering(self.poly)
        clustering.cluster(clusters)
        return (time.perf_counter() - started) * 1e3, faces_of(np.asarray(clustering.clusters), self.faces)

    def dual(self):
        """Edges, centroids and areas of the faces."""
        vertices, corners, first = self.scored
        a, b, c = (vertices[corners.reshape(-1, 3)[:, i]] for i in range(3))
        area = np.sqrt((np.cross(b - a, c - a) ** 2).sum(1)) / 2
        return dual_edges(corners, first, vertices), (a + b + c) / 3, area

    def higra(self):
        pairs, centroid, area = self.dual()
        graph = higra.UndirectedGraph(len(area))
        graph.add_edges(pairs[:, 0], pairs[:, 1])
        started = time.perf_counter()
        tree, _ = higra.binary_partition_tree_ward_linkage(graph, centroid, area)
        return (time.perf_counter() - started) * 1e3, tree

    def higra_energy(self, tree, clusters):
        parents, top = tree.parents(), np.arange(tree.num_vertices())
        last = tree.num_vertices() - (clusters - 1)
        for node in range(tree.num_vertices() - 1, -1, -1):
            if parents[node] < last:
                top[node] = top[parents[node]]
        return score.score(self.scored, np.unique(top[: len(self.faces)], return_inverse=True)[1])["energy"]


ROWS = []


def row(work, mesh, peer, theirs, ours, energy=None, note=""):
    """A row of the table: their time and ours, and our energy over theirs."""
    ROWS.append({"work": work, "mesh": mesh, "peer": peer, "peer_ms": theirs, "tesserae_ms": ours,
                 "time_ratio": ours / theirs if theirs else None, "energy_ratio": energy, "note": note})
    ratio = f", {ours / theirs:.2f} of its time" if theirs else ""
    energy = f", {energy:.4f} of its energy" if energy else ""
    beside = f"{peer} {theirs:.1f} ms, " if theirs else ""
    print(f"{work}, {mesh}: {beside}tesserae {ours:.1f} ms{ratio}{energy} {note}", flush=True)


def flat(mesh, name, clusters, client):
    """pyacvd beside the three presets and our own ACVD."""
    presets = {"fast": [], "default": [], "best": []}
    served = {"fast": [], "default": []}
    body, kind = mesh.path.read_bytes(), KINDS[mesh.path.suffix]
    theirs, labels, acvd = [], None, []
    runs = RUNS if len(mesh.faces) < 500_000 else max(2, RUNS // 3)
    for _ in range(runs):
        ms, labels = mesh.pyacvd(clusters)
        theirs.append(ms)
        for quality, times in presets.items():
            if quality == "best" and len(times) == 2:
                continue
            times.append(tesserae(mesh.path, clusters, "--quality", quality))
        for quality, times in served.items():
            job = client.job(body, kind, clusters, quality)
            times.append(from_memory(json.loads(client.answer("GET", f"{job}/report"))))
            client.answer("GET", f"{job}/labels", Accept="application/octet-stream")
        if len(acvd) < 2:
            acvd.append(tesserae(mesh.path, clusters, "--algorithm", "acvd"))
    theirs_energy = score.score(mesh.scored, labels)["energy"]
    acvd_energy = score.score(mesh.scored, acvd[0][2])["energy"]
    for quality, times in presets.items():
        scored = score.score(mesh.scored, times[0][2])
        assert scored["clusters"] == clusters and scored["disconnected_clusters"] == 0, scored
        ours = min(time[0] for time in times)
        row(f"flat, {quality}", f"{name} {clusters}", "pyacvd", min(theirs), ours, scored["energy"] / theirs_energy)
        row(f"flat, {quality}", f"{name} {clusters}", "own acvd", min(run[0] for run in acvd), ours,
            scored["energy"] / acvd_energy)
        if quality in served:
            row(f"flat, {quality}", f"{name} {clusters}", "pyacvd", min(theirs), min(served[quality]),
                scored["energy"] / theirs_energy, "in a service")


def hierarchies(mesh, name, clusters):
    """higra's and scikit-learn's Ward beside trees without and with optimisation."""
    runs = 3 if len(mesh.faces) < 500_000 else 2
    theirs, nested, full = [], [], []
    for _ in range(runs):
        ms, tree = mesh.higra()
        theirs.append(ms)
        nested.append(tesserae(mesh.path, None, "--algorithm", "pml", "--optimize", "none"))
        full.append(tesserae(mesh.path, None, "--algorithm", "pml", "--levels", str(clusters)))
    energy = mesh.higra_energy(tree, clusters)
    at = tesserae(mesh.path, clusters, "--algorithm", "pml", "--optimize", "none")[2]
    level = next(level for level in full[0][3]["levels"] if level["clusters"] == clusters)["energy"]
    row("whole hierarchy, no optimisation", name, "higra", min(theirs), min(run[0] for run in nested),
        score.score(mesh.scored, at)["energy"] / energy, f"energies at {clusters}")
    row("whole hierarchy, optimised", name, "higra", min(theirs), min(run[0] for run in full), level / energy,
        f"energies at {clusters}")
    if len(mesh.faces) < 200_000:
        pairs, centroid, _ = mesh.dual()
        graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(centroid),) * 2)
        started = time.perf_counter()
        AgglomerativeClustering(n_clusters=clusters, connectivity=graph + graph.T, compute_full_tree=True).fit(centroid)
        row("whole hierarchy, no optimisation", name, "scikit-learn", (time.perf_counter() - started) * 1e3,
            min(run[0] for run in nested))


def in_process(mesh, name, clusters):
    """The Python package beside pyacvd, both in this process: faces, then points as pyacvd clusters them.

    Energies are of what is clustered: of the same points, weighted by the area around them, for the stand-in.
    """
    took = {work: ([], []) for work in ("faces", "points", "cluster()", "create_mesh()")}
    positions, triangles = np.asarray(mesh.poly.points, dtype=float), mesh.faces
    runs = RUNS if len(mesh.faces) < 500_000 else max(2, RUNS // 3)

    def points_of(module, whole, alone):
        made, making = timed(lambda: module.Clustering(mesh.poly))
        _, clustering = timed(lambda: made.cluster(clusters))
        whole.append(making + clustering)
        alone.append(clustering)
        return made

    for _ in range(runs):
        peer = points_of(pyacvd, took["points"][0], took["cluster()"][0])
        of_faces, of_call = timed(lambda: package.cluster(positions, triangles, clusters).labels)
        took["faces"][1].append(of_call)
        stand_in = points_of(drop_in, took["points"][1], took["cluster()"][1])
    took["faces"] = (took["points"][0], took["faces"][1])
    for _ in range(2):
        other, of_call = timed(peer.create_mesh)
        took["create_mesh()"][0].append(of_call)
        made, of_call = timed(stand_in.create_mesh)
        took["create_mesh()"][1].append(of_call)

    def rows(work, measured, energy, note):
        theirs, ours = (np.min(times, axis=0) for times in measured)
        row(work, f"{name} {clusters}", "pyacvd", theirs[0], ours[0], energy,
            f"{note}; processor {ours[1]:.0f} ms, theirs {theirs[1]:.0f}")

    scored = score.score(mesh.scored, of_faces)
    of_peer = score.score(mesh.scored, faces_of(np.asarray(peer.clusters), mesh.faces))
    rows("faces, in process, default", took["faces"], scored["energy"] / of_peer["energy"],
         f"connected clusters {clusters - scored['disconnected_clusters']}, "
         f"theirs {of_peer['clusters'] - of_peer['disconnected_clusters']}")
    ours_of, theirs_of = (points_scored(positions, stand_in.area, triangles, each.clusters) for each in (stand_in, peer))
    connected = f"connected clusters {ours_of[1]}, theirs {theirs_of[1]}"
    for work, part in (("made and clustered", "points"), ("cluster() alone", "cluster()")):
        rows(f"points, drop-in, {work}", took[part], ours_of[0] / theirs_of[0], connected)
    rows("mesh of the clusters, drop-in", took["create_mesh()"], None,
         f"{made.n_points} points, {made.n_open_edges} open edges, theirs {other.n_points}, {other.n_open_edges}")


def timed(call):
    """What a call gives; milliseconds, and those of the processors."""
    started = np.array([time.perf_counter(), time.process_time()])
    result = call()
    return result, (np.array([time.perf_counter(), time.process_time()]) - started) * 1e3


PYACVD_PROGRAM = """
import sys, numpy, pyvista, pyacvd
clustering = pyacvd.Clustering(pyvista.read(sys.argv[1]))
clustering.cluster(int(sys.argv[2]))
numpy.save(sys.argv[3], clustering.clusters)
"""


def whole_process(path, name, clusters):
    theirs, ours = [], {"fast": [], "default": []}
    for _ in range(RUNS):
        started = time.perf_counter()
        subprocess.run([sys.executable, "-c", PYACVD_PROGRAM, path, str(clusters), FOLDER / "peer.npy"], check=True)
        theirs.append((time.perf_counter() - started) * 1e3)
        for quality, times in ours.items():
            times.append(tesserae(path, clusters, "--quality", quality)[1])
    for quality, times in ours.items():
        row(f"whole process, OBJ to labels, {quality}", f"{name} {clusters}", "python + pyacvd", min(theirs), min(times))


def over_http(path, name, clusters, client):
    """POST to labels in hand on loopback, `Prefer: wait`, one connection."""
    body, ours = path.read_bytes(), {"fast": [], "default": []}
    for _ in range(3 * RUNS):
        for quality, times in ours.items():
            started = time.perf_counter()
            job = client.job(body, KINDS[path.suffix], clusters, quality)
            assert len(client.answer("GET", f"{job}/labels", Accept="application/octet-stream")) % 4 == 0
            times.append((time.perf_counter() - started) * 1e3)
    for quality, times in ours.items():
        row(f"POST to labels over HTTP, p50, {quality}", f"{name} {clusters}", "–", None, statistics.median(times))


def memory_and_growth():
    """Peak memory and time a face as meshes grow, clusters in proportion."""
    base = None
    for faces in (100_000, 1_000_000, *([10_000_000] if os.environ.get("LARGE") else [])):
        path = FOLDER / f"sphere-{faces}.glb"
        subprocess.run([BINARY, "sample", "sphere", "--faces", str(faces), path], check=True, stderr=subprocess.DEVNULL)
        runs = [tesserae(path, faces // 100) for _ in range(2)]
        ns = min(run[0] for run in runs) * 1e6 / faces
        base = base or ns
        row("growth, sphere", f"{faces:,} faces, {faces // 100:,} clusters", "–", None, min(run[0] for run in runs),
            note=f"{ns:.0f} ns a face ({ns / base:.2f} of the smallest), peak {runs[0][4] / faces:.0f} bytes a face")
        path.unlink()


def machine():
    cpu = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "")
    versions = {module: __import__("importlib.metadata").metadata.version(module)
                for module in ("pyacvd", "higra", "scikit-learn", "numpy")}
    version = subprocess.run([BINARY, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    return {"date": datetime.date.today().isoformat(), "cpu": cpu, "cores": os.cpu_count(), "system": platform.platform(),
            "load_before": os.getloadavg()[0], "tesserae": version, "peers": versions, "runs": RUNS}


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    described = machine()
    bunny = real("stanford-bunny.obj", "knot", 69_000)
    igea = real("igea.glb", "terrain", 268_000)
    large = subdivided(bunny, 2) if bunny.suffix == ".obj" else real("", "knot", 1_100_000)
    glb = real("stanford-bunny.glb", "knot", 69_000)
    with Service(BINARY, "--device", "cpu") as service:
        client = Client(service)
        for path, name, clusters in [(bunny, bunny.stem, 1000), (igea, igea.stem, 5000), (large, large.stem, 10000)]:
            mesh = Mesh(path)
            if "flat" in PARTS:
                flat(mesh, name, clusters, client)
            if "python" in PARTS:
                in_process(mesh, name, clusters)
            if "hierarchies" in PARTS and name != igea.stem:
                hierarchies(mesh, name, clusters)
        if "http" in PARTS:
            over_http(glb, glb.stem, 1000, client)
    if "whole" in PARTS and bunny.suffix == ".obj":
        whole_process(bunny, bunny.stem, 1000)
    if "growth" in PARTS:
        memory_and_growth()

    (OUT / "peers.json").write_text(json.dumps({"machine": described, "rows": ROWS}, indent=1) + "\n")
    table = ["| work | mesh | peer | peer ms | tesserae ms | of its time | of its energy | |", "|---|---|---|--:|--:|--:|--:|---|"]
    show = lambda value, form: format(value, form) if value else ""
    for r in ROWS:
        table.append(f"| {r['work']} | {r['mesh']} | {r['peer']} | {show(r['peer_ms'], '.1f')} | {r['tesserae_ms']:.1f} "
                     f"| {show(r['time_ratio'], '.2f')} | {show(r['energy_ratio'], '.4f')} | {r['note']} |")
    facts = [f"{key}: {value}" for key, value in described.items()]
    (OUT / "peers.md").write_text("# Tesserae beside its peers\n\n" + "  \n".join(facts) + "\n\n" + __doc__.split("\n\n")[2]
                                  + "\n\n" + "\n".join(table) + "\n")
    print(f"written to {OUT / 'peers.md'}")


main()
