#!/usr/bin/python3 -B
"""Light comes from where it is said to come from, and in the amount that is said."""
import json

import numpy as np

import geometry
import harness
import pictures

SMALL_MAP = (32, 64)  # rows, columns


def calibration(rig):
    return json.loads(harness.stage.read(rig.path("calibration.json")))


def relit(rig, take, *how):
    rig.control("relight", take, *how, "--raw", "--output", rig.path("relit.exr"))
    return pictures.read(rig.path("relit.exr"))


def relit_by_weights(rig, take, **rows):
    path = rig.path("weights.json")
    harness.stage.write(path, json.dumps(rows))
    return relit(rig, take, "--weights", path)


def test_white_furnace_reads_the_reflectance_of_a_grey_sphere(folder):
    radius = 0.05
    rig = harness.rig_of(folder, size=96, scene="grey", focal_mm=100,
                         scene_extra=f"sphere_radius_m = {radius};").start()
    take = rig.start_take("furnace", """subject = "still"; exposures_us = [2500, 12500]; darks = 16;
conditions = ( { kind = "each"; channels = ["W"]; } );""")
    cal = calibration(rig)
    picture = relit_by_weights(rig, take, W=cal["lights"]["omega_sr"])
    normals, _ = geometry.sphere(rig, radius)
    # The dome ends at 70 degrees below the equator, and the lowest ring stands for the hole too: a
    # point whose normal is above the horizon sees nothing of it. Not the edge: there demosaicing
    # mixes in the background.
    seen = (normals[:, :, 1] > 0.05) & (normals[:, :, 2] > 0.5)
    assert np.count_nonzero(seen) > 700
    found = picture[seen] / (0.33 * np.array(cal["p"]["W"]))
    mean, spread = found.mean(axis=0) - 1, np.abs(found - 1).max()
    print(f"# furnace: mean off by {np.round(100 * mean, 3)} % in R G B, "
          f"worst pixel {100 * spread:.2f} %, {np.count_nonzero(seen)} px")
    assert np.all(np.abs(mean) < 0.01), mean
    # one pixel: responsivity of a pixel 0.5 % (prnu), 5 sigma, and the 1 %
    assert spread < 0.035, spread


def red_sun(rig, direction):
    """A map that is black but for one red texel; the light that stands there, its position."""
    rows, columns = SMALL_MAP
    row, column = geometry.texel(direction, rows, columns)
    picture = np.zeros((rows, columns, 3))
    picture[row, column] = (2000, 40, 20)
    path = geometry.hdr(rig.path("sun.hdr"), picture)
    theta, phi = np.pi * (row + 0.5) / rows, 2 * np.pi * ((column + 0.5) / columns - 0.5)
    middle = np.array([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)])
    lights = np.array(calibration(rig)["lights"]["position_m"])
    return path, lights[np.argmax(lights @ middle / np.linalg.norm(lights, axis=1))]


def colours_photographed(rig):
    return rig.start_take("sun", """subject = "still"; exposures_us = [500, 2500, 12500]; darks = 8;
conditions = ( { kind = "sphere"; channels = ["W", "R", "A", "G", "C", "B"]; },
               { kind = "each"; channels = ["W"]; } );""")


def test_a_red_sun_high_at_camera_left_shines_red_at_the_left_of_a_chrome_ball(folder):
    radius = 0.1
    rig = harness.rig_of(folder, size=128, scene="chrome", focal_mm=60,
                         scene_extra="lights = 60;").start()
    take = colours_photographed(rig)
    path, light = red_sun(rig, (-0.6, 0.55, 0.58))
    assert light[0] < -0.5 and light[1] > 0.4, light
    picture = relit(rig, take, path)
    luminance = picture.sum(axis=2)
    # the middle of what is brighter than half: a lobe of alpha 0.05 is some pixels wide
    y, x = np.nonzero(luminance > 0.5 * luminance.max())
    at = np.array([x.mean(), y.mean()])
    expected = np.array(geometry.mirror_pixel(rig, radius, light))
    turned = np.array(geometry.mirror_pixel(rig, radius, light * [-1, 1, 1]))
    print(f"# highlight at {np.round(at, 1)}, geometry says {expected}; mirrored it would be "
          f"at {turned}")
    # one pixel is 1.2 degrees of the ball's normal here; the lobe is wider towards the edge
    assert np.linalg.norm(at - expected) < 2, (at, expected)
    assert np.linalg.norm(at - turned) > 20
    red, green, blue = picture[int(round(at[1])), int(round(at[0]))]
    assert red > 3 * green and red > 5 * abs(blue), (red, green, blue)


def test_a_red_sun_high_at_camera_left_casts_its_shadow_where_geometry_says(folder):
    rig = harness.rig_of(folder, size=192, scene_extra="lights = 60;").start()
    take = colours_photographed(rig)
    # from the left and a little in front: the shadow of the gold ball falls on free table
    path, light = red_sun(rig, (-0.62, 0.62, 0.48))
    picture = relit(rig, take, path)
    ball, floor_y = (0.155, -0.19, 0.22), -0.22  # sim/subject.c
    dark = geometry.project(rig, geometry.shadow(light, ball, floor_y))
    mirrored = light * [-1, 1, 1]
    turned = geometry.project(rig, geometry.shadow(mirrored, ball, floor_y))

    def around(place):
        x, y = (int(round(v)) for v in place)
        return picture[y - 1:y + 2, x - 1:x + 2].mean(axis=(0, 1))

    print(f"# light {np.round(light, 2)}: red in the shadow {around(dark)[0]:.4f} at "
          f"{np.round(dark, 1)}, in the light {around(turned)[0]:.4f} at {np.round(turned, 1)}")
    # only light bounced off the table and the other things reaches a shadow
    assert around(dark)[0] < 0.25 * around(turned)[0]
    assert around(turned)[0] > 3 * around(turned)[2]


harness.main(globals())
