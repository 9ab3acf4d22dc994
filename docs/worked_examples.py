"""The numbers and the picture of docs/light-probe.md and docs/regions.md: `python docs/worked_examples.py`, with gonio installed."""

from pathlib import Path

import numpy as np

import gonio

HERE = Path(__file__).parent
RADIUS, SIZE = 250, 520
REFLECTANCE = 0.6
SAMPLES = 3


def looked_up(light, directions):
    """Radiance of a lat-long map in these directions."""
    x, y, z = np.moveaxis(directions, -1, 0)
    rows, columns = light.shape[:2]
    u = np.arctan2(x, -z) / (2 * np.pi) + 0.5
    v = np.arccos(np.clip(y, -1, 1)) / np.pi
    return light[np.minimum((v * rows).astype(int), rows - 1), (u * columns).astype(int) % columns]


def mirror_ball(light, yaw):
    """Exact photograph of a chrome ball, from a camera that went around it by `yaw` degrees; the camera shows in it."""
    total = np.zeros((SIZE, SIZE, 3))
    alpha = np.zeros((SIZE, SIZE))
    for i in range(SAMPLES):
        for j in range(SAMPLES):
            column, row = np.meshgrid(np.arange(SIZE) + (i + 0.5) / SAMPLES, np.arange(SIZE) + (j + 0.5) / SAMPLES)
            nx, ny = (column - SIZE / 2) / RADIUS, (SIZE / 2 - row) / RADIUS
            inside = nx**2 + ny**2 < 1
            nz = np.sqrt(np.maximum(1 - nx**2 - ny**2, 0))
            d = np.stack([2 * nz * nx, 2 * nz * ny, 2 * nz**2 - 1], -1)
            aside = np.arccos(np.clip(d[..., 2], -1, 1))
            turn = np.radians(yaw)
            turned = np.stack([np.cos(turn) * d[..., 0] + np.sin(turn) * d[..., 2], d[..., 1], np.cos(turn) * d[..., 2] - np.sin(turn) * d[..., 0]], -1)
            seen = looked_up(light, turned)
            seen[aside < 0.18] = 0.05
            seen[aside < 0.06] = 3.0
            fresnel = REFLECTANCE + (1 - REFLECTANCE) * (1 - nz) ** 5
            total += np.where(inside[..., None], seen * fresnel[..., None], 0)
            alpha += inside
    count = SAMPLES**2
    return np.concatenate([total / count, alpha[..., None] / count], -1).astype(np.float32)


def energy(light):
    rows = light.shape[0]
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    return (light.mean(axis=(1, 2)) * (edges[:-1] - edges[1:])).sum() / 2


def off(a, b):
    """Root mean square of the difference of logarithms, below 80 degrees of both angles."""
    a, b = (np.log(x.luminance[:84, :80]) for x in (a, b))
    return np.sqrt(((a - b) ** 2).mean())


studio = gonio.studio_light(128)
front, side = mirror_ball(studio, 0), mirror_ball(studio, 90)
both = gonio.light_probe(front, second=side, reflectance=REFLECTANCE)
one = gonio.light_probe(front, reflectance=REFLECTANCE)
print("turn", both.result["views"]["azimuth_degrees"], "unseen", both.result["unseen"], one.result["unseen"])
print("energy of two views", energy(both.light) / energy(studio), "of one", energy(one.light) / energy(studio))
gonio._gonio.write_file(str(HERE / "images" / "light-probe.png"), gonio._gonio.encode_png(both.picture))

matte = gonio.render(gonio.Brdf.of(lambda h, d: 0.1 + 0.3 * np.exp(-((h / 0.4) ** 2))), studio, size=256)
exact, of_both, of_one = (gonio.infer(matte, light=light, align_light="fixed", pictures=False) for light in (studio, both.light, one.light))
print("BRDF by two views off by", off(of_both, exact), "by one", off(of_one, exact))

ball = gonio.read_image(HERE.parent / "samples" / "ball.exr")
darker = ball * np.array([0.4, 0.4, 0.4, 1.0][: ball.shape[2]], np.float32)
found = gonio.infer_regions(np.concatenate([ball, darker], axis=1), pictures=False)
print("relative albedos", {name: round(posterior.result["relative_albedo"], 3) for name, posterior in found.items()})
