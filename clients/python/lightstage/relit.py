"""Relit pictures: weights out, pictures in."""
import dataclasses
from typing import Any, List, Mapping, Optional, Tuple, Union

import numpy as np

from . import lightstage_pb2 as messages
from .arrays import Array, place_in, room

# Rows of weights of one picture: of each channel; of each target and channel; of each target.
Weights = Union[Mapping[str, Any], Any]


@dataclasses.dataclass
class Relit:
    """`pixels` float32 [height][width][3], camera RGB; of several pictures [n][height][width][3]."""

    pixels: Array
    report: messages.RelightReply  # lights used and skipped, bound, seconds, spectra: of all pictures


def rows_of(weights: Weights, mode: int) -> Tuple[List[str], Array, bool]:
    """(channels, float32 [n_pictures][rows][n_lights], whether the pictures were an axis)."""
    if mode == messages.TRISTIMULUS:
        channels: List[str] = []
        rows = np.asarray(weights, np.float32)
        if rows.ndim not in (2, 3) or rows.shape[-2] != 3:
            raise ValueError(f"weights of shape {rows.shape}: expected [3][n_lights], or "
                             "[n_pictures][3][n_lights]")
        many = rows.ndim == 3
    else:
        if not isinstance(weights, Mapping) or not weights:
            raise ValueError("weights: expected {channel: weights}")
        channels = list(weights)
        parts = np.broadcast_arrays(*(np.asarray(w, np.float32) for w in weights.values()))
        targets = mode == messages.PER_TARGET
        if parts[0].ndim not in (1 + targets, 2 + targets) or (targets and parts[0].shape[-2] != 3):
            raise ValueError(f"weights of shape {parts[0].shape}: expected "
                             f"{'[3]' if targets else ''}[n_lights], or one axis more: pictures")
        many = parts[0].ndim == 2 + targets
        # [pictures][targets][channels][lights]
        rows = np.stack(parts, axis=-2)
    n_lights = rows.shape[-1]
    n_pictures = rows.shape[0] if many else 1
    return channels, np.ascontiguousarray(rows.reshape(n_pictures, -1, n_lights), "<f4"), many


class Canvas:
    """Bands of several pictures, each received where it belongs."""

    def __init__(self, n: int, out: Optional[Array]):
        self.n, self.out = n, out
        self.pixels: Optional[Array] = None

    def room(self, reply: messages.RelightReply, n_bytes: int) -> List[memoryview]:
        if not reply.n_rows:
            return []
        if self.pixels is None:
            shape = (self.n, reply.height, reply.width, 3)
            out = self.out
            if out is not None and self.n == 1 and out.ndim == 3:
                out = out[None]
            self.pixels = room(out, shape, np.dtype("<f4"))
        return [place_in(self.pixels[reply.picture,
                                     reply.first_row:reply.first_row + reply.n_rows])]
