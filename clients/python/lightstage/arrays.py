"""Arrays as places for bytes that come."""
from typing import Any, Iterable, Optional, Tuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def place_in(array: Array) -> memoryview:
    """Its bytes, to be written; it must be C-contiguous."""
    if array.size == 0:
        return memoryview(b"")
    return array.reshape(-1).view(np.uint8).data


def room(out: Optional[Array], shape: Tuple[int, ...], dtype: "np.dtype[Any]") -> Array:
    """`out`, if it is fit for an array of this shape and dtype; else a new one. Memory of a new one
    that nothing is written to costs nothing."""
    if out is None:
        return np.empty(shape, dtype)
    if out.shape != shape or out.dtype != dtype or not out.flags.c_contiguous \
            or not out.flags.writeable:
        raise ValueError(f"out is {out.dtype} {out.shape}: expected a C-contiguous, writable array "
                         f"of {dtype} {shape}")
    return out


def light_numbers(lights: Optional[Iterable[int]]) -> Optional[Tuple[int, ...]]:
    """As asked for, each once. None: every light."""
    return None if lights is None else tuple(dict.fromkeys(int(light) for light in lights))
