"""A fleet run made by hand: frames of a known camera, events at known places, no network."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path

import cv2
import numpy as np

from railinspect.camera import Camera
from railinspect.fleet.finished import InputCounts
from railinspect.positions.fixes import EARTH_RADIUS_M
from railinspect.runinfo import write_json
from railinspect.sinks.json_lines import JsonLines

NOON = datetime(2026, 5, 1, 12, 0, 0, tzinfo=UTC)
METRE_DEG = math.degrees(1 / EARTH_RADIUS_M)
SIZE_WH = (640, 360)
CAMERA = Camera.from_field_of_view(SIZE_WH, np.radians(50.0), 2.6, pitch_rad=0.045)
SPEED_MPS = 20.0
RUN_ID = "00112233445566ff"
FIRST, SECOND = "a" * 16, "b" * 16


def rails(camera: Camera = CAMERA, noise_px: float = 0.0, rng=None):
    """Both rails of a straight track as ``frames.jsonl`` has them."""
    along = np.geomspace(60.0, 5.0, 40)
    lines = []
    for side in (1, -1):
        y = np.full(along.size, side * camera.rail_spacing_m / 2)
        line = camera.project(np.stack([along, y, np.zeros(along.size)], axis=1))
        if noise_px:
            line[:, 0] += rng.normal(0.0, noise_px, along.size)
        lines.append(np.round(line, 1).tolist())
    return {"left": lines[0], "right": lines[1]}


def frame(index, time_s, status="clear", speed_mps=SPEED_MPS, camera=CAMERA, **rest):
    """One line of ``frames.jsonl``."""
    known = status != "unknown"
    vanishing = camera.project([1e6, 0.0, 0.0]).round(1).tolist()
    return {
        "index": index,
        "time_s": time_s,
        "status": status,
        "followed": known,
        "reason": None if known else f"only {index} pixels of rail were seen",
        "rails": rails(camera) if known else {"left": [], "right": []},
        "vanishing_point": vanishing if known else None,
        "reach_m": 80.0 if known else None,
        "speed_mps": speed_mps,
        "speed_error_mps": None if speed_mps is None else 0.5,
        "findings": [],
        "advice": None,
        **rest,
    }


def finding(event_id, range_m, kind="obstruction"):
    """One finding of a frame."""
    return {
        "type": kind,
        "polygon": [[300.0, 200.0], [330.0, 200.0], [330.0, 240.0], [300.0, 240.0]],
        "box_xyxy": [300.0, 200.0, 330.0, 240.0],
        "confidence": 0.8,
        "range_m": range_m,
        "range_std_m": 1.0,
        "range_interval_m": [range_m - 2, range_m + 2],
        "event_id": event_id,
    }


def event(number, first_s, kind="obstruction", range_m=30.0, advice="service", **rest):
    """One line of ``events.jsonl``."""
    near = None if range_m is None else [range_m - 2, range_m + 2]
    return {
        "id": number,
        "type": kind,
        "confidence": 0.8,
        "type_shares": {kind: 1.0},
        "first_time_s": first_s,
        "confirmed_time_s": first_s + 0.2,
        "last_time_s": first_s + 1.0,
        "first_frame": round(first_s * 10),
        "last_frame": round(first_s * 10) + 10,
        "best_frame": round(first_s * 10) + 5,
        "best_box_xyxy": [300.0, 200.0, 330.0, 240.0],
        "frames_seen": 10,
        "first_range_m": None if range_m is None else range_m + 20,
        "first_range_interval_m": None if range_m is None else [range_m + 17, range_m + 23],
        "closest_range_m": range_m,
        "closest_range_interval_m": near,
        "closest_time_s": None if range_m is None else first_s + 1.0,
        "advice": advice,
        "advice_reason": None if advice is None else "too little room",
        "advice_time_s": None if advice is None else first_s + 0.3,
        "service_by": None,
        "service_by_time_s": None,
        "emergency_by": None,
        "emergency_by_time_s": None,
        "doubt": None,
        "thumbnail": None,
        **rest,
    }


def write_input(run: Path, input_id, name, frames, events, address="", kind="video", **counts):
    """An ``inputs/<id>`` folder."""
    folder = run / "inputs" / input_id
    (folder / "thumbnails").mkdir(parents=True)
    for path, rows in (("frames.jsonl", frames), ("events.jsonl", events)):
        lines = JsonLines(folder / path)
        for row in rows:
            lines.write({"input": input_id, "name": name, **row})
        lines.close()
    for one in events:
        if one["thumbnail"]:
            cv2.imwrite(str(folder / one["thumbnail"]), np.full((40, 60, 3), 90, np.uint8))
    summary = InputCounts(
        input_id,
        name,
        address or f"/nowhere/{name}.mp4",
        kind,
        SIZE_WH,
        frames=len(frames),
        unknown_frames=sum(one["status"] == "unknown" for one in frames),
        first_time_s=frames[0]["time_s"] if frames else None,
        last_time_s=frames[-1]["time_s"] if frames else None,
        events=len(events),
        **counts,
    )
    write_json(folder / "summary.json", summary.as_json())
    return folder


def made_run(base: Path) -> Path:
    """A run of two finished inputs and a damaged one; its folder."""
    run = base / "run"
    run.mkdir(parents=True)
    frames = [frame(i, i / 10, "unknown" if 300 <= i < 360 else "clear") for i in range(600)]
    for i in range(100, 111):
        frames[i] = frame(i, i / 10, "finding", findings=[finding(1, 50.0 - 2 * (i - 100))])
    first = [
        event(1, 10.0, range_m=30.0, thumbnail="thumbnails/event-00001.jpg"),
        event(2, 40.0, "trespasser", range_m=None, advice=None),
    ]
    write_input(run, FIRST, "ride <&> one", frames, first)
    still = [frame(i, i / 10, speed_mps=None) for i in range(100)]
    write_input(run, SECOND, "ride-2", still, [event(1, 5.0, "distortion", range_m=120.0)])
    inputs = [
        {"id": FIRST, "name": "ride <&> one", "address": "/nowhere", "state": "done"},
        {"id": SECOND, "name": "ride-2", "address": "/nowhere", "state": "done"},
        {"id": "c" * 16, "name": "bad", "address": "x", "state": "bad", "reason": "cut <off>"},
    ]
    write_json(run / "fleet.json", {"run": RUN_ID, "inputs": inputs})
    return run


def write_gpx(path: Path, seconds: int = 80, start: datetime = NOON) -> Path:
    """A train that goes north at 20 m/s."""
    points = "".join(
        f'<trkpt lat="{50 + METRE_DEG * SPEED_MPS * t:.9f}" lon="8.000000000"><time>'
        f"{(start + timedelta(seconds=t)).isoformat()}</time></trkpt>"
        for t in range(seconds)
    )
    path.write_text(f"<gpx><trk><trkseg>{points}</trkseg></trk></gpx>", encoding="utf-8")
    return path


def write_logbook(base: Path, extra: str = "") -> Path:
    """A logbook that knows the first input's place and both inputs' lines."""
    write_gpx(base / "ride.gpx")
    text = (
        "input,line,vehicle,started,positions\n"
        f"{FIRST},Main <line>,Unit 7,2026-05-01T14:00:00+02:00,ride.gpx\n"
        f"ride-2,Branch,Unit 7,2026-05-01T15:00:00+02:00,\n{extra}"
    )
    path = base / "logbook.csv"
    path.write_text(text, encoding="utf-8")
    return path


def read_lines(path: Path) -> list[dict]:
    """Lines of JSON."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
