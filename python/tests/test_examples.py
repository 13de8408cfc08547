"""The example runs and prints what the guide shows."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys
from pathlib import Path

import pytest

import tesserae_mesh._cluster

PYTHON = Path(__file__).parents[1]
GUIDE = PYTHON.parent / "docs" / "python.md"


def test_the_example_prints_what_the_guide_shows() -> None:
    example = PYTHON / "examples" / "cluster_arrays.py"
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, check=True)
    assert f"```text\n{done.stdout}```" in GUIDE.read_text(encoding="utf-8"), done.stdout


def test_an_example_without_its_arguments_shows_its_usage() -> None:
    example = PYTHON / "examples" / "follow_a_job.py"
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("usage: follow_a_job.py") and "url mesh clusters" in done.stderr


def test_the_code_of_the_guide_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) >= 3
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(GUIDE), "exec"), names)  # noqa: S102


def test_the_documentation_of_cluster_is_right() -> None:
    assert doctest.testmod(tesserae_mesh._cluster).failed == 0
