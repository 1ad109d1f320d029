"""OpenEXR pictures as numpy arrays, for tests: what the project writes, tiled, plain or packed."""
import struct
import zlib

import numpy as np

TYPES = {1: np.dtype("<f2"), 2: np.dtype("<f4")}


def header(data, at):
    """Attributes {name: (type, bytes)} of the header at @at, and where it ends."""
    found = {}
    while data[at]:
        name, kind = data[at:at + 1024].split(b"\0", 2)[:2]
        at += len(name) + len(kind) + 6
        size, = struct.unpack_from("<i", data, at - 4)
        found[name.decode()] = (kind.decode(), data[at:at + size])
        at += size
    return found, at + 1


def channels(value):
    """(name without its layer, dtype) of a chlist, in file order."""
    at, found = 0, []
    while value[at]:
        end = value.index(b"\0", at)
        kind, = struct.unpack_from("<i", value, end + 1)
        found.append((value[at:end].decode().rsplit(".", 1)[-1], TYPES[kind]))
        at = end + 17
    return found


def unpacked(data):
    """A chunk compressed with ZIP: differences of bytes, the even ones before the odd ones."""
    packed = np.frombuffer(zlib.decompress(data), np.uint8).astype(np.int64)
    packed[1:] -= 128
    halves = np.cumsum(packed).astype(np.uint8)
    middle = (len(halves) + 1) // 2
    out = np.empty_like(halves)
    out[0::2], out[1::2] = halves[:middle], halves[middle:]
    return out.tobytes()


def read(path, part=None):
    """A part (the first) as float64 (height, width, channels): R G B, or Y; None if it is not there."""
    with open(path, "rb") as file:
        data = file.read()
    _, version = struct.unpack_from("<II", data)
    parts = bool(version & 0x1000)
    head, at = header(data, 8)
    heads = [head]
    while parts and data[at]:
        head, at = header(data, at)
        heads.append(head)
    at += parts
    for head in heads:
        if part is None or head.get("name", ("", b""))[1] == part.encode():
            break
        at += 8 * struct.unpack("<i", head["chunkCount"][1])[0]
    else:
        return None
    packed = head["compression"][1] == b"\3"
    assert packed or head["compression"][1] == b"\0", "neither plain nor ZIP"
    x0, y0, x1, y1 = struct.unpack("<4i", head["dataWindow"][1])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    side, = struct.unpack_from("<I", head["tiles"][1])
    names = channels(head["channels"][1])
    picture = {name: np.zeros((height, width)) for name, _ in names}
    across = -(-width // side)
    for tile in range(across * -(-height // side)):
        chunk, = struct.unpack_from("<Q", data, at + 8 * tile)
        chunk += 24 if parts else 20
        x, y = tile % across * side, tile // across * side
        w, h = min(side, width - x), min(side, height - y)
        row = sum(kind.itemsize for _, kind in names) * w
        size, = struct.unpack_from("<i", data, chunk - 4)
        pixels, offset = data[chunk:chunk + size], 0
        if packed and size < row * h:
            pixels = unpacked(pixels)
        for name, kind in names:
            picture[name][y:y + h, x:x + w] = np.ndarray((h, w), kind, pixels, offset,
                                                         (row, kind.itemsize))
            offset += kind.itemsize * w
    order = "RGB" if "R" in picture else "Y"
    return np.stack([picture[name] for name in order], axis=2)


def attributes(path):
    """Of the first part: {name: (type, bytes)}."""
    with open(path, "rb") as file:
        return header(file.read(), 8)[0]
