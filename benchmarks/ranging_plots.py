"""The docs' picture of the paper's instruments: as printed and with consistent units."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from railinspect.ranging import as_printed
from railinspect.ranging.goniometric import angle_error
from railinspect.ranging.rolling_shutter import ShutterSensor, blur_range_error, lateral_error
from railinspect.ranging.stereo_camera import StereoCamera

_STEP_RAD = 0.47e-3
_TABLE_1 = {
    "C0": ((20.0, 0.72), (18.0, 0.59)),
    "C1": ((20.0, 0.67), (18.0, 0.61)),
    "C2": ((20.0, 0.08), (19.6, 0.07)),
}
"""Range and error, metres, as the paper prints them: stereo, goniometer, blur sensor."""


def plots(folder: Path) -> None:
    """Table 1 and Figs. 6 and 7 as printed and with consistent units.

    Args:
        folder: Where ``ranging_paper.png`` is written.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    away = np.linspace(2.0, 20.0, 60)
    pair = StereoCamera(1 / _STEP_RAD, 2.5, (0.0, 0.0))
    figure, (one, two) = plt.subplots(1, 2, figsize=(10.5, 4.4), layout="constrained")
    curves = {
        "goniometer, root sum square": (
            [angle_error(d, 2.7, 0.1, _STEP_RAD).std_m for d in away],
            "C1-",
        ),
        "goniometer, as printed": (
            [as_printed.goniometer_error(d, 2.7, 0.1, _STEP_RAD) for d in away],
            "C1:",
        ),
        "stereo, as printed": (
            [as_printed.stereo_error(d, 2.5, 0.1, _STEP_RAD) for d in away],
            "C0:",
        ),
        "stereo, consistent units": (list(pair.noise_m(pair.focal_px * 2.5 / away, 1.0)), "C0-"),
        "blur sensor, both": ([blur_range_error(d, 2.5, _STEP_RAD) for d in away], "C2--"),
    }
    for name, (errors, style) in curves.items():
        one.plot(away, errors, style, lw=2, label=name)
    for colour, points in _TABLE_1.items():
        one.plot(*zip(*points, strict=True), "o", mfc="none", color=colour, ms=7)
    one.plot([], [], "o", mfc="none", color="black", ms=7, label="Table 1's own figures")
    one.set(xlabel="range, m", ylabel="error of the range, m", title="Range: Table 1 at all ranges")
    one.set_yscale("log")
    for lens, colour in (("angle-linear", "C2"), ("pinhole", "C3")):
        sensor = ShutterSensor(lens=lens)
        speeds = np.linspace(0.5, 25.0, 60)
        shifts = sensor.pixels(speeds * 836e-4)
        rolled = [lateral_error(1.0, float(s), 836, sensor, 0.01, math.radians(1)) for s in shifts]
        two.plot(speeds * 3.6, rolled, colour, lw=2, label=f"{lens} lens, ±0.01 m, 1° roll, (16)")
        alone = [lateral_error(1.0, float(s), 836, sensor) for s in shifts]
        two.plot(speeds * 3.6, alone, colour, ls=":", lw=2, label=f"{lens} lens, pixel alone, (15)")
    two.plot([40.0], [0.13], "ko", mfc="none", ms=7)
    two.annotate(
        "the paper: at most 0.13 m/s", (40.0, 0.13), (2.0, 0.17), arrowprops={"arrowstyle": "-"}
    )
    two.set(
        xlabel="speed, km/h", ylabel="error of the speed, m/s", title="Lateral speed: Figs. 6 and 7"
    )
    two.set_ylim(0, 0.42)
    for axes in (one, two):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="lower right" if axes is one else "upper left")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "ranging_paper.png", dpi=110)
    plt.close(figure)
