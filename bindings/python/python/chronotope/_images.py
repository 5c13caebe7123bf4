"""Which array do a PIL image, a tensor and other arrays mean?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ._chronotope import Features


def as_array(image: Any) -> Any:
    """The pixels of an image that is no numpy array.

    A PIL image is turned as its EXIF data say; anything else has to say that it is an array.

    Errors: ``TypeError`` for what is no image.
    """
    if type(image).__module__.partition(".")[0] == "PIL":
        from PIL import ImageOps

        upright = ImageOps.exif_transpose(image)
        if upright.mode in ("L", "1"):
            return np.ascontiguousarray(np.asarray(upright.convert("L")))
        return np.ascontiguousarray(np.asarray(upright.convert("RGB")))
    if hasattr(image, "__array__") or hasattr(image, "__array_interface__"):
        return np.asarray(image)
    if image is None:
        raise TypeError("None is no image: could the file not be read?")
    raise TypeError(
        f"{type(image).__name__} is no image: give a numpy array of uint8, a PIL image or a path"
    )


def features_of_bytes(
    keypoints: bytes, descriptors: bytes, image_size: tuple[int, int] | None
) -> Features:
    """Features as they were pickled."""
    from ._chronotope import Features

    rows = np.frombuffer(keypoints, "<f4").reshape(-1, 4)
    bits = np.frombuffer(descriptors, np.uint8).reshape(-1, 32)
    return Features(
        rows[:, :2], bits, size=rows[:, 2], response=rows[:, 3], image_size=image_size
    )
