"""The pinhole cab camera over a track: projection, ground plane, horizon, and its YAML file.

World frame: x along the track ahead, y left, z up, metres; the origin lies on the track centre
line under the camera, at the height of the rail tops, so ``z = 0`` is the running surface.
Image frame: u right, v down, pixels, (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import yaml

from railinspect.errors import BadInputError
from railinspect.labels import GAUGES_M, RAIL_HEAD_WIDTH_M
from railops.files import parse_yaml

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CameraStd:
    """One standard deviation of each calibrated quantity, in the quantity's own unit."""

    focal_px: float = 0.0
    height_m: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    gauge_m: float = 0.0


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with Brown–Conrady distortion above a track.

    Attributes:
        size_wh: Image width and height, pixels.
        focal_px: Focal length, pixels (square pixels).
        principal_uv: Principal point, pixels.
        height_m: Height of the optical centre above the rail tops, metres, > 0.
        pitch_rad: Rotation downwards, radians; positive looks at the ground.
        roll_rad: Clockwise rotation about the viewing direction, radians; positive lowers the
            camera's right side, so the horizon in the image rises to the right.
        yaw_rad: Rotation to the left, radians, against the track's direction at the camera.
        offset_m: Lateral position of the camera, metres, positive to the left of the centre line.
        distortion: k1, k2, p1, p2, k3 of the Brown–Conrady model, as OpenCV orders them.
        gauge_m: Track gauge between the inner faces of the heads, metres.
        std: Standard deviation of each of these that was estimated.
    """

    size_wh: tuple[int, int]
    focal_px: float
    principal_uv: tuple[float, float]
    height_m: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    yaw_rad: float = 0.0
    offset_m: float = 0.0
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    gauge_m: float = GAUGES_M["standard"]
    std: CameraStd = field(default_factory=CameraStd)

    def __post_init__(self) -> None:
        width, height = self.size_wh
        if width < 1 or height < 1:
            raise BadInputError(f"camera size_wh is {self.size_wh}; both must be at least 1 pixel")
        for name in ("focal_px", "height_m", "gauge_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise BadInputError(f"camera {name} is {value}; give a positive number")
        angles = (self.pitch_rad, self.roll_rad, self.yaw_rad)
        others = (*self.principal_uv, *self.distortion, *angles, self.offset_m)
        if not all(math.isfinite(value) for value in others):
            raise BadInputError(
                "camera principal point, distortion, angles and offset must be finite numbers"
            )
        for name, value in vars(self.std).items():
            if not (math.isfinite(value) and value >= 0):
                raise BadInputError(
                    f"camera standard deviation of {name} is {value}; give a number of at least 0"
                )
        if not abs(self.pitch_rad) < math.pi / 3 or not abs(self.roll_rad) < math.pi / 3:
            raise BadInputError(
                f"camera pitch_rad {self.pitch_rad} and roll_rad {self.roll_rad} must lie within "
                "±π/3; angles are in radians"
            )

    @staticmethod
    def from_field_of_view(
        size_wh: tuple[int, int], horizontal_fov_rad: float, height_m: float, **rest: Any
    ) -> Camera:
        """Build a camera with a centred principal point from its horizontal field of view."""
        width, height = size_wh
        focal_px = width / 2 / math.tan(horizontal_fov_rad / 2)
        centre = ((width - 1) / 2, (height - 1) / 2)
        return Camera(size_wh, focal_px, centre, height_m, **rest)

    @property
    def rail_spacing_m(self) -> float:
        """Distance between the centre lines of the two rail heads, metres."""
        return self.gauge_m + RAIL_HEAD_WIDTH_M

    @cached_property
    def camera_from_world(self) -> Array:
        """Rotation from world to camera axes (right, down, ahead), shape (3, 3)."""
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        yaw = np.array([[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]])
        axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        pitch = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
        roll = np.array([[cr, sr, 0.0], [-sr, cr, 0.0], [0.0, 0.0, 1.0]])
        rotation = cast(Array, roll @ pitch @ axes @ yaw)
        rotation.setflags(write=False)
        return rotation

    def project(self, points_xyz: npt.ArrayLike) -> Array:
        """Project world points without lens distortion.

        Args:
            points_xyz: World points, metres, shape (..., 3).

        Returns:
            Pixels (u, v), shape (..., 2); NaN for points at or behind the camera.
        """
        points = np.asarray(points_xyz, float) - np.array([0.0, self.offset_m, self.height_m])
        seen = points @ self.camera_from_world.T
        depth = np.where(seen[..., 2] > 1e-6, seen[..., 2], np.nan)
        centre = np.array(self.principal_uv)
        return cast(Array, seen[..., :2] / depth[..., None] * self.focal_px + centre)

    def distort(self, pixels_uv: npt.ArrayLike) -> Array:
        """Pixels where the lens shows undistorted pixels (Brown–Conrady), shape (..., 2)."""
        pixels = np.asarray(pixels_uv, float)
        if not any(self.distortion):
            return pixels
        k1, k2, p1, p2, k3 = self.distortion
        centre = np.array(self.principal_uv)
        a, b = np.moveaxis((pixels - centre) / self.focal_px, -1, 0)
        r2 = a * a + b * b
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        seen = np.stack(
            [
                a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a),
                b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b,
            ],
            axis=-1,
        )
        return cast(Array, seen * self.focal_px + centre)

    def undistort(self, pixels_uv: npt.ArrayLike) -> Array:
        """Undo :meth:`distort` by fixed-point iteration, shape (..., 2)."""
        pixels = np.asarray(pixels_uv, float)
        if not any(self.distortion):
            return pixels
        guess = pixels.copy()
        for _ in range(12):
            guess = guess + pixels - self.distort(guess)
        return cast(Array, guess)

    def ray(self, pixels_uv: npt.ArrayLike) -> Array:
        """World direction of each undistorted pixel's ray, not normalised, shape (..., 3)."""
        pixels = np.asarray(pixels_uv, float)
        plane = (pixels - np.array(self.principal_uv)) / self.focal_px
        seen = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        return cast(Array, seen @ self.camera_from_world)

    def ground(self, pixels_uv: npt.ArrayLike, z_m: float = 0.0) -> Array:
        """Intersect pixel rays with the plane ``z = z_m``.

        Args:
            pixels_uv: Undistorted pixels, shape (..., 2).
            z_m: Height of the plane above the rail tops, metres.

        Returns:
            World x and y, metres, shape (..., 2); NaN where the ray does not descend to the plane.
        """
        ray = self.ray(pixels_uv)
        drop = np.where(ray[..., 2] < -1e-9, ray[..., 2], np.nan)
        scale = (z_m - self.height_m) / drop
        scale = np.where(scale > 0, scale, np.nan)
        return cast(Array, ray[..., :2] * scale[..., None] + np.array([0.0, self.offset_m]))

    def horizon_v(self, u_px: float | None = None) -> float:
        """Row of the ground plane's horizon at column ``u_px`` (default: the principal point's)."""
        u = self.principal_uv[0] if u_px is None else u_px
        x, y, z = self.camera_from_world[:, 2].tolist()  # the ground's normal
        across = (u - self.principal_uv[0]) / self.focal_px
        return float(self.principal_uv[1] - self.focal_px * (x * across + z) / y)

    def resized(self, size_wh: tuple[int, int]) -> Camera:
        """The same camera delivering images of another size (focal length follows the width)."""
        width, height = size_wh
        scale_u, scale_v = width / self.size_wh[0], height / self.size_wh[1]
        u, v = self.principal_uv
        return replace(
            self,
            size_wh=size_wh,
            focal_px=self.focal_px * scale_u,
            principal_uv=((u + 0.5) * scale_u - 0.5, (v + 0.5) * scale_v - 0.5),
            std=replace(self.std, focal_px=self.std.focal_px * scale_u),
        )

    def save(self, path: Path) -> None:
        """Write the camera as YAML."""
        data = asdict(self)
        for name in ("size_wh", "principal_uv", "distortion"):
            data[name] = list(data[name])
        path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")

    @staticmethod
    def load(path: Path) -> Camera:
        """Read a camera from YAML.

        Raises:
            BadInputError: if the file is missing, is not a mapping, or has wrong keys or values.
        """
        try:
            data = parse_yaml(path.read_text(encoding="utf-8"))[0]
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise BadInputError(f"cannot read camera file {path}: {error}") from error
        if not isinstance(data, dict):
            raise BadInputError(f"camera file {path} must hold a mapping of camera quantities")
        known = {f.name for f in fields(Camera)}
        if unknown := sorted(set(map(str, data)) - known):
            raise BadInputError(
                f"camera file {path} has unknown keys {unknown}; known: {sorted(known)}"
            )
        try:
            data["std"] = CameraStd(**data.get("std", {}))
            for name in ("size_wh", "principal_uv", "distortion"):
                if name in data:
                    data[name] = tuple(data[name])
            return Camera(**data)
        except TypeError as error:
            raise BadInputError(f"camera file {path} is incomplete or mistyped: {error}") from error
