"""Are features arrays of the right shape, and can they be made of arrays?"""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import chronotope

XY = np.array([[1.0, 2.0], [3.5, 4.5]], np.float32)
BITS = np.arange(64, dtype=np.uint8).reshape(2, 32)


@pytest.fixture(scope="module")
def features(query: tuple[np.ndarray, object, str]) -> chronotope.Features:
    return chronotope.extract(query[0])


def test_shapes_and_types_are_what_the_documentation_says(features: chronotope.Features) -> None:
    n = len(features)
    assert 50 < n <= 600
    assert features.xy.shape == (n, 2) and features.xy.dtype == np.float32
    assert features.descriptors.shape == (n, 32) and features.descriptors.dtype == np.uint8
    assert features.size.shape == features.response.shape == (n,)
    assert features.image_size == (448, 384)
    assert (features.xy >= 0).all() and (features.xy < [448, 384]).all()
    assert repr(features) == f"Features({n} of an image of 448 x 384 px)"


def test_results_cannot_be_changed(features: chronotope.Features) -> None:
    with pytest.raises(ValueError):
        features.xy[0, 0] = 1
    with pytest.raises(AttributeError):
        features.image_size = (1, 1)  # type: ignore[misc]


def test_features_are_made_of_arrays_and_give_them_back() -> None:
    made = chronotope.Features(XY, BITS, size=[7, 8], response=[1, 2], image_size=(640, 480))
    assert (made.xy == XY).all() and (made.descriptors == BITS).all()
    assert made.size.tolist() == [7, 8] and made.response.tolist() == [1, 2]
    # Lists and other floats will do.
    assert chronotope.Features(XY.tolist(), BITS) == chronotope.Features(XY.astype(np.float64), BITS)


def test_features_are_pickled_to_the_same_bytes(features: chronotope.Features) -> None:
    data = pickle.dumps(features)
    again = pickle.loads(data)
    assert again == features and pickle.dumps(again) == data
    assert again.image_size == features.image_size


@pytest.mark.parametrize(
    ("xy", "bits", "words"),
    [
        (XY[:1], BITS, "descriptors"),
        (XY[:, :1], BITS, "(n, 2)"),
        (XY.ravel(), BITS, "(n, 2)"),
        (XY, BITS[:, :16], "(2, 32)"),
        (XY, BITS.astype(np.float32), "packbits"),
        (XY, BITS.astype(np.int16), "packbits"),
        (XY * np.nan, BITS, "NaN"),
        (XY * np.inf, BITS, "NaN or infinity"),
        (np.array([["a", "b"], ["c", "d"]]), BITS, "xy"),
        (np.array([[None, 1], [2, 3]], object), BITS, "xy"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(xy: object, bits: object, words: str) -> None:
    with pytest.raises(chronotope.ShapeError) as raised:
        chronotope.Features(xy, bits)  # type: ignore[arg-type]
    assert words in str(raised.value)


@pytest.mark.parametrize(("n", "kind"), [(0, chronotope.ConfigError), (-1, OverflowError)])
def test_a_number_of_features_that_is_none_is_refused(n: int, kind: type[Exception]) -> None:
    with pytest.raises(kind):
        chronotope.extract(np.zeros((240, 320), np.uint8), n=n)


def test_fewer_features_are_the_strongest(features: chronotope.Features, query) -> None:
    few = chronotope.extract(query[0], n=20)
    assert (few.xy == features.xy[:20]).all()
    assert (few.descriptors == features.descriptors[:20]).all()


def test_a_flat_image_has_no_features() -> None:
    features = chronotope.extract(np.full((240, 320), 128, np.uint8))
    assert len(features) == 0 and features.xy.shape == (0, 2)
