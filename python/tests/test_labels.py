"""Labels are those of the command line, whatever the arrays look like and wherever the work runs."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import command, flat, read_obj, real_meshes

import tesserae_mesh

Sample = Callable[[str, int], Path]


def by_command(path: Path, folder: Path, *options: str) -> Any:
    labels = folder / "labels.npy"
    done = command("cluster", path, *options, "--labels", labels)
    assert done.returncode == 0, done.stderr
    return np.load(labels)


@pytest.mark.parametrize("name", ["knot", "quads", "parts", "terrain"])
def test_arrays_and_files_have_the_labels_of_the_command_line(sample: Sample, tmp_path: Path, name: str) -> None:
    path = sample(name, 3000)
    expected = by_command(path, tmp_path, "-k", "40")
    points, faces = read_obj(path)
    clustering = tesserae_mesh.cluster(points, flat(faces), 40)
    assert clustering.labels.dtype == np.uint32
    assert np.array_equal(clustering.labels, expected)
    assert np.array_equal(tesserae_mesh.cluster(path, clusters=40).labels, expected)
    assert np.array_equal(tesserae_mesh.cluster(os.fspath(path), clusters=40).labels, expected)
    assert clustering.report["input"]["format"] is None
    assert tesserae_mesh.cluster(path, clusters=40).report["input"]["format"] == "obj"


OPTIONS: list[tuple[list[str], dict[str, Any]]] = [
    (
        ["--algorithm", "pml", "-k", "20", "--levels", "200,50"],
        {"algorithm": "pml", "clusters": 20, "levels": [200, 50]},
    ),
    (["--algorithm", "ml", "-k", "20"], {"algorithm": "ml", "clusters": 20}),
    (["--algorithm", "hr", "-k", "20"], {"algorithm": "hr", "clusters": 20}),
    (["--algorithm", "acvd", "-k", "20"], {"algorithm": "acvd", "clusters": 20}),
    (
        ["--algorithm", "vc", "-k", "20", "--max-iterations", "3"],
        {"algorithm": "vc", "clusters": 20, "max_iterations": 3},
    ),
    (["-k", "20", "--seeds", "random", "--seed", "7"], {"clusters": 20, "seeds": "random", "seed": 7}),
    (["-k", "20", "--quality", "fast"], {"clusters": 20, "quality": "fast"}),
    (["-k", "60", "--features", "40"], {"clusters": 60, "features": 40}),
    (
        ["-k", "40", "--energy", "shapes", "--shapes", "cylinder", "--resolution", "0.001"],
        {"clusters": 40, "energy": "shapes", "shapes": "cylinder", "resolution": 0.001},
    ),
    (["--energy", "planes", "--tolerance", "0.01"], {"energy": "planes", "tolerance": 0.01}),
    (["-k", "20", "--curvature-exponent", "1.5"], {"clusters": 20, "curvature_exponent": 1.5}),
    (
        ["-k", "20", "--refine", "none", "--allow-disconnected"],
        {"clusters": 20, "refine": "none", "allow_disconnected": True},
    ),
]


@pytest.mark.parametrize(("flags", "keywords"), OPTIONS)
def test_every_way_to_cluster_is_that_of_the_command_line(
    sample: Sample, tmp_path: Path, flags: list[str], keywords: dict[str, Any]
) -> None:
    path = sample("knot", 2000)
    points, faces = read_obj(path)
    assert np.array_equal(tesserae_mesh.cluster(points, faces, **keywords).labels, by_command(path, tmp_path, *flags))


def test_seeds_and_weights_are_arrays(sample: Sample, tmp_path: Path) -> None:
    path = sample("knot", 2000)
    points, faces = read_obj(path)
    weights = np.linspace(1, 5, len(faces), dtype=np.float32)
    np.save(tmp_path / "weights.npy", weights)
    seeds = [17, 900, 3, 1500]
    (tmp_path / "seeds.json").write_text(str(seeds), encoding="utf-8")
    flags = ["--weights", os.fspath(tmp_path / "weights.npy"), "--seeds", f"file:{tmp_path / 'seeds.json'}"]
    clustering = tesserae_mesh.cluster(points, faces, seeds=seeds, weights=weights)
    assert np.array_equal(clustering.labels, by_command(path, tmp_path, *flags))
    assert clustering.clusters == 4 and clustering.report["parameters"]["seeds"] == "listed"


def test_layouts_types_and_orders_make_no_difference(sample: Sample) -> None:
    points, rows = read_obj(sample("knot", 2000))
    faces = np.array(rows)
    expected = tesserae_mesh.cluster(points, faces, 30).labels
    padded = np.insert(faces, 0, 3, axis=1)
    offsets = np.arange(0, 3 * len(faces) + 1, 3)
    layouts: list[Any] = [
        *(faces.astype(kind) for kind in ("i2", "i4", "u4", "i8", "u8", ">i4", ">u8")),
        np.asfortranarray(faces),
        np.repeat(faces, 2, axis=0)[::2],
        padded.reshape(-1),
        padded.reshape(-1).astype(np.int32),
        (offsets, faces.reshape(-1)),
        (offsets.astype(np.uint64), faces.reshape(-1).astype(np.int32)),
        rows,
    ]
    for given in layouts:
        assert np.array_equal(tesserae_mesh.cluster(points, given, 30).labels, expected)
    for given in [np.asfortranarray(points), points.astype(">f8"), points.tolist(), np.repeat(points, 2, axis=0)[::2]]:
        assert np.array_equal(tesserae_mesh.cluster(given, faces, 30).labels, expected)
    frozen = points.copy()
    frozen.flags.writeable = False
    assert np.array_equal(tesserae_mesh.cluster(frozen, faces, 30).labels, expected)
    single = points.astype(np.float32)
    expected = tesserae_mesh.cluster(single.astype(np.float64), faces, 30).labels
    assert np.array_equal(tesserae_mesh.cluster(single, faces, 30).labels, expected)


class Like:
    """An object with attributes."""

    def __init__(self, **attributes: object) -> None:
        self.__dict__.update(attributes)


def test_objects_of_other_libraries_are_recognised_by_their_attributes(sample: Sample) -> None:
    points, rows = read_obj(sample("knot", 2000))
    faces = np.array(rows)
    expected = tesserae_mesh.cluster(points, faces, 30).labels
    for mesh in [
        Like(points=points, faces=np.insert(faces, 0, 3, axis=1).reshape(-1), n_strips=0),
        Like(vertices=points, faces=faces, triangles=points[faces]),
        Like(vertices=points, triangles=faces),
        Like(points=points, cells=[Like(type="vertex", data=np.array([[0]])), Like(type="triangle", data=faces)]),
        Like(
            points=points,
            cells=[Like(type="triangle", data=faces[:50]), Like(type="polygon", data=list(faces[50:]))],
        ),
        tesserae_mesh.Mesh(points, faces),
    ]:
        assert np.array_equal(tesserae_mesh.cluster(mesh, clusters=30).labels, expected)  # type: ignore[arg-type]
    tetrahedra = Like(points=points, cells=[Like(type="tetra", data=faces)])
    for wrong in [tetrahedra, Like(points=points, faces=faces, n_strips=2)]:
        with pytest.raises(tesserae_mesh.Error) as caught:
            tesserae_mesh.cluster(wrong, clusters=30)  # type: ignore[arg-type]
        assert caught.value.kind == "unsupported-mesh"


@pytest.mark.parametrize("path", list(real_meshes(".obj")), ids=lambda path: str(path.stem))
def test_real_meshes_have_the_labels_of_the_command_line(path: Path, tmp_path: Path) -> None:
    points, faces = read_obj(path)
    clusters = max(1, min(1000, len(faces) // 4))
    expected = by_command(path, tmp_path, "-k", str(clusters), "--quality", "fast", "--bridge-components")
    keywords: dict[str, Any] = {"clusters": clusters, "quality": "fast", "bridge_components": True}
    assert np.array_equal(tesserae_mesh.cluster(points, flat(faces), **keywords).labels, expected)
    assert np.array_equal(tesserae_mesh.cluster(path, **keywords).labels, expected)


@pytest.mark.parametrize(
    "path", list(real_meshes(".glb", ".gltf", ".ply", ".stl")), ids=lambda path: str(path.name)
)
def test_real_files_have_the_labels_of_the_command_line(path: Path, tmp_path: Path) -> None:
    keywords: dict[str, Any] = {"quality": "fast", "bridge_components": True}
    try:
        faces = tesserae_mesh.cluster(path, clusters=1, **keywords).report["input"]["faces"]
    except tesserae_mesh.Error as error:
        done = command("cluster", path, "-k", "1")
        assert done.returncode == 1 and str(error) in done.stderr
        return
    clusters = max(1, min(1000, faces // 4))
    expected = by_command(path, tmp_path, "-k", str(clusters), "--quality", "fast", "--bridge-components")
    assert np.array_equal(tesserae_mesh.cluster(path, clusters=clusters, **keywords).labels, expected)
