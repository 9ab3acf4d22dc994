"""Times the usual alternative on one photograph: joint gradient descent on light and material with Mitsuba 3.

    pip install mitsuba==3.9.1 (and an LLVM library: DRJIT_LIBLLVM_PATH sets its path if it is not found)
    python crates/gonio-app/benches/mitsuba_descent.py samples/ball.exr [STEPS]

The script fits a sphere of the `principled` model in a lat-long light of 32 x 16 pixels to the photograph, reduced to
64 x 64 pixels. It minimises the squared difference by Adam, with 16 rays per pixel. The result is one solution without
an uncertainty. It depends on the initial values.
"""

import sys
import time

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")

SIZE = 64
LIGHT = (16, 32, 3)
RAYS = 16


def photograph(path: str) -> mi.TensorXf:
    """Returns the picture in linear RGB at 64 x 64 pixels, scaled to a mean of one."""
    picture = mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    values = np.array(picture.resample([SIZE, SIZE]))
    return mi.TensorXf(np.maximum(values, 0) / values.mean())


def scene() -> mi.Scene:
    """Returns a scene with a sphere that fills the picture."""
    looks = mi.ScalarTransform4f().look_at(origin=[0, 0, 4], target=[0, 0, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    material = {"type": "principled", "roughness": 0.4, "metallic": 0.2, "base_color": {"type": "rgb", "value": 0.5}}
    light = mi.Bitmap(np.ones(LIGHT, np.float32))
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct", "hide_emitters": True},
            "sensor": {"type": "orthographic", "to_world": looks, "film": film},
            "ball": {"type": "sphere", "bsdf": {"type": "twosided", "material": material}},
            "light": {"type": "envmap", "bitmap": light},
        }
    )


def main(path: str, steps: int) -> None:
    start = time.perf_counter()
    target, ball = photograph(path), scene()
    parameters = mi.traverse(ball)
    kept = [k for k in parameters.keys() if k.endswith(("roughness.value", "metallic.value", "base_color.value", "light.data"))]
    optimiser = mi.ad.Adam(lr=0.02)
    for key in kept:
        optimiser[key] = parameters[key]
    parameters.update(optimiser)
    ready = time.perf_counter()
    for step in range(steps):
        picture = mi.render(ball, parameters, spp=RAYS, seed=step)
        error = dr.mean(dr.square(picture - target), axis=None)
        dr.backward(error)
        optimiser.step()
        for key in kept:
            top = 1e4 if key == "light.data" else 0.99
            optimiser[key] = dr.clip(optimiser[key], 0.01, top)
        parameters.update(optimiser)
    off = np.sqrt(np.array(error)).item() / np.sqrt(np.mean(np.array(target) ** 2)).item()
    end = time.perf_counter()
    print(f"mitsuba {mi.__version__}: {steps} steps at {SIZE} x {SIZE} in {end - ready:.1f} s, {end - start:.1f} s with the start")
    print(f"residual relative to the photograph: {100 * off:.1f} %")
    for key in kept[:3]:
        print(key, np.array(parameters[key]).ravel())


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 200)
