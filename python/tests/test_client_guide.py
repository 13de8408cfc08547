"""The Python blocks of ``docs/python-http.md``, run in order, in one folder, against a service."""

from __future__ import annotations

import pathlib
import re
from typing import Any

import pytest
from services import BINARY, ROOT, Service, sample

pyvista = pytest.importorskip("pyvista")


def test_the_guide_runs(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not hasattr(pyvista, "register_dataset_accessor"):
        pytest.skip("pyvista is older than 0.48")
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "python-http.md").read_text(), re.DOTALL)
    assert len(blocks) == 4
    sample(tmp_path, "knot", 2_000, "obj").rename(tmp_path / "knot.obj")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    with Service(BINARY, "--data-dir", str(tmp_path / "data"), "--device", "cpu") as service:
        for block in blocks:
            exec(block.replace("http://127.0.0.1:8080", service.url), names)
    assert names["labels"].max() == 99
    assert names["report"]["clusters"] == 100
    assert (tmp_path / "remesh.ply").read_bytes()[:3] == b"ply"
    assert (tmp_path / "clusters.png").exists()
    assert names["coarse"].is_manifold
    assert names["remesh"].n_points == 500
