"""The pictures of docs/how-it-works.md, of which the README shows two.

    python docs/how_it_works.py GONIO DATA MERL WORK

GONIO is the program, DATA the folder of captured lights and RGL materials for gonio-eval, MERL a
folder of MERL tables. WORK is a folder for intermediate files. Needs numpy, matplotlib, Pillow and
OpenEXR.
"""

import json
import subprocess
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import OpenEXR
from PIL import Image

PROGRAM, DATA, MERL, WORK = (Path(argument).resolve() for argument in sys.argv[1:5])
IMAGES = Path(__file__).parent / "images"
LIGHTS = DATA / "lighting" / "test"
HANGAR, SHOP = LIGHTS / "small_hangar_01.hdr", LIGHTS / "autoshop_01.hdr"
BLUE, GREEN, MINT = (DATA / "rgl" / f"{name}_rgb.bsdf" for name in ("vch_silk_blue", "cm_military_green", "chm_mint"))
# Radius of the ball in the pictures of gonio render, over half their width.
BALL = 0.984
PAPER, INK = "#1d1f22", "#dddddd"
RGB_TO_Y = np.array([0.2126, 0.7152, 0.0722])
MERL_SCALE = np.array([1.0, 1.15, 1.66]) / 1500
# Half angles and difference angles of the rows and columns of a table, in degrees.
HALF, DIFFERENCE = (np.arange(90) / 90) ** 2 * 90, np.arange(90.0)


def gonio(*arguments):
    subprocess.run([PROGRAM, *map(str, arguments)], check=True, cwd=WORK, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def infer(photograph, out, *arguments):
    """Runs `gonio infer` and returns the content of `result.json`."""
    gonio("infer", photograph, "-o", out, "--no-report", *arguments)
    return json.loads((WORK / out / "result.json").read_text())


def render(brdf, light, out, *arguments):
    """Runs `gonio render` and returns the picture."""
    gonio("render", "--brdf", brdf, "--light", light, "-o", out, *arguments)
    return read(WORK / out)


def read(path):
    channels = OpenEXR.File(str(path)).channels()
    together = next(name for name in ("RGBA", "RGB") if name in channels)
    return np.array(channels[together].pixels, np.float64)


def write_exr(path, picture):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGBA": picture.astype(np.float32)}).write(str(path))


def write_map(path, rgb):
    """Writes an environment map as PFM."""
    height, width, _ = rgb.shape
    path.write_bytes(f"PF\n{width} {height}\n-1.0\n".encode() + rgb[::-1].astype("<f4").tobytes())


def luminance_table(path):
    """Mean of a MERL table's luminance over the azimuth, without directions below the horizon."""
    values = np.fromfile(path, offset=12).reshape(3, 90, 90, 180) * MERL_SCALE[:, None, None, None]
    seen = values.max(0) > 0
    return np.where(seen, np.tensordot(RGB_TO_Y, values, 1), 0).sum(-1) / np.maximum(seen.sum(-1), 1)


def write_mirror(path):
    """Writes a nearly perfect mirror in the MERL format: a lobe of a quarter of a degree."""
    half, difference, azimuth = np.radians(HALF)[:, None, None], np.radians(DIFFERENCE)[None, :, None], np.radians(np.arange(180))[None, None]
    flat, across = np.cos(half) * np.cos(difference), np.sin(half) * np.sin(difference) * np.cos(azimuth)
    light, view = flat - across, flat + across
    lobe = np.exp(-((np.degrees(half) / 0.25) ** 2)) / (np.pi * np.radians(0.25) ** 2)
    values = np.where((light > 0) & (view > 0), lobe / (4 * np.maximum(light * view, 1e-3)), -1)
    channels = [np.where(values < 0, -1, values / scale) for scale in MERL_SCALE]
    path.write_bytes(np.array([90, 90, 180], "<i4").tobytes() + np.stack(channels).astype("<f8").tobytes())


def tone(rgb, white):
    """Converts radiance to sRGB for display; `white` is shown just below white, with a soft shoulder."""
    x = np.clip(rgb / white, 0, None)
    x = x * (1 + x / 4) / (1 + x)
    return np.clip(np.where(x < 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055), 0, 1)


def white_of(rgb, cover=None):
    """The level that is shown as white: three times the mean over the object or the map."""
    return 3 * (rgb[..., :3].mean() if cover is None else rgb[..., :3][cover > 0.5].mean())


def ball(picture):
    """Composites a picture with coverage over the background."""
    cover = np.clip(picture[..., 3:4], 0, 1)
    own = np.divide(picture[..., :3], cover, out=np.zeros_like(picture[..., :3]), where=cover > 0)
    paper = np.array(matplotlib.colors.to_rgb(PAPER))
    return tone(own, white_of(own, cover[..., 0])) * cover + paper * (1 - cover)


def grey(picture):
    """The luminance of a picture in all three channels."""
    return np.concatenate([np.repeat(picture[..., :3] @ RGB_TO_Y[:, None], 3, -1), picture[..., 3:]], -1)


def places(size):
    """x and y of the pixels of a ball, one at its outline."""
    at = ((np.arange(size) + 0.5) / size * 2 - 1) / BALL
    return np.meshgrid(at, -at)


def misfit(picture, photograph):
    """Luminance of the photograph of a ball minus that of the picture, scaled to minimise the difference.

    The result is relative to the RMS of the photograph, and NaN beyond 75 degrees.
    """
    inside = np.hypot(*places(photograph.shape[0])) < np.sin(np.radians(75))
    a, b = picture[..., :3] @ RGB_TO_Y, photograph[..., :3] @ RGB_TO_Y
    left = b - a * (a[inside] @ b[inside]) / (a[inside] @ a[inside])
    return np.where(inside, left / np.sqrt((b[inside] ** 2).mean()), np.nan)


def page(rows, columns, width=10.2, height=5.0, **grid):
    figure, axes = plt.subplots(rows, columns, figsize=(width, height), facecolor=PAPER, squeeze=False, gridspec_kw=grid or None)
    for ax in axes.flat:
        ax.set_axis_off()
    return figure, axes


def show(ax, picture, caption, **how):
    ax.imshow(picture, **how)
    ax.set_title(caption, color=INK, fontsize=10, y=-0.06, va="top", linespacing=1.4)


def words(ax, text, size=10):
    ax.text(0, 0.5, text, color=INK, fontsize=size, va="center", ha="left", transform=ax.transAxes, linespacing=1.5)


def save(figure, name):
    figure.savefig(WORK / name, dpi=100, facecolor=PAPER, bbox_inches="tight", pad_inches=0.12)
    plt.close(figure)
    picture = Image.open(WORK / name).convert("RGB")
    picture.quantize(palette=picture.quantize(256), dither=Image.Dither.FLOYDSTEINBERG).save(IMAGES / name, optimize=True)
    print(name, (IMAGES / name).stat().st_size // 1000, "kB")


def peak(notes):
    """The peak, relative to the body, and its 90 % interval, with two significant digits."""
    low, middle, high = (rounded(notes["posterior"]["highlight"]["peak_height"][key]) for key in ("5", "50", "95"))
    return f"peak height {middle} ({low} to {high})"


def rounded(value):
    return f"{float(f'{value:.2g}'):,.0f}" if value >= 10 else f"{value:.1f}"


def true_peak(table):
    """The peak height as gonio defines it: the BRDF along the normal over the mean of the BRDF at half angles
    above 45 degrees and difference angles below 45 degrees."""
    return table[0, 0] / table[(HALF > 45) & (HALF < 80), :45].mean()


def two_explanations(photograph):
    """The photograph as a mirror in a blurry environment, and as the estimate in the estimated light."""
    write_mirror(WORK / "mirror.binary")
    gonio("light", "blue.exr", "-o", "blurry.exr")
    figure, axes = page(2, 4, height=4.6, width_ratios=[1, 2, 1, 1])
    for row, (what, brdf, light) in zip(axes, (("a mirror", "mirror.binary", "blurry.exr"), ("the estimate", "blue/brdf.npz", "blue/light.exr"))):
        made = render(brdf, light, "made.exr")
        left = np.sqrt(np.nanmean(misfit(made, photograph) ** 2))
        shown = read(WORK / light)[..., :3]
        show(row[0], ball(photograph), "the photograph")
        show(row[1], tone(shown, white_of(shown)), "a blurry environment" if what == "a mirror" else "an environment with edges and lamps", aspect="auto")
        show(row[2], ball(render(brdf, SHOP, "sample.exr")), f"{what},\nin another light")
        show(row[3], ball(made), f"in this environment:\nmisfit {100 * left:.0f} %")
        print("misfit of", what, left)
    save(figure, "two-explanations.png")


def disk_of_normals(photograph):
    """A bunny, its normals, and its brightness by normal."""
    bunny = render(BLUE, HANGAR, "bunny.exr", "--mesh", "bunny", "--size", 320)
    # Normals by the program itself: a Lambertian bunny in the lights 1 + x, 1 + y and 1 + z has the irradiance
    # 1 + 2/3 of a component of its normal.
    height = 64
    v, u = np.meshgrid((np.arange(height) + 0.5) / height * np.pi, ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5) * 2 * np.pi, indexing="ij")
    directions = np.stack([np.sin(u) * np.sin(v), np.cos(v), -np.cos(u) * np.sin(v)], -1)
    flat = np.full((3, 90, 90, 180), 0.3) / MERL_SCALE[:, None, None, None]
    (WORK / "flat.binary").write_bytes(np.array([90, 90, 180], "<i4").tobytes() + flat.astype("<f8").tobytes())

    def lit(values, name):
        write_map(WORK / f"{name}.pfm", np.repeat(values[..., None], 3, -1))
        return render("flat.binary", f"{name}.pfm", f"{name}.exr", "--mesh", "bunny", "--size", 320, "--no-shadows")[..., 1]

    even = lit(np.ones_like(u), "even")
    inside = bunny[..., 3] > 0.999
    normals = np.stack([(lit(1 + directions[..., axis], f"axis{axis}") / np.where(inside, even, 1) - 1) * 1.5 for axis in range(3)], -1)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    side = 128
    cells = np.floor((normals[inside][:, :2] * [1, -1] + 1) / 2 * side).astype(int).clip(0, side - 1)
    sums = np.zeros((side, side, 4))
    np.add.at(sums, (cells[:, 1], cells[:, 0]), np.concatenate([bunny[inside][:, :3], np.ones((len(cells), 1))], 1))
    seen = sums[..., 3] > 0
    mean = sums[..., :3] / np.maximum(sums[..., 3:], 1)
    white = white_of(bunny, bunny[..., 3])
    paper = np.array(matplotlib.colors.to_rgb(PAPER))
    figure, axes = page(1, 4, height=2.8)
    show(axes[0, 0], ball(bunny), "photograph")
    show(axes[0, 1], np.where(inside[..., None], normals / 2 + 0.5, paper), "the normals of the bunny\n(red: right, green: up)")
    show(axes[0, 2], np.where(seen[..., None], tone(mean, white), paper), "pixels sorted by normal:\nthe input of the network")
    show(axes[0, 3], ball(photograph), "a ball of the same material\nin the same light")
    save(figure, "disk-of-normals.png")
    on_disk = np.hypot(*np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 - 1] * 2)) < np.sin(np.radians(80))
    print("cells of the disk with pixels of the bunny:", (seen & on_disk).sum(), "of", on_disk.sum())


def candidates(photograph, found):
    """The measured materials with the largest weights in the light of the photograph."""
    named = [it for it in found["posterior"]["materials"] if it["weight"] >= 0.005]
    figure, axes = page(1, 5, height=2.7, width_ratios=[1, 1, 1, 1, 1.7])
    show(axes[0, 0], ball(grey(photograph)), "the photograph\nwithout colour")
    for ax, it in zip(axes[0, 1:4], named):
        name = it["name"].replace("changing-", "changing-\n")
        show(ax, ball(grey(render(MERL / f"{it['name']}.binary", HANGAR, "candidate.exr"))), f"{name}\n{100 * it['weight']:.0f} %")
    ax = axes[0, 4]
    ax.set_axis_on()
    ax.set_facecolor(PAPER)
    ax.barh([it["name"] for it in named][::-1], [100 * it["weight"] for it in named][::-1], color="#8fa3bf")
    ax.tick_params(colors=INK, labelsize=8, length=0)
    ax.yaxis.tick_right()
    ax.invert_xaxis()
    ax.set_xlabel("weight (%)", color=INK, fontsize=9)
    for spine in ax.spines.values():
        spine.set_visible(False)
    save(figure, "candidates.png")


def interval(found):
    """Two slices of the BRDF with their intervals, and the truth."""
    gonio("convert", BLUE, "truth.binary")
    tables = np.load(WORK / "blue/brdf.npz")
    truth, mean = luminance_table(WORK / "truth.binary"), tables["brdf"] @ RGB_TO_Y
    quantiles = tables["luminance_quantiles"]
    trusted = np.ix_(HALF < 80, DIFFERENCE < 80)
    seen = truth[trusted] > 0
    truth = truth * np.exp(np.median(np.log(mean[trusted][seen] / truth[trusted][seen])))
    figure, axes = plt.subplots(1, 2, figsize=(10.2, 3.4), facecolor=PAPER, sharey=True)
    for ax, column in zip(axes, (5, 60)):
        rows = HALF < 80
        low, below, above, high = quantiles[:, rows, column]
        ax.fill_between(HALF[rows], low, high, color="#3d5a80", label="90 % interval")
        ax.fill_between(HALF[rows], below, above, color="#6b8fbf", label="50 % interval")
        ax.plot(HALF[rows], mean[rows, column], color="white", label="estimate")
        ax.plot(HALF[rows], truth[rows, column], "--", color="#ffb454", label="measurement")
        ax.set_xscale("function", functions=(np.sqrt, np.square))
        ax.set_xticks([0, 1, 5, 10, 20, 40, 60, 80])
        ax.set_yscale("log")
        ax.set_facecolor(PAPER)
        ax.tick_params(colors=INK, labelsize=9)
        ax.set_title(f"difference angle {column} degrees", color=INK, fontsize=10)
        ax.set_xlabel("half angle (degrees)", color=INK, fontsize=9)
    axes[0].set_ylabel("BRDF (1/sr)", color=INK, fontsize=9)
    axes[1].legend(fontsize=9, facecolor=PAPER, labelcolor=INK, edgecolor=PAPER)
    held = (quantiles[0][trusted] <= truth[trusted]) & (truth[trusted] <= quantiles[3][trusted])
    print("the interval contains", held[seen].mean(), "of the cells;", peak(found), "true", true_peak(truth))
    save(figure, "interval.png")


def light_found():
    """The light of the photograph and the estimated light."""
    true, found = read(WORK / "lit/light.exr")[..., :3], read(WORK / "blue/light.exr")[..., :3]
    figure, axes = page(1, 2, height=2.9)
    show(axes[0, 0], tone(true, white_of(true)), "the light of the photograph", aspect="auto")
    show(axes[0, 1], tone(found, white_of(found)), "the estimated light", aspect="auto")
    save(figure, "light-found.png")


def light_of_mirror():
    """A nearly perfect mirror, its reproduction, the light of the photograph and the estimated light."""
    photograph = render(MINT, HANGAR, "mint.exr", "--size", 400, "--samples", 3)
    notes = infer("mint.exr", "mint")
    made = render("mint/brdf.npz", "mint/light.exr", "made.exr", "--size", 400)
    gonio("infer", "mint.exr", "-o", "mint-lit", "--no-report", "--light", HANGAR, "--align-light", "fixed", "--force")
    true, found = read(WORK / "mint-lit/light.exr")[..., :3], read(WORK / "mint/light.exr")[..., :3]
    figure, axes = page(1, 4, height=2.6, width_ratios=[1.3, 1.3, 2, 2])
    show(axes[0, 0], ball(photograph), "the photograph")
    show(axes[0, 1], ball(made), f"the reproduction:\nmisfit {100 * notes['residual']['misfit']:.0f} %")
    show(axes[0, 2], tone(true, white_of(true)), "the light of the photograph", aspect="auto")
    show(axes[0, 3], tone(found, white_of(found)), "the estimated light", aspect="auto")
    print("mirror", notes["residual"], peak(notes), notes["warnings"])
    save(figure, "light-of-mirror.png")


def misfits(photograph, blind, lit, wrong):
    """Photograph, reproduction and difference: unknown light, correct environment map and wrong environment map."""
    figure, axes = page(3, 4, height=7.4, width_ratios=[1, 1, 1, 2.1])
    for row, (what, notes, folder) in zip(axes, (("Unknown light", blind, "blue"), ("Known light, correct map", lit, "lit"), ("Known light, map of another place", wrong, "wrong"))):
        made = render(f"{folder}/brdf.npz", f"{folder}/light.exr", "made.exr")
        show(row[0], ball(photograph), "photograph")
        show(row[1], ball(made), "reproduction")
        show(row[2], misfit(made, photograph), "difference", cmap="RdBu_r", vmin=-0.6, vmax=0.6)
        residual = notes["residual"]
        text = f"{what}\nmisfit {100 * residual['misfit']:.0f} % (expected: {100 * residual['expected']:.0f} %)"
        words(row[3], text + "\n" + ("No warning" if not notes["warnings"] else "Warning: " + wrapped(notes["warnings"], 44)), 9)
        print(what, residual["misfit"], residual["expected"], peak(notes), notes["warnings"])
    save(figure, "misfit.png")


def wrapped(lines, width):
    """Joins texts and wraps them to lines of at most `width` characters."""
    rows = [""]
    for word in "; ".join(lines).split():
        if len(rows[-1]) + len(word) + 1 > width:
            rows.append("")
        rows[-1] = (rows[-1] + " " + word).strip()
    return "\n".join(rows)


def comparison(name, photograph, notes, folder, truth, table, comment):
    """A photograph, the estimate and the truth in another light, and the warnings of gonio."""
    figure, axes = page(1, 4, height=2.5, width_ratios=[1, 1, 1, 1.8])
    show(axes[0, 0], ball(photograph), "photograph")
    show(axes[0, 1], ball(render(f"{folder}/brdf.npz", SHOP, "found.exr")), "estimate, in another light")
    show(axes[0, 2], ball(render(truth, SHOP, "true.exr")), "truth, in another light")
    said = "Warning: " + wrapped(notes["warnings"], 40) if notes["warnings"] else "No warning"
    words(axes[0, 3], f"{comment}\n{peak(notes)}\ntrue peak height: {rounded(true_peak(table))}\n{said}", 9)
    print(name, peak(notes), "true", true_peak(table), notes["warnings"], notes["residual"]["misfit"], notes["residual"]["expected"])
    save(figure, name)


def dull_light():
    """A metal under an even sky."""
    height = 128
    y = np.cos(np.pi * (np.arange(height) + 0.5) / height)
    overcast = 0.25 + 0.75 * np.clip((y + 0.3) / 1.3, 0, 1)
    write_map(WORK / "overcast.pfm", np.broadcast_to(overcast[:, None, None], (height, 2 * height, 3)))
    nickel = MERL / "nickel.binary"
    dull = render(nickel, "overcast.pfm", "dull.exr")
    comparison("failure-dull-light.png", dull, infer("dull.exr", "dull"), "dull", nickel, luminance_table(nickel), "Nickel under an even grey sky")


def two_paints():
    """A ball painted in two shades."""
    checked = render(GREEN, HANGAR, "green.exr")
    x, y = places(checked.shape[0])
    east, north = np.arctan2(x, np.sqrt(np.maximum(1 - x * x - y * y, 0))), np.arcsin(np.clip(y, -1, 1))
    dark = (np.floor(east / np.radians(15)) + np.floor(north / np.radians(15))) % 2 == 0
    checked[..., :3] *= np.where(dark, 0.5, 1)[..., None]
    write_exr(WORK / "checked.exr", checked)
    gonio("convert", GREEN, "green.binary")
    notes = infer("checked.exr", "checked")
    comparison("two-paints.png", checked, notes, "checked", GREEN, luminance_table(WORK / "green.binary"), "Satin paint in two shades")


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    photograph = render(BLUE, HANGAR, "blue.exr")
    blind = infer("blue.exr", "blue")
    lit = infer("blue.exr", "lit", "--light", HANGAR, "--align-light", "fixed")
    wrong = infer("blue.exr", "wrong", "--light", SHOP, "--force")
    two_explanations(photograph)
    disk_of_normals(photograph)
    candidates(photograph, blind)
    interval(blind)
    light_found()
    light_of_mirror()
    misfits(photograph, blind, lit, wrong)
    dull_light()
    two_paints()


if __name__ == "__main__":
    main()
