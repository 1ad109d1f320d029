"""Tiles of 64 x 64 pixels: each comes once, and again only when it has changed; or in shared memory."""
import dataclasses
import fcntl
import os
from typing import Any, Iterator, List, Optional

import numpy as np

from . import lightstage_pb2 as messages
from .arrays import Array, place_in, room
from .connection import tiles_sent
from .field import dtype_of, which_of
from .shared import memory_of

SIDE = 64
SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE


class Grid:
    """The tiles of a picture that a request asks for."""

    def __init__(self, ask: messages.Fetch, reply: messages.FetchReply):
        size, r = 1 << ask.level, ask.region
        right, bottom = ((r.x + r.width, r.y + r.height) if r.width or r.height
                         else (reply.width << ask.level, reply.height << ask.level))
        self.x, self.y = r.x // size, r.y // size
        self.width = min(-(-right // size), reply.width) - self.x
        self.height = min(-(-bottom // size), reply.height) - self.y
        self.across, self.down = -(-reply.width // SIDE), -(-reply.height // SIDE)
        self.x0, self.y0 = self.x // SIDE, self.y // SIDE
        self.n_x = (self.x + self.width - 1) // SIDE + 1 - self.x0
        self.n_y = (self.y + self.height - 1) // SIDE + 1 - self.y0

    def assemble(self, tiles: Array) -> Array:
        """[height][width][components] of the region, of tiles [n_y][n_x][64][64][components]: the one
        copy."""
        across = tiles.swapaxes(1, 2)  # [n_y][64][n_x][64][components]
        whole = across.reshape(self.n_y * SIDE, self.n_x * SIDE, tiles.shape[-1])
        x, y = self.x - self.x0 * SIDE, self.y - self.y0 * SIDE
        return whole[y:y + self.height, x:x + self.width]


class Tiles:
    """Pictures in tiles, empty at first; Stage.fetch_tiles fills it, and refreshes it.

    `pixels`: [n][n_y][n_x][64][64][components], those that the region touches, 0 beyond the picture.
    `hashes`: uint64 [n][n_y][n_x], of their bytes; 0: not there yet, or `left_out` [n][n_y][n_x]:
    under max_error, all 0. `lights`: of the pictures. `error_bound`: of what the last call left out."""

    def __init__(self) -> None:
        self.lights: List[int] = []
        self.pixels: Array = np.empty((0, 0, 0, SIDE, SIDE, 1), "<f4")
        self.hashes: Array = np.zeros((0, 0, 0), "<u8")
        self.left_out: Array = np.zeros((0, 0, 0), bool)
        self.received, self.error_bound = 0, 0.0  # tiles, by the last call
        self._grid: Optional[Grid] = None

    def picture(self, k: int) -> Array:
        """The k-th picture's region, [height][width][components]: a copy, put together."""
        assert self._grid is not None, "nothing was fetched"
        return self._grid.assemble(self.pixels[k])

    @property
    def missing(self) -> int:
        """The first tile, through all pictures, that is not there; their number: all are."""
        lacking = np.flatnonzero((self.hashes == 0) & ~self.left_out)
        return int(lacking[0]) if len(lacking) else self.hashes.size

    def _begin(self, ask: messages.Fetch, reply: messages.FetchReply, n: int) -> None:
        grid = Grid(ask, reply)
        shape = (n, grid.n_y, grid.n_x)
        whole = (*shape, SIDE, SIDE, reply.components)
        if self._grid is None:
            self.pixels, self.hashes = room(None, whole, dtype_of(reply)), np.zeros(shape, "<u8")
            self.left_out = np.zeros(shape, bool)
        elif self.pixels.shape[1:] != whole[1:] or self.pixels.dtype != dtype_of(reply) \
                or self._grid.__dict__ != grid.__dict__ or len(self.pixels) != n:
            raise ValueError("these are the tiles of another request")
        self._grid = grid

    def fill(self, request: Any) -> None:
        """From a request's answers, whose payloads went to what room() said."""
        self.received, self.error_bound = 0, 0.0
        for answer in request:
            reply = answer.message
            first = reply.first_tile
            span = slice(first, first + len(reply.tile))
            self.hashes.reshape(-1)[span] = reply.tile_hash
            self.received += tiles_sent(reply)
            self.error_bound = reply.error_bound
            picture = first // (self.hashes[0].size)
            self.lights[picture:picture + 1] = [reply.light]
        n = len(self.lights)
        self.pixels, self.hashes, self.left_out = self.pixels[:n], self.hashes[:n], self.left_out[:n]

    def room(self, ask: messages.Fetch, n: int, reply: messages.FetchReply) -> List[memoryview]:
        self._begin(ask, reply, n)
        tiles = self.pixels.reshape(-1, SIDE, SIDE, reply.components)
        first, count = reply.first_tile, len(reply.tile)
        known = np.ones(count + 2, bool)  # with an end on either side
        known[1:-1] = reply.tile_unchanged if reply.tile_unchanged else False
        self.hashes.reshape(-1)[first:first + count][~known[1:-1]] = 0  # they are being overwritten
        out = np.array(reply.tile_hash, "<u8") == 0
        self.left_out.reshape(-1)[first:first + count] = out
        tiles[first:first + count][out] = 0
        known[1:-1] |= out
        edges = np.flatnonzero(np.diff(known))  # of the runs that are sent
        return [place_in(tiles[first + a:first + b]) for a, b in edges.reshape(-1, 2)]


@dataclasses.dataclass
class Shared:
    """A picture in the daemon's own memory, read-only: `tiles` [n_y][n_x][64][64][components], those
    that the region touches. The memory stays as long as an array of it does."""

    light: int
    tiles: Array
    grid: Grid
    number: int = 0  # of the spectra asked for, which

    def picture(self) -> Array:
        """The region, [height][width][components]: a copy, put together."""
        return self.grid.assemble(self.tiles)


def mapped(reply: messages.FetchReply, fds: List[int]) -> Array:
    """All tiles of the picture whose memory came with a frame."""
    memory = memory_of(fds, reply.memfd_bytes, SEALS)
    return np.frombuffer(memory, dtype_of(reply)).reshape(-1, SIDE, SIDE, reply.components)


def shared_pictures(ask: messages.Fetch, request: Any) -> Iterator[Shared]:
    """Each when the first of its frames is there; the others list more of the same memory."""
    which = None
    for answer in request:
        reply, fds = answer.message, answer.fds
        try:
            if which_of(reply) != which:
                which, grid = which_of(reply), Grid(ask, reply)
                tiles = mapped(reply, fds).reshape(grid.down, grid.across, SIDE, SIDE, -1)
                yield Shared(reply.light,
                             tiles[grid.y0:grid.y0 + grid.n_y, grid.x0:grid.x0 + grid.n_x], grid,
                             reply.spectrum_number)
        finally:
            while fds:
                os.close(fds.pop())
