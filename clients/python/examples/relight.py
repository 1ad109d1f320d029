#!/usr/bin/python3
"""The take under white light from camera left: relight.py TAKE PICTURE.png"""
import sys
import lightstage
import numpy as np

take, picture = sys.argv[1:]
with lightstage.connect() as stage:
    x = stage.rig().positions_m[:, 0] / np.linalg.norm(stage.rig().positions_m, axis=1)
    weights = 4 * np.pi / len(x) * np.clip(-x, 0, None)  # radiance x sr of each light
    relit = stage.relight(take, {"W": weights})
    to_rec709 = np.array(stage.show(take)["calibration"]["M"])
lightstage.write_png(picture, relit.pixels @ to_rec709.T)
