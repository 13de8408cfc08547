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
DOCS = PYTHON.parent / "docs"
GUIDE = DOCS / "python.md"


def test_the_example_prints_what_the_guide_shows() -> None:
    example = PYTHON / "examples" / "cluster_arrays.py"
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, check=True)
    assert f"```text\n{done.stdout}```" in GUIDE.read_text(encoding="utf-8"), done.stdout


def test_an_example_without_its_arguments_shows_its_usage() -> None:
    example = PYTHON / "examples" / "follow_a_job.py"
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("usage: follow_a_job.py") and "url mesh clusters" in done.stderr


@pytest.mark.filterwarnings("ignore")  # of other libraries
@pytest.mark.parametrize("page", ["python.md", "images.md", "volumes.md", "maps.md", "clouds.md"])
def test_the_code_of_a_page_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    text = (DOCS / page).read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(block, page, "exec"), names)  # noqa: S102
    drawn = re.findall(r"!\[.*\]\(([a-z]+\.(?:png|jpg))\)", text)
    assert names and all((tmp_path / picture).stat().st_size > 10_000 for picture in drawn)


def test_the_documentation_of_cluster_is_right() -> None:
    assert doctest.testmod(tesserae_mesh._cluster).failed == 0
