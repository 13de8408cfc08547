"""A service to test against: TESSERAE_BINARY, or ``target/debug/tesserae`` when that is not set."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
from typing import Any

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "scripts"))

from service import Service  # type: ignore[import-not-found]  # noqa: E402

__all__ = ["BINARY", "ROOT", "Service", "command_line", "sample"]

TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
BINARY = pathlib.Path(os.environ.get("TESSERAE_BINARY", TARGET / "debug" / "tesserae"))


def sample(folder: pathlib.Path, name: str, faces: int, extension: str) -> pathlib.Path:
    path = folder / f"{name}-{faces}.{extension}"
    subprocess.run([BINARY, "sample", name, "--faces", str(faces), path], check=True, stderr=subprocess.DEVNULL)
    return path


def command_line(mesh: pathlib.Path, *arguments: str) -> np.ndarray[Any, Any]:
    """Labels of ``tesserae cluster``."""
    labels = mesh.with_suffix(".command-line.npy")
    command: list[str | pathlib.Path] = [BINARY, "cluster", mesh, "--device", "cpu", "--labels", labels, *arguments]
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    return np.asarray(np.load(labels))
