"""Pictures, the accessor of pyvista, and the notebook; all without a window."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

pyvista = pytest.importorskip("pyvista")

import tesserae_mesh  # noqa: E402
from tesserae_mesh import _native  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[1]
HAS_ACCESSORS = hasattr(pyvista, "register_dataset_accessor")


@pytest.fixture
def mesh() -> Any:
    return pyvista.Sphere(theta_resolution=30, phi_resolution=30)


def test_colours_are_those_of_outputs(mesh: Any) -> None:
    clustering = tesserae_mesh.cluster(mesh, clusters=20)
    text = clustering.output("mesh.ply")
    rows = np.frombuffer(text[text.index(b"end_header\n") + 11 :][-mesh.n_cells * 20 :], np.uint8).reshape(-1, 20)
    colours = {tuple(row[13:16]) for row in rows}
    assert colours == {tuple(colour) for colour in _native.colours(20)}


def test_a_picture_shows_every_cluster(mesh: Any, tmp_path: pathlib.Path) -> None:
    clustering = tesserae_mesh.cluster(mesh, clusters=12)
    file = tmp_path / "clusters.png"
    clustering.plot(off_screen=True, screenshot=file, lighting=False, window_size=(300, 300), anti_aliasing=None)
    seen = np.unique(pyvista.read(file).active_scalars.reshape(-1, 3), axis=0)
    shown = {tuple(colour) for colour in _native.colours(12)} & {tuple(colour) for colour in seen}
    assert len(shown) >= 5, "a camera sees half of a sphere"


@pytest.mark.skipif(not HAS_ACCESSORS, reason="pyvista is older than 0.48")
def test_every_mesh_of_pyvista_has_the_accessor(mesh: Any) -> None:
    expected = tesserae_mesh.cluster(mesh, clusters=30, seed=4).labels
    assert np.array_equal(mesh.tesserae.cluster(30, seed=4).labels, expected)
    remesh = mesh.tesserae.remesh(100, placement="surface")
    assert remesh.is_manifold
    assert set(remesh.point_data["cluster"]) == set(range(100))
    quads = pyvista.Box(level=5, quads=True)
    assert len(np.unique(quads.tesserae.cluster(12).labels)) == 12


@pytest.mark.skipif(not HAS_ACCESSORS, reason="pyvista is older than 0.48")
def test_the_accessor_needs_no_import_and_costs_none() -> None:
    program = (
        "import sys, pyvista\n"
        "assert 'tesserae_mesh' not in sys.modules\n"
        "print(len(set(pyvista.Sphere().tesserae.cluster(7).labels)))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "7", done.stderr


def test_the_notebook_runs(tmp_path: pathlib.Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    if not HAS_ACCESSORS:
        pytest.skip("pyvista is older than 0.48")
    notebook = nbformat.read(ROOT / "examples" / "clusters.ipynb", as_version=4)
    os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert not [output for output in outputs if output.output_type == "error"]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    html = [output.get("data", {}).get("text/html", "") for output in outputs]
    assert sum("Clustering(" in text and "<img " in text for text in html) == 1
