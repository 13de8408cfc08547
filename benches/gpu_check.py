"""What a graphics card does with tesserae: whether its results are right, what it takes, and which constants suit it.

    python3 gpu_check.py [--out DIR] [--minutes N] [--steps 1,2,3,4,5]

Runs in the folder that `make gpu-check` packs (bin/tesserae, tests/, lib/, meshes/), needs nothing but Python there,
and writes DIR/<date>-<card>/gpu-check.md and .json. It is meant for a card that is at hand for an hour: steps go from
what decides most to what decides least, each has its share of the minutes and what earlier ones left, and a step that
takes longer is cut off and said to be. It stops after step 1 where labels are not those of the cpu. On software Vulkan
the same runs on meshes of some thousand faces: its times mean nothing, its labels do.
"""

import argparse
import datetime
import glob
import json
import math
import os
import pathlib
import platform
import re
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
BINARY = HERE / "bin" / "tesserae"

# What an H200 was estimated to take before one was at hand: microseconds, GB/s, milliseconds. Name, least, most.
PREDICTED = [
    ("direct_written_8", 2.0, 3.0, "µs a dispatch, 8 written bindings"),
    ("direct_528_groups_6_loads - direct_written_8", 1.0, 2.0, "µs more for 528 groups of dependent loads"),
    ("round_trip", 35, 60, "µs, submission to bytes on the host"),
    ("upload_staged", 3, 8, "GB/s, through staging memory"),
    ("upload_written", 3, 8, "GB/s, by write_buffer"),
    ("open", 500, 2000, "ms to open it and compile all kernels"),
    ("bunny", 7, 18, "ms, bunny into 1,000 clusters at `fast`"),
    ("armadillo", 10, 25, "ms, armadillo (172,972 faces) into 2,000 at `fast`"),
    ("copy", 3500, 4500, "GB/s, copies within its memory, read and written"),
    ("sweep", 0.4, 0.6, "of a copy's speed, sums and lists from labels"),
]

# Values to try, the default not among them.
VARIANTS = {
    "first_batch": [4, 16],
    "least_batch": [2, 8],
    "largest_batch": [16, 64],
    "batch_after_repair": [4, 8],
    "compact_part": [4, 8, 64],
    "sums_along": [0, 4096, 65536],
    "workgroup": [64, 128, 512],
    "run": [1, 4, 16],
    "labels_along": [0, 4_194_304],
    "chain_items": [0, 512, 8192],
    "start_on_cpu": [0, 16_384],
    "merges_up_to": [0],
}

# Constants that no measurement of a card decides.
GIVEN = {
    "batch_ms": "how long a cancelled job may go on",
    "software_limit": "of software alone",
}

# A constant changes where that makes runs faster by more than this.
GAIN = 0.05


class Cut(Exception):
    """A step's time is up."""


class Check:
    def __init__(self, minutes):
        self.figures, self.report, self.decisions, self.failures = {}, [], [], []
        self.minutes, self.until, self.begun, self.shares = minutes, None, time.monotonic(), 0
        self.env = os.environ | {
            "NODEVICE_SELECT": "1",
            "XDG_RUNTIME_DIR": os.environ.get("XDG_RUNTIME_DIR", "/tmp"),
            "TESSERAE_TEST_MESHES": str(HERE / "meshes"),
            "TESSERAE_TEST_SECONDS": "20",
        }
        if "libvulkan.so.1" not in self.try_run(["/sbin/ldconfig", "-p"]):
            self.env["LD_LIBRARY_PATH"] = f"{HERE / 'lib'}:{os.environ.get('LD_LIBRARY_PATH', '')}"

    def run(self, *command):
        """The output of a command; Cut if it outlasts the step."""
        left = self.until - time.monotonic() if self.until else 60
        if left <= 1:
            raise Cut
        try:
            command = [str(part) for part in command]
            done = subprocess.run(command, env=self.env, capture_output=True, text=True, timeout=left)
        except subprocess.TimeoutExpired:
            raise Cut from None
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)}: {(done.stderr or done.stdout).strip()[-2000:]}")
        return done.stdout

    def try_run(self, command):
        """The output of a command that may not be there."""
        try:
            return subprocess.run(command, capture_output=True, text=True, timeout=30).stdout
        except (OSError, subprocess.TimeoutExpired):
            return ""

    def say(self, *lines):
        self.report += lines
        print(*lines, sep="\n", flush=True)

    def table(self, head, rows):
        align = [":--"] + ["--:"] * (len(head) - 1)
        self.say("", *("| " + " | ".join(map(str, row)) + " |" for row in [head, align, *rows]), "")

    def step(self, number, title, share, work):
        """Runs a step within its share of the minutes, and what earlier steps left of theirs."""
        self.say("", f"## {number}. {title}", "")
        started = time.monotonic()
        self.shares += share
        self.until = self.begun + self.shares * self.minutes * 60
        try:
            work()
        except Cut:
            self.say("", f"**Cut off** after {time.monotonic() - started:.0f} s, its share of the time.")
        except RuntimeError as error:
            self.failures.append(f"step {number}: {error}")
            self.say("", f"**Failed**: {error}")
        self.say("", f"({time.monotonic() - started:.0f} s)")

    # steps

    def find_adapter(self):
        """The adapter that is checked: hardware where there is any."""
        for attempt in (lambda: True, self.point_to_driver):
            if not attempt():
                continue
            adapters = json.loads(self.run(BINARY, "devices", "--json"))["adapters"]
            usable = [adapter for adapter in adapters if adapter["usable"]]
            if any(adapter["kind"] != "software" for adapter in usable):
                break
        order = ["discrete", "integrated", "virtual", "other", "software"]
        if not usable:
            raise RuntimeError(f"no adapter can be used: {json.dumps(adapters)}")
        self.adapter = min(usable, key=lambda adapter: order.index(adapter["kind"]))
        self.is_software = self.adapter["kind"] == "software"
        self.figures["adapters"] = adapters
        self.gpu = ["--device", "gpu", "--adapter", str(self.adapter["index"])]

    def point_to_driver(self):
        """Points the loader to NVIDIA's driver where nothing else does, as in containers that do not describe it."""
        folders = ["/usr/share", "/usr/local/share", "/etc", "/usr/local/nvidia/share"]
        found = [path for folder in folders for path in glob.glob(f"{folder}/vulkan/icd.d/nvidia_icd*.json")]
        libraries = self.try_run(["/sbin/ldconfig", "-p"])
        if not found and "libEGL_nvidia.so.0" in libraries:
            # this one needs no X11, unlike libGLX_nvidia
            made = pathlib.Path("/tmp/nvidia_icd.json")
            driver = {"library_path": "libEGL_nvidia.so.0", "api_version": "1.3"}
            made.write_text(json.dumps({"file_format_version": "1.0.1", "ICD": driver}))
            found = [str(made)]
        if found:
            self.env["VK_DRIVER_FILES"] = found[0]
        if "libnvidia-glvkspirv" not in libraries and found:
            self.say("libnvidia-glvkspirv is missing: the driver was mounted without graphics, and Vulkan cannot work")
        return bool(found)

    def sample(self, faces):
        path = HERE / "meshes" / f"knot-{faces}.glb"
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            self.run(BINARY, "sample", "knot", "--faces", faces, path)
        return path

    def meshes(self):
        """The meshes that are compared, and a number of clusters: small samples on software."""
        if self.is_software:
            return [("knot 3,000", self.sample(3000), 100), ("knot 6,000", self.sample(6000), 60)]
        names = [("bunny", "stanford-bunny.glb", 1000), ("armadillo", "armadillo-172k.glb", 2000)]
        there = [(name, HERE / "meshes" / file, k) for name, file, k in names if (HERE / "meshes" / file).exists()]
        return there or [("knot 70,000", self.sample(70_000), 1000), ("knot 170,000", self.sample(170_000), 2000)]

    def named_meshes(self):
        """The meshes as arguments of `tesserae bench`; none on software."""
        if self.is_software:
            return []
        return [part for _, mesh, k in self.meshes() for part in ("--mesh", f"{mesh}:{k}")]

    def cluster(self, device, mesh, *arguments):
        """The report of a clustering, and the seconds of its process."""
        report = HERE / "report.json"
        started = time.monotonic()
        self.run(BINARY, "cluster", mesh, *device, *arguments, "--report", report)
        return json.loads(report.read_text()), time.monotonic() - started

    def right_and_fast(self):
        probe = json.loads(self.run(BINARY, "bench", *self.gpu, "--probe"))
        self.figures["probe"] = probe
        self.table(["what", "figure"], [[name, f"{figure:.3f}"] for name, figure in probe.items()])
        rows = []
        for name, mesh, clusters in self.meshes():
            job = [mesh, "-k", clusters, "--quality", "fast"]
            cold, first = self.cluster(self.gpu, *job)
            warm, second = self.cluster(self.gpu, *job)
            cpu, _ = self.cluster(["--device", "cpu"], *job)
            same = cold["labels_sha256"] == warm["labels_sha256"] == cpu["labels_sha256"]
            times = warm["timings_ms"]
            self.figures[name] = times["cluster"] + times["upload"]
            seconds = [f"{first:.2f}", f"{second:.2f}"]
            rows.append([name, clusters, *seconds, f"{self.figures[name]:.1f}", "yes" if same else "**no**"])
            if not same:
                self.failures.append(f"labels of {name} are not the cpu's")
        head = ["mesh", "clusters", "s, cold", "s, warm", "ms, upload and clustering", "labels of the cpu"]
        self.table(head, rows)

    def tests(self):
        rows = []
        for test in sorted((HERE / "tests").glob("*")):
            started = time.monotonic()
            try:
                outcome = re.search(r"test result: .*", self.run(test, "--test-threads", 2))[0]
            except Cut:
                outcome = "cut off"
            except RuntimeError as error:
                outcome = "**failed**"
                self.failures.append(f"{test.name}: {error}")
            rows.append([test.name, outcome, f"{time.monotonic() - started:.0f}"])
        self.table(["tests", "outcome", "s"], rows)
        name, mesh, clusters = self.meshes()[-1]
        self.until = max(self.until, time.monotonic() + 60)
        flat, hierarchies = (3, 2) if self.is_software else (50, 10)
        for arguments, times in ((["-k", clusters], flat), (["--algorithm", "pml", "-k", 7], hierarchies)):
            hashes = {self.cluster(self.gpu, mesh, *arguments)[0]["labels_sha256"] for _ in range(times)}
            self.say(f"{name}, {' '.join(map(str, arguments))}: {times} runs, {len(hashes)} different results")
            if len(hashes) != 1:
                self.failures.append(f"{name}: {len(hashes)} different results in {times} runs")

    def bench(self, *arguments):
        out = HERE / "bench.json"
        self.run(BINARY, "bench", *self.gpu, "--json", out, "--markdown", HERE / "bench.md", *arguments)
        return json.loads(out.read_text())

    def sizes(self):
        faces = [1000, 4000] if self.is_software else [10_000, 100_000, 1_000_000]
        meshes = self.named_meshes()
        bench = self.bench("--repeats", 1 if self.is_software else 5, "--faces", ",".join(map(str, faces)), *meshes)
        self.figures["bench"] = bench
        self.report += (HERE / "bench.md").read_text().splitlines()[2:]
        if bench["copy_bytes_a_second"]:
            self.figures["copy"] = bench["copy_bytes_a_second"] / 1e9
        shares = [row["sweep"]["share_of_copy"] for row in bench["rows"] if row["sweep"]]
        if shares:
            self.figures["sweep"] = shares[-1]
        flat = [row for row in bench["rows"] if row["algorithm"] == "bb, 100 faces a cluster" and row["cluster_on_cpu"]]
        points = [(row["faces"], row["cluster"] + row["upload"], row["cluster_on_cpu"]) for row in flat]
        self.decide_faces_for_gpu(sorted(points))

    def decide_faces_for_gpu(self, points):
        """Where the gpu begins to be faster, between two sizes by their logarithms."""
        ratios = [(math.log(faces), math.log(gpu / cpu)) for faces, gpu, cpu in points]
        if not ratios:
            return
        if all(ratio > 0 for _, ratio in ratios):
            found = f"none up to {points[-1][0]:,}: keep 200,000"
        elif ratios[0][1] <= 0:
            found = f"below {points[0][0]:,}"
        else:
            (x0, y0), (x1, y1) = next(pair for pair in zip(ratios, ratios[1:]) if pair[0][1] > 0 >= pair[1][1])
            found = f"{math.exp(x0 + (x1 - x0) * y0 / (y0 - y1)):,.0f}"
        why = "clustering and upload as fast as on this machine's cpu"
        self.decisions.append(["faces_for_gpu", "200,000", found, why])

    def large(self):
        if self.is_software:
            self.say("not on software Vulkan")
            return
        bench = self.bench("--repeats", 1, "--faces", "4000000,10000000,28000000", "--compare-up-to", 4_000_000)
        self.figures["large"] = bench
        self.report += (HERE / "bench.md").read_text().splitlines()[2:]

    def variants(self):
        size = ["--faces", "1000"] if self.is_software else ["--faces", "1000000"]
        meshes = self.named_meshes()
        # without whole clusters that move, which the host alone does
        quality = ["--quality", "fast"]
        arguments = ["--repeats", 1 if self.is_software else 3, "--compare-up-to", 0, *quality, *size, *meshes]
        times = lambda bench: [row["cluster"] + row["upload"] for row in bench["rows"] if not row["refused"]]
        self.bench(*arguments)  # warms up
        rows = []
        for name, values in VARIANTS.items():
            # beside its variants, since clocks and neighbours change
            try:
                default = times(self.bench(*arguments))
            except Cut:
                self.decisions.append([name, "default", "keep", "not measured: the time was up"])
                continue
            best = (1.0, "keep")
            for value in values:
                try:
                    bench = self.bench("--tuning", f"{name}={value}", *arguments)
                except Cut:
                    rows.append([name, value, "not run: the time was up"])
                    continue
                except RuntimeError as error:
                    rows.append([name, value, f"failed: {str(error).splitlines()[-1]}"])
                    continue
                logs = [math.log(new / old) for new, old in zip(times(bench), default)]
                ratio = math.exp(sum(logs) / len(logs))
                rows.append([name, value, f"{ratio:.3f}"])
                best = min(best, (ratio, value))
            self.figures.setdefault("variants", []).extend(row for row in rows if row[0] == name)
            decision = best[1] if best[0] < 1 - GAIN else "keep"
            why = f"{best[0]:.3f} of the time" if decision != "keep" else "no gain above 5 %"
            if self.is_software:
                # its dispatches and waits cost what no card's do
                decision, why = "keep", f"software decides nothing: {best[1]}, {best[0]:.3f} of the time"
            self.decisions.append([name, "default", decision, why])
        self.table(["constant", "value", "time over that of the default"], rows)
        self.decisions += [[name, "default", "keep", why] for name, why in GIVEN.items()]

    # the report

    def judge_probe(self):
        """What the probe decides about the shape of the kernels."""
        probe = self.figures.get("probe")
        if not probe:
            return
        direct = probe["direct_written_8"]
        rules = [
            ("empty tails of batches", probe["direct_written_1"] > 1.5, "shorter batches"),
            ("bindings", direct - probe["direct_written_1"] > 0.5, "one buffer with offsets instead of eight"),
            ("waits", probe["round_trip"] > 80, "fewer waits first of all"),
            ("uploads", max(probe["upload_staged"], probe["upload_written"]) < 2, "uploads first of all"),
        ]
        for what, is_met, text in rules:
            if self.is_software:
                is_met, text = False, "software decides nothing"
            self.decisions.append([what, "as it is", "change" if is_met else "keep", text])

    def predictions(self):
        rows = []
        figures = dict(self.figures.get("probe", {})) | {k: v for k, v in self.figures.items() if isinstance(v, float)}
        for name, least, most, text in PREDICTED:
            names = name.split(" - ")
            if all(name in figures for name in names):
                found = figures[names[0]] - sum(figures[other] for other in names[1:])
                verdict = "as predicted" if least <= found <= most else "below" if found < least else "above"
                rows.append([text, f"{least:g} to {most:g}", f"{found:.3g}", verdict])
        self.table(["what", "predicted for an H200", "found", ""], rows)

    def write(self, out):
        self.judge_probe()
        self.say("", "## Predictions", "")
        self.predictions()
        self.say("## Decisions", "")
        self.table(["constant", "now", "decision", "why"], self.decisions)
        self.say("## Failures", "", *(f"- {failure}" for failure in self.failures or ["none"]))
        # without what drivers add in brackets
        card = re.sub(r"[^a-z0-9]+", "-", self.adapter["name"].split("(")[0].lower()).strip("-")
        folder = pathlib.Path(out) / f"{datetime.date.today()}-{card}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "gpu-check.md").write_text("\n".join(self.report) + "\n")
        figures = self.figures | {"decisions": self.decisions, "failures": self.failures}
        (folder / "gpu-check.json").write_text(json.dumps(figures, indent=1) + "\n")
        print(folder)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", default=str(HERE / "results"))
    parser.add_argument("--minutes", type=float, default=40)
    parser.add_argument("--steps", default="1,2,3,4,5")
    arguments = parser.parse_args()
    steps = {int(step) for step in arguments.steps.split(",")}
    check = Check(arguments.minutes)
    check.find_adapter()
    adapter = check.adapter
    largest, processor = adapter["largest"], platform.processor() or platform.machine()
    check.say("# What a card does", "")
    check.say("- " + ", ".join(adapter[key] for key in ("name", "kind", "backend", "driver")))
    check.say(f"- largest meshes: {largest['flat']:,} faces flat, {largest['hierarchy']:,} of hierarchies")
    check.say(f"- {check.run(BINARY, '--version').strip()}; {processor}, {os.cpu_count()} threads")
    smi = check.try_run(["nvidia-smi", "-q"])
    if smi:
        check.figures["nvidia_smi"] = smi
    plan = [
        ("Right, and what it takes", 0.15, check.right_and_fast),
        ("Tests", 0.25, check.tests),
        ("Sizes", 0.2, check.sizes),
        ("Large meshes", 0.15, check.large),
        ("Constants", 0.25, check.variants),
    ]
    for number, (title, share, work) in enumerate(plan, 1):
        if number in steps:
            check.step(number, title, share, work)
        if number == 1 and any("not the cpu's" in failure for failure in check.failures):
            check.say("", "**Stopped**: labels differ, so nothing else means anything.")
            break
    check.write(arguments.out)
    sys.exit(1 if check.failures else 0)


main()
