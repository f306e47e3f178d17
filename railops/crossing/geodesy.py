"""Where things are: positions on Earth, and the distance between two of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from railops._extras import extra
from railops.errors import check_range

EARTH_RADIUS_M = 6_371_008.8  # mean radius of the GRS 80 ellipsoid, (2a + b) / 3


@dataclass(frozen=True)
class Position:
    """A position as a satellite receiver gives it.

    Attributes:
        latitude_deg: Latitude, degrees, −90 … 90, north positive.
        longitude_deg: Longitude, degrees, −180 … 180, east positive.

    Raises:
        DomainError: if it is not a position on Earth.
    """

    latitude_deg: float
    longitude_deg: float

    def __post_init__(self) -> None:
        hint = "latitude comes first"
        check_range("latitude_deg", self.latitude_deg, -90.0, 90.0, "°", hint=hint)
        check_range("longitude_deg", self.longitude_deg, -180.0, 180.0, "°", hint=hint)


def haversine_m(a: Position, b: Position) -> float:
    """Great-circle distance on a sphere, metres   [eq. 1.1].

    d = 2R·arcsin √( sin²(Δφ/2) + cos φ_A · cos φ_B · sin²(Δλ/2) )

    Within 0.6 % of the ellipsoid's distance: good for ranking crossings, not for braking.

    Example:
        >>> riga, daugavpils = Position(56.9496, 24.1052), Position(55.8747, 26.5362)
        >>> round(haversine_m(riga, daugavpils))
        191419
    """
    lat_a, lat_b = math.radians(a.latitude_deg), math.radians(b.latitude_deg)
    half_lat = 0.5 * (lat_a - lat_b)
    half_lon = 0.5 * math.radians(a.longitude_deg - b.longitude_deg)
    h = math.sin(half_lat) ** 2 + math.cos(lat_a) * math.cos(lat_b) * math.sin(half_lon) ** 2
    return 2.0 * EARTH_RADIUS_M * math.asin(min(1.0, math.sqrt(h)))


def geodesic_m(a: Position, b: Position) -> float:
    """Distance on the WGS 84 ellipsoid, metres, by Karney's algorithm (to nanometres).

    Raises:
        MissingExtraError: if geographiclib is not installed.
    """
    wgs84 = extra("crossing", "geographiclib.geodesic", "the geodesic distance").Geodesic.WGS84
    found = wgs84.Inverse(a.latitude_deg, a.longitude_deg, b.latitude_deg, b.longitude_deg)
    return float(found["s12"])


def offset(origin: Position, east_m: float, north_m: float) -> Position:
    """The position ``east_m`` and ``north_m`` from ``origin``; plane, for a few kilometres only.

    Example:
        >>> here = Position(56.95, 24.1)
        >>> round(haversine_m(here, offset(here, 300.0, 400.0)), 1)
        500.0
    """
    check_range("east_m", east_m, -50_000.0, 50_000.0, "m")
    check_range("north_m", north_m, -50_000.0, 50_000.0, "m")
    latitude = origin.latitude_deg + math.degrees(north_m / EARTH_RADIUS_M)
    parallel_m = EARTH_RADIUS_M * math.cos(math.radians(origin.latitude_deg))
    return Position(latitude, origin.longitude_deg + math.degrees(east_m / parallel_m))
