"""Loads exports of gonio in Mitsuba 3 with `mi.load_file`, and compares renderings of the exported scene with `gonio render`.

    python scene.py GONIO RESULTS

GONIO is the program, and RESULTS a folder of results of `gonio infer`. Requires numpy and mitsuba. The exit code is 1 if a file does not load.
It is also 1 if the difference of the scene from `gonio render` with the same BRDF and light exceeds LIMIT plus the noise of the samples.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

# The scene has the framing of `gonio render` at this size.
SIZE = 256
SAMPLES = 8
# Side of the blocks of pixels whose means are compared, because single pixels are mostly noise.
BLOCK = 8
# Limits of the relative error without noise. For a tensor, it allows for 0.5 % from `gonio render` and for the reported error of the tensor, and for more with spectra;
# for `principled`, for the error of a table over two angles.
LIMIT = {"brdf_measured.xml": 0.015, "brdf_measured_spectral.xml": 0.03, "principled.xml": 0.04}
# Table with which each file is compared.
TABLE = {"brdf_measured.xml": "brdf.binary", "brdf_measured_spectral.xml": "brdf.binary", "principled.xml": "principled.binary"}
RGB = ["brdf_measured.xml", "principled.xml"]
# Loads the files in a compiled variant, and renders with it.
COMPILED = """
import sys
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
for file in sys.argv[1:]:
    mi.load_file(file)
    print(file, "loads", flush=True)
scene = mi.load_file("scene.xml", size=32, samples=4)
print("scene.xml loads", flush=True)
assert mi.render(scene).shape == (32, 32, 4)
print("scene.xml is rendered")
"""


def run(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, stdout=subprocess.DEVNULL)


def read(path):
    return np.array(mi.Bitmap(str(path)).convert(component_format=mi.Struct.Type.Float32), dtype=np.float64)


def compare(own, pictures):
    """Returns the relative mean square error of two pictures with independent noise over the blocks that the sphere covers, and its standard error from noise. The
    error is the mean product of their deviations, in which independent noise cancels."""
    side = SIZE // BLOCK
    own, a, b = (picture.reshape(side, BLOCK, side, BLOCK, 4).mean(axis=(1, 3)) for picture in (own, *pictures))
    covered = np.minimum(np.minimum(own[..., 3], a[..., 3]), b[..., 3]) > 0.999
    own, a, b = (picture[covered][:, :3] for picture in (own, a, b))
    products = ((a - own) * (b - own)).mean(axis=1) / np.mean(own**2)
    return products.mean(), products.std() / np.sqrt(len(products))


def check(folder, file, own):
    """Returns whether the error of the scene with this material is below the limit plus three standard errors."""
    scene = mi.load_file(str(folder / "scene.xml"), material=file, samples=SAMPLES)
    pictures = [np.array(mi.render(scene, seed=seed), dtype=np.float64) for seed in (0, 1)]
    (square, doubt), limit = compare(own, pictures), LIMIT[file] ** 2
    good = abs(pictures[0][..., 3] - own[..., 3]).mean() < 0.005 and square < limit + 3 * doubt
    # Mirrored and shifted pictures (by 3 pixels) must fail, so that noise does not hide errors.
    for what, wrong in [("mirrored", [picture[:, ::-1] for picture in pictures]), ("shifted", [np.roll(picture, 3, 1) for picture in pictures])]:
        off, unsure = compare(own, wrong)
        good &= off > limit + 3 * unsure
        print(f"{file:26} {what:10} {np.sqrt(max(off, 0)):.3f}")
    print(f"{file:26} error {np.sqrt(max(square, 0)):.4f} (limit {LIMIT[file]}; allowance for noise {np.sqrt(3 * doubt):.4f}){'' if good else '  FAILED'}")
    return good


def compiled(folder):
    """Returns whether the files load and render in a compiled variant. Ignores failures of LLVM on this system."""
    done = subprocess.run([sys.executable, "-c", COMPILED, *RGB], cwd=folder, capture_output=True, text=True)
    print(*(f"llvm_ad_rgb: {line}\n" for line in done.stdout.splitlines()), sep="", end="")
    loaded = done.stdout.count(" loads\n") == len(RGB) + 1
    if loaded and done.returncode and "LLVM ERROR" in done.stderr:
        print(f"llvm_ad_rgb: LLVM does not work on this system: {next(line for line in done.stderr.splitlines() if 'LLVM' in line)[:100]}")
        return True
    print(done.stderr, end="", file=sys.stderr)
    return not done.returncode


def main(gonio, results):
    gonio = Path(gonio).resolve()
    good = True
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "export"
        run(gonio, "export", results, "-o", folder, "--to", "merl,bsdf,mitsuba", "--tables")
        # The files must load from any working directory.
        mi.set_variant("scalar_rgb")
        mi.set_log_level(mi.LogLevel.Error)
        for file in RGB:
            assert isinstance(mi.load_file(str(folder / file)), mi.BSDF), file
        assert isinstance(mi.load_file(str(folder / "scene.xml")), mi.Scene)
        own = {}
        for table in ("brdf.binary", "principled.binary"):
            picture = Path(work) / "own.exr"
            run(gonio, "render", "--brdf", folder / table, "--light", folder / "light.exr", "--size", SIZE, "--samples", 2, "-o", picture)
            own[table] = read(picture)
        for file in RGB:
            good &= check(folder, file, own[TABLE[file]])
        mi.set_variant("scalar_spectral")
        good &= check(folder, "brdf_measured_spectral.xml", own["brdf.binary"])
        good &= compiled(folder)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
