"""The client against a real service: what comes back, and what happens when the service is killed."""

from __future__ import annotations

import asyncio
import pathlib
import subprocess
import threading
from typing import Any, Iterator

import numpy as np
import pytest
import scipy.sparse
from conftest import read_obj
from services import BINARY, ROOT, Service, command_line, sample

import tesserae_mesh
from tesserae_mesh.client import (
    Conflict,
    InvalidRequest,
    Job,
    JobCancelled,
    JobFailed,
    NotFound,
    TimedOut,
    Unauthorized,
    Unreachable,
)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with Service(BINARY, "--data-dir", str(tmp_path_factory.mktemp("data")), "--device", "cpu") as running:
        yield running


@pytest.fixture(scope="module")
def client(service: Any) -> Iterator[tesserae_mesh.Client]:
    with tesserae_mesh.Client(service.url) as connected:
        yield connected


@pytest.fixture(scope="module")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return sample(tmp_path_factory.mktemp("meshes"), "sphere", 3_000, "obj")


def test_labels_are_those_of_the_command_line(client: tesserae_mesh.Client, sphere: pathlib.Path) -> None:
    job = client.submit(sphere, clusters=40).wait()
    expected = command_line(sphere, "--clusters", "40")
    assert job.state == "succeeded"
    labels = job.labels()
    assert labels.dtype == np.uint32
    assert np.array_equal(labels, expected)
    assert np.array_equal(np.frombuffer(job.output("labels.bin"), "<u4"), expected)
    # The comparison can fail: other parameters give other labels.
    assert not np.array_equal(client.submit(sphere, clusters=40, seed=1, seeds="random").wait().labels(), expected)


def test_a_mesh_in_memory_has_the_labels_of_its_file(client: tesserae_mesh.Client, tmp_path: pathlib.Path) -> None:
    for name in ("quads", "sphere"):
        path = sample(tmp_path, name, 600, "obj")
        points, faces = read_obj(path)
        padded = np.concatenate([[len(face), *face] for face in faces])
        expected = command_line(path, "--clusters", "9")
        for mesh in ((points, padded), tesserae_mesh.Mesh(points, padded), path.read_bytes(), path.open("rb")):
            job = client.submit(mesh, clusters=9).wait()
            assert np.array_equal(job.labels(), expected), (name, type(mesh))
        read: Any = client.submit(path, clusters=9).wait().report()["input"]
        assert read["faces"] == len(faces)


def test_points_have_the_labels_that_they_have_in_process(client: tesserae_mesh.Client) -> None:
    points = np.random.default_rng(1).random((60, 4)).astype(np.float32)
    path = scipy.sparse.coo_matrix((np.ones(59), (np.arange(59), np.arange(1, 60))), shape=(60, 60))
    for near, graph in ((6, "knn:6"), (path, path)):
        job = client.submit(points, clusters=5, graph=graph, outputs=["clusters.csv"]).wait()
        expected = tesserae_mesh.cluster_points(points, 5, graph=near).labels
        assert np.array_equal(job.labels(), expected)
        assert job.output("clusters.csv").startswith(b"cluster,items")
    job = client.submit(points.reshape(6, 10, 4), clusters=5, graph="grid").wait()
    assert job.labels().shape == (6, 10)
    read: Any = job.report()["input"]
    assert read["items"] == 60
    assert job.output("labels.png").startswith(b"\x89PNG")


def test_seeds_and_weights_are_uploaded(client: tesserae_mesh.Client, sphere: pathlib.Path) -> None:
    seeds = np.array([5, 100, 2000])
    labels = client.submit(sphere, seeds=seeds).wait().labels()
    assert labels.max() == 2
    points, faces = read_obj(sphere)
    above = points[np.array(faces)].mean(axis=1)[:, 2] > 0
    job = client.submit(sphere, clusters=60, weights=np.where(above, 9.0, 1.0)).wait()
    assert job.report()["energy"]["weighted_by"] == ["weights"]
    assert len(set(job.labels()[above])) > 1.5 * len(set(job.labels()[~above]))


def test_events_are_the_iterations_of_the_report(client: tesserae_mesh.Client, sphere: pathlib.Path) -> None:
    job = client.submit(sphere, clusters=30, idempotency_key="events")
    events = list(job.events())
    assert [event.id for event in events] == list(range(1, len(events) + 1))
    assert (events[-1].kind, events[-1].data["state"]) == ("end", "succeeded")
    assert [event.data for event in events if event.kind == "iteration"] == job.wait().report()["iterations"]
    middle = len(events) // 2
    assert list(job.events(after=middle)) == events[middle:]
    assert list(job.events(after=len(events))) == []
    again = client.submit(sphere, clusters=30, idempotency_key="events")
    assert again.id == job.id
    with pytest.raises(InvalidRequest) as caught:
        client.submit(sphere, clusters=31, idempotency_key="events")
    assert caught.value.kind == "key-reused"


def test_hierarchies_are_cut_here_and_there(client: tesserae_mesh.Client, sphere: pathlib.Path) -> None:
    job = client.submit(sphere, algorithm="pml", optimize="none", levels=[50], keep_mesh=True).wait()
    for clusters in (50, 7):
        labels = job.labels(clusters)
        assert labels.max() == clusters - 1
        assert len(job.table(clusters)) == clusters
    document = job.hierarchy(max_clusters=100)
    assert document["nodes"][0]["clusters_left"] <= 100
    assert job.linkage().shape == (len(labels) - 1, 4)
    with pytest.raises(Conflict):
        job.labels()


def test_trees_are_cut_without_the_service(client: tesserae_mesh.Client, sphere: pathlib.Path) -> None:
    job = client.submit(sphere, algorithm="pml", levels=[50]).wait()
    assert np.array_equal(job.tree().cut(50).labels, job.labels(50))


def test_every_output_is_there(client: tesserae_mesh.Client, sphere: pathlib.Path, tmp_path: pathlib.Path) -> None:
    job = client.submit(sphere, clusters=25, keep_mesh=True, outputs=["mesh.glb"], snapshots=[0, 2]).wait()
    assert job.output("mesh.glb")[:4] == b"glTF"
    assert job.output("mesh.ply", ply_vertex_colours=True) != job.output("mesh.ply")
    assert job.output("submeshes.stl.zip")[:2] == b"PK"
    assert job.output("remesh.ply", placement="centroid") != job.output("remesh.ply", placement="surface")
    assert len(job.graph()["nodes"]) == len(job.table()) == 25
    assert {curve["left"] for curve in job.boundaries()["curves"]} <= set(range(25))
    assert set(job.remesh_source()) == {"kind", "cluster", "face", "vertices", "barycentric"}
    assert job.labels(iteration=2).shape == job.labels().shape
    job.save(tmp_path / "remesh.obj")
    assert (tmp_path / "remesh.obj").read_bytes() == job.output("remesh.obj")
    job.save(tmp_path / "table", "clusters.csv")
    assert (tmp_path / "table").read_text().count("\n") == 26
    with pytest.raises(NotFound):
        job.save(tmp_path / "labels.npy", "hierarchy.tsr")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["remesh.obj", "table"]


def test_jobs_are_listed_cancelled_and_deleted(client: tesserae_mesh.Client, tmp_path: pathlib.Path) -> None:
    # each takes seconds
    mesh = sample(tmp_path, "sphere", 100_000, "glb")
    jobs = [client.submit(mesh, clusters=2000, quality="best") for _ in range(3)]
    listed = {job.id for job in client.jobs(page=1)}
    assert {job.id for job in jobs} <= listed
    jobs[2].cancel()
    with pytest.raises(JobCancelled):
        jobs[2].wait()
    jobs[2].cancel()
    assert client.job(jobs[2].id).state == "cancelled", "a second cancellation does not delete"
    for job in jobs:
        job.delete()
        with pytest.raises(NotFound):
            client.job(job.id)
    with pytest.raises(NotFound):
        jobs[0].delete()


def test_mistakes_have_their_kinds(client: tesserae_mesh.Client, sphere: pathlib.Path) -> None:
    with pytest.raises(InvalidRequest, match="clusters"):
        client.submit(sphere, clusters=0)
    with pytest.raises(InvalidRequest):
        client.submit(b"no mesh")
    with pytest.raises(JobFailed) as caught:
        client.submit(sphere, clusters=10**6, wait=30).wait()
    assert caught.value.kind == "invalid-parameter"
    with pytest.raises(Conflict):
        client.submit(sphere, clusters=10, wait=30).retry()
    with pytest.raises(tesserae_mesh.Error) as address:
        tesserae_mesh.Client("localhost:8080")
    assert address.value.kind == "invalid-parameter"


def test_a_job_that_takes_longer_than_the_caller_waits_goes_on(
    client: tesserae_mesh.Client, tmp_path: pathlib.Path
) -> None:
    job = client.submit(sample(tmp_path, "sphere", 20_000, "glb"), clusters=200)
    with pytest.raises(TimedOut):
        job.wait(timeout=0.0)
    assert job.refresh().state in ("queued", "running")
    job.delete()


def test_the_service_says_what_it_is(client: tesserae_mesh.Client) -> None:
    assert client.is_alive()
    assert client.is_ready()
    assert client.version()["name"] == "tesserae"
    assert client.device()["kind"] == "cpu"
    assert "glb" in {format["name"] for format in client.formats()["meshes"]}
    assert client.readiness()["status"] == "ok"
    assert "# EOF" in client.metrics()
    assert client.openapi() == (ROOT / "openapi.yaml").read_text()


def test_tokens_are_sent(tmp_path: pathlib.Path, sphere: pathlib.Path) -> None:
    tokens = tmp_path / "tokens.json"
    made = subprocess.run(
        [BINARY, "token", "new", "acme", "--tokens", tokens], check=True, capture_output=True, text=True
    )
    with Service(BINARY, "--data-dir", str(tmp_path / "data"), "--device", "cpu", "--tokens", str(tokens)) as service:
        with tesserae_mesh.Client(service.url, made.stdout.split()[-1]) as client:
            assert client.submit(sphere, clusters=5).wait().labels().max() == 4
        with tesserae_mesh.Client(service.url, "wrong") as stranger, pytest.raises(Unauthorized):
            next(stranger.jobs())


def follow_across_a_crash(service: Any, job: Job) -> list[Any]:
    """The events of a job, whose service is killed at its fifth iteration and comes back while the reader tries."""
    events: list[Any] = []
    back = threading.Thread(target=service.start)
    for event in job.events():
        events.append(event)
        if back.ident is None and sum(event.kind == "iteration" for event in events) == 5:
            service.kill()
            back.start()
    back.join()
    return events


def test_events_go_on_after_the_service_was_killed(tmp_path: pathlib.Path) -> None:
    mesh = sample(tmp_path, "sphere", 300_000, "glb")
    with Service(BINARY, "--data-dir", str(tmp_path / "data"), "--device", "cpu") as service:
        with tesserae_mesh.Client(service.url, patience=60) as client:
            job = client.submit(mesh, clusters=200)
            events = follow_across_a_crash(service, job)
            assert [event.id for event in events] == list(range(1, len(events) + 1))
            assert [event.kind for event in events].count("end") == 1
            assert events[-1].data["state"] == "succeeded"
            attempts = [event.data["attempt"] for event in events if event.data.get("state") == "running"]
            assert attempts == [1, 2], "it was killed while the job ran"
            last = max(at for at, event in enumerate(events) if event.kind == "state")
            rows = [event.data for event in events[last:] if event.kind == "iteration"]
            assert rows == job.wait().report()["iterations"]
            assert np.array_equal(job.labels(), command_line(mesh, "--clusters", "200"))


def test_calls_are_made_again_while_the_service_restarts(tmp_path: pathlib.Path, sphere: pathlib.Path) -> None:
    with Service(BINARY, "--data-dir", str(tmp_path / "data"), "--device", "cpu") as service:
        patient = tesserae_mesh.Client(service.url, patience=60)
        with patient as client, tesserae_mesh.Client(service.url, patience=0.0) as hasty:
            job = client.submit(sphere, clusters=10).wait()
            service.kill()
            with pytest.raises(Unreachable):
                hasty.job(job.id)
            back = threading.Thread(target=service.start)
            back.start()
            other = client.submit(sphere, clusters=10)
            back.join()
            assert np.array_equal(other.wait().labels(), job.labels())


def test_awaited_calls_do_the_same(service: Any, sphere: pathlib.Path, tmp_path: pathlib.Path) -> None:
    async def use() -> None:
        async with tesserae_mesh.AsyncClient(service.url) as client:
            jobs = await asyncio.gather(*(client.submit(sphere, clusters=k, keep_mesh=True) for k in (8, 9)))
            for clusters, job in zip((8, 9), jobs):
                events = [event async for event in job.events()]
                assert events[-1].data["state"] == "succeeded"
                await job.wait()
                labels = await job.labels()
                assert np.array_equal(labels, command_line(sphere, "--clusters", str(clusters)))
            await jobs[0].save(tmp_path / "mesh.glb")
            assert (tmp_path / "mesh.glb").read_bytes() == await jobs[0].output("mesh.glb")
            await jobs[0].delete()
            with pytest.raises(NotFound):
                await client.job(jobs[0].id)

    asyncio.run(use())
