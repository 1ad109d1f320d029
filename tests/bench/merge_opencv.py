#!/usr/bin/python3 -B
"""Seconds that OpenCV takes to merge three exposures of 8 bits, a line per round.

usage: merge_opencv.py debevec|weighted WIDTH

debevec: its own float merge (createMergeDebevec, linear response), which knows no darks. weighted:
the mean of what is in range, darks subtracted, weights t^2, to halves, of its vector operations.
One thread. Prints nothing where OpenCV or NumPy is missing.
"""
import sys
import time

try:
    import cv2
    import numpy as np
except ImportError:
    sys.exit(0)

TIMES = np.array([0.001, 0.004, 0.016], np.float32)


def weighted(raw, darks):
    total = np.zeros(raw[0].shape, np.float32)
    norm = np.full(raw[0].shape, 1e-9, np.float32)
    for x, dark, t in zip(raw, darks, TIMES):
        weight = cv2.inRange(x, 26, 217).astype(np.float32)
        y = cv2.subtract(x, dark, dtype=cv2.CV_32F)
        total += cv2.multiply(y, weight, scale=float(t))
        norm += weight * float(t * t)
    return cv2.divide(total, norm).astype(np.float16)


def main():
    what, width = sys.argv[1], int(sys.argv[2])
    cv2.setNumThreads(1)
    noise = np.random.default_rng(1)
    raw = [noise.integers(0, 200, (width, width), np.uint8) for _ in TIMES]
    darks = [np.full((width, width), 8, np.float32) for _ in TIMES]
    response = np.arange(1, 257, dtype=np.float32).reshape(256, 1, 1)
    debevec = cv2.createMergeDebevec()
    pictures = [x[:, :, None] for x in raw]
    for _ in range(4):
        start = time.perf_counter()
        if what == "debevec":
            debevec.process(pictures, TIMES, response)
        else:
            weighted(raw, darks)
        print(time.perf_counter() - start)


main()
