"""A mission as a self-contained HTML page: both vehicles moving, and what it came to."""

from __future__ import annotations

import json
from pathlib import Path
from string import Template

import numpy as np
import numpy.typing as npt

from railops.braking.stopping import motion_of, runge_kutta
from railops.braking.train import Train
from railops.pilot.mission import SYSTEMS, Campaign, Mission

Array = npt.NDArray[np.float64]

_STEP_S = 0.1
_NAMES = {
    "pilot": "with a pilot vehicle",
    "camera": "camera on the train",
    "driver": "driver alone",
}

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Pilot vehicle: a mission</title>
<style>
body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#223}
canvas{width:100%;border:1px solid #ccd;background:#f7f8fb}
table{border-collapse:collapse;margin:1rem 0}td,th{padding:.25rem .8rem;text-align:right}
th:first-child,td:first-child{text-align:left}tr+tr{border-top:1px solid #dde}
input{width:70%;vertical-align:middle}i{display:inline-block;width:.8em;height:.8em}
</style></head><body>
<h1>A mission of the pilot vehicle</h1>
<p>$summary</p>
<canvas id="view" width="1100" height="330"></canvas>
<p><i style="background:#2e8b57"></i> mother train <i style="background:#d08a00"></i> pilot vehicle
<i style="background:#c0392b"></i> obstacle; distances to scale, vehicles not</p>
<p><button id="play">play</button> <input id="at" type="range" min="0" max="$last" value="0">
<span id="clock"></span></p>
$table
<script>
const runs = $runs, obstacle = $obstacle, step = $step;
const canvas = document.getElementById("view"), pen = canvas.getContext("2d");
const slider = document.getElementById("at"), clock = document.getElementById("clock");
const names = $names;
function draw() {
  const i = +slider.value, scale = 1020 / (obstacle * 1.05);
  pen.clearRect(0, 0, canvas.width, canvas.height); pen.font = "15px system-ui";
  Object.keys(runs).forEach((name, row) => {
    const run = runs[name], y = 75 + 105 * row, k = Math.min(i, run.train.length - 1);
    const x = m => 40 + m * scale;
    pen.fillStyle = "#99a"; pen.fillRect(40, y + 8, 1040, 2);
    const train = run.train[k], hit = train >= obstacle;
    pen.fillStyle = "#c0392b"; pen.fillRect(x(obstacle), y - 14, 8, 22);
    pen.fillStyle = hit ? "#c0392b" : "#2e8b57"; pen.fillRect(x(train) - 34, y - 8, 34, 14);
    if (run.pilot) { pen.fillStyle = "#d08a00"; pen.fillRect(x(run.pilot[k]) - 8, y - 4, 8, 10); }
    pen.fillStyle = "#223";
    const v = k ? (run.train[k] - run.train[k - 1]) / step * 3.6 : run.speed * 3.6;
    const left = (obstacle - train).toFixed(0), still = k && run.train[k] === run.train[k - 1];
    let words = hit ? "hits the obstacle" : still ? "stands " + left + " m before it" :
      v.toFixed(0) + " km/h, " + left + " m left";
    if (run.pilot && run.pilot[k] >= obstacle) words += "; the pilot vehicle has hit the obstacle";
    pen.fillText(names[name] + ": " + words, 40, y - 24);
  });
  clock.textContent = (i * step).toFixed(1) + " s";
}
let timer = null;
document.getElementById("play").onclick = () => {
  if (timer) { clearInterval(timer); timer = null; return; }
  if (+slider.value >= +slider.max) slider.value = 0;
  timer = setInterval(() => { slider.value = +slider.value + 2; draw();
    if (+slider.value >= +slider.max) { clearInterval(timer); timer = null; } }, 50);
};
// The address may end in a time: mission.html#20 opens at 20 s.
slider.value = (+location.hash.slice(1) || 0) / step;
slider.oninput = draw; draw();
</script></body></html>
""")


def write_page(campaign: Campaign, path: str | Path) -> Path:
    """Write the page: one undisturbed mission animated, and the campaign's shares below it."""
    mission = campaign.mission
    runs, obstacle = _runs(mission)
    last = max(len(run["train"]) for run in runs.values()) - 1  # type: ignore[arg-type]  # lists
    page = _PAGE.substitute(
        summary=(
            f"The mother train runs at {3.6 * mission.train.speed_mps:.0f} km/h, the pilot vehicle "
            f"{mission.gap_m:.0f} m ahead of it; its camera recognises an obstacle at "
            f"{mission.camera.working_m:.0f} m. The picture shows the undisturbed case, the table "
            f"{campaign.missions} simulated missions."
        ),
        table=_table(campaign),
        names=json.dumps(_NAMES),
        runs=json.dumps(runs),
        obstacle=json.dumps(obstacle),
        step=_STEP_S,
        last=last,
    )
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(page, encoding="utf-8")
    return target


def _table(campaign: Campaign) -> str:
    """The shares as an HTML table."""
    rows = [
        "<table><tr><th>system</th><th>train stops in time</th><th>95 % interval</th>"
        "<th>margin, median</th><th>worst 1 %</th></tr>"
    ]
    for system in SYSTEMS:
        share, (worst, median) = campaign.stops(system), campaign.quantiles(system, (0.01, 0.5))
        rows.append(
            f"<tr><td>{_NAMES[system]}</td><td>{100 * share.value:.2f} %</td>"
            f"<td>{100 * share.low:.2f} … {100 * share.high:.2f} %</td>"
            f"<td>{median:.0f} m</td><td>{worst:.0f} m</td></tr>"
        )
    return "\n".join([*rows, "</table>"])


def _runs(mission: Mission) -> tuple[dict[str, dict[str, object]], float]:
    """Positions over time in the undisturbed mission, and the obstacle's; metres."""
    camera, driver, radio = mission.camera, mission.driver, mission.radio
    speed, front = mission.train.speed_mps, mission.gap_m + mission.pilot_length_m
    seen = max(camera.working_m, driver.sight_m)
    obstacle = front + camera.working_m + 3.0 * speed
    # When each brakes, in seconds after the start of the picture.
    pilot_s = 3.0 + camera.recognition_s
    found_s = min(pilot_s, 3.0 + camera.working_m / speed)
    train_s = {
        "pilot": found_s + radio.delay_s + mission.reaction_s,
        "camera": (obstacle - camera.working_m) / speed + camera.recognition_s + mission.reaction_s,
        "driver": (obstacle - driver.sight_m) / speed + driver.reaction_s,
    }
    steps = int((obstacle + seen) / speed / _STEP_S) + 600
    runs: dict[str, dict[str, object]] = {}
    for system in SYSTEMS:
        path = np.minimum(_path(mission.train, max(0.0, train_s[system]), steps), obstacle)
        runs[system] = {"train": path.round(1).tolist(), "speed": round(speed, 2)}
    ahead = front + _path(mission.pilot_train, pilot_s, steps)
    runs["pilot"]["pilot"] = np.minimum(ahead, obstacle).round(1).tolist()
    return runs, round(obstacle, 1)


def _path(train: Train, brake_s: float, steps: int) -> Array:
    """Distance run over time: steady until ``brake_s``, then the emergency brake."""
    brake = train.emergency
    motion = motion_of(train, brake)
    speed, run, out = train.speed_mps, 0.0, np.empty(steps)
    for i in range(steps):
        out[i] = run
        since = i * _STEP_S - brake_s - brake.delay_s
        if since < 0.0:
            run += speed * _STEP_S
            continue
        share = min(1.0, since / brake.build_up_s) if brake.build_up_s > 0.0 else 1.0
        if speed > 0.0:
            speed, run = runge_kutta(share, 0.0, speed, run, _STEP_S, motion)
    return out
