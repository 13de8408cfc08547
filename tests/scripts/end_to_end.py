"""The whole program from outside: curl against the service, the command line, cpu against gpu, all of it scored.

    python end_to_end.py BINARY [MESHES]

BINARY is the `tesserae` to test. MESHES is a folder of meshes; samples made by BINARY are used as well, and alone where
there is no such folder. A file tools/score.py beside that folder is a second, independent scorer and is asked too.
"""

import itertools
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np

import linkage
import score
from service import Service

BINARY = pathlib.Path(sys.argv[1]).resolve()
MESHES = pathlib.Path(sys.argv[2]).resolve() if len(sys.argv) > 2 else None
SECOND_SCORER = MESHES.parent / "tools" / "score.py" if MESHES else None
TEMPORARY = tempfile.TemporaryDirectory(prefix="tesserae-")
WORK = pathlib.Path(TEMPORARY.name)


def run(*command):
    """Standard output of a command, which must succeed."""
    done = subprocess.run([str(word) for word in command], capture_output=True)
    assert done.returncode == 0, f"{command} ended with {done.returncode}:\n{done.stderr.decode()}"
    return done.stdout


def sample(name, faces, extension="obj"):
    path = WORK / f"{name}-{faces}.{extension}"
    if not path.exists():
        run(BINARY, "sample", name, "--faces", faces, path)
    return path


def real(name, replacement):
    """A mesh of the folder, or what stands for it where there is no folder."""
    path = MESHES and MESHES / name
    return path if path and path.exists() else replacement()


def close(a, b, tolerance=1e-6):
    return abs(a - b) <= tolerance * max(abs(a), abs(b))


def check_result(what, mesh, labels_path, report, clusters):
    """Labels and report of one job against the scorers."""
    scored = score.score(score.load(mesh), np.load(labels_path))
    energy = report["energy"]
    assert scored["clusters"] == report["clusters"] == clusters, f"{what}: {scored['clusters']} clusters"
    assert scored["largest_label"] == clusters - 1, f"{what}: label {scored['largest_label']}"
    assert scored["faces"] == report["input"]["faces"], what
    assert close(scored["energy"], energy["final"]), f"{what}: {scored['energy']} and {energy['final']}"
    assert (scored["hexagon_ratio"] is None) == (energy["hexagon_ratio"] is None), what
    if scored["hexagon_ratio"] is not None:
        assert close(scored["hexagon_ratio"], energy["hexagon_ratio"]), f"{what}: hexagon ratio"
    assert scored["disconnected_clusters"] == report["disconnected_clusters"] == 0, what
    check_descent(what, report["iterations"])
    # The comparison can fail: labels shifted by one face have another energy.
    if clusters > 1:
        shifted = score.score(score.load(mesh), np.roll(np.load(labels_path), 1))
        assert not close(shifted["energy"], energy["final"]), f"{what}: the energy does not depend on the labels"
    # It reads the nodes of a scene in an order of its own.
    one_part = mesh.suffix == ".obj" or len(report["input"]["parts"]) == 1
    if SECOND_SCORER and SECOND_SCORER.exists() and one_part:
        second = json.loads(run(sys.executable, SECOND_SCORER, mesh, labels_path))
        assert close(second["energy_source"], energy["final"]), f"{what}: second scorer, {second}"
        assert second["k"] == clusters and second["disconnected"] == 0, f"{what}: second scorer, {second}"
    print(f"  {what}: {scored['faces']} faces, {clusters} clusters, energy {scored['energy']:.9e}, "
          f"hexagon ratio {scored['hexagon_ratio']}", flush=True)


def check_descent(what, rows):
    """The energy never rises within a phase."""
    for before, after in zip(rows, rows[1:]):
        if after["phase"] == before["phase"] != "repair":
            assert after["energy"] <= before["energy"] * (1 + 1e-15), f"{what}: {before} then {after}"


def events_of(text):
    """Events of a stream: id, name, data."""
    events = []
    for block in text.decode().split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if ": " in line and not line.startswith(":"))
        if "data" in fields:
            events.append((int(fields["id"]), fields["event"], json.loads(fields["data"])))
    return events


def check_service_job(service, mesh, clusters, *curl):
    """One job: posted by curl, watched to its end, fetched, scored."""
    job = json.loads(run("curl", "-sS", "--fail-with-body", *curl))
    url = f"{service.url}/v1/jobs/{job['id']}"
    events = events_of(run("curl", "-sSN", "--fail-with-body", "--max-time", 300, url + "/events"))
    ids = [event[0] for event in events]
    assert ids == sorted(set(ids)), f"ids {ids}"
    assert events[-1][1] == "end" and events[-1][2]["state"] == "succeeded", f"{events[-1]}"
    middle = ids[len(ids) // 2]
    resumed = events_of(run("curl", "-sSN", "--max-time", 60, "-H", f"Last-Event-ID: {middle}", url + "/events"))
    assert resumed == [event for event in events if event[0] > middle], "a resumed stream is not the rest"

    report = json.loads(run("curl", "-sS", "--fail-with-body", url + "/report"))
    rows = [data for _, name, data in events if name == "iteration"]
    assert rows == report["iterations"] and len(rows) > 3, "streamed and reported iterations differ"
    labels = {}
    for extension, media_type in [
            ("npy", "application/x-npy"), ("json", "application/json"), ("bin", "application/octet-stream")]:
        labels[extension] = WORK / f"{job['id']}.{extension}"
        run("curl", "-sS", "--fail-with-body", "-H", f"Accept: {media_type}", "-o", labels[extension], url + "/labels")
    numbers = np.load(labels["npy"])
    assert json.loads(labels["json"].read_text()) == {"clusters": clusters, "labels": numbers.tolist()}
    assert (np.fromfile(labels["bin"], "<u4") == numbers).all()
    check_result(f"service, {mesh.name}", mesh, labels["npy"], report, clusters)


def check_service():
    """The two uploads: a raw body with a media type, and a form."""
    glb = real("stanford-bunny.glb", lambda: sample("knot", 70_000, "glb"))
    obj = real("horse.obj", lambda: sample("terrain", 90_000))
    with Service(BINARY) as service:
        jobs = service.url + "/v1/jobs"
        check_service_job(service, glb, 1000, "--data-binary", f"@{glb}", "-H", "Content-Type: model/gltf-binary",
                          jobs + "?algorithm=bb&clusters=1000")
        check_service_job(service, obj, 2000, "-F", f"mesh=@{obj}", "-F", 'parameters={"clusters":2000}', jobs)
    print("  the service stopped when asked to")


def cluster(mesh, clusters, *arguments):
    """Report of `tesserae cluster`, and where the labels are."""
    labels, report = WORK / "labels.npy", WORK / "report.json"
    run(BINARY, "cluster", mesh, "--clusters", clusters, "--labels", labels, "--report", report, *arguments)
    return json.loads(report.read_text()), labels


def check_command_line():
    meshes = [(real("horse.obj", lambda: sample("terrain", 90_000)), 2000)]
    meshes += [(sample("sphere", 20_000), 200), (sample("parts", 8_000, "glb"), 150), (sample("quads", 6_000), 100)]
    for mesh, clusters in meshes:
        report, labels = cluster(mesh, clusters)
        check_result(f"command line, {mesh.name}", mesh, labels, report, clusters)


def check_density_and_snapshots():
    """Weights draw clusters, as many as the field says; labels that are kept have the energies of their iterations."""
    mesh, clusters = sample("icosphere", 20_000), 300
    vertices, corners, first = loaded = score.load(mesh)
    upper = vertices[corners].reshape(-1, 3, 3)[:, :, 2].mean(1) > 0
    weights = WORK / "weights.npy"
    np.save(weights, np.where(upper, 16.0, 1.0))
    report, labels = cluster(mesh, clusters, "--weights", weights)
    assert report["energy"]["weighted_by"] == ["weights"], report["energy"]
    labels = np.load(labels)
    faces_above = np.bincount(labels[upper], minlength=clusters)
    dense = int((2 * faces_above > np.bincount(labels)).sum())
    # sixteen times the density: clusters of half the width, four to one
    assert 3.3 < dense / (clusters - dense) < 4.7, dense
    even, _ = cluster(mesh, clusters)
    assert even["labels_sha256"] != report["labels_sha256"]

    report, labels = cluster(mesh, clusters, "--snapshots", "0,3,5", "--quality", "best")
    assert report["snapshots"] == [0, 3, 5], report["snapshots"]
    for iteration in report["snapshots"]:
        kept = np.load(labels.with_name(f"labels.iteration-{iteration}.npy"))
        scored = score.score(loaded, kept)["energy"]
        assert close(scored, report["iterations"][iteration]["energy"]), iteration
    assert report["energy"]["final"] < even["energy"]["final"], "best is not lower"
    assert report["energy"]["hexagon_ratio"] < 1.04, report["energy"]
    print(f"  {dense} of {clusters} clusters in the dense half of a sphere", flush=True)


def check_hierarchies():
    """Cuts scored, and the linkage matrices of nested trees as scipy sees them."""
    meshes = [(real("stanford-bunny.obj", lambda: sample("knot", 70_000)), [2000, 1000]), (sample("quads", 6_000), [300, 77])]
    for mesh, levels in meshes:
        loaded = score.load(mesh)
        tree, report, labels = WORK / "tree.tsr", WORK / "tree.json", WORK / "cut.npy"
        run(BINARY, "cluster", mesh, "--algorithm", "pml", "--levels", ",".join(map(str, levels)), "--hierarchy", tree,
            "--report", report)
        for clusters in [*levels, 3 * levels[0], levels[1] - 1, 2]:
            run(BINARY, "cut", tree, "--clusters", clusters, "--labels", labels, "--report", WORK / "cut.json")
            cut, scored = json.loads((WORK / "cut.json").read_text()), score.score(loaded, np.load(labels))
            assert scored["clusters"] == clusters and scored["disconnected_clusters"] == 0, scored
            # faces weigh what their integer weights say
            assert close(scored["energy"], cut["energy"], 1e-4), f"{mesh.name}, {clusters}: {cut} {scored['energy']}"
            assert cut["cut"] == "exact" or clusters not in levels, cut
            print(f"  {mesh.name}, pml cut at {clusters}: energy {scored['energy']:.9e}, {cut['cut']}", flush=True)
        for algorithm in (["hr"], ["pml", "--optimize", "none"]):
            matrix = WORK / "linkage.npy"
            run(BINARY, "cluster", mesh, "--algorithm", *algorithm, "--linkage", matrix, "--hierarchy", tree)
            run(BINARY, "cut", tree, "--clusters", levels[1], "--labels", labels)
            linkage.check(np.load(matrix), scored["faces"])
            print(f"  {mesh.name}, {' '.join(algorithm)}: a linkage matrix for scipy", flush=True)
            if linkage.ward is not None:
                ours, peer = score.score(loaded, np.load(labels))["energy"], linkage.ward(loaded, levels[1])
                print(f"  {mesh.name}, {' '.join(algorithm)} at {levels[1]}: {ours / peer:.5f} of higra's Ward", flush=True)
                # On meshes with many equal costs, which of them merges first decides more than that.
                assert "bunny" not in mesh.name or close(ours, peer, 1e-3 if algorithm == ["hr"] else 1e-2), f"{ours} and {peer}"


def check_energies():
    """Energies at default settings, where the meshes are: below ACVD's, and a hierarchy's levels near flat ones, below Ward's."""
    if not MESHES:
        print("  left out: there is no folder of meshes", flush=True)
        return
    # ACVD (Valette & Chassery 2004) on faces, from its own source: Σ area·distance², bounding box of diagonal 1
    for name, clusters, acvd in [
        ("stanford-bunny.obj", 1000, 1.3215e-4), ("stanford-bunny.obj", 3000, 4.4709e-5), ("horse.obj", 1000, 4.9573e-5),
        ("horse.obj", 2000, 2.5055e-5), ("nefertiti.obj", 1000, 1.1112e-4), ("igea.glb", 5000, 3.0017e-5),
    ]:
        if (MESHES / name).exists():
            mesh = score.load(MESHES / name)
            report, labels = cluster(MESHES / name, clusters, "--device", "cpu")
            scored = score.score(mesh, np.load(labels))
            energy = scored["energy"] / diagonal(mesh) ** 4
            print(f"  {name}, {clusters}: {energy:.4e}, {energy / acvd:.4f} of ACVD's", flush=True)
            assert energy <= acvd and scored["disconnected_clusters"] == 0 and scored["clusters"] == clusters, scored
    for name in ["stanford-bunny.obj", "horse.obj", "nefertiti.obj", "armadillo-172k.glb"]:
        if (MESHES / name).exists():
            mesh, tree, labels = score.load(MESHES / name), WORK / "levels.tsr", WORK / "cut.npy"
            run(BINARY, "cluster", MESHES / name, "--algorithm", "pml", "--levels", "2000,1000", "--clusters", 1000,
                "--hierarchy", tree, "--device", "cpu")
            for clusters in [2000, 1000]:
                flat = cluster(MESHES / name, clusters, "--device", "cpu")[0]["energy"]["final"]
                run(BINARY, "cut", tree, "--clusters", clusters, "--labels", labels)
                ours = score.score(mesh, np.load(labels))["energy"]
                ward = linkage.ward and linkage.ward(mesh, clusters)
                beside = f", {ours / ward:.4f} of higra's Ward" if ward else ""
                print(f"  {name}, pml at {clusters}: {ours / flat:.4f} of a flat clustering{beside}", flush=True)
                assert ours <= 1.015 * flat and (not ward or ours < ward), (ours, flat, ward)


def diagonal(mesh):
    """Length of the diagonal of the bounding box of the vertices that faces use."""
    vertices, corners, _ = mesh
    used = vertices[corners]
    return float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))


def meshes_to_compare():
    yield from [sample("knot", 30_000, "glb"), sample("parts", 6_000), sample("quads", 5_000), sample("strip", 4_096),
                sample("plane", 8_192), sample("cube", 4_800)]
    if MESHES:
        # Draco is not read; everything else in these formats is. A mesh in several formats is compared once.
        files = (path for path in sorted(MESHES.rglob("*")) if path.suffix in (".obj", ".glb", ".gltf"))
        yield from {path.with_suffix(""): path for path in files if "draco" not in str(path)}.values()


def check_cpu_against_gpu():
    """The same labels from both devices, for numbers of clusters and ways to choose seeds, which take turns; with
    TESSERAE_TEST_LONG, for all."""
    runs, hashes = 0, set()
    is_long = "TESSERAE_TEST_LONG" in os.environ
    ways = [("coarse", 0), ("random", 5), ("morton", 1)]
    if is_long:
        chosen = itertools.product(meshes_to_compare(), ways)
    else:
        chosen = zip(meshes_to_compare(), itertools.cycle(ways))
    for at, (mesh, (seeds, seed)) in enumerate(chosen):
        described = describe(mesh)
        faces, components = described["faces"], described["components"]
        counts = [faces // 60, faces // 9, components]
        if not is_long:
            # with few clusters, large meshes take a software gpu long
            counts = [counts[0 if faces > 100_000 else (at + at // 3) % 3]]
        counts = sorted({max(clusters, components) for clusters in counts})
        both = [reports_of(mesh, counts, "--device", device, "--seeds", seeds, "--seed", seed) for device in ("cpu", "gpu")]
        for clusters, cpu, gpu in zip(counts, *both):
            what = f"{mesh.name}, {clusters} clusters, seeds {seeds} {seed}"
            assert gpu["device"]["kind"] == "gpu", gpu["device"]
            assert cpu["labels_sha256"] == gpu["labels_sha256"], f"{what}: cpu and gpu labels differ"
            assert [row["energy"] for row in cpu["iterations"]] == [row["energy"] for row in gpu["iterations"]], what
            runs += 1
            hashes.add(cpu["labels_sha256"])
    # The comparison can fail: other meshes and parameters give other labels.
    assert len(hashes) > runs / 2, f"{len(hashes)} different labellings in {runs} runs"
    print(f"  {runs} runs, the same labels and energies on cpu and gpu", flush=True)


def reports_of(mesh, counts, *arguments):
    """Reports of one `tesserae cluster` with several numbers of clusters."""
    listed = ",".join(map(str, counts))
    run(BINARY, "cluster", mesh, "--clusters", listed, "--report", WORK / "report-{k}.json", "--quiet", *arguments)
    return [json.loads((WORK / f"report-{clusters}.json").read_text()) for clusters in counts]


def describe(mesh):
    """The `input` of a report. The number of components is named by the refusal of fewer clusters."""
    clusters = 1
    while True:
        done = subprocess.run([BINARY, "cluster", mesh, "--clusters", str(clusters), "--report", "-", "--device", "cpu",
                               "--max-iterations", "0"], capture_output=True, text=True)
        if done.returncode == 0:
            return json.loads(done.stdout)["input"]
        components = re.search(r"connected components, (\d+)", done.stderr)
        assert components and clusters == 1, f"{mesh}: {done.stderr}"
        clusters = int(components[1])


if __name__ == "__main__":
    for check in (check_command_line, check_density_and_snapshots, check_service, check_hierarchies, check_energies, check_cpu_against_gpu):
        print(check.__name__.replace("_", " "), flush=True)
        check()
