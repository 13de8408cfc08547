"""What a notebook shows of a result: a picture that needs no other library, and one line."""

from __future__ import annotations

import base64
import re
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import tesserae_mesh

Sample = Callable[[str, int], Path]
Pixels = NDArray[np.uint8]


def picture(result: Any) -> Pixels:
    """The pixels of a result's picture, read independently of the package."""
    html = result._repr_html_()
    assert html.startswith("<div><img ") and html.count("<div>") == html.count("</div>") == 1
    match = re.search(r'src="data:image/png;base64,([^"]+)"', html)
    assert match
    return read_png(base64.b64decode(match[1]))


def read_png(data: bytes) -> Pixels:
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    chunks: dict[bytes, bytes] = {}
    at = 8
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        assert struct.unpack(">I", data[at + 8 + length : at + 12 + length])[0] == zlib.crc32(kind + body)
        chunks[kind] = body
        at += 12 + length
    width, height, depth, colour = struct.unpack(">IIBB", chunks[b"IHDR"][:10])
    assert (depth, colour) == (8, 6)
    rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, 1 + 4 * width)
    assert (rows[:, 0] == 2).all()
    return np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8).reshape(height, width, 4)


def grid(n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A bent square of 2 (n - 1)² triangles."""
    x, y = np.meshgrid(np.linspace(0, 6, n), np.linspace(0, 6, n))
    points = np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1).reshape(-1, 3)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    return points, np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)])


def hues(pixels: Pixels) -> set[int]:
    """Hues of the opaque pixels, in steps of 30 degrees, that cover a hundredth of them or more."""
    rgb = pixels[pixels[..., 3] == 255][:, :3].astype(float)
    high, low = rgb.max(axis=1), rgb.min(axis=1)
    rgb, high, low = rgb[high > low + 40], high[high > low + 40], low[high > low + 40]
    sixth = np.choose(rgb.argmax(axis=1), [rgb[:, 1] - rgb[:, 2], rgb[:, 2] - rgb[:, 0], rgb[:, 0] - rgb[:, 1]])
    steps = np.floor(2 * ((sixth / (high - low) + 2 * rgb.argmax(axis=1)) % 6)).astype(int)
    counts = np.bincount(steps, minlength=12)
    return set(np.flatnonzero(counts > len(rgb) / 100).tolist())


def test_a_picture_shows_clusters_in_several_hues_and_fills_its_frame() -> None:
    clustering = tesserae_mesh.cluster(*grid(60), 40)
    pixels = picture(clustering)
    assert pixels.shape[0] <= 540 and pixels.shape[1] <= 720 and max(pixels.shape[0] / 540, pixels.shape[1] / 720) == 1
    opaque = pixels[..., 3] == 255
    assert 0.3 < opaque.mean() < 0.95
    # the mesh touches every side but for a margin
    rows, columns = np.flatnonzero(opaque.any(axis=1)), np.flatnonzero(opaque.any(axis=0))
    assert rows[0] < 8 and columns[0] < 8 and rows[-1] >= len(opaque) - 8 and columns[-1] >= opaque.shape[1] - 8
    assert len(hues(pixels)) >= 6
    # one cluster has one hue
    assert len(hues(picture(tesserae_mesh.cluster(*grid(60), 1)))) == 1
    html = clustering._repr_html_()
    assert repr(clustering) in html


def test_pictures_are_the_same_each_time_and_differ_between_clusterings() -> None:
    mesh = tesserae_mesh.Mesh(*grid(40))
    one = picture(tesserae_mesh.cluster(mesh, 20))
    assert np.array_equal(one, picture(tesserae_mesh.cluster(mesh, 20)))
    assert not np.array_equal(one, picture(tesserae_mesh.cluster(mesh, 21)))


def test_what_is_nearer_hides_what_is_behind() -> None:
    """Two squares, of which one hides the other, in both orders of faces."""
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    # towards the eye
    points = np.concatenate([square, square + 5 * np.array([0.4532, 0.4226, 0.7849])])
    far, near = [0, 1, 2, 3], [4, 5, 6, 7]
    (last,), (first,) = (hues(picture(tesserae_mesh.cluster(points, faces, 2))) for faces in ([far, near], [near, far]))
    assert last != first, "the nearer one is cluster 1, then cluster 0"
    apart = np.concatenate([square, square + np.array([5, 0, 0])])
    assert hues(picture(tesserae_mesh.cluster(apart, [far, near], 2))) == {first, last}


def test_hierarchies_cuts_and_remeshes_have_pictures(sample: Sample) -> None:
    whole = tesserae_mesh.cluster(sample("knot", 2000), algorithm="pml")
    assert "cut at 100" in whole._repr_html_()
    assert len(hues(picture(whole))) >= 6
    assert len(hues(picture(whole.cut(20)))) >= 6
    remesh = whole.cut(200).remesh()
    assert len(hues(picture(remesh))) <= 2 and repr(remesh) in remesh._repr_html_()
    tiny = tesserae_mesh.cluster(np.eye(3), [[0, 1, 2]], algorithm="hr")
    assert picture(tiny).any()


def test_a_million_faces_take_bounded_time_and_bytes() -> None:
    points, faces = grid(708)
    clustering = tesserae_mesh.cluster(points, faces, 500, quality="fast")
    assert len(faces) > 999_000
    assert len(clustering._repr_html_()) < 1_000_000
    many = tesserae_mesh.cluster(points, faces, 100_000, quality="fast")
    assert len(many._repr_html_()) < 2_000_000


def test_faces_that_cover_one_another_too_often_have_no_picture() -> None:
    """100,000 large squares one behind the other would take minutes."""
    count = 100_000
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    depth = np.linspace(0, 0.01, count)[:, None, None] * [0.0, 0, 1]
    points = (square + depth).reshape(-1, 3)
    clustering = tesserae_mesh.cluster(points, np.arange(4 * count).reshape(-1, 4), count)
    html = clustering._repr_html_()
    assert "<img" not in html and "too often for a picture" in html and repr(clustering) in html


@pytest.mark.parametrize("scale", [1e-300, 1e-30, 1.0, 1e30, 1e150])
def test_pictures_do_not_depend_on_the_unit(scale: float) -> None:
    points, faces = grid(20)
    mesh = tesserae_mesh._mesh.Mesh(points * scale, faces)
    geometry = tesserae_mesh._native.Geometry(mesh.points, mesh.connectivity, None)
    labels = np.zeros(len(faces), dtype=np.uint32)
    labels[len(faces) // 2 :] = 1
    expected = tesserae_mesh._native.Geometry(points, faces, None).picture(labels)
    difference = geometry.picture(labels).astype(int) - expected
    assert (np.abs(difference) > 8).mean() < 1e-3


def test_a_point_without_a_face_changes_no_picture() -> None:
    points, faces = grid(20)
    far = np.concatenate([points, [[1e9, 1e9, 1e9]]])
    one, other = (tesserae_mesh._native.Geometry(p, faces, None).picture(None) for p in (points, far))
    assert np.array_equal(one, other)


def test_a_mesh_without_extent_has_a_picture() -> None:
    for points in (np.zeros((3, 3)), np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.full((3, 3), 1e308)):
        geometry = tesserae_mesh._native.Geometry(points, np.array([[0, 1, 2]]), None)
        assert geometry.picture(None).shape[2] == 4
    with pytest.raises(tesserae_mesh.Error, match="labels must be 1 numbers below 1"):
        geometry.picture(np.array([1], dtype=np.uint32))


def test_a_picture_imports_no_other_library(sample: Sample) -> None:
    code = (
        "import sys, tesserae_mesh\n"
        f"assert '<img' in tesserae_mesh.cluster({str(sample('knot', 500))!r}, 9)._repr_html_()\n"
        "print(*({'pyvista', 'vtk', 'PIL', 'matplotlib', 'trimesh'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
