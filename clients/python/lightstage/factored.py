"""Many spectra from few pictures: the white picture of each light, and a ratio for each spectrum."""
import dataclasses
from typing import Dict, List

import numpy as np

from . import lightstage_pb2 as messages
from .arrays import Array
from .errors import Error
from .field import Picture

HALF_MAX = 65504


def expand(white: Array, gain: float, ratio: Array) -> Array:
    """gain x white x ratio of halves, as halves: to the bit what core/factored.h makes of them. What
    is not finite becomes 0, what is beyond half's range its end."""
    with np.errstate(over="ignore", invalid="ignore"):
        product = white.astype("<f4") * np.float32(gain)
        product *= ratio
    product[~np.isfinite(product)] = 0
    np.clip(product, -HALF_MAX, HALF_MAX, out=product)
    return product.astype("<f2")


@dataclasses.dataclass
class Factored:
    """`whites`: pictures of the lights, halves in RGB; `ratios`: of each spectrum, for all lights."""

    whites: List[Picture]
    ratios: Dict[str, Picture]

    @property
    def lights(self) -> List[int]:
        return [white.light for white in self.whites]

    def picture(self, k: int, spectrum: str) -> Array:
        """The k-th light under a spectrum, float16 [height][width][3]: bit for bit what fetch() of
        that light, spectrum and model brings as halves in RGB."""
        white = self.whites[k]
        return expand(white.pixels, white.gain, self.ratios[spectrum].pixels)


def gather(pictures: List[Picture]) -> Factored:
    found = Factored([], {})
    for picture in pictures:
        if picture.factor == messages.WHITE:
            found.whites.append(picture)
        elif picture.factor == messages.RATIO and picture.spectrum is not None:
            found.ratios[picture.spectrum.channel] = picture
        else:
            raise Error("the daemon answered a factored fetch with a whole picture")
    return found
