"""Every output of three meshes, read back by the programs that people use it with, and compared.

    python outputs.py BINARY [--node FOLDER] [MESHES]

FOLDER is where npm installed gltf-validator and three; without it, GLB files are not validated, nor opened in Chromium.
MESHES is a folder of meshes; samples made by BINARY are used as well.

| output | read by |
|---|---|
| mesh, remesh: glb, ply, obj, stl | trimesh; gltf-validator; three.js in Chromium (glb); pymeshlab (ply, obj, stl) |
| mesh, remesh, boundaries: vtp; mesh: ply | pyvista |
| submeshes: zip, glb, npz | trimesh, numpy |
| graph: json, npz, graphml | networkx, scipy |
| clusters, boundaries | json, csv |
"""

import argparse
import base64
import csv
import io
import json
import os
import pathlib
import re
import subprocess
import tempfile
import zipfile

import networkx
import numpy as np
import pyvista
import scipy.sparse
import trimesh

import colours
import score

try:
    import pymeshlab
except ImportError:
    pymeshlab = None

PARSER = argparse.ArgumentParser()
PARSER.add_argument("binary", type=pathlib.Path)
PARSER.add_argument("meshes", type=pathlib.Path, nargs="?")
PARSER.add_argument("--node", type=pathlib.Path)
OPTIONS = PARSER.parse_intermixed_args()
BINARY = OPTIONS.binary.resolve()
TEMPORARY = tempfile.TemporaryDirectory(prefix="tesserae-")
WORK = pathlib.Path(TEMPORARY.name)
GLB = []


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True)
    assert done.returncode == 0, f"{command} ended with {done.returncode}:\n{done.stderr.decode()}"
    return done.stdout.decode()


class Case:
    """A mesh, its labels, and its outputs."""

    def __init__(self, mesh, clusters):
        self.name, self.clusters = mesh.stem, clusters
        self.folder = WORK / self.name
        self.folder.mkdir()
        labels = self.path("labels.npy")
        run(BINARY, "cluster", mesh, "-k", clusters, "--labels", labels, "--device", "cpu")
        self.mesh, self.labels = mesh, np.load(labels)
        self.vertices, self.corners, self.first = score.load(mesh)
        self.faces = len(self.labels)
        self.colours = np.array([colours.of_cluster(cluster) for cluster in range(clusters)], dtype=int)
        self.are_triangles = bool((np.diff(self.first) == 3).all())
        self.triangles, face = score.fans(self.corners, self.first)
        self.triangle_labels = self.labels[face]

    def path(self, file):
        return self.folder / file

    def export(self, flag, file, *more):
        run(BINARY, "export", self.mesh, "--labels", self.path("labels.npy"), flag, self.path(file), *more)
        if file.endswith(".glb"):
            GLB.append(self.path(file))
        return self.path(file)

    def near(self, found, what):
        """Whether the box of positions is that of the mesh."""
        used = self.vertices[self.corners]
        size = (used.max(0) - used.min(0)).max()
        off = max(abs(found.min(0) - used.min(0)).max(), abs(found.max(0) - used.max(0)).max())
        assert off < 1e-5 * size, f"{self.name}, {what}: the box is off by {off}"


def check_mesh(case):
    ply = pyvista.read(case.export("--mesh", "mesh.ply"))
    assert ply.n_cells == case.faces, "ply, pyvista"
    assert (ply.cell_data["RGB"] == case.colours[case.labels]).all(), "ply, pyvista"
    case.near(np.asarray(ply.points), "mesh.ply")

    vtp = pyvista.read(case.export("--mesh", "mesh.vtp"))
    assert vtp.n_cells == case.faces and (vtp.cell_data["cluster"] == case.labels).all(), "vtp, pyvista"
    assert (vtp.cell_data["RGB"] == case.colours[case.labels]).all(), "vtp, pyvista"
    assert abs(np.asarray(vtp.points) - case.vertices).max() == 0, "vtp, pyvista"

    scene = trimesh.load(case.export("--mesh", "mesh.glb"), process=False)
    part, = scene.geometry.values()
    assert len(part.faces) == len(case.triangle_labels), "glb, trimesh"
    attributes = {name.lower(): values for name, values in part.vertex_attributes.items()}
    ids = np.asarray(attributes["_feature_id_0"]).reshape(-1)[part.faces]
    assert (ids == case.triangle_labels[:, None]).all(), "glb, trimesh: ids"
    colours = np.asarray(part.visual.vertex_attributes["color"])[part.faces[:, 0], :3]
    assert (colours == case.colours[case.triangle_labels]).all(), "glb, trimesh: colours"
    case.near(np.asarray(scene.to_mesh().vertices), "mesh.glb")
    table(case, case.path("mesh.glb"))

    loaded = trimesh.load(case.path("mesh.ply"), process=False)
    if case.are_triangles:
        assert (loaded.metadata["_ply_raw"]["face"]["data"]["cluster"].reshape(-1) == case.labels).all(), "ply, trimesh"
    if case.are_triangles:
        loaded = trimesh.load(case.export("--mesh", "coloured.ply", "--ply-vertex-colours"), process=False)
        colours = np.asarray(loaded.visual.vertex_colors)[loaded.faces[:, 0], :3]
        assert (colours == case.colours[case.labels]).all(), "ply with coloured vertices, trimesh"
    obj = case.export("--mesh", "mesh.obj")
    groups = [line for line in obj.read_text().splitlines() if line.startswith("g ")]
    assert groups == [f"g cluster-{cluster}" for cluster in range(case.clusters)], "obj"
    loaded = trimesh.load(obj, process=False, force="mesh")
    assert len(loaded.faces) == len(case.triangle_labels), "obj, trimesh"
    if pymeshlab:
        for file in ("mesh.ply", "mesh.obj"):
            meshes = pymeshlab.MeshSet()
            meshes.load_new_mesh(str(case.path(file)))
            found = meshes.current_mesh()
            assert found.face_number() == len(case.triangle_labels), f"{file}, pymeshlab"
            if file == "mesh.ply" and case.are_triangles:
                colours = np.rint(found.face_color_matrix()[:, :3] * 255).astype(int)
                assert (colours == case.colours[case.labels]).all(), "ply, pymeshlab: colours"


def table(case, path):
    """The table of clusters inside a GLB file."""
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20:20 + length]), data[28 + length:]
    properties, = document["extensions"]["EXT_structural_metadata"]["propertyTables"]
    view = document["bufferViews"][properties["properties"]["faces"]["values"]]
    assert view["byteOffset"] % 8 == 0 and properties["count"] == case.clusters
    faces = np.frombuffer(binary, "<u4", case.clusters, view["byteOffset"])
    assert (faces == np.bincount(case.labels)).all(), "glb: table"


def check_submeshes(case):
    sizes = np.bincount(case.triangle_labels)
    for file in ("submeshes.zip", "submeshes.stl.zip", "submeshes.obj.zip"):
        with zipfile.ZipFile(case.export("--submeshes", file)) as archive:
            assert archive.testzip() is None
            kind = {"submeshes.zip": "ply"}.get(file, file.split(".")[1])
            assert archive.namelist() == [f"cluster-{cluster:05}.{kind}" for cluster in range(case.clusters)], file
            for cluster in (0, case.clusters - 1):
                data = io.BytesIO(archive.read(f"cluster-{cluster:05}.{kind}"))
                loaded = trimesh.load(data, file_type=kind, process=False)
                assert len(loaded.faces) == sizes[cluster], f"{file}, trimesh"
    scene = trimesh.load(case.export("--submeshes", "submeshes.glb"), process=False)
    assert len(scene.geometry) == case.clusters, "submeshes.glb, trimesh"
    assert sum(len(part.faces) for part in scene.geometry.values()) == len(case.triangle_labels), "submeshes.glb"
    names = {name for name in scene.graph.nodes if name.startswith("cluster-")}
    assert names >= {f"cluster-{cluster}" for cluster in range(case.clusters)}, "submeshes.glb: nodes"

    with np.load(case.export("--submeshes", "submeshes.npz")) as buffers:
        vertices, triangles = buffers["vertices"], buffers["triangles"].astype(np.int64)
        begin, first = buffers["triangle_offsets"], buffers["vertex_offsets"].astype(np.int64)
        spheres, cones = buffers["spheres"], buffers["cones"]
    assert (np.diff(begin) == sizes).all(), "npz"
    whole = vertices[triangles + np.repeat(first[:-1], np.diff(begin))[:, None]]
    order = np.argsort(case.triangle_labels, kind="stable")
    assert (whole == case.triangles[order]).all(), "npz: triangles"
    points = case.vertices[whole]
    cluster = np.repeat(np.arange(case.clusters), np.diff(begin))
    far = np.linalg.norm(points - spheres[cluster, None, :3], axis=2).max(1)
    assert (far <= spheres[cluster, 3] * (1 + 1e-12)).all(), "npz: spheres"
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    cosines = (normals * cones[cluster, :3]).sum(1)[lengths > 0] / lengths[lengths > 0]
    assert (cosines >= cones[cluster, 3][lengths > 0] - 1e-9).all(), "npz: cones"


def check_remesh(case):
    summary = None
    counts = set()
    for file in ("remesh.ply", "remesh.obj", "remesh.stl", "remesh.glb"):
        loaded = trimesh.load(case.export("--remesh", file), process=False, force="mesh")
        counts.add(len(loaded.faces))
        if file == "remesh.ply":
            summary = loaded
    vtp = pyvista.read(case.export("--remesh", "remesh.vtp"))
    assert counts == {vtp.n_cells} == {len(summary.faces)}, f"remesh: {counts}"
    assert len(summary.vertices) >= case.clusters
    clusters = np.asarray(vtp.point_data["cluster"])
    assert (clusters[:case.clusters] == np.arange(case.clusters)).all(), "remesh: vertex i is cluster i"
    with np.load(case.export("--remesh-source", "remesh-source.npz")) as source:
        assert (source["cluster"] == clusters).all() and (source["kind"][:case.clusters] == 0).all()
        assert abs(source["barycentric"].sum(1) - 1).max() < 1e-9
        assert source["vertices"].max() < len(case.vertices) and source["face"].max() < case.faces
    is_closed = bool(np.unique(np.sort(edges_of(case), axis=1), axis=0, return_counts=True)[1].min() == 2)
    if is_closed:
        assert summary.is_watertight and summary.is_winding_consistent, "remesh, trimesh"
        assert vtp.is_manifold, "remesh, pyvista"


def edges_of(case):
    """Edges of the triangles, by position."""
    _, welded = np.unique(case.vertices, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[case.triangles]
    return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])


def check_data(case):
    """Graph, boundaries, table of clusters, where this program writes them."""
    if "--clusters-graph" not in run(BINARY, "export", "--help"):
        return
    document = json.loads(case.export("--clusters-graph", "graph.json").read_text())
    graph = networkx.node_link_graph(document, edges="edges")
    assert graph.number_of_nodes() == case.clusters
    matrix = scipy.sparse.load_npz(case.export("--clusters-graph", "graph.npz"))
    assert matrix.shape == (case.clusters, case.clusters) and abs(matrix - matrix.T).max() == 0
    assert matrix.nnz == 2 * graph.number_of_edges()
    drawn = networkx.read_graphml(case.export("--clusters-graph", "graph.graphml"))
    assert drawn.number_of_edges() == graph.number_of_edges()
    rows = list(csv.DictReader(case.export("--clusters-table", "clusters.csv").open()))
    assert [int(row["faces"]) for row in rows] == np.bincount(case.labels).tolist()
    curves = json.loads(case.export("--boundaries", "boundaries.json").read_text())["curves"]
    pairs = {(curve["left"], curve["right"]) for curve in curves if curve["right"] is not None}
    assert pairs == {tuple(sorted(map(int, edge))) for edge in graph.edges}
    lines = pyvista.read(case.export("--boundaries", "boundaries.vtp"))
    assert lines.n_lines == len(curves) and (lines.cell_data["left"] == [curve["left"] for curve in curves]).all()
    trimesh.load(case.export("--boundaries", "boundaries.glb"))


def validate():
    """Khronos' validator on every GLB file that was written."""
    if not OPTIONS.node:
        print("  left out: gltf-validator is not there", flush=True)
        return
    script = pathlib.Path(__file__).parent / "gltf" / "validate.mjs"
    broken = WORK / "broken.glb"
    broken.write_bytes(GLB[0].read_bytes().replace(b":5125", b":5126"))
    found = json.loads(run("node", script, OPTIONS.node.resolve(), *GLB, broken))
    assert found.pop(str(broken))["errors"] > 0, "the validator finds nothing"
    for file, issues in found.items():
        assert issues["errors"] == issues["warnings"] == 0, f"{file}: {issues}"
    print(f"  {len(found)} GLB files without error or warning", flush=True)


def in_chromium(case):
    """The GLB of the mesh as three.js has it in Chromium."""
    modules = OPTIONS.node and OPTIONS.node.resolve() / "node_modules"
    if not modules or not (modules / "three").exists():
        print("  left out: three is not there", flush=True)
        return
    page = (pathlib.Path(__file__).parent / "gltf" / "three.html").read_text()
    glb = base64.b64encode(case.path("mesh.glb").read_bytes()).decode()
    case.path("three.html").write_text(page.replace("MODULES", modules.as_uri()).replace("FILE", glb))
    # the page reads modules from files; the virtual time passes at once when nothing is left to do
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files"]
    flags.append("--virtual-time-budget=60000")
    folder = f"--user-data-dir={case.path('chromium')}"
    browser = os.environ.get("CHROMIUM", "chromium-headless-shell")
    text = run(browser, *flags, folder, "--dump-dom", case.path("three.html").as_uri())
    found, = json.loads(re.search(r"<body>(.*?)</body>", text, re.S)[1])
    assert found["ids"] == case.triangle_labels.tolist(), f"{case.name}: glb, three.js: ids"
    assert found["ids"] != np.roll(case.triangle_labels, 1).tolist(), "other labels are not noticed"
    colours = np.array(found["colours"]) * 255
    assert abs(colours - case.colours[case.triangle_labels]).max() < 0.01, f"{case.name}: glb, three.js: colours"


def main():
    samples = [("knot", 6000, "glb", 60), ("quads", 3000, "obj", 40)]
    meshes = []
    for name, faces, extension, clusters in samples:
        path = WORK / f"{name}.{extension}"
        run(BINARY, "sample", name, "--faces", faces, path)
        meshes.append((path, clusters))
    bunny = OPTIONS.meshes and OPTIONS.meshes / "stanford-bunny.obj"
    if bunny and bunny.exists():
        meshes.append((bunny, 1000))
    for mesh, clusters in meshes:
        case = Case(mesh, clusters)
        for check in (check_mesh, check_submeshes, check_remesh, check_data, in_chromium):
            check(case)
        print(f"  {case.name}: every output of {case.faces} faces in {clusters} clusters is read back", flush=True)
    validate()


if __name__ == "__main__":
    main()
