#!/usr/bin/env python3
"""Measures `gonio infer --mirror-ball` on renderings with interreflection (docs/light-probe.md).

    python3 tools/mirror_ball.py GONIO LIGHTS -o OUT

GONIO is the program, LIGHTS are lat-long maps. Needs Mitsuba 3 and NumPy. Each photograph shows a
mirror ball and a ball of one material. The reference is the BRDF that gonio estimates from the
same photograph with the exact map.
"""

import argparse
import subprocess
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

WIDTH, HEIGHT = 640, 320
HALF_WIDTH = 2.9
"""Half of the width of the picture, in radii of the balls."""
CENTRE = 1.35
"""Distance of each ball from the middle of the picture, in radii."""
SAMPLES = 128
MATERIALS = {
    "satin plastic": {"type": "roughplastic", "alpha": 0.25, "diffuse_reflectance": {"type": "rgb", "value": [0.4, 0.2, 0.1]}},
    "glossy plastic": {"type": "roughplastic", "alpha": 0.08, "diffuse_reflectance": {"type": "rgb", "value": [0.1, 0.25, 0.4]}},
    "gold": {"type": "roughconductor", "alpha": 0.2, "material": "Au"},
    "matte": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.45, 0.3]}},
}


def photograph(light: Path, material: dict, file: Path) -> None:
    """Renders a mirror ball on the left and a ball of a material on the right."""
    transform = mi.ScalarTransform4f
    view = transform().look_at(origin=[0, 0, 10], target=[0, 0, 0], up=[0, 1, 0])
    ball = lambda x, bsdf: {"type": "sphere", "center": [x, 0, 0], "radius": 1.0, "bsdf": bsdf}
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8},
        "sensor": {
            "type": "orthographic",
            "to_world": view @ transform().scale([HALF_WIDTH, HALF_WIDTH, 1]),
            "film": {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
        },
        # The centre of a map is -z in gonio, and +z in Mitsuba.
        "light": {"type": "envmap", "filename": str(light), "to_world": transform().rotate([0, 1, 0], 180)},
        "mirror": ball(-CENTRE, {"type": "conductor", "material": "none"}),
        "ball": ball(CENTRE, material),
    })
    mi.util.write_bitmap(str(file), mi.render(scene, spp=SAMPLES), write_async=False)


def infer(gonio: str, image: Path, out: Path, *options: str) -> np.ndarray:
    """Runs gonio; returns the logarithms of the BRDF at angles below 60 degrees."""
    subprocess.run([gonio, "infer", image, "-o", out, "--no-report", *options], check=True, capture_output=True)
    found = np.load(out / "brdf.npz")
    near = [found[name] < np.radians(60) for name in ("half_angle", "difference_angle")]
    return np.log(np.maximum(found["brdf"][np.ix_(*near)], 1e-5))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("gonio")
    parser.add_argument("lights", nargs="+", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    radius = 0.5 * WIDTH / HALF_WIDTH
    circle = lambda x: f"{0.5 * WIDTH + x * radius},{0.5 * HEIGHT},{radius}"
    distances = {"mirror ball": [], "unknown light": []}
    print("| light | material | mirror ball | unknown light |\n|---|---|---|---|")
    for light in given.lights:
        for name, material in MATERIALS.items():
            stem = f"{light.stem} {name}".replace(" ", "_")
            image = given.out / f"{stem}.exr"
            photograph(light, material, image)
            ball = ["--circle", circle(CENTRE)]
            exact = infer(given.gonio, image, given.out / f"{stem}_exact", *ball, "--light", str(light), "--align-light", "fixed")
            runs = {"mirror ball": ["--mirror-ball", circle(-CENTRE)], "unknown light": ball}
            row = []
            for key, options in runs.items():
                ratio = infer(given.gonio, image, given.out / f"{stem}_{key[0]}", *options) - exact
                row.append(np.sqrt(np.mean((ratio - np.median(ratio)) ** 2)))
                distances[key].append(row[-1])
            print(f"| {light.stem} | {name} | {row[0]:.2f} | {row[1]:.2f} |", flush=True)
    for key, values in distances.items():
        print(f"{key}: median {np.median(values):.2f}, {min(values):.2f} to {max(values):.2f}")


if __name__ == "__main__":
    main()
