"""What bench_fetch_python.c drives: fetch_python.py PACKAGES SOCKET TAKE. For each line on standard
input, the word is fetched once, and a line says that it is done."""
import sys

sys.path.insert(0, sys.argv[1])

import lightstage  # noqa: E402
import numpy as np  # noqa: E402

STORED = {"channel": "W", "quantity": "estimate", "dtype": np.float16}


def main():
    socket, take = sys.argv[2:]
    with lightstage.connect(socket) as stage:
        tiles = lightstage.Tiles()
        out = stage.fetch(take, **STORED).pixels
        rows = len(out), *out.shape[1:]

        def fetch_tiles():
            tiles.hashes[:] = 0  # all of them, into the same memory
            stage.fetch_tiles(tiles, take, **STORED)

        def fetch_rows():
            assert stage.fetch(take, out=out, **STORED).pixels.shape == rows

        work = {"tiles": fetch_tiles, "rows": fetch_rows}
        for line in sys.stdin:
            work[line.strip()]()
            print("done", flush=True)


if __name__ == "__main__":
    main()
