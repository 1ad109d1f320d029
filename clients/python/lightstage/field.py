"""What is fetched: pictures of single lights, in numpy arrays that the bytes are received into."""
import dataclasses
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from . import lightstage_pb2 as messages
from .arrays import Array, place_in, room
from .errors import Error

Region = Tuple[int, int, int, int]  # x, y, width, height in pixels


@dataclasses.dataclass
class Picture:
    """One picture: `pixels` [height][width][components]; what else is None unless asked for."""

    light: int  # of the rig, from 0; of `conditions` their place in the request
    pixels: Array
    gain_k: float
    calibrated: bool
    reference_exposure_s: float
    spectrum: Optional[messages.SpectrumReport]  # how it was promoted
    factor: int  # messages.Factor: WHOLE, or of a factored fetch RATIO or WHITE
    gain: float  # of WHITE: what expand() multiplies it by beside the ratio
    number: int = 0  # of the spectra asked for, which
    variance: Optional[Array] = None  # float32 [height][width]
    validity: Optional[Array] = None  # uint8 [height][width], messages.Validity


@dataclasses.dataclass
class Field:
    """Pictures of equal size in one array, [n][height][width][components]; `pictures` are views of it."""

    pixels: Array
    pictures: List[Picture]

    @property
    def lights(self) -> List[int]:
        return [picture.light for picture in self.pictures]


def number(enum: Any, name: Any) -> Any:
    """An enum's value by its name, in any case, or by itself."""
    if isinstance(name, str):
        try:
            return enum.Value(name.upper())
        except ValueError:
            names = ", ".join(word.lower() for word in enum.keys())
            raise ValueError(f"\"{name}\": expected one of {names}") from None
    return name


def region_message(region: Optional[Sequence[int]]) -> messages.Region:
    x, y, width, height = region or (0, 0, 0, 0)
    return messages.Region(x=x, y=y, width=width, height=height)


def sample_of(dtype: Any) -> messages.Sample:
    """HALF or FLOAT, as the protocol has them, for a numpy type."""
    kind = np.dtype(dtype)
    if kind == np.float32:
        return messages.FLOAT
    if kind == np.float16:
        return messages.HALF
    raise ValueError(f"{kind}: expected float32 or float16")


def dtype_of(reply: messages.FetchReply) -> "np.dtype[Any]":
    return np.dtype("<f2" if reply.sample == messages.HALF else "<f4")


def which_of(reply: messages.FetchReply) -> Tuple[int, int, int]:
    """Of the request's pictures: it changes from one to the next."""
    return reply.factor, reply.light, reply.spectrum_number


class Bands:
    """Bands of rows, each received where it belongs. With `n` pictures all lie in one array, `out`
    or a new one; without, each in its own."""

    def __init__(self, n: Optional[int] = None, out: Optional[Array] = None):
        self.n, self.out = n, out
        self.whole: Dict[str, Array] = {}
        self.which: Optional[Tuple[int, int, int]] = None
        self.count = 0
        self.now: Dict[str, Array] = {}

    def _next(self, reply: messages.FetchReply) -> None:
        """Arrays of the picture that begins."""
        size: Tuple[int, ...] = (reply.height, reply.width)
        parts: Dict[str, Tuple[Tuple[int, ...], Any, Optional[Array]]] = {
            "pixels": ((*size, reply.components), dtype_of(reply), self.out)}
        if reply.variance:
            parts["variance"] = (size, np.dtype("<f4"), None)
        if reply.validity:
            parts["validity"] = (size, np.dtype(np.uint8), None)
        now = {}
        for name, (shape, dtype, out) in parts.items():
            if self.n is None:
                now[name] = np.empty(shape, dtype)
                continue
            if name not in self.whole:
                self.whole[name] = room(out, (self.n, *shape), dtype)
            now[name] = self.whole[name][self.count]
        self.now, self.which, self.count = now, which_of(reply), self.count + 1

    def room(self, reply: messages.FetchReply, n_bytes: int) -> List[memoryview]:
        if which_of(reply) != self.which:
            if self.n is not None and self.count == self.n:
                raise Error(f"the daemon sent more than the {self.n} pictures asked for")
            self._next(reply)
        rows = slice(reply.first_row, reply.first_row + reply.n_rows)
        return [place_in(array[rows]) for array in self.now.values()]

    def pictures(self, answers: Any) -> Iterator[Picture]:
        """Each as it is complete."""
        arrays: Dict[str, Array] = {}
        for answer in answers:
            reply = answer.message
            if reply.first_row == 0:
                arrays, first = self.now, reply
            if reply.first_row + reply.n_rows == reply.height:
                yield Picture(first.light, gain_k=first.gain_k, calibrated=first.calibrated,
                              reference_exposure_s=first.reference_exposure_s,
                              spectrum=first.spectrum if first.HasField("spectrum") else None,
                              factor=first.factor, gain=first.gain,
                              number=first.spectrum_number, **arrays)
