"""Infers the material of the sample and prints it. Runs with an installed wheel and NumPy only."""

from pathlib import Path

import gonio

ROOT = Path(__file__).resolve().parents[3]


def main() -> None:
    inside = Path(gonio.__file__).resolve()
    assert ROOT not in inside.parents or "site-packages" in inside.parts, f"{inside} is not installed"
    found = gonio.infer(ROOT / "samples" / "ball.exr", pictures=False)
    low, median, high = found.ggx_alpha
    assert abs(found.brdf.albedo - 0.5) < 1e-3 and 0 < low <= median <= high <= 1, found
    print(f"gonio {gonio.__version__}: {found}, GGX alpha {median:.3f} ({low:.3f} to {high:.3f})")


main()
