"""Spectra of red, green and blue for `crates/gonio-io/src/rgl/spectra.rs`.

The three spectra S_k are linear between evenly spaced wavelengths. The mixture sum_k c_k S_k is the
spectrum of a colour c of the sRGB gamut. The spectra satisfy four conditions:

* no spectrum is negative;
* their sum is one (white reflects all light alike);
* under D65 and the CIE 1931 observer each has the linear sRGB colour that it represents;
* among all such spectra they are the smoothest (least sum of squared second differences).

The method is that of Mallett and Yuksel 2019, "Spectral Primary Decomposition for Rendering with
sRGB Reflectance", on fewer wavelengths.

Needs numpy, scipy, colour-science. Prints the rows of the table.
"""

import colour
import numpy as np
from scipy.optimize import LinearConstraint, minimize

WAVELENGTHS = np.linspace(380, 730, 15)

cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(colour.SpectralShape(360, 780, 1))
d65 = colour.SDS_ILLUMINANTS["D65"].copy().align(colour.SpectralShape(360, 780, 1))
fine = cmfs.wavelengths
weights = cmfs.values * d65.values[:, None]
weights /= weights[:, 1].sum()
# Colour of the hat function at each wavelength; beyond the first and last they go on.
hats = np.array([np.interp(fine, WAVELENGTHS, row) for row in np.eye(len(WAVELENGTHS))])
xyz = hats @ weights
to_rgb = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB
rgb = xyz @ to_rgb.T
# White as these integrals have it, not as the matrix was rounded.
rgb /= rgb.sum(axis=0)

n = len(WAVELENGTHS)
second = np.diff(np.eye(n), 2, axis=0)
smooth = np.kron(np.eye(3), second.T @ second)
colours = np.kron(np.eye(3), rgb.T)
ones = np.tile(np.eye(n), 3)
constraints = [
    LinearConstraint(colours, np.eye(3).ravel(), np.eye(3).ravel()),
    LinearConstraint(ones, np.ones(n), np.ones(n)),
]
found = minimize(
    lambda x: x @ smooth @ x, np.full(3 * n, 1 / 3), jac=lambda x: 2 * smooth @ x, hess=lambda x: 2 * smooth,
    method="trust-constr", bounds=[(0, 1)] * (3 * n), constraints=constraints,
    options={"maxiter": 5000, "gtol": 1e-10, "xtol": 1e-12},
)
spectra = found.x.reshape(3, n)
assert abs(spectra @ rgb - np.eye(3)).max() < 1e-4, spectra @ rgb
for wavelength, row in zip(WAVELENGTHS, spectra.T):
    print(f"    ({wavelength:.1f}, [{row[0]:.4f}, {row[1]:.4f}, {row[2]:.4f}]),")
