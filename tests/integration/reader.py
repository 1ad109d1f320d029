"""Rebuild one relit pixel from a take's own files alone: take.json and its OpenEXR pictures.

usage: reader.py TAKE_FOLDER WEIGHTS.json X Y

Prints the pixel's camera colour (0 R, 1 G, 2 B) and its value in camera RGB under the weights
{"W": [one per light], "R": [...]}: W was photographed light by light, any other spectrum is promoted
by Eq. 1, F / V. Demosaicing keeps the colour a pixel has seen, so at that colour it needs no other.
"""
import json
import struct
import sys

import numpy as np


def sample(path, x, y):
    """Pixel (x, y) of the first part of an uncompressed tiled OpenEXR file of one half channel."""
    data = open(path, "rb").read()
    at, heads, parts = 8, [], data[5] >> 4 & 1
    while not heads or (parts and data[at]):
        heads.append({})
        while data[at]:
            name, kind = data[at:].split(b"\0", 2)[:2]
            at += len(name) + len(kind) + 6
            size, = struct.unpack_from("<i", data, at - 4)
            heads[-1][name], at = data[at:at + size], at + size
        at += 1
    head, at = heads[0], at + parts
    assert head[b"compression"] == b"\0" and head[b"channels"][:6] == b"Y\0\1\0\0\0"
    x0, y0, x1, _ = struct.unpack("<4i", head[b"dataWindow"])
    width, (side, _) = x1 - x0 + 1, struct.unpack_from("<II", head[b"tiles"])
    chunk, = struct.unpack_from("<Q", data, at + 8 * (y // side * -(-width // side) + x // side))
    row = min(side, width - x // side * side)
    pixel = chunk + (24 if parts else 20) + 2 * (y % side * row + x % side)
    return float(np.frombuffer(data, "<f2", 1, pixel)[0])


def rebuild(folder, weights, x, y):
    take = json.load(open(f"{folder}/take.json", encoding="utf-8"))
    cal, plan = take["calibration"], take["plan"]["conditions"]
    order = {"RG": "RGGB", "GR": "GRBG", "GB": "GBRG", "BG": "BGGR"}
    cfa = order[take["rig"]["cameras"][0]["pixel_format"][5:7]]
    k = {name: np.array(gains) for name, gains in cal["k"].items()}
    e = np.array([sample(f"{folder}/cam0/{c['id']}.exr", x, y) for c in plan if c["kind"] == "one"])
    field, value = k["W"] * e * cal["scale"] / take["reference_exposure_s"], 0.0
    for s, w in weights.items():
        ratio = 1.0
        if s != "W":
            sphere, = [c for c in plan if c["kind"] == "sphere" and c["channel"] == s]
            duty = sphere["level"] / 65535
            factor, = [f["factor"] for f in cal["pattern_factors"]
                       if f["channel"] == s and abs(f["duty"] / duty - 1) <= 1e-3]
            f = sample(f"{folder}/cam0/{sphere['id']}.exr", x, y) * factor / duty
            ratio = f / np.sum(k["W"] * e / k[s])
        value += ratio * np.sum(np.array(w) * field)
    return "RGB".index(cfa[y % 2 * 2 + x % 2]), value


if __name__ == "__main__":
    print(*rebuild(sys.argv[1], json.load(open(sys.argv[2])), int(sys.argv[3]), int(sys.argv[4])))
