#!/usr/bin/python3
"""The take under white light from camera left. Usage: relight.py TAKE PICTURE.png"""
import sys
import lightstage
import numpy as np

take, picture = sys.argv[1:] if len(sys.argv) == 3 else sys.exit(__doc__)
with lightstage.connect() as stage:
    about = stage.show(take)
    positions = np.array(about["rig"]["lights"]["position_m"])
    left = np.clip(-positions[:, 0] / np.linalg.norm(positions, axis=1), 0, None)
    relit = stage.relight(take, {"W": 4 * np.pi / len(left) * left})  # radiance x sr of each light
lightstage.write_png(picture, relit.pixels @ np.array(about["calibration"]["M"]).T)
