#!/usr/bin/python3
"""The take under white light from camera left. Usage: relight.py TAKE PICTURE.png"""
import sys
import lightstage
import numpy as np

if len(sys.argv) != 3:
    sys.exit(__doc__)
with lightstage.connect() as stage:
    about = stage.show(take := sys.argv[1])
    positions = np.array(about["rig"]["lights"]["position_m"])
    left = np.clip(-positions[:, 0] / np.linalg.norm(positions, axis=1), 0, None)
    weights = 4 * np.pi / len(left) * left  # radiance x sr of each light
    relit = stage.relight(take, {"W": weights})
lightstage.write_png(sys.argv[2], relit.pixels @ np.array(about["calibration"]["M"]).T)
