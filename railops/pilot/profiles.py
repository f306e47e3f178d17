"""Random trips over mountainous lines, for tests and benchmarks of the planner."""

from __future__ import annotations

import math

import numpy as np

from railops.pilot.route import Route, SpeedProfile
from railops.traction import Line


def random_route(
    rng: np.random.Generator,
    *,
    length_m: float = 40e3,
    speed_kmh: tuple[float, float] = (60.0, 250.0),
    steepest: float = 0.025,
    tightest_m: float = 300.0,
    accel_mps2: float = 0.1,
) -> Route:
    """A trip with random gradients, curves, tunnels and a mother train that changes speed.

    Args:
        rng: Source of randomness.
        length_m: Length of the trip, metres.
        speed_kmh: Interval the mother train's speeds are drawn from, km/h.
        steepest: Largest gradient, rise over run, either way.
        tightest_m: Smallest curve radius, metres.
        accel_mps2: Largest acceleration of the mother train between two speeds, m/s².

    Returns:
        The route: gradients every 400–2000 m, curves of 200–800 m half of the way, a tunnel or
        two, and speeds held for 3–8 km, all within the limits given.
    """
    gradients, at = [], 0.0
    while at < length_m + 5000.0:
        gradients.append((at, float(rng.uniform(-steepest, steepest))))
        at += float(rng.uniform(400.0, 2000.0))
    curves, at = [(0.0, math.inf)], float(rng.uniform(100.0, 1000.0))
    while at < length_m:
        radius = tightest_m / float(rng.uniform(0.05, 1.0))
        bend, straight = rng.uniform(200.0, 800.0), rng.uniform(200.0, 1500.0)
        curves += [(at, radius), (at + float(bend), math.inf)]
        at += float(bend + straight)
    tunnels, at = [], float(rng.uniform(1000.0, 15e3))
    while at < length_m:
        end = at + float(rng.uniform(300.0, 3000.0))
        tunnels.append((at, end, float(rng.uniform(1.2, 3.0))))
        at = end + float(rng.uniform(5e3, 30e3))
    low, high = (value / 3.6 for value in speed_kmh)
    speed = float(rng.uniform(low, high))
    position, speeds, at = [0.0], [speed], float(rng.uniform(3e3, 8e3))
    while at < length_m:
        next_speed = float(np.clip(speed + rng.uniform(-10.0, 10.0), low, high))
        ramp = abs(next_speed**2 - speed**2) / 2.0 / (accel_mps2 * rng.uniform(0.3, 1.0)) + 200.0
        position += [at, at + float(ramp)]
        speeds += [speed, next_speed]
        at, speed = at + float(ramp) + float(rng.uniform(3e3, 8e3)), next_speed
    position.append(position[-1] + 20e3)
    speeds.append(speed)
    mother = SpeedProfile.through(position, speeds)
    return Route(mother, Line(tuple(gradients), tuple(curves)), tuple(tunnels))
