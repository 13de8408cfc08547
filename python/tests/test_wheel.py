"""The wheel: its size, its tags, and what it needs of a machine. TESSERAE_WHEEL names its file."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

WHEEL = Path(os.environ.get("TESSERAE_WHEEL", ""))
MOST_BYTES = 15 << 20

pytestmark = pytest.mark.skipif(not WHEEL.is_file(), reason="no wheel is named by TESSERAE_WHEEL")


def test_the_wheel_is_small_and_for_every_python_from_3_9_on() -> None:
    assert WHEEL.stat().st_size <= MOST_BYTES
    assert re.search(r"-cp39-abi3-", WHEEL.name), WHEEL.name


def test_the_extension_uses_what_python_3_9_has() -> None:
    """No symbol outside the stable interface of 3.9; `make python` checks the syntax of the Python files."""
    words = [sys.executable, "-m", "abi3audit", "--strict", os.fspath(WHEEL)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_types_are_in_the_wheel() -> None:
    with zipfile.ZipFile(WHEEL) as wheel:
        names = set(wheel.namelist())
    assert {"tesserae_mesh/py.typed", "tesserae_mesh/_native.pyi", "tesserae_mesh/_native.abi3.so"} <= names
    assert not any(name.startswith(("tests/", "src/", "examples/")) for name in names)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="manylinux is for Linux")
def test_the_wheel_is_a_manylinux_wheel() -> None:
    assert "manylinux" in WHEEL.name
    words = [sys.executable, "-m", "auditwheel", "show", os.fspath(WHEEL)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    shown = " ".join(done.stdout.split())
    tag = re.search(r'is consistent with the following platform tag: "(\w+)"', shown)
    assert tag and tag[1].startswith("manylinux"), done.stdout
