"""What the thesis prints: its safe situations, its twelve antigens, its three probabilities.

The scan of Fig. 4.2 is damaged. The nine rows form a pattern, three slopes (0, 5, −5 %) of three
situations each, and rows 3 to 6, 8 and 9 are legible enough to fix it; the missing digits of rows
1, 2 and 7 were filled in by that pattern.
"""

from __future__ import annotations

import numpy as np

from railops.crossing.situation import Array

SELF: Array = np.array(
    [
        [0, 5, 0, 0, 1000, 0, 20, 50],  # a train standing far away, a car creeping over
        [50, 30, 0, 0, 900, 100, 20, 50],
        [20, 30, 0, 0, 600, 100, 20, 50],
        [0, 5, 5, 0, 1000, 0, 20, 50],
        [40, 25, 5, 0, 900, 100, 20, 50],
        [20, 30, 5, 0, 600, 100, 20, 50],
        [0, 5, -5, 0, 1000, 0, 20, 50],
        [60, 35, -5, 0, 900, 100, 20, 50],
        [20, 30, -5, 0, 600, 100, 20, 50],
    ],
    dtype=np.float64,
)
"""The nine safe situations of Fig. 4.2, shape (9, 8), in the order and units of ``SPACE``."""

ANTIGENS: Array = np.array(
    [
        [98.72, 26.37, 7.92, -13.67, 508.15, 512.51, -36.32, 47.57],
        [46.94, 3.47, -2.07, -0.7, 153.35, 270.08, 49.57, 7.8],
        [84, 128.61, -8.83, 6.11, 691.17, 277.47, -9.93, 98.54],
        [93.67, 43.21, 11.44, -1.8, 57.42, 234.12, -49.12, 67.16],
        [30.57, 5.21, -15.37, -19.56, 353.4, 710.79, -2.5, 2.27],
        [10.87, 10.65, -19.86, 7.32, 304.03, 260.37, 1.09, 96.94],
        [5.11, 77.52, 1.9, -7.67, 25.99, 537.38, -33.56, 16.44],
        [63.64, 59.49, 8.22, 2.81, 181.57, 564.33, -3.25, 93.42],
        [42.31, 114.83, -4.73, -0.78, 701.87, 804.13, 47.73, 48.11],
        [52.22, 13.48, -3.01, 17.42, 788.05, 748.83, -20.12, 53.37],
        [28.85, 4.42, 3.1, 14.4, 383.7, 897.68, 9.28, 49.83],
        [4.44, 122.8, -9.2, -1.42, 396.72, 845.58, -12.04, 58.54],
    ]
)
"""The twelve antigens of Fig. 4.3; all but the last were alarmed there, shape (12, 8)."""

ALARMED = 11
"""How many of :data:`ANTIGENS`, counted from the first, the published run alarmed."""

COLLISION_PROBABILITIES: tuple[tuple[float, float], ...] = (
    (0.0, 0.4658043346),
    (-2.24, 0.0555120849),
    (-10.0, 0.000135043),
)
"""Fig. 5.2: change of the car's speed, km/h, and the collision probability it leaves.

Train at 80 km/h and 1000 m, car at 40 km/h and 500 m. The last digits of the scan are uncertain.
"""

for _constant in (SELF, ANTIGENS):
    _constant.setflags(write=False)
