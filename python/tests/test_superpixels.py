"""Images: superpixels, types of samples, masks, errors."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from items import assert_connected, by_command, energy, grid_edges, sha256
from PIL import Image
from skimage.color import rgb2gray, rgb2lab
from skimage.data import astronaut
from skimage.segmentation import mark_boundaries, slic
from skimage.util import img_as_float, img_as_uint

import tesserae_mesh
import tesserae_mesh._points
from tesserae_mesh import cluster_points, superpixels


def test_superpixels_are_connected_and_exactly_as_many() -> None:
    image = astronaut()[60:180, 160:310]
    edges = grid_edges(image.shape[:2])
    grey = np.rint(rgb2gray(image) * 255).astype(np.uint8)
    alpha = np.full((*grey.shape, 1), 255, dtype=np.uint8)
    alpha[:30, :40] = 0
    for given in [image, grey, grey[:, :, None], np.dstack([grey, alpha]), np.dstack([image, alpha])]:
        labels = superpixels(given, 50)
        assert labels.shape == grey.shape and labels.dtype == np.int32
        assert_connected(labels, edges, 50)
        has_alpha = given.ndim == 3 and given.shape[2] in (2, 4)
        assert np.array_equal(labels < 0, (alpha[:, :, 0] == 0) if has_alpha else np.zeros(grey.shape, dtype=bool))
    marked = mark_boundaries(image, superpixels(image, 50))
    assert marked.shape == image.shape and (marked != img_as_float(image)).any()
    mask = alpha[:, :, 0] > 0
    assert np.array_equal(superpixels(image, 50, mask=mask), superpixels(np.dstack([image, alpha]), 50))
    assert not np.array_equal(superpixels(image, 50), superpixels(image, 50, 40))


def test_superpixels_start_where_seeds_say() -> None:
    image = np.zeros((2, 4), dtype=np.uint8)
    assert superpixels(image, 2, seeds=[7, 0]).tolist() == [[1, 1, 0, 0], [1, 1, 0, 0]]


def test_superpixels_are_those_of_the_command_line(tmp_path: Path) -> None:
    image = astronaut()[60:180, 160:310]
    alpha = np.full((*image.shape[:2], 1), 255, dtype=np.uint8)
    alpha[:30, :40] = 0
    for given in [image, image[:, :, 0], np.dstack([image, alpha])]:
        Image.fromarray(given).save(tmp_path / "image.png")
        report = by_command(tmp_path / "image.png", "-k", "50", "--compactness", "20")
        assert report["labels_sha256"] == sha256(superpixels(given, 50, 20))


def test_superpixels_are_clusters_of_lab_and_place() -> None:
    image = astronaut()[60:180, 160:310]
    side = np.sqrt(image.shape[0] * image.shape[1] / 60)
    row, column = np.indices(image.shape[:2])
    lab = rgb2lab(image)
    x = np.dstack([lab / 10, column / side, row / side]).astype(np.float32)
    # both round colours, in different ways: a pixel in a thousand may be beside another's boundary
    ours, theirs = superpixels(image, 60), cluster_points(x, 60, graph="grid").labels
    assert np.isclose(energy(x, ours), energy(x, theirs), rtol=5e-3)
    assert energy(x, ours) < energy(x, slic(image, 60, compactness=10, start_label=0))


def test_images_of_other_types_are_converted_as_scikit_image_does() -> None:
    image = astronaut()[60:120, 160:230]
    for kind in ["f4", "f8"]:
        given = (image / 255).astype(kind)
        assert np.array_equal(superpixels(given, 20), superpixels(img_as_uint(given), 20)), kind
        between = np.random.default_rng(0).random((9, 9, 3)).astype(kind)
        assert np.array_equal(tesserae_mesh._points._samples(between, None), img_as_uint(between))
    # img_as_uint overflows with these
    half = (image / 255).astype("f2")
    assert np.array_equal(superpixels(half, 20), superpixels(half.astype("f4"), 20))
    bright = image[:, :, 0] > 100
    assert np.array_equal(superpixels(bright, 20), superpixels(img_as_uint(bright), 20))
    wide = image.astype(np.uint16) * 257
    assert np.array_equal(superpixels(wide.astype(">u2")[:, ::-1], 20), superpixels(wide[:, ::-1].copy(), 20))
    holes = image / 255
    holes[3:9, 5:9] = np.nan
    labels = superpixels(holes, 20, mask=~np.isnan(holes[:, :, 0]))
    assert np.array_equal(labels < 0, np.isnan(holes[:, :, 0]))


IMAGE = np.zeros((4, 5), dtype=np.uint8)
REFUSED_IMAGES: list[tuple[dict[str, Any], str]] = [
    ({"image": np.zeros(4, dtype=np.uint8)}, "height x width"),
    ({"image": np.zeros((4, 5, 5), dtype=np.uint8)}, "1 to 4 channels"),
    ({"image": np.zeros((0, 5), dtype=np.uint8)}, "no items"),
    ({"image": IMAGE.astype(int)}, "not int64"),
    ({"image": np.full((4, 5), 1.5)}, "row 0, column 0, channel 0 is 1.5"),
    ({"image": np.full((4, 5), np.nan)}, "channel 0 is nan"),
    ({"n": 0}, "at least 1"),
    ({"n": 21}, "clusters must not be more"),
    ({"n": "many"}, "n must be an integer"),
    ({"compactness": 0}, "compactness must be from"),
    ({"compactness": np.nan}, "not JSON"),
    ({"mask": np.ones((5, 4), dtype=bool)}, "shape of the pixels"),
    ({"mask": np.zeros((4, 5), dtype=bool)}, "no pixel takes part"),
]


@pytest.mark.parametrize(("wrong", "words"), REFUSED_IMAGES)
def test_images_that_are_refused_say_so_in_a_line(wrong: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"image": IMAGE, "n": 3, **wrong}
    with pytest.raises(tesserae_mesh.Error, match=words) as caught:
        superpixels(**given)
    assert caught.value.kind == "invalid-parameter" and "\n" not in str(caught.value)


def test_a_grey_picture_in_colours_is_nothing_unusual() -> None:
    grey = np.random.default_rng(5).integers(0, 256, (40, 60, 1), dtype=np.uint8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        superpixels(np.repeat(grey, 3, axis=2), 20)
