"""Pictures as files: PNG to look at, PFM with every bit."""
import struct
import zlib
from typing import Any, Optional

import numpy as np

from .arrays import Array

SHOWN_PERCENTILE, SHOWN_AS = 99, 0.8  # what is scaled automatically


def write_png(path: str, pixels: Array, scale: Optional[float] = None) -> float:
    """8 bit sRGB of linear pixels [height][width] or [height][width][1 or 3], times `scale`; None:
    the 99th percentile of the largest channel becomes 0.8. Returns the scale."""
    linear = as_picture(pixels)
    if scale is None:
        bright = float(np.percentile(linear.max(axis=2), SHOWN_PERCENTILE))
        scale = SHOWN_AS / bright if bright > 0 else 1.0
    shown = np.clip(np.nan_to_num(linear * scale), 0, 1)
    curve = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    codes = np.rint(255 * curve).astype(np.uint8)
    height, width, n = codes.shape
    lines = np.zeros((height, 1 + n * width), np.uint8)  # each begins with its filter: none
    lines[:, 1:] = codes.reshape(height, n * width)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for name, data in ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2 if n == 3 else 0,
                                                 0, 0, 0)),
                           (b"IDAT", zlib.compress(lines.tobytes())), (b"IEND", b"")):
            file.write(struct.pack(">I", len(data)) + name + data +
                       struct.pack(">I", zlib.crc32(name + data)))
    return scale


def write_pfm(path: str, pixels: Array) -> None:
    """Float32, linear, as it is; Portable Float Map: rows from the bottom."""
    picture = as_picture(pixels).astype("<f4", copy=False)
    height, width, n = picture.shape
    with open(path, "wb") as file:
        file.write(f"{'PF' if n == 3 else 'Pf'}\n{width} {height}\n-1.0\n".encode())
        file.write(np.ascontiguousarray(picture[::-1]).tobytes())


def as_picture(pixels: Any) -> Array:
    picture = np.asarray(pixels)
    if picture.ndim == 2:
        picture = picture[:, :, None]
    if picture.ndim != 3 or picture.shape[2] not in (1, 3):
        raise ValueError(f"pixels of shape {picture.shape}: expected [height][width][1 or 3]")
    return picture.astype(np.float32, copy=False)
