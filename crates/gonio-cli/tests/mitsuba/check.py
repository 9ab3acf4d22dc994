"""Renders exports of gonio in Mitsuba 3, and compares them with `gonio render` of the same BRDF under the same light.

    python check.py GONIO RESULTS [BRDF...]

GONIO is the program, RESULTS a folder of results of `gonio infer`, and BRDF are further BRDF files. The script creates the light and two analytic materials. Requires numpy
and mitsuba. The exit code is 1 if the error of a picture exceeds its limit.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

SIZE = 96
SAMPLES = 256
# Limits of the log relight error.
LIMITS = {"measured": 0.05, "spectral": 0.08, "principled": 0.05}


def run(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, stdout=subprocess.DEVNULL)


def read(path):
    """Reads an EXR file as height x width x RGBA."""
    return np.array(mi.Bitmap(str(path)).convert(component_format=mi.Struct.Type.Float32), dtype=np.float64)


def write_merl(path, f):
    """Writes a BRDF in 1/sr as a MERL table; `f(theta_h, theta_d)` returns RGB in the last axis."""
    theta_h = (np.arange(90) / 90) ** 2 * np.pi / 2
    theta_d = np.radians(np.arange(90))
    rgb = np.moveaxis(f(theta_h[:, None], theta_d[None, :]), -1, 0)
    units = np.array([1500, 1500 / 1.15, 1500 / 1.66])
    with open(path, "wb") as file:
        np.array([90, 90, 180], "<i4").tofile(file)
        np.repeat((rgb * units[:, None, None])[..., None], 180, axis=-1).astype("<f8").tofile(file)


def coat(colour, width):
    """Returns a diffuse body under a coat with Fresnel reflection."""

    def f(theta_h, theta_d):
        fresnel = 0.04 + 0.96 * (1 - np.cos(theta_d)) ** 5
        lobe = fresnel / (4 * np.pi * width**2 * (1 + (np.tan(theta_h) / width) ** 2) ** 2)
        return np.array(colour) / np.pi + lobe[..., None]

    return f


def make_light(path):
    """Writes an environment map without symmetries: lamps on a sky with a gradient. It is smooth, so that a rendering with 256 samples has little noise."""
    height = 64
    v, u = np.mgrid[:height, : 2 * height]
    azimuth, polar = (2 * np.pi * ((u + 0.5) / (2 * height) - 0.5), np.pi * (v + 0.5) / height)
    d = np.stack([np.sin(azimuth) * np.sin(polar), np.cos(polar), -np.cos(azimuth) * np.sin(polar)], axis=-1)
    sky = 0.4 + 0.3 * d[..., 1:2] * np.array([0.6, 0.8, 1.0])
    for centre, width, colour in [([-0.7, 0.5, 0.6], 0.35, [6, 5, 4]), ([0.9, 0.1, 0.3], 0.25, [2, 4, 6]), ([0.2, 0.7, -0.8], 0.4, [5, 6, 3])]:
        centre = np.array(centre) / np.linalg.norm(centre)
        sky = sky + np.exp((d @ centre - 1) / width**2)[..., None] * np.array(colour)
    mi.Bitmap(sky.astype(np.float32)).write(str(path))


def render(bsdf, light, turned=True):
    """Renders a sphere of radius one orthographically along -z. As in `gonio render`, the margin is two pixels."""
    half = 0.5 * SIZE / (0.5 * SIZE - 2.0)
    transform = mi.ScalarTransform4f
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {
            "type": "orthographic",
            "to_world": transform().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]).scale([half, half, 1]),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgba", "component_format": "float32"},
            "sampler": {"type": "multijitter", "sample_count": SAMPLES},
        },
        "sphere": {"type": "sphere", "bsdf": bsdf},
        # The centre of a map is -z in gonio, and +z in Mitsuba.
        "light": {"type": "envmap", "filename": str(light), "to_world": transform().rotate([0, 1, 0], 180 if turned else 0)},
    })
    return np.array(mi.render(scene), dtype=np.float64)


def off(own, other):
    """Returns the log relight error over the pixels that the sphere covers entirely, and the scale s. The error is the root mean square of ln((s b + e)/(a + e)), where e
    is 1 % of the mean."""
    covered = (own[..., 3] > 0.999) & (other[..., 3] > 0.999)
    a, b = own[covered][:, :3], other[covered][:, :3]
    scale = (a * b).sum() / (b * b).sum()
    floor = 0.01 * a.mean()
    return np.sqrt(np.mean(np.log((scale * b + floor) / (a + floor)) ** 2)), scale


def main():
    gonio, results = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    failed = False
    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        mi.set_variant("scalar_rgb")
        mi.set_log_level(mi.LogLevel.Error)
        light = work / "light.exr"
        make_light(light)
        inputs = {"found": results}
        for name, f in [("satin", coat([0.4, 0.1, 0.05], 0.3)), ("glossy", coat([0.05, 0.1, 0.3], 0.03))]:
            inputs[name] = work / f"{name}.binary"
            write_merl(inputs[name], f)
        inputs |= {Path(path).stem: Path(path) for path in sys.argv[3:]}
        own = {}
        for name, path in inputs.items():
            out = work / name
            run(gonio, "export", path, "-o", out, "--to", "merl,bsdf,mitsuba", "--tables")
            for which, file in [("measured", "brdf.binary"), ("principled", "principled.binary")]:
                run(gonio, "render", "--brdf", out / file, "--light", light, "--size", SIZE, "--samples", 2, "-o", work / "own.exr")
                own[name, which] = read(work / "own.exr")

        def check(name, kind, own, picture):
            nonlocal failed
            error, scale = off(own, picture)
            good = error < LIMITS[kind] and abs(scale - 1) < 0.03
            failed |= not good
            print(f"{name:8} {kind:12} log relight {error:.4f} (limit {LIMITS[kind]}), scale {scale:.4f}{'' if good else '  FAILED'}")

        for name in inputs:
            measured = {"type": "measured", "filename": str(work / name / "brdf_rgb.bsdf")}
            picture = render(measured, light)
            check(name, "measured", own[name, "measured"], picture)
            if name == "satin":
                wrong, _ = off(own[name, "measured"], render(measured, light, turned=False))
                print(f"{name:8} with the light rotated by 180 degrees: {wrong:.2f}")
                failed |= wrong < 0.1
            principled = mi.load_file(str(work / name / "principled.xml"))
            check(name, "principled", own[name, "principled"], render(principled, light))
            entry = json.loads((work / name / "export.json").read_text())["exports"]
            for target in ("bsdf", "mitsuba"):
                print(f"{name:8} {target:12} reported by gonio export: log relight {entry[target]['log_relight']:.4f} in the studio light")
        if "scalar_spectral" in mi.variants():
            mi.set_variant("scalar_spectral")
            for name in inputs:
                picture = render({"type": "measured", "filename": str(work / name / "brdf_spec.bsdf")}, light)
                check(name, "spectral", own[name, "measured"], picture)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
