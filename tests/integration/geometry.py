"""Where things are in a picture: the rigs' camera at (0, 0, 1.6) m, looking at the origin."""
import numpy as np

import harness

EYE = np.array([0.0, 0.0, 1.6])


def pixels_per_tangent(rig):
    return rig.focal_mm * rig.width / harness.stage.SENSOR_MM


def project(rig, point):
    """(x, y) in px of a point in m."""
    x, y, z = np.asarray(point) - EYE
    scale = pixels_per_tangent(rig) / -z
    return rig.width / 2 + scale * x - 0.5, rig.height / 2 - scale * y - 0.5


def rays(rig):
    """(height, width, 3): the unit direction every pixel's middle looks in."""
    y, x = np.mgrid[0:rig.height, 0:rig.width] + 0.5
    scale = pixels_per_tangent(rig)
    d = np.stack([(x - rig.width / 2) / scale, (rig.height / 2 - y) / scale, -np.ones(x.shape)], 2)
    return d / np.linalg.norm(d, axis=2, keepdims=True)


def sphere(rig, radius, centre=(0, 0, 0)):
    """(normals, points) of a sphere in every pixel; NaN where it is not seen."""
    d, o = rays(rig), EYE - np.asarray(centre)
    b = d @ o
    with np.errstate(invalid="ignore"):
        t = -b - np.sqrt(b * b - (o @ o - radius * radius))
    points = EYE + t[:, :, None] * d
    return (points - np.asarray(centre)) / radius, points


def mirror_pixel(rig, radius, light):
    """(x, y) of the pixel of a mirror ball at the origin that shows a light at a point in m."""
    normals, points = sphere(rig, radius)
    d = rays(rig)
    mirrored = d - 2 * np.sum(d * normals, axis=2, keepdims=True) * normals
    to = np.asarray(light) - points
    to /= np.linalg.norm(to, axis=2, keepdims=True)
    y, x = np.unravel_index(np.nanargmax(np.sum(mirrored * to, axis=2)), normals.shape[:2])
    return int(x), int(y)


def shadow(light, point, floor_y):
    """Where the floor is dark because @point is between it and the light."""
    light, point = np.asarray(light), np.asarray(point)
    return light + (point - light) * (floor_y - light[1]) / (point[1] - light[1])


def hdr(path, picture):
    """Write a lat-long map (height, width, 3) of floats as Radiance RGBE, flat pixels."""
    picture = np.asarray(picture, float)
    high = picture.max(axis=2)
    exponent = np.where(high > 0, np.ceil(np.log2(np.maximum(high, 1e-30)) + 1e-6), -128)
    bytes_ = np.zeros(picture.shape[:2] + (4,), np.uint8)
    bytes_[:, :, :3] = np.floor(picture / np.exp2(exponent)[:, :, None] * 256)
    bytes_[:, :, 3] = np.where(high > 0, exponent + 128, 0)
    with open(path, "wb") as file:
        file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % picture.shape[:2])
        file.write(bytes_.tobytes())
    return path


def texel(direction, height, width):
    """(row, column) of a lat-long map that a direction in the stage falls on."""
    x, y, z = np.asarray(direction) / np.linalg.norm(direction)
    u = np.arctan2(x, -z) / (2 * np.pi) + 0.5
    v = np.arccos(y) / np.pi
    return int(v * height), int(u * width) % width
