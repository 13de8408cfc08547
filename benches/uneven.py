"""Energies of every quality and of the other algorithms, on meshes of every kind.

    python uneven.py BINARY MESH_DIR OUT_DIR [--before BINARY] [--faces MOST] [--meshes PART,...]

Clusters every mesh of MESH_DIR with k in 5, 20, 100, 300, 1000, faces/4 and faces/2, and writes OUT_DIR/uneven.json and
OUT_DIR/uneven.md: for each gate the number of cases, the worst ones and the geometric mean. Energies are those of the
reports (f64, from source positions). `--before` is an older build whose default and best count among the bars.
"""

import argparse
import gzip
import json
import math
import pathlib
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
BEFORE = {"default before": [], "best before": ["--quality", "best"]}
SUFFIXES = {".obj", ".glb", ".gltf", ".ply", ".stl"}

# gate: (what, bars, allowed ratio)
GATES = [
    ("default", ["default before", "best before", "hr", "pml", "acvd"], 1.005),
    ("default", ["acvd"], 1.0),
    ("best", ["default", "fast", "default before", "best before", "hr", "pml", "acvd"], 1.0),
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


def run(binary, mesh, k, options, scratch):
    """The report of a run, or None where it is refused."""
    report = scratch / "report.json"
    command = [binary, "cluster", mesh, "--device", "cpu", "--clusters", str(k), "--report", report, *options]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode == 1:
        return None
    done.check_returncode()
    return json.loads(report.read_text())


def measured(arguments, scratch):
    """One row a mesh and k."""
    rows = []
    for name, mesh in meshes(arguments.meshes_dir, scratch):
        if arguments.only and not any(part in name for part in arguments.only.split(",")):
            continue
        first = run(arguments.binary, mesh, 1, ["--bridge-components"], scratch)
        if first is None or first["input"]["faces"] > arguments.faces:
            continue
        faces = first["input"]["faces"]
        for k in sorted({5, 20, 100, 300, 1000, faces // 4, faces // 2}):
            runs = [(arguments.binary, label, options) for label, options in RUNS.items()]
            if arguments.before:
                runs += [(arguments.before, label, options) for label, options in BEFORE.items()]
            row = {"mesh": name, "faces": faces, "k": k, "energy": {}, "ms": {}}
            for binary, label, options in runs:
                report = run(binary, mesh, k, options, scratch) if 0 < k <= faces else None
                if report is None:
                    break
                row["energy"][label] = report["energy"]["final"]
                row["ms"][label] = report["timings_ms"]["cluster"]
            else:
                rows.append(row)
                print(name, k, {label: f"{energy:.6g}" for label, energy in row["energy"].items()}, flush=True)
    return rows


def ratios(rows, of, bars):
    """(ratio, row) of each case in which something is to be lowered, the worst first."""
    found = []
    for row in rows:
        bar = min((row["energy"][bar] for bar in bars if bar in row["energy"]), default=0)
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
    labels = list(rows[0]["energy"]) if rows else []
    times = ["| | " + " | ".join(labels) + " |", "|---|" + "--:|" * len(labels)]
    totals = [sum(row["ms"][label] for row in rows) for label in labels]
    times.append("| ms, all cases | " + " | ".join(f"{total:.0f}" for total in totals) + " |")
    table = ["| mesh | k | " + " | ".join(labels) + " |", "|---|--:|" + "--:|" * len(labels)]
    for row in rows:
        energies = " | ".join(f"{row['energy'][label]:.6g}" for label in labels)
        table.append(f"| {row['mesh']} | {row['k']} | {energies} |")
    return "\n\n".join("\n".join(part) for part in (lines, worst, times, table)) + "\n"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary")
    parser.add_argument("meshes_dir", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--before")
    parser.add_argument("--faces", type=int, default=1 << 20)
    parser.add_argument("--meshes", dest="only")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        rows = measured(arguments, pathlib.Path(scratch))
    (arguments.out / "uneven.json").write_text(json.dumps(rows, indent=1))
    (arguments.out / "uneven.md").write_text(markdown(rows))
    print(markdown(rows).split("| mesh | k |")[0])


if __name__ == "__main__":
    main()
