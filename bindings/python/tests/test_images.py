"""Which arrays are images, and what is said of those that are none?"""

from __future__ import annotations

import io
import pathlib

import numpy as np
import pytest

import chronotope
from chronotope import _chronotope as engine

GRAY = np.random.default_rng(1).integers(0, 256, (240, 320), dtype=np.uint8)


@pytest.mark.parametrize(
    ("name", "image", "words"),
    [
        ("bool", GRAY > 10, ["bool", "* 255"]),
        ("int8", GRAY.view(np.int8), ["int8", "astype"]),
        ("uint16", GRAY.astype(np.uint16), ["uint16", ">> 8"]),
        ("int32", GRAY.astype(np.int32), ["int32", "astype"]),
        ("int64", GRAY.astype(np.int64), ["int64", "astype"]),
        ("float32", GRAY.astype(np.float32) / 255, ["float32", "255"]),
        ("float64", GRAY.astype(np.float64) / 255, ["float64", "255"]),
        ("float16", GRAY.astype(np.float16) / 255, ["float16", "255"]),
        ("complex", GRAY.astype(np.complex64), ["complex64", "uint8"]),
        ("nan", np.full((240, 320), np.nan), ["float64", "nan_to_num"]),
        ("object", GRAY.astype(object), ["object", "length"]),
        ("text", np.full((4, 4), "a"), ["uint8"]),
        ("datetime", np.zeros((4, 4), "datetime64[s]"), ["datetime64", "uint8"]),
        ("structured", np.zeros((4, 4), [("r", "u1"), ("g", "u1")]), ["uint8"]),
        ("four channels", np.zeros((240, 320, 4), np.uint8), ["4 channels", "[..., :3]"]),
        ("one channel", np.zeros((240, 320, 1), np.uint8), ["[..., 0]"]),
        ("two channels", np.zeros((240, 320, 2), np.uint8), ["(240, 320, 2)", "RGB"]),
        ("channels first", np.zeros((3, 240, 320), np.uint8), ["(3, 240, 320)"]),
        ("one dimension", np.zeros(100, np.uint8), ["(100)", "(height, width)"]),
        ("no dimension", np.array(3, np.uint8), ["(height, width)"]),
        ("a stack", np.zeros((2, 240, 320, 3), np.uint8), ["localize_many"]),
        ("no rows", np.zeros((0, 320), np.uint8), ["no pixels"]),
        ("no columns", np.zeros((240, 0), np.uint8), ["no pixels"]),
        ("nothing", np.zeros((0, 0), np.uint8), ["no pixels"]),
        ("columns of an image", np.zeros((240, 640), np.uint8)[:, ::2], ["ascontiguousarray"]),
        ("a crop", np.zeros((480, 640), np.uint8)[10:250, 10:330], ["ascontiguousarray"]),
        ("upside down", np.zeros((240, 320), np.uint8)[::-1], ["ascontiguousarray"]),
        ("transposed", np.zeros((320, 240), np.uint8).T, ["ascontiguousarray"]),
        ("Fortran", np.asfortranarray(GRAY), ["ascontiguousarray"]),
        ("channels turned", np.zeros((240, 320, 3), np.uint8)[..., ::-1], ["ascontiguousarray"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_no_image_is_refused_with_what_helps(
    name: str, image: np.ndarray, words: list[str], localizer: chronotope.Localizer
) -> None:
    for call in (chronotope.extract, lambda it: localizer.localize(it, 0)):
        with pytest.raises(chronotope.ShapeError) as raised:
            call(image)
        assert raised.value.kind == "shape"
        assert raised.value.help is not None
        for word in words:
            assert word in str(raised.value), name


@pytest.mark.parametrize("image", [None, 3, 1.5, object(), {}, [[1, 2], [3, 4]], b"bytes"])
def test_what_is_no_array_is_a_type_error(image: object) -> None:
    with pytest.raises((TypeError, chronotope.Error)) as raised:
        chronotope.extract(image)
    assert type(raised.value).__name__ != "PanicException"


def test_a_contiguous_image_is_not_copied() -> None:
    assert engine._address_of(GRAY) == GRAY.ctypes.data
    large = np.zeros((1024, 4096), np.uint8)
    assert engine._address_of(large) == large.ctypes.data
    # Whole rows of an image are contiguous, too.
    assert engine._address_of(large[100:]) == large[100:].ctypes.data


def test_a_read_only_image_is_read_where_it_lies() -> None:
    image = GRAY.copy()
    image.flags.writeable = False
    assert engine._address_of(image) == image.ctypes.data
    assert chronotope.extract(image) == chronotope.extract(GRAY)


def test_colours_are_rgb_unless_bgr_is_said() -> None:
    rgb = np.random.default_rng(2).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    bgr = np.ascontiguousarray(rgb[..., ::-1])
    weights = np.array([9798, 19235, 3735])
    gray = ((rgb.astype(np.int64) @ weights + 2**14) >> 15).astype(np.uint8)
    expected = chronotope.extract(gray)
    assert chronotope.extract(rgb) == expected
    assert chronotope.extract(bgr, bgr=True) == expected
    assert chronotope.extract(bgr) != expected
    # Grey is grey in either order.
    assert chronotope.extract(GRAY, bgr=True) == chronotope.extract(GRAY)


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P"])
def test_a_pil_image_is_its_pixels(mode: str, street: chronotope.Street) -> None:
    pil = pytest.importorskip("PIL.Image")
    pixels = street.render(street.places[0], "2023-06-01T12:00:00Z")
    image = pil.fromarray(pixels).convert(mode)
    expected = np.ascontiguousarray(np.asarray(image.convert("RGB")))
    assert chronotope.extract(image) == chronotope.extract(expected)


def test_a_pil_image_is_turned_as_its_exif_data_say(tmp_path: pathlib.Path) -> None:
    pil = pytest.importorskip("PIL.Image")
    image = pil.fromarray(GRAY)
    exif = image.getexif()
    exif[0x0112] = 3
    written = io.BytesIO()
    image.save(written, "png", exif=exif)
    (tmp_path / "turned.png").write_bytes(written.getvalue())
    turned = np.ascontiguousarray(GRAY[::-1, ::-1])
    assert chronotope.extract(pil.open(written)) == chronotope.extract(turned)
    assert chronotope.extract(tmp_path / "turned.png") == chronotope.extract(turned)


def test_what_says_that_it_is_an_array_is_one() -> None:
    class Tensor:
        def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
            return GRAY

    assert chronotope.extract(Tensor()) == chronotope.extract(GRAY)


def test_a_path_is_read_as_text_and_as_path(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "image.pgm"
    path.write_bytes(b"P5 320 240 255\n" + GRAY.tobytes())
    expected = chronotope.extract(GRAY)
    assert chronotope.extract(path) == expected
    assert chronotope.extract(str(path)) == expected


@pytest.mark.parametrize(
    ("content", "kind"),
    [(b"", "format"), (b"no image at all", "format"), (b"P5 320 240 255\nshort", "format")],
)
def test_a_broken_file_is_named(tmp_path: pathlib.Path, content: bytes, kind: str) -> None:
    path = tmp_path / "broken.pgm"
    path.write_bytes(content)
    with pytest.raises(chronotope.FormatError) as raised:
        chronotope.extract(path)
    assert raised.value.kind == kind and raised.value.path == str(path)


def test_a_missing_file_is_a_file_that_is_not_found(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FileNotFoundError) as raised:
        chronotope.extract(tmp_path / "none.png")
    assert isinstance(raised.value, chronotope.NotFoundError)
    assert raised.value.help


def test_a_mask_hides_what_is_zero_or_false() -> None:
    mask = np.ones(GRAY.shape, np.uint8)
    mask[:, :160] = 0
    some = chronotope.extract(GRAY, mask=mask)
    assert len(some) > 0 and (some.xy[:, 0] >= 159).all()
    assert chronotope.extract(GRAY, mask=mask.astype(bool)) == some
    assert chronotope.extract(GRAY, mask=mask * 255) == some
    assert len(chronotope.extract(GRAY, mask=np.zeros(GRAY.shape, bool))) == 0


@pytest.mark.parametrize(
    "mask",
    [np.ones((10, 10), np.uint8), np.ones(4, np.uint8), np.ones((240, 320)), np.zeros((0, 0), bool)],
)
def test_a_mask_that_does_not_fit_is_refused(mask: np.ndarray) -> None:
    with pytest.raises(chronotope.ShapeError):
        chronotope.extract(GRAY, mask=mask)


def test_two_images_that_share_memory_and_one_that_somebody_writes() -> None:
    image = GRAY.copy()
    before = chronotope.extract(image)
    image[:] = 0
    assert len(chronotope.extract(image)) == 0
    assert before == chronotope.extract(GRAY)
