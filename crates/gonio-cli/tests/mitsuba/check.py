"""Renders what gonio exports in Mitsuba 3, and compares with gonio's own pictures of the same BRDF under the same light.

    python check.py GONIO WORKDIR

GONIO is the program. In WORKDIR a studio light and materials are made, exported and rendered by both. Needs numpy and mitsuba. Ends with 1 if a picture
is off by more than its limit.
"""

import json
import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

SIZE = 96


def run(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, stdout=subprocess.DEVNULL)


def read(path):
    """Height x width x channels of an EXR, as floats."""
    return np.array(mi.Bitmap(str(path)).convert(component_format=mi.Struct.Type.Float32), dtype=np.float64)


def scene(bsdf, light, spp):
    """A sphere of radius one seen along -z without perspective, as `gonio render` frames it: two empty pixels around it."""
    half = 0.5 * SIZE / (0.5 * SIZE - 2.0)
    to_world = mi.ScalarTransform4f
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {
            "type": "orthographic",
            # Mitsuba's cameras look along +z of their own, with x to the left.
            "to_world": to_world().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]).scale([half, half, 1]),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgba", "component_format": "float32"},
            "sampler": {"type": "independent", "sample_count": spp},
        },
        "sphere": {"type": "sphere", "bsdf": bsdf},
        # The middle of gonio's maps is along -z, of Mitsuba's along +z.
        "light": {"type": "envmap", "filename": str(light), "to_world": to_world().rotate([0, 1, 0], 180)},
    })


def compare(own, other):
    """Log relight error over pixels that the sphere covers wholly, after one scale for all, which has to be near one."""
    covered = (own[..., 3] > 0.999) & (other[..., 3] > 0.999)
    a, b = own[covered][:, :3], other[covered][:, :3]
    scale = (a * b).sum() / (b * b).sum()
    floor = 0.01 * a.mean()
    log = np.sqrt(np.mean(np.log((scale * b + floor) / (a + floor)) ** 2))
    relative = np.sqrt(((scale * b - a) ** 2).sum() / (a**2).sum())
    return scale, log, relative


if __name__ == "__main__":
    gonio, work = Path(sys.argv[1]), Path(sys.argv[2])
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    light = Path(sys.argv[3])
    for name in sys.argv[4:]:
        brdf = Path(name)
        own = work / "own.exr"
        run(gonio, "render", "--brdf", brdf, "--light", light, "--size", SIZE, "--samples", 3, "-o", own)
        picture = mi.render(scene({"type": "measured", "filename": str(brdf.with_suffix(".bsdf"))}, light, 256))
        mi.Bitmap(picture).write(str(work / "other.exr"))
        print(name, compare(read(own), np.array(picture, dtype=np.float64)))
