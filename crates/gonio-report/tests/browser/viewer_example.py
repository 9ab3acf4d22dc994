"""Writes a page for viewer.mjs: the viewer with analytic materials and lights.

    python3 viewer_example.py OUTPUT.html
"""

import base64
import json
import sys
from pathlib import Path

import numpy as np

VIEWER = Path(__file__).parents[2] / "viewer"
SIDE = 90
THETA_H = (np.arange(SIDE) / SIDE) ** 2 * (np.pi / 2)
THETA_D = np.radians(np.arange(SIDE))


def packed(values):
    """Encodes non-negative values as 16-bit logarithms; code 0 is zero."""
    values = np.asarray(values, float)
    some = values > 0
    low, high = (float(f(np.log2(values[some]))) for f in (np.min, np.max))
    high = max(high, low + 1e-6)
    logs = np.log2(np.where(some, values, 1.0))
    codes = np.where(some, 1 + np.rint((logs - low) / (high - low) * 65534), 0).astype("<u2")
    return {"low": low, "high": high, "codes": base64.b64encode(codes.tobytes()).decode()}


def material(name, f):
    """Encodes a material; `f(theta_h, theta_d)` returns the channels along its first axis."""
    h, d = np.meshgrid(THETA_H, THETA_D, indexing="ij")
    table = np.stack([np.broadcast_to(channel, h.shape) for channel in f(h, d)], axis=-1)
    return {"name": name, **packed(table)}


def microfacets(h, d, alpha, reflectance):
    """Returns a GGX lobe with Schlick's Fresnel term, divided by four times the squared cosine of the difference angle."""
    normal = alpha**2 / (np.pi * (np.cos(h) ** 2 * (alpha**2 - 1) + 1) ** 2)
    shadow = np.maximum(np.cos(d), 0.06) ** 2
    return [(r + (1 - r) * (1 - np.cos(d)) ** 5) * normal / (4 * shadow) for r in reflectance]


def glossy(h, d, albedo, alpha):
    lobe = microfacets(h, d, alpha, [0.04])[0]
    return [a / np.pi + lobe for a in albedo]


def directions(width, height):
    azimuth = 2 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    polar = np.pi * (np.arange(height) + 0.5) / height
    a, p = np.meshgrid(azimuth, polar)
    return np.stack([np.sin(a) * np.sin(p), np.cos(p), -np.cos(a) * np.sin(p)], axis=-1)


def unit(*v):
    return np.array(v) / np.linalg.norm(v)


def light(name, radiance):
    height, width, _ = radiance.shape
    return {"name": name, "width": width, "height": height, **packed(radiance)}


def smooth(x):
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def studio(width=128, height=64):
    """Returns softboxes and a small lamp in a room with a gradient."""
    d = directions(width, height)
    up = 0.5 * (d[..., 1:2] + 1)
    total = np.array([0.20, 0.17, 0.15]) * (1 - up**2) + np.array([0.50, 0.55, 0.62]) * up**2
    for centre, half, colour, soft in [
        (unit(-0.75, 0.75, 0.7), (0.42, 0.30), (9.0, 8.6, 8.0), 0.05),
        (unit(1.0, 0.15, 0.35), (0.09, 0.75), (6.0, 6.6, 7.6), 0.02),
        (unit(0.25, 0.35, -1.0), (0.35, 0.25), (5.0, 5.4, 6.2), 0.03),
        (unit(-0.15, -0.55, 0.9), (0.5, 0.12), (0.9, 0.7, 0.5), 0.1),
    ]:
        right = np.cross([0, 1, 0], centre)
        right /= np.linalg.norm(right)
        top = np.cross(centre, right)
        depth = d @ centre
        safe = np.where(depth > 0, depth, 1)
        inside = [smooth((h - np.abs(d @ axis / safe)) / soft) for axis, h in zip((right, top), half)]
        total = total + np.where(depth > 0, inside[0] * inside[1], 0)[..., None] * np.array(colour)
    away = np.arccos(np.clip(d @ unit(-0.55, 0.25, 0.95), -1, 1))
    return total + smooth((0.045 - away) / 0.01)[..., None] * np.array([150.0, 135.0, 110.0])


def sun(width=128, height=64):
    """Returns a sky over dark ground, with a sun of one or two texels that is 10,000 times as bright."""
    d = directions(width, height)
    y = d[..., 1:2]
    sky = np.array([0.35, 0.55, 1.0]) * np.clip(y, 0, 1) + np.array([0.9, 0.9, 0.9]) * (1 - np.clip(y, 0, 1)) ** 4
    out = np.where(y > 0, sky, np.array([0.12, 0.10, 0.07]))
    away = np.arccos(np.clip(d @ unit(0.6, 0.7, 0.5), -1, 1))
    return out + (away < 0.03)[..., None] * np.array([1e4, 0.93e4, 0.8e4])


def overhead(width=128, height=64):
    """Returns stripes that meet at both poles, which make seams visible."""
    d = directions(width, height)
    stripes = 0.5 + 0.5 * np.cos(6 * np.arctan2(d[..., 0], d[..., 2]))
    return np.stack([0.1 + stripes, 0.1 + 0.5 * stripes + 0.3 * np.abs(d[..., 1]), 0.6 + 0 * stripes], axis=-1)


def patch(width=64, height=32):
    """Returns radiance 1, with 3 x 3 texels of radiance 200."""
    out = np.ones((height, width, 3))
    out[8:11, 8:11] = 200.0
    return out


def data():
    return {
        "materials": [
            material("glossy plastic", lambda h, d: glossy(h, d, (0.2, 0.05, 0.03), 0.06)),
            material("matte", lambda h, d: [np.full_like(h, a / np.pi) for a in (0.6, 0.5, 0.35)]),
            material("satin metal", lambda h, d: microfacets(h, d, 0.25, (0.95, 0.75, 0.4))),
            material("chrome", lambda h, d: microfacets(h, d, 0.004, (0.55, 0.56, 0.57))),
            material("white Lambertian", lambda h, d: [np.full_like(h, 1 / np.pi)] * 3),
            material("lobe", lambda h, d: [0.05 + 20 / (1 + (h / 0.1) ** 2) ** 2] * 3),
        ],
        "lights": [
            light("studio", studio()),
            light("sun", sun()),
            light("stripes to the poles", overhead()),
            light("even", np.ones((32, 64, 3))),
            light("patch", patch()),
        ],
    }


PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Sphere under embedded lights</title>
<style>
:root {{ color-scheme: light dark; }}
body {{ margin: 1rem; font-family: system-ui, sans-serif; background: #fdfdfb; color: #1d2126; }}
@media (prefers-color-scheme: dark) {{ body {{ background: #16181b; color: #e6e6e3; }} }}
{css}</style>
</head>
<body>
<h1>Sphere under embedded lights</h1>
<div id="sphere"></div>
<script type="application/json" id="sphere-data">{data}</script>
<script>
{js}</script>
<script>
globalThis.viewer = gonioViewer(document.getElementById("sphere"), JSON.parse(document.getElementById("sphere-data").textContent));
</script>
</body>
</html>
"""

if __name__ == "__main__":
    css, renderer, viewer = ((VIEWER / name).read_text() for name in ("viewer.css", "renderer.js", "viewer.js"))
    Path(sys.argv[1]).write_text(PAGE.format(css=css, js=renderer + viewer, data=json.dumps(data())))
