"""What several tests use: generated meshes, the real ones where there are any, and the command line."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

Labels = NDArray[np.uint32]


def command(*arguments: str | os.PathLike[str]) -> subprocess.CompletedProcess[str]:
    """Run a command of the command line that the package has."""
    words = [sys.executable, "-m", "tesserae_mesh", *(os.fspath(argument) for argument in arguments)]
    return subprocess.run(words, capture_output=True, text=True, check=False)


@pytest.fixture(scope="session")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int], Path]:
    """Write a generated mesh to an OBJ file; gives its name."""
    folder = tmp_path_factory.mktemp("samples")

    def write(name: str, faces: int) -> Path:
        path = folder / f"{name}-{faces}.obj"
        if not path.exists():
            done = command("sample", name, "--faces", str(faces), path)
            assert done.returncode == 0, done.stderr
        return path

    return write


def read_obj(path: Path) -> tuple[NDArray[np.float64], list[list[int]]]:
    """Points and faces of an OBJ file, read independently of the package."""
    points: list[list[float]] = []
    faces: list[list[int]] = []
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            word, *rest = line.split() or [""]
            if word == "v":
                points.append([float(number) for number in rest[:3]])
            elif word == "f":
                corners = [int(corner.split("/")[0]) for corner in rest]
                faces.append([corner - 1 if corner > 0 else len(points) + corner for corner in corners])
    return np.array(points), faces


def flat(faces: list[list[int]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Offsets and corners of a list of faces."""
    offsets = np.cumsum([0, *(len(face) for face in faces)], dtype=np.int64)
    return offsets, np.array([corner for face in faces for corner in face], dtype=np.int64)


def real_meshes(*endings: str) -> Iterator[Path]:
    """The files with these endings in the folder that TESSERAE_TEST_MESHES names, and in those in it."""
    folder = os.environ.get("TESSERAE_TEST_MESHES", "")
    if folder:
        yield from sorted(path for path in Path(folder).rglob("*") if path.suffix in endings)
