"""Tests of tools/bench.py."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import bench

APP = """\
3 products of 2000 x 2000 in f64: 0.500 s, 96 GFLOP/s

                                             reading     light     total     units    of peak
samples/ball.exr                               0.022     0.872     2.211       4.4       17 %
bunny of 13136 triangles, 256 x 256            0.022               1.702       3.4           

sphere of 256 x 256 under a map of 1024 x 512: 1.60 s, 3.2 units
"""

DIVAN = """\
Timer precision: 17 ns
speed              fastest       │ slowest       │ median        │ mean          │ samples │ iters
├─ cost            5.071 ms      │ 6.1 ms        │ 5.2 ms        │ 5.3 ms        │ 20      │ 20
├─ iteration                     │               │               │               │         │
│  ├─ Blocks       54.2 ms       │ 60 ms         │ 55 ms         │ 56 ms         │ 10      │ 10
│  ╰─ Printed      1.3 s         │ 1.4 s         │ 1.3 s         │ 1.3 s         │ 10      │ 10
╰─ render_point                  │               │               │               │         │
   ╰─ 0.02         80.5 µs       │ 90 µs         │ 81 µs         │ 82 µs         │ 100     │ 100
"""


class Rows(unittest.TestCase):
    def test_unit_and_rows_of_the_app(self) -> None:
        self.assertEqual(bench.unit_of(APP), (0.5, 96))
        rows = bench.app_rows(APP)
        self.assertEqual(rows["samples/ball.exr"], 2.211)
        self.assertEqual(rows["bunny of 13136 triangles, 256 x 256"], 1.702)
        self.assertEqual(rows["sphere of 256 x 256 under a map of 1024 x 512"], 1.6)
        self.assertEqual(len(rows), 3)
        with self.assertRaises(ValueError):
            bench.unit_of(DIVAN)

    def test_nested_rows_of_divan(self) -> None:
        rows = bench.divan_rows(DIVAN)
        self.assertEqual(list(rows), ["cost", "iteration Blocks", "iteration Printed", "render_point 0.02"])
        self.assertAlmostEqual(rows["cost"], 5.071e-3)
        self.assertAlmostEqual(rows["iteration Printed"], 1.3)
        self.assertAlmostEqual(rows["render_point 0.02"], 80.5e-6)

    def test_rows_of_the_training(self) -> None:
        rows = bench.plain_rows("one light                                   0.0100 s\n512 photographs    2.5000 s\n")
        self.assertEqual(rows, {"one light": 0.01, "512 photographs": 2.5})

    def test_regressions_are_rows_slower_by_a_fifth(self) -> None:
        recorded = {"a": 1.0, "b": 1.0, "c": 1.0}
        slower = bench.regressions({"a": 1.19, "b": 1.3, "new": 9.0}, recorded)
        self.assertEqual(slower, ["b: 1.3 units, 30 % more than the recorded 1"])


if __name__ == "__main__":
    unittest.main()
