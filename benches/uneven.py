"""Energies of every quality and of the other algorithms, on meshes of every kind.

    python uneven.py BINARY MESH_DIR OUT_DIR [--before BINARY] [--faces MOST] [--more-than LEAST] [--meshes PART,...]
        [--seconds LIMIT] [--variants]

Clusters every mesh of MESH_DIR with k in 5, 20, 100, 300, 1000, faces/4 and faces/2, and writes OUT_DIR/uneven.json and
OUT_DIR/uneven.md: for each gate the number of cases, the worst ones and the geometric mean. Energies are those of the
reports (f64, from source positions). `--before` is an older build whose energies count among the bars. A run of more than
LIMIT seconds is left out, and named.

With `--variants`, every mesh is clustered with k in 20, 100 and 1000 in twelve forms that are the same surface: scaled,
shifted, rotated, with other orders of faces and corners. OUT_DIR/variants.json and OUT_DIR/variants.md have the spread
of the energies, the largest over the smallest less one.
"""

import argparse
import gzip
import json
import math
import pathlib
import random
import shutil
import subprocess
import tempfile

RUNS = {
    "default": [],
    "best": ["--quality", "best"],
    "fast": ["--quality", "fast"],
    "hr": ["--algorithm", "hr"],
    "pml": ["--algorithm", "pml"],
    "acvd": ["--algorithm", "acvd"],
}
BEFORE = {f"{label} before": options for label, options in RUNS.items() if label != "fast"}
SUFFIXES = {".obj", ".glb", ".gltf", ".ply", ".stl"}

# gate: (what, bars, allowed ratio)
GATES = [
    ("default", list(BEFORE), 1.005),
    ("default", ["hr", "pml", "acvd"], 1.005),
    ("default", ["acvd"], 1.0),
    ("best", ["default", "fast", "hr", "pml", "acvd", *BEFORE], 1.0),
    ("fast", ["default"], 1.15),
    ("pml", ["default"], 1.12),
]


def meshes(folder, scratch):
    """Every mesh once: the first of several formats of one name, unpacked."""
    seen = set()
    for path in sorted(folder.rglob("*")):
        name = path.name.removesuffix(".gz")
        if pathlib.Path(name).suffix not in SUFFIXES or (path.parent == folder and name.split(".")[0] in seen):
            continue
        seen.add(name.split(".")[0])
        if path.suffix == ".gz":
            unpacked = scratch / name
            with gzip.open(path) as packed, open(unpacked, "wb") as out:
                shutil.copyfileobj(packed, out)
            path = unpacked
        yield str(path).removeprefix(f"{folder}/"), path


def chosen_meshes(arguments, scratch):
    for name, path in meshes(arguments.meshes_dir, scratch):
        if not arguments.only or any(part in name for part in arguments.only.split(",")):
            yield name, path


def run(arguments, binary, mesh, k, options, scratch):
    """The report of a run, or None where it is refused or takes too long."""
    report = scratch / "report.json"
    command = [binary, "cluster", mesh, "--device", "cpu", "--clusters", str(k), "--report", report, *options]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=arguments.seconds)
    except subprocess.TimeoutExpired:
        print("left out:", mesh, k, *options, flush=True)
        return None
    if done.returncode == 1:
        return None
    done.check_returncode()
    return json.loads(report.read_text())


def measured(arguments, scratch):
    """One row a mesh and k."""
    rows = []
    for name, mesh in chosen_meshes(arguments, scratch):
        first = run(arguments, arguments.binary, mesh, 1, ["--bridge-components"], scratch)
        if first is None or not arguments.least < first["input"]["faces"] <= arguments.faces:
            continue
        faces = first["input"]["faces"]
        for k in sorted({5, 20, 100, 300, 1000, faces // 4, faces // 2}):
            runs = [(arguments.binary, label, options) for label, options in RUNS.items()]
            if arguments.before:
                runs += [(arguments.before, label, options) for label, options in BEFORE.items()]
            row = {"mesh": name, "faces": faces, "k": k, "energy": {}, "ms": {}}
            for binary, label, options in runs:
                report = run(arguments, binary, mesh, k, options, scratch) if 0 < k <= faces else None
                if report is not None:
                    row["energy"][label] = report["energy"]["final"]
                    row["ms"][label] = report["timings_ms"]["cluster"]
            if row["energy"]:
                rows.append(row)
                print(name, k, {label: f"{energy:.6g}" for label, energy in row["energy"].items()}, flush=True)
                (arguments.out / "uneven.json").write_text(json.dumps(rows, indent=1))
    return rows


def rotated(axis, degrees):
    """A rotation about an axis through the origin (Rodrigues)."""
    length = math.sqrt(sum(x * x for x in axis))
    x, y, z = (part / length for part in axis)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    rows = [
        [c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
        [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
        [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)],
    ]
    return lambda point: [sum(a * b for a, b in zip(row, point)) for row in rows]


def variants(points, faces):
    """(name, scale of lengths, points, faces) of each form of a mesh."""
    low, high = ([end(axis) for axis in zip(*points)] for end in (min, max))
    diagonal = math.dist(low, high)
    shuffled = faces[:]
    random.Random(1).shuffle(shuffled)
    yield "as it is", 1, points, faces
    for scale in (1e-3, 1e3, 1e6):
        yield f"times {scale:g}", scale, [[scale * x for x in point] for point in points], faces
    for by in (1, 100):
        offset = [by * part * diagonal for part in (1, -2, 3)]
        yield f"shifted by {by}", 1, [[x + d for x, d in zip(point, offset)] for point in points], faces
    for axis, degrees in (((1, 2, 3), 30), ((1, 0, 0), 90)):
        yield f"rotated by {degrees}", 1, list(map(rotated(axis, degrees), points)), faces
    yield "faces reversed", 1, points, faces[::-1]
    yield "faces shuffled", 1, points, shuffled
    yield "winding reversed", 1, points, [face[::-1] for face in faces]
    yield "other first corners", 1, points, [face[1:] + face[:1] for face in faces]


def spreads(arguments, scratch):
    """One row a mesh and k: the energy of each variant, in units of the mesh as it is."""
    rows = []
    for name, mesh in chosen_meshes(arguments, scratch):
        plain = scratch / "plain.obj"
        if run(arguments, arguments.binary, mesh, 1, ["--bridge-components", "--mesh", plain], scratch) is None:
            continue
        words = [line.split() for line in plain.read_text().splitlines()]
        points = [[float(x) for x in line[1:4]] for line in words if line and line[0] == "v"]
        faces = [[int(corner.split("/")[0]) for corner in line[1:]] for line in words if line and line[0] == "f"]
        if not max(40, arguments.least + 1) <= len(faces) <= arguments.faces:
            continue
        energies = {k: {} for k in (20, 100, 1000) if k <= len(faces) // 2}
        for variant, scale, moved, ordered in variants(points, faces):
            form = scratch / "variant.obj"
            lines = ["v " + " ".join(map(repr, point)) for point in moved]
            lines += ["f " + " ".join(map(str, face)) for face in ordered]
            form.write_text("\n".join(lines) + "\n")
            for k, energy in energies.items():
                report = run(arguments, arguments.binary, form, k, [], scratch)
                if report is not None:
                    energy[variant] = report["energy"]["final"] / scale**4
        for k, energy in energies.items():
            if len(energy) > 1 and min(energy.values()) > 0:
                spread = max(energy.values()) / min(energy.values()) - 1
                rows.append({"mesh": name, "faces": len(faces), "k": k, "spread": spread, "energy": energy})
                print(name, k, f"{100 * spread:.2f} %", flush=True)
    return rows


def markdown_of_spreads(rows):
    ordered = sorted(row["spread"] for row in rows)
    lines = [f"{len(rows)} cases, median {100 * ordered[len(ordered) // 2]:.2f} %, most {100 * ordered[-1]:.2f} %.", ""]
    lines += ["| mesh | k | spread | lowest | highest |", "|---|--:|--:|---|---|"]
    for row in sorted(rows, key=lambda row: -row["spread"]):
        low, high = (end(row["energy"], key=row["energy"].get) for end in (min, max))
        lines.append(f"| {row['mesh']} | {row['k']} | {100 * row['spread']:.2f} % | {low} | {high} |")
    return "\n".join(lines) + "\n"


def ratios(rows, of, bars):
    """(ratio, row) of each case in which something is to be lowered, the worst first."""
    found = []
    for row in rows:
        bar = min((row["energy"][bar] for bar in bars if bar in row["energy"] and of in row["energy"]), default=0)
        scale = max(row["energy"].values())
        # at rounding errors of the whole mesh there is nothing to compare
        if bar > 1e-9 * scale:
            found.append((row["energy"][of] / bar, row))
    return sorted(found, key=lambda case: -case[0])


def markdown(rows):
    lines = ["| | lowest of | cases | allowed | above | worst | geometric mean |", "|---|---|--:|--:|--:|--:|--:|"]
    worst = ["| | mesh, k | ratio |", "|---|---|--:|"]
    for of, bars, allowed in GATES:
        cases = ratios(rows, of, bars)
        if not cases:
            continue
        above = [case for case in cases if case[0] > allowed * (1 + 1e-9)]
        mean = math.exp(sum(math.log(ratio) for ratio, _ in cases if ratio > 0) / len(cases))
        bars = ", ".join(bars)
        lines.append(f"| {of} | {bars} | {len(cases)} | {allowed} | {len(above)} | {cases[0][0]:.4f} | {mean:.4f} |")
        worst += [f"| {of} / {bars} | {row['mesh']}, {row['k']} | {ratio:.4f} |" for ratio, row in above[:10]]
    labels = list(dict.fromkeys(label for row in rows for label in row["energy"]))
    times = ["| | " + " | ".join(labels) + " |", "|---|" + "--:|" * len(labels)]
    complete = [row for row in rows if len(row["ms"]) == len(labels)]
    totals = [sum(row["ms"][label] for row in complete) for label in labels]
    times.append("| ms, all cases | " + " | ".join(f"{total:.0f}" for total in totals) + " |")
    table = ["| mesh | k | " + " | ".join(labels) + " |", "|---|--:|" + "--:|" * len(labels)]
    for row in rows:
        energies = " | ".join(f"{row['energy'][label]:.6g}" if label in row["energy"] else "" for label in labels)
        table.append(f"| {row['mesh']} | {row['k']} | {energies} |")
    return "\n\n".join("\n".join(part) for part in (lines, worst, times, table)) + "\n"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary")
    parser.add_argument("meshes_dir", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--before")
    parser.add_argument("--faces", type=int, default=1 << 20)
    parser.add_argument("--more-than", dest="least", type=int, default=0)
    parser.add_argument("--meshes", dest="only")
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--variants", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        rows = (spreads if arguments.variants else measured)(arguments, pathlib.Path(scratch))
    name, text = ("variants", markdown_of_spreads(rows)) if arguments.variants else ("uneven", markdown(rows))
    (arguments.out / f"{name}.json").write_text(json.dumps(rows, indent=1))
    (arguments.out / f"{name}.md").write_text(text)
    print(text.split("| mesh | k |")[0])


if __name__ == "__main__":
    main()
