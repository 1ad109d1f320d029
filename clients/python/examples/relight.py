#!/usr/bin/python3
"""The take under white light from camera left: relight.py TAKE PICTURE.png"""
import sys
import lightstage
import numpy as np

take, picture = sys.argv[1:]
with lightstage.connect() as stage:
    about = stage.show(take)
    positions = np.array(about["rig"]["lights"]["position_m"])
    x = positions[:, 0] / np.linalg.norm(positions, axis=1)
    weights = 4 * np.pi / len(x) * np.clip(-x, 0, None)  # radiance x sr of each light
    relit = stage.relight(take, {"W": weights})
lightstage.write_png(picture, relit.pixels @ np.array(about["calibration"]["M"]).T)
