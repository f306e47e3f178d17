"""``railinspect calibrate``, ``range`` and ``camera report``: cameras, and how far they see."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from railinspect.errors import BadInputError
from railinspect.scenes_command import size_of

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from railinspect.camera import Camera
    from railinspect.ranging.stereo_view import StereoView

AddCommand = Callable[..., argparse.ArgumentParser]


def add_ranging(commands: Any, add: AddCommand) -> None:
    """Add the three commands to the parser."""
    _add_calibrate(commands, add)
    _add_range(commands, add)
    camera = commands.add_parser("camera", help="what a camera is good for")
    kinds = camera.add_subparsers(title="what to say", metavar="KIND", required=True)
    report = add(
        kinds,
        "report",
        "reliable range, blur, sharpness, braking distance and errors by range",
    )
    report.add_argument("camera", type=Path, metavar="YAML", help="camera file")
    report.add_argument("--speed-kmh", type=float, default=80.0, help="km/h (default: 80)")
    report.add_argument(
        "--decel", type=float, default=1.2, help="emergency deceleration, m/s² (default: 1.2)"
    )
    report.add_argument(
        "--recognition-s", type=float, default=0.5, help="light to decision, s (default: 0.5)"
    )
    report.add_argument(
        "--exposure-ms", type=float, default=1.0, help="exposure time, ms (default: 1)"
    )
    report.add_argument(
        "--radius-m", type=float, default=600.0, help="tightest curve, m (default: 600)"
    )
    report.add_argument("--focal-mm", type=float, help="focal length, mm; with --f-number")
    report.add_argument("--f-number", type=float, help="aperture; gives the sharp interval")
    report.add_argument(
        "--working-m", type=float, default=100.0, help="distance in focus, m (default: 100)"
    )
    report.add_argument(
        "--blur-um", type=float, default=5.0, help="acceptable blur circle, µm (default: 5)"
    )
    report.set_defaults(run=_run_report)


def _add_calibrate(commands: Any, add: AddCommand) -> None:
    calibrate = commands.add_parser(
        "calibrate",
        help="make a camera file: from a checkerboard, a ride or a data set's file",
    )
    kinds = calibrate.add_subparsers(title="from what", metavar="KIND", required=True)
    board = add(kinds, "board", "focal length and distortion from pictures of a checkerboard")
    board.add_argument("folder", type=Path, help="folder of pictures")
    board.add_argument(
        "--corners", required=True, metavar="WxH", help="inner corners of the board, e.g. 9x6"
    )
    board.add_argument("--square-mm", type=float, required=True, help="side of a square, mm")
    board.add_argument("--height-m", type=float, help="height above the rail tops, m, if measured")
    ride = add(kinds, "ride", "pitch, height and focal length from a ride's rails and sleepers")
    ride.add_argument("video", type=Path, help="video or folder of images of a ride")
    ride.add_argument("--gauge-mm", type=float, default=1435.0, help="mm (default: 1435)")
    ride.add_argument(
        "--sleeper-m", type=float, default=0.60, help="spacing of sleepers, m (default: 0.60)"
    )
    ride.add_argument(
        "--seconds", type=float, default=30.0, help="how much of it to use, s (default: 30)"
    )
    ride.add_argument("--bundle", type=Path, help="ONNX bundle (default: the shipped one)")
    osdar = add(kinds, "osdar23", "one camera of an OSDaR23 scene")
    osdar.add_argument("file", type=Path, help="the scene's OpenLABEL file")
    osdar.add_argument("--sensor", default="rgb_center", help="stream (default: rgb_center)")
    kitti = add(kinds, "kitti", "the left camera of a KITTI calibration")
    kitti.add_argument("file", type=Path, help="calibration file")
    kitti.add_argument("--size", required=True, metavar="WxH", help="size of the pictures, pixels")
    kitti.add_argument("--height-m", type=float, help="height above the rail tops, m, if known")
    for parser, run in (
        (board, _run_board),
        (ride, _run_ride),
        (osdar, _run_osdar),
        (kitti, _run_kitti),
    ):
        parser.add_argument("--out", type=Path, help="camera file to write (YAML)")
        parser.set_defaults(run=run)


def _add_range(commands: Any, add: AddCommand) -> None:
    parser = add(
        commands,
        "range",
        "ranges of what is found on the track in a picture or a stereo pair, or of a box in a pair",
    )
    parser.add_argument("picture", type=Path, help="picture; of a stereo pair the left one")
    parser.add_argument("--camera", type=Path, metavar="YAML", help="calibrated camera")
    parser.add_argument("--bundle", type=Path, help="ONNX bundle (default: the shipped one)")
    parser.add_argument("--right", type=Path, help="right picture of a rectified pair")
    parser.add_argument(
        "--calibration", type=Path, help="the pair's file: Middlebury calib.txt or KITTI"
    )
    parser.add_argument(
        "--box",
        metavar="L,T,R,B",
        help="range this region of the pair instead, pixels of the left picture",
    )
    parser.set_defaults(run=_run_range)


# Calibration


def _run_board(options: argparse.Namespace) -> int:
    from railinspect.ranging.calibrate_board import calibrate_folder

    found = calibrate_folder(
        options.folder, size_of(options.corners), options.square_mm / 1000.0, options.height_m
    )
    extra = {"rms_px": found.rms_px, "used": found.used, "without_board": found.without}
    return _deliver(found.camera, options, extra)


def _run_ride(options: argparse.Namespace) -> int:
    from contextlib import closing

    from railinspect.ranging.calibrate_ride import RideCalibrator
    from railinspect.video import open_source

    _positive("--gauge-mm", options.gauge_mm)
    _positive("--seconds", options.seconds)
    segmenter = _segmenter(options.bundle)
    calibrator = None
    with closing(open_source(options.video, None)) as source:
        for frame in source:
            if frame.time_s > options.seconds:
                break
            if calibrator is None:
                size_wh = (frame.rgb.shape[1], frame.rgb.shape[0])
                calibrator = RideCalibrator(size_wh, options.gauge_mm / 1e3, options.sleeper_m)
            calibrator.update(segmenter(frame.rgb), frame.rgb)
    if calibrator is None:
        raise BadInputError(f"{options.video} holds no frame")
    found = calibrator.result()
    return _deliver(
        found.camera, options, {"frames": found.frames, "sleeper_contrast": found.contrast}
    )


def _run_osdar(options: argparse.Namespace) -> int:
    from railinspect.ranging.camera_files import camera_from_osdar23

    return _deliver(camera_from_osdar23(options.file, options.sensor), options, {})


def _run_kitti(options: argparse.Namespace) -> int:
    from railinspect.ranging.camera_files import camera_from_kitti

    camera = camera_from_kitti(options.file, size_of(options.size), options.height_m)
    return _deliver(camera, options, {})


def _deliver(camera: Camera, options: argparse.Namespace, extra: dict[str, Any]) -> int:
    if options.out is not None:
        camera.save(options.out)
    if options.json:
        print(json.dumps({"camera": asdict(camera), **extra}))
        return 0
    std = camera.std
    print(f"focal length  {camera.focal_px:9.1f} px   ± {std.focal_px:.1f}")
    print(f"height        {camera.height_m:9.3f} m    ± {std.height_m:.3f}")
    print(
        f"pitch         {math.degrees(camera.pitch_rad):9.2f} °    "
        f"± {math.degrees(std.pitch_rad):.2f}"
    )
    for name, value in extra.items():
        print(f"{name.replace('_', ' '):<13} {value}")
    if options.out is not None:
        print(f"camera file   {options.out}")
    return 0


# Range


def _run_range(options: argparse.Namespace) -> int:
    from railinspect.images import read_image

    if (options.right is None) != (options.calibration is None):
        raise BadInputError("a stereo pair needs both --right and --calibration with its file")
    if options.box is not None:
        return _run_box(options)
    from railinspect.camera import Camera
    from railinspect.findings import find
    from railinspect.fovea import for_stills
    from railinspect.ranging import FrameRanging, Range
    from railinspect.records import LocatedFinding, located_json
    from railinspect.thresholds import Thresholds
    from railinspect.track import TrackFollower

    rgb = read_image(options.picture)
    camera = Camera.load(options.camera) if options.camera else None
    segmentation = for_stills(_segmenter(options.bundle), camera)(rgb)
    track = TrackFollower(camera).update(segmentation)
    ranging = FrameRanging(track, segmentation=segmentation, stereo=_pair(options, rgb), rgb=rgb)
    located = []
    for finding in find(segmentation, track, Thresholds().still()):
        if finding.doubt is not None:
            continue
        found = ranging.measure(finding)
        known = found if isinstance(found, Range) else None
        reason = None if isinstance(found, Range) else found.reason
        located.append(LocatedFinding(finding, known, None, reason))
    if options.json:
        document = {
            "followed": track.followed,
            "reason": track.reason,
            "reach_m": track.reach_m,
            "findings": [located_json(one) for one in located],
        }
        print(json.dumps(document))
        return 0
    if not track.followed:
        print(f"the track is not followed: {track.reason}")
    for one in located:
        if one.range is None:
            print(f"{one.finding.type:<12} no range: {one.range_reason}")
            continue
        low, high = one.range.interval_m
        print(
            f"{one.finding.type:<12} {one.range.range_m:7.1f} m   95 % {low:.1f} … {high:.1f} m   "
            f"by {one.range.method}"
        )
    if not located:
        print("nothing found")
    return 0


def _run_box(options: argparse.Namespace) -> int:
    import numpy as np

    from railinspect.images import read_image
    from railinspect.ranging import Absent
    from railinspect.ranging.stereo import match, region_range
    from railinspect.ranging.stereo_camera import StereoCamera

    if options.right is None:
        raise BadInputError("--box is for a stereo pair; give --right and --calibration as well")
    camera = StereoCamera.load(options.calibration)
    left, right = read_image(options.picture), read_image(options.right)
    disparity = match(left, right)
    region = _box(options.box, left)
    found = region_range(disparity, region, camera)
    share = float(np.isfinite(disparity.disparity_px).mean())
    document: dict[str, Any] = {"matched_share": share}
    if isinstance(found, Absent):
        document |= {"range_m": None, "reason": found.reason}
        said = f"no range: {found.reason}"
    else:
        document |= {**asdict(found), "std_m": found.std_m, "reason": None}
        said = (
            f"{found.range_m:.3f} m ± {found.std_m:.3f} m (noise {found.noise_m:.3f}, bias "
            f"{found.bias_m:.3f})"
        )
    print(json.dumps(document) if options.json else said)
    return 0


def _pair(options: argparse.Namespace, left: npt.NDArray[np.uint8]) -> StereoView | None:
    from railinspect.images import read_image
    from railinspect.ranging.stereo import check_sides
    from railinspect.ranging.stereo_camera import StereoCamera
    from railinspect.ranging.stereo_view import StereoView

    if options.right is None:
        return None
    right = read_image(options.right)
    check_sides(left, right)
    return StereoView(left, right, StereoCamera.load(options.calibration))


def _box(text: str, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
    import numpy as np

    height, width = image.shape[:2]
    try:
        left, top, right, bottom = (int(part) for part in text.split(","))
    except ValueError:
        raise BadInputError(f"--box is {text!r}; give left,top,right,bottom in pixels") from None
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise BadInputError(f"--box {text} does not lie in the picture of {width}x{height} pixels")
    region = np.zeros((height, width), bool)
    region[top:bottom, left:right] = True
    return region


# Report


def _run_report(options: argparse.Namespace) -> int:
    from railinspect.camera import Camera
    from railinspect.ranging.feasibility import Operation, report
    from railops.pilot.camera import Optics

    if (options.focal_mm is None) != (options.f_number is None):
        raise BadInputError("the sharp interval needs both --focal-mm and --f-number")
    optics = None
    if options.focal_mm is not None:
        optics = Optics(
            options.focal_mm / 1e3, options.f_number, options.blur_um * 1e-6, options.working_m
        )
    operation = Operation(
        options.speed_kmh / 3.6,
        options.decel,
        options.recognition_s,
        options.exposure_ms / 1e3,
        options.radius_m,
    )
    document = report(Camera.load(options.camera), operation, optics)
    if options.json:
        print(json.dumps(document))
        return 0
    print(
        f"braking distance  {document['braking_distance_m']:7.0f} m at {options.speed_kmh:g} km/h"
    )
    print(f"reliable range    {document['reliable_range_m']:7.0f} m")
    if document["sharp_m"] is not None:
        near, far = document["sharp_m"]
        print(f"sharp             {near:7.1f} m … {'∞' if far is None else f'{far:.1f} m'}")
    print("  range   gauge    row      blur    shift   noise    bias  reliable")
    print("      m      px   m/px        px        m       m       m")
    for row in document["ranges"]:
        shift = row["lateral_shift_m"]
        print(
            f"{row['range_m']:7.0f} {row['gauge_px']:7.1f} {row['row_m_per_px']:6.2f} "
            f"{row['blur_px']:9.2f} {'—' if shift is None else f'{shift:.2f}':>8} "
            f"{row['noise_m']:7.2f} {row['bias_m']:7.2f}  {'yes' if row['reliable'] else 'no'}"
        )
    for problem in document["problems"]:
        print(f"note: {problem}")
    return 0


def _segmenter(bundle: Path | None) -> Any:
    from railinspect.segmenter import Segmenter

    return Segmenter.default() if bundle is None else Segmenter.load(bundle)


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise BadInputError(f"{name} is {value}; give a positive number")
