"""Runs exported scripts in Blender unchanged, and compares each picture with `gonio render` of the table of the same fit.

    python3 blender.py GONIO RESULTS [BRDF...]

GONIO is the program, RESULTS a folder of results of `gonio infer`, and BRDF are further BRDF files. The script adds a paint with a coloured highlight, whose fit has a tint.
Requires the package bpy (Blender 4.2 or later as a module) and numpy, which bpy installs. The exit code is 1 if the error of a picture exceeds LIMIT.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

# Limit of the root mean square difference of logarithms. It allows for multiple scattering, which the fit does not model, for denoising, and for 8-bit values.
LIMIT = 0.05


def run(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, stdout=subprocess.DEVNULL)


def read(path):
    """Reads an image as height x width x RGBA, without colour conversion."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    width, height = image.size
    return np.array(image.pixels[:], dtype=np.float64).reshape(height, width, 4)[::-1]


def linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def error(shown, own):
    """Returns the difference over the pixels that both pictures cover entirely and that are neither clipped nor nearly black, and their share of the sphere."""
    inside = own[..., 3] > 0.999
    told = inside & (shown[..., 3] > 0.999) & (shown[..., :3].max(axis=-1) < 0.999) & (shown[..., :3].min(axis=-1) > 0.1)
    logs = np.log(linear(shown[told][:, :3]) / own[told][:, :3])
    return np.sqrt(np.mean(logs**2)), told.sum() / inside.sum()


def paint(path):
    """Writes a blue paint whose highlight is orange at normal incidence and white at grazing angles."""
    half, difference = (np.arange(90) / 90) ** 2 * np.pi / 2, np.radians(np.arange(90))
    lobe = 1 / (4 * np.pi * 0.1**2 * (1 + (np.tan(half) / 0.1) ** 2) ** 2)
    normal = np.array([0.06, 0.02, 0.005])
    fresnel = normal + (1 - normal) * ((1 - np.cos(difference)) ** 5)[:, None]
    np.savez(path, brdf=np.array([0.01, 0.015, 0.03]) / np.pi + lobe[:, None, None] * fresnel)


def check(gonio, brdf, limit_of_tint=1.0):
    """Checks a BRDF; its fit must have a tint of at most the limit in one channel."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        run(gonio, "export", brdf, "--to", "blender", "--tables", "-o", folder)
        tint = json.loads((folder / "export.json").read_text())["exports"]["blender"]["parameters"]["specular_color"]
        run(sys.executable, folder / "blender.py")
        shown = read(folder / "blender.png")
        own = Path(scratch) / "own.exr"
        run(gonio, "render", "--brdf", folder / "blender.binary", "--light", folder / "light.exr", "-o", own, "--size", len(shown))
        own = read(own)
        [stops] = re.findall(r"^EXPOSURE = (\S+)", (folder / "blender.py").read_text(), re.MULTILINE)
    own[..., :3] *= 2 ** float(stops)
    log, share = error(shown, own)
    coverage = abs(shown[..., 3] - own[..., 3]).mean()
    mirrored, _ = error(shown[:, ::-1], own)
    shifted, _ = error(np.roll(shown, len(shown) // 64, axis=1), own)
    good = log < LIMIT < min(mirrored, shifted) and share > 0.9 and coverage < 0.005 and min(tint) <= limit_of_tint
    print(f"{Path(brdf).stem}: difference {log:.4f} (limit {LIMIT}) over {share:.0%}; mirrored {mirrored:.2f}, shifted {shifted:.2f}, tint {min(tint):.2f}{'' if good else '  FAILED'}")
    return good


def main(gonio, results, *brdfs):
    with tempfile.TemporaryDirectory() as scratch:
        tinted = Path(scratch) / "paint.npz"
        paint(tinted)
        # A weaker tint would hide an error in the angles to which it applies.
        good = [check(gonio, tinted, 0.5), *(check(gonio, brdf) for brdf in (results, *brdfs))]
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
