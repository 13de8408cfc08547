"""The client against ``openapi.yaml``: every path, parameter, document; the kinds of errors against the library."""

from __future__ import annotations

import asyncio
import copy
import inspect
import io
import json
import pathlib
import re
from typing import Any, Callable

import httpx
import numpy as np
import pytest
import scipy.sparse
import yaml

from tesserae_mesh.client import AsyncClient, Client, documents, errors
from tesserae_mesh.client.operations import OPERATIONS, PARAMETERS, PARTS
from tesserae_mesh.client.options import Parameters

ROOT = pathlib.Path(__file__).resolve().parents[2]
METHODS = ("get", "put", "post", "patch", "delete", "head", "options")
Document = dict[str, Any]


@pytest.fixture(scope="module")
def openapi() -> Document:
    document: Document = yaml.safe_load((ROOT / "openapi.yaml").read_text())
    return document


def rows(openapi: Document) -> dict[str, tuple[str, str, set[str], set[str]]]:
    """The operations of the document: id, and method, path, names in the query, names of headers."""
    found: dict[str, tuple[str, str, set[str], set[str]]] = {}
    for path, item in openapi["paths"].items():
        for method in set(item) & set(METHODS):
            names: dict[str, set[str]] = {"query": set(), "header": set(), "path": set()}
            for parameter in item[method].get("parameters", []):
                names[parameter["in"]].add(parameter["name"])
            found[item[method]["operationId"]] = (method.upper(), path, names["query"], names["header"])
    return found


def differences(openapi: Document) -> list[str]:
    """Where the table of the client and the document are not the same."""
    found: list[str] = []
    described = rows(openapi)
    for id in sorted(set(described) ^ set(OPERATIONS)):
        found.append(f"operation {id}")
    for id in set(described) & set(OPERATIONS):
        method, path, query, headers = described[id]
        ours = OPERATIONS[id]
        # The form says what the query may say, too.
        mine = set(ours.query) | (set(PARAMETERS) if id == "createJob" else set())
        found += [f"{id}: {method} {path}"] * ((ours.method, ours.path) != (method, path))
        found += [f"{id}: query {name}" for name in query ^ mine]
        found += [f"{id}: header {name}" for name in headers ^ set(ours.headers)]
    schemas = openapi["components"]["schemas"]
    found += [f"parameter {name}" for name in set(schemas["JobParameters"]["properties"]) ^ set(PARAMETERS)]
    found += [f"keyword {name}" for name in set(Parameters.__annotations__) ^ set(PARAMETERS)]
    found += [f"part {name}" for name in set(schemas["UploadForm"]["properties"]) ^ set(PARTS)]
    return found


def test_every_operation_and_parameter_is_in_the_table(openapi: Document) -> None:
    assert differences(openapi) == []


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        (lambda paths: paths["/v1/jobs/{id}"].update(patch={"operationId": "patchJob"}), "operation patchJob"),
        (lambda paths: paths["/v1/device"]["get"].update(parameters=[{"in": "query", "name": "which"}]),
         "getDevice: query which"),
        (lambda paths: paths["/v1/jobs/{id}/events"]["get"]["parameters"].pop(), "streamEvents: header Last-Event-ID"),
        (lambda paths: paths["/v1/jobs"]["post"]["parameters"].append({"in": "query", "name": "colour"}),
         "createJob: query colour"),
    ],
)  # fmt: skip
def test_a_change_of_the_document_is_a_difference(
    openapi: Document, change: Callable[[Document], None], difference: str
) -> None:
    changed = copy.deepcopy(openapi)
    change(changed["paths"])
    assert differences(changed) == [difference]


# Names that differ, since a class of ours has the document's name.
NAMES = {
    "MeshInput": "Input",
    "Job": "JobDocument",
    "Hierarchy": "HierarchyDocument",
    "NodeLink": "Graph",
    "Summary": "RemeshSummary",
}
# Parameters, parts of enumerations, what is bytes, and what has a class of its own.
NO_DOCUMENTS = {"JobParameters", "Parameters", "UploadForm", "Labels", "LabelsEvent", "StreamEvent", "Urls"}


def resolved(openapi: Document, schema: Document) -> Document:
    found: Document = schema
    while "$ref" in found:
        found = openapi["components"]["schemas"][found["$ref"].split("/")[-1]]
    return found


def test_documents_have_the_members_of_the_schemas(openapi: Document) -> None:
    compared = 0
    for name, schema in openapi["components"]["schemas"].items():
        if name in NO_DOCUMENTS or not ("properties" in schema or "allOf" in schema):
            continue
        members: set[str] = set(schema.get("properties", {}))
        for part in schema.get("allOf", []):
            part = resolved(openapi, part)
            # of a union, the first is of meshes
            part = resolved(openapi, part["oneOf"][0]) if "oneOf" in part else part
            members |= set(part["properties"])
        ours = getattr(documents, NAMES.get(name, name))
        annotations = {member for base in ours.__mro__ for member in getattr(base, "__annotations__", {})}
        assert annotations == members, name
        compared += 1
    assert compared > 30


def test_enumerations_are_those_of_the_schemas(openapi: Document) -> None:
    for name in ("State", "Algorithm", "Format", "PointsFormat", "Phase", "DeviceKind", "WeightedBy"):
        values = openapi["components"]["schemas"][name]["enum"]
        assert list(getattr(documents, name).__args__) == values, name


def test_every_kind_of_error_has_a_class_and_those_that_may_pass_are_tried_again() -> None:
    source = (ROOT / "src" / "error.rs").read_text()
    slugs = dict(re.findall(r'Kind::(\w+) => "([a-z-]+)"', source.split("fn slug")[1].split("fn title")[0]))
    assert len(slugs) > 20
    assert set(errors.KINDS) == set(slugs.values())
    retryable = source.split("fn is_retryable")[1].split("=> true")[0]
    assert {slugs[name] for name in re.findall(r"Kind::(\w+)", retryable)} == {
        kind for kind, made in errors.KINDS.items() if made is errors.Busy
    }


# Every call that there is, with every keyword, recorded.

JOB = "00000000-0000-4000-8000-000000000000"
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
EVERYTHING: Document = {
    "algorithm": "bb",
    "energy": "shapes",
    "shapes": "plane,sphere",
    "resolution": "0.5u",
    "tolerance": 0.001,
    "clusters": 1,
    "quality": "fast",
    "seeds": "morton",
    "seed": 1,
    "max_iterations": 1,
    "refine": "none",
    "allow_disconnected": True,
    "bridge_components": True,
    "features": "30,groups",
    "snapshots": [0],
    "subdivide": 1,
    "curvature_exponent": 1.0,
    "weight_attribute": "_A",
    "graph": "knn:8",
    "compactness": 1.0,
    "optimize": "none",
    "optimize_iterations": 1,
    "switch_to_ml_at": 1,
    "collapse_fraction": 1.0,
    "ties": "hash",
    "pairs": "all",
    "levels": [1],
    "priority": 1,
    "outputs": ["remesh"],
    "keep_mesh": True,
    "webhook": "http://example.org",
    "weights": [1.0],
    "buffers": {"a.bin": b"0"},
    "format": "obj",
    "file_name": "a.obj",
    "wait": 1,
    "idempotency_key": "key",
}
CALLS: list[tuple[str, tuple[Any, ...], Document]] = [
    ("refresh", (), {}),
    ("wait", (1.0,), {}),
    ("cancel", (), {}),
    ("retry", (), {}),
    ("events", (7,), {}),
    ("labels", (3,), {"iteration": 4}),
    ("report", (), {}),
    ("hierarchy", (2, 3, 4), {}),
    ("linkage", (), {}),
    ("graph", (2,), {}),
    ("boundaries", (2,), {}),
    ("table", (2,), {}),
    ("remesh_source", (2,), {"placement": "fit"}),
    ("output", ("upload",), {"buffer": "mesh.bin"}),
    ("output", ("mesh.glb", 2), {"colours": "none", "ply_vertex_colours": True}),
    ("output", ("submeshes.zip", 2), {"force": True}),
    ("output", ("remesh.ply", 2), {"placement": "centroid"}),
    ("output", ("means.png", 2), {}),
    ("delete", (), {}),
]


class Recorder:
    """Answers every request, and notes operations and names."""

    def __init__(self) -> None:
        self.seen: set[tuple[str, str]] = set()

    def __call__(self, request: httpx.Request) -> httpx.Response:
        path = request.url.path.replace(JOB, "{id}")
        row = next(row for row in OPERATIONS.values() if (row.method, row.path) == (request.method, path))
        self.seen.add((row.id, ""))
        self.seen |= {(row.id, name) for name in request.url.params}
        self.seen |= {(row.id, name) for name in row.headers if name in request.headers}
        if row.id == "createJob":
            body = request.read()
            parts = re.findall(rb'name="(\w+)"', body)
            self.seen |= {(row.id, f"part {part.decode()}") for part in parts}
            given = re.search(rb'name="parameters".*?\r\n\r\n(.*?)\r\n--', body, re.DOTALL)
            assert given is not None
            self.seen |= {(row.id, name) for name in json.loads(given[1])}
        return self.answer(row.id, request)

    def answer(self, id: str, request: httpx.Request) -> httpx.Response:
        job = {"id": JOB, "state": "running", "cancel_requested": False, "problem": None}
        if id == "getJob" and (id, "once") in self.seen:
            job["state"] = "succeeded"
        if id == "getJob":
            self.seen.add((id, "once"))
        if id == "listJobs":
            more = "more" if "cursor" not in request.url.params else None
            return httpx.Response(200, json={"jobs": [job], "next": more})
        if id == "streamEvents" or (id == "deleteJob" and "cancel" not in request.url.params):
            return httpx.Response(204)
        if request.url.params.get("format") == "npy":
            file = io.BytesIO()
            np.save(file, np.zeros(1, np.uint32))
            return httpx.Response(200, content=file.getvalue())
        if request.url.params.get("format") == "npz":
            file = io.BytesIO()
            np.savez(file, kind=np.zeros(1, np.uint32))
            return httpx.Response(200, content=file.getvalue())
        return httpx.Response(200, json={**job, "clusters": [], "workers": []})


def expected() -> set[tuple[str, str]]:
    names = {(row.id, name) for row in OPERATIONS.values() for name in ("", *row.query, *row.headers)}
    uploads = {("createJob", name) for name in (*PARAMETERS, *(f"part {part}" for part in PARTS))}
    return names | uploads


def missing(recorder: Recorder) -> set[tuple[str, str]]:
    # labels of a running job are for the page
    return expected() - recorder.seen - {("streamEvents", "labels")}


def test_blocking_calls_reach_every_operation_and_parameter(tmp_path: pathlib.Path) -> None:
    recorder = Recorder()
    client = Client("http://service", "token", http=httpx.Client(transport=httpx.MockTransport(recorder)))
    with client:
        client.submit(OBJ, **EVERYTHING)
        client.submit(OBJ, seeds=[0])
        client.submit(np.zeros((2, 3)), clusters=1, graph=scipy.sparse.eye(2, format="coo"))
        client.submit("s3://bucket/mesh.obj")
        assert len(list(client.jobs("queued", 10))) == 2
        job = client.job(JOB)
        for name, arguments, keywords in CALLS:
            result = getattr(job, name)(*arguments, **keywords)
            assert name != "events" or list(result) == []
        job.save(tmp_path / "graph.json")
        assert (tmp_path / "graph.json").exists()
        for call in (client.device, client.formats, client.limits, client.version, client.readiness, client.metrics, client.openapi):
            call()
        assert client.workers() == []
        assert client.is_alive()
        assert client.is_ready()
    assert missing(recorder) == set()


def test_awaited_calls_reach_every_operation_and_parameter(tmp_path: pathlib.Path) -> None:
    recorder = Recorder()

    async def use() -> None:
        http = httpx.AsyncClient(transport=httpx.MockTransport(recorder))
        async with AsyncClient("http://service", "token", http=http) as client:
            await client.submit(OBJ, **EVERYTHING)
            await client.submit(OBJ, seeds=[0])
            await client.submit(np.zeros((2, 3)), clusters=1, graph=scipy.sparse.eye(2, format="coo"))
            await client.submit("s3://bucket/mesh.obj")
            assert len([job async for job in client.jobs("queued", 10)]) == 2
            job = await client.job(JOB)
            for name, arguments, keywords in CALLS:
                result = getattr(job, name)(*arguments, **keywords)
                if name == "events":
                    assert [event async for event in result] == []
                else:
                    await result
            await job.save(tmp_path / "graph.json")
            for call in (client.device, client.formats, client.limits, client.version, client.readiness, client.metrics):
                await call()
            await client.openapi()
            assert await client.workers() == []
            assert await client.is_alive()
            assert await client.is_ready()
        await http.aclose()

    asyncio.run(use())
    assert missing(recorder) == set()


def test_a_call_that_is_not_made_is_missing() -> None:
    recorder = Recorder()
    client = Client("http://service", http=httpx.Client(transport=httpx.MockTransport(recorder)))
    client.job(JOB).labels(3)
    assert ("getLabels", "iteration") in missing(recorder)
    assert ("getReport", "") in missing(recorder)
    assert ("getLabels", "clusters") not in missing(recorder)


def test_both_clients_have_the_same_methods_and_parameters() -> None:
    from tesserae_mesh.client import AsyncJob, Job

    for blocking, awaited in ((Client, AsyncClient), (Job, AsyncJob)):
        ours = {name for name in vars(blocking) if not name.startswith("_")}
        assert ours == {name for name in vars(awaited) if not name.startswith("_")}
        for name in ours:
            method, other = getattr(blocking, name), getattr(awaited, name)
            if callable(method):
                assert list(inspect.signature(method).parameters) == list(inspect.signature(other).parameters), name


def test_a_name_that_an_operation_does_not_have_is_refused() -> None:
    client = Client("http://service", http=httpx.Client(transport=httpx.MockTransport(Recorder())))
    with pytest.raises(TypeError, match="placement"):
        client.job(JOB).output("mesh.glb", placement="fit")
    with pytest.raises(TypeError, match="colour"):
        client.submit(OBJ, colour=1)  # type: ignore[call-arg]
