"""OSDaR23: the calibration against the data set's own rails, drawn in 3-d and in the image."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fscnn.data.osdar import OpenLabel
from railinspect.camera import Camera
from railinspect.errors import BadInputError


def hand_made(folder: Path) -> Path:
    """One camera 2 m up, 0.1 m left of the centre, turned 0.02 left, 0.03 down, 0.01 right."""
    turned = Rotation.from_euler("ZYX", [0.02, 0.03, 0.01]).as_quat().tolist()
    pinhole = {
        "camera_matrix": [500.0, 0, 320.0, 0, 0, 500.0, 240.0, 0, 0, 0, 1, 0],
        "distortion_coeffs": [0, 0, 0, 0, 0],
        "width_px": 640,
        "height_px": 480,
    }
    lines = [[400.0, 470.0, 330.0, 250.0], [300.0, 250.0, 250.0, 460.0]]
    drawn = [{"coordinate_system": "cab", "val": line, "closed": False} for line in lines]
    box = {"coordinate_system": "cab", "val": [100.0, 50.0, 20.0, 10.0]}
    data = {
        "coordinate_systems": {
            "cab": {"pose_wrt_parent": {"translation": [0.0, 0.1, 2.0], "quaternion": turned}}
        },
        "streams": {
            "cab": {"type": "camera", "stream_properties": {"intrinsics_pinhole": pinhole}},
            "lidar": {"type": "lidar"},
        },
        "objects": {
            "1": {"type": "track", "name": "track0001"},
            "2": {"type": "person", "name": "person0001"},
            "3": {"type": "signal", "name": "signal0001"},
        },
        "frames": {
            "7": {
                "frame_properties": {"streams": {"cab": {"uri": "/cab/007.png"}}},
                "objects": {
                    "1": {"object_data": {"poly2d": drawn}},
                    "2": {"object_data": {"bbox": [box]}},
                    "3": {"object_data": {"poly2d": [{**drawn[0], "closed": True}]}},
                },
            }
        },
    }
    path = folder / "labels.json"
    path.write_text(json.dumps({"openlabel": data}))
    return path


def test_pose_becomes_height_offset_and_angles(tmp_path: Path) -> None:
    camera = OpenLabel(hand_made(tmp_path)).camera("cab")
    assert camera.height_m == 2.0
    assert camera.offset_m == 0.1
    angles = (camera.yaw_rad, camera.pitch_rad, camera.roll_rad)
    assert angles == pytest.approx((0.02, 0.03, 0.01))
    turned = Rotation.from_euler("ZYX", angles).as_matrix()
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # right, down, ahead
    np.testing.assert_allclose(camera.camera_from_world, axes @ turned.T, atol=1e-12)


def test_shapes_become_the_types_railsem19_is_read_into(tmp_path: Path) -> None:
    annotation = OpenLabel(hand_made(tmp_path)).annotation("7", "cab")
    assert annotation.name == "cab/007.png"
    assert annotation.size_wh == (640, 480)
    (track,) = annotation.rails
    assert track.track == "track0001"
    assert track.left_uv.tolist() == [[300, 250], [250, 460]]
    assert track.right_uv.tolist() == [[330, 250], [400, 470]]
    assert annotation.boxes[0].box_xyxy == (90, 45, 110, 55)
    assert [(s.label, s.closed) for s in annotation.shapes] == [("signal", True)]


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    sequence = OpenLabel(hand_made(tmp_path))
    with pytest.raises(BadInputError, match="has no camera 'lidar'; it has cab"):
        sequence.camera("lidar")
    with pytest.raises(BadInputError, match="has no frame '8'; it has 7 … 7"):
        sequence.annotation("8", "cab")
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(BadInputError, match="is not an OpenLABEL file of OSDaR23"):
        OpenLabel(tmp_path / "other.json")
    with pytest.raises(BadInputError, match="cannot read"):
        OpenLabel(tmp_path / "none.json")


def real_file() -> Path | None:
    for parent in Path(__file__).resolve().parents:
        path = parent / "shared/real/osdar23_calibration_labels.json"
        if path.is_file():
            return path
    return None


@pytest.mark.skipif(real_file() is None, reason="the OSDaR23 file lies beside the checkout only")
def test_the_data_sets_rails_in_space_project_onto_its_rails_in_the_image() -> None:
    path = real_file()
    assert path is not None
    sequence = OpenLabel(path)
    for name in ("rgb_center", "rgb_highres_center"):
        camera = sequence.camera(name)
        gap = median_gap_px(sequence, path, name, camera)
        # About a rail's width; space and image were drawn apart. No other sense of turning fits.
        assert gap < 25
        for other in (
            replace(camera, pitch_rad=-camera.pitch_rad),
            replace(camera, yaw_rad=-camera.yaw_rad),
        ):
            assert median_gap_px(sequence, path, name, other) > 3 * gap


def median_gap_px(sequence: OpenLabel, path: Path, name: str, camera: Camera) -> float:
    """Distance along the row from each projected rail point to the nearest rail of its track."""
    raw = json.loads(path.read_text())["openlabel"]
    frame = sequence.frames[0]
    rails = {track.track: track for track in sequence.annotation(frame, name).rails}
    gaps = []
    for key, content in raw["frames"][frame]["objects"].items():
        track = rails.get(raw["objects"][key]["name"])
        lines = content["object_data"].get("poly3d", ()) if track else ()
        for line in lines:
            pixels = camera.distort(camera.project(np.array(line["val"], float).reshape(-1, 3)))
            for u, v in pixels:
                across = [
                    abs(u - np.interp(v, rail[:, 1], rail[:, 0]))
                    for rail in (track.left_uv, track.right_uv)
                    if rail[0, 1] <= v <= rail[-1, 1]
                ]
                gaps.extend([min(across)] if across else [])
    assert len(gaps) >= 3
    return float(np.median(gaps))
