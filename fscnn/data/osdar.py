"""OSDaR23's OpenLABEL files: calibrated cameras, rails and boxes (DZSF 2023).

A sensor's axes are x ahead, y left, z up, and its pose is given in the frame ``base``, which stands
on the rail tops between the rails. Each object holds its shapes by sensor: ``bbox`` as centre and
size, ``poly2d`` as u, v, u, v, …; the two ``poly2d`` of a ``track`` are its rails.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from railinspect.annotations import Annotation, Box, RailPair, Shape, rail_pair
from railinspect.camera import Camera
from railinspect.errors import BadInputError


class OpenLabel:
    """One OSDaR23 sequence.

    Attributes:
        path: The file.
        cameras: Names of its cameras.
        frames: Names of its frames, in order.
    """

    def __init__(self, path: Path) -> None:
        """Read a file.

        Raises:
            BadInputError: if it cannot be read or is not OpenLABEL.
        """
        try:
            self._data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["openlabel"]
            self.frames = tuple(sorted(self._data["frames"], key=int))
            self.cameras = tuple(
                name for name, s in self._data["streams"].items() if s["type"] == "camera"
            )
            self._systems = self._data["coordinate_systems"]
        except OSError as error:
            raise BadInputError(f"cannot read {path}: {error.strerror}") from error
        except (ValueError, KeyError, TypeError) as error:
            raise BadInputError(
                f"{path} is not an OpenLABEL file of OSDaR23 ({type(error).__name__}: {error}); "
                "pass a sequence's *_labels.json"
            ) from error
        self.path = path

    def camera(self, name: str) -> Camera:
        """The calibrated camera ``name`` over the track the train stands on.

        Raises:
            BadInputError: if there is no such camera, or its pixels are not square.
        """
        self._known(name)
        try:
            pinhole = self._data["streams"][name]["stream_properties"]["intrinsics_pinhole"]
            pose = self._systems[name]["pose_wrt_parent"]
            f_u, f_v = pinhole["camera_matrix"][0], pinhole["camera_matrix"][5]
            centre = (pinhole["camera_matrix"][2], pinhole["camera_matrix"][6])
            k1, k2, p1, p2, k3 = pinhole["distortion_coeffs"]
            size = (int(pinhole["width_px"]), int(pinhole["height_px"]))
            _, offset_m, height_m = pose["translation"]
            rotation = Rotation.from_quat(pose["quaternion"])
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"{self.path}: camera {name} has no full calibration") from error
        if abs(f_u / f_v - 1) > 1e-3:
            raise BadInputError(f"{self.path}: camera {name} has pixels that are not square")
        # Base from sensor, turned about z, then y, then x: left, downwards, right side down.
        yaw, pitch, roll = rotation.as_euler("ZYX")
        return Camera(
            size_wh=size,
            focal_px=f_u,
            principal_uv=centre,
            height_m=height_m,
            pitch_rad=float(pitch),
            roll_rad=float(roll),
            yaw_rad=float(yaw),
            offset_m=offset_m,
            distortion=(k1, k2, p1, p2, k3),
        )

    def annotation(self, frame: str, camera: str) -> Annotation:
        """What is drawn on one camera's image of one frame.

        Raises:
            BadInputError: if there is no such frame or camera.
        """
        self._known(camera)
        if frame not in self._data["frames"]:
            raise BadInputError(
                f"{self.path} has no frame {frame!r}; it has {self.frames[0]} … {self.frames[-1]}"
            )
        held = self._data["frames"][frame]
        rails: list[RailPair] = []
        shapes: list[Shape] = []
        boxes: list[Box] = []
        for key, content in held.get("objects", {}).items():
            kind = self._data["objects"][key]["type"]
            data = content["object_data"]
            for box in data.get("bbox", ()):
                if box["coordinate_system"] == camera:
                    u, v, w, h = box["val"]
                    boxes.append(Box(kind, (u - w / 2, v - h / 2, u + w / 2, v + h / 2)))
            drawn = [p for p in data.get("poly2d", ()) if p["coordinate_system"] == camera]
            lines = [np.array(p["val"], float).reshape(-1, 2) for p in drawn]
            if kind == "track" and len(lines) == 2:
                rails.append(rail_pair(lines[0], lines[1], self._data["objects"][key]["name"]))
            else:
                shapes.extend(
                    Shape(kind, line, bool(p.get("closed", False)))
                    for line, p in zip(lines, drawn, strict=True)
                )
        uri = held["frame_properties"]["streams"].get(camera, {}).get("uri", f"{camera}/{frame}")
        size = self.camera(camera).size_wh
        return Annotation(uri.lstrip("/"), size, tuple(rails), tuple(shapes), tuple(boxes))

    def _known(self, camera: str) -> None:
        if camera not in self.cameras:
            raise BadInputError(
                f"{self.path} has no camera {camera!r}; it has {', '.join(self.cameras)}"
            )
