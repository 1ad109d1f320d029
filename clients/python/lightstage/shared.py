"""Memory that the daemon shares: what came with a frame is looked at before it is believed."""
import fcntl
import mmap
import os
from typing import List

from .errors import Error


def memory_of(fds: List[int], size: int, seals: int) -> mmap.mmap:
    """The first `size` bytes behind the one descriptor that came, read-only. `seals`: what nobody can
    do to it any more."""
    if len(fds) != 1:
        raise Error(f"{len(fds)} descriptors came with a frame that speaks of shared memory")
    try:
        has = fcntl.fcntl(fds[0], fcntl.F_GET_SEALS)
    except OSError:
        has = 0
    if has & seals != seals:
        raise Error("the daemon's shared memory may change under its reader: its seals are "
                    f"{has:#x}, expected {seals:#x}")
    if not 0 < size <= os.fstat(fds[0]).st_size:
        raise Error(f"the daemon's shared memory is shorter than the {size} bytes that it speaks of")
    return mmap.mmap(fds[0], size, prot=mmap.PROT_READ)
