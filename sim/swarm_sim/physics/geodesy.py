"""WGS-84 geodetic coordinates to and from a local tangent plane (north, east, down). Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

Vector3 = tuple[float, float, float]

_A = 6378137.0
_F = 1.0 / 298.257223563
_B = _A * (1.0 - _F)
_E2 = _F * (2.0 - _F)
_EP2 = _E2 / (1.0 - _E2)


@dataclass(frozen=True, slots=True)
class GeodeticPoint:
    """Height in metres above the ellipsoid, which the simulator takes for mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_m: float


class TangentPlane:
    """The plane that touches the ellipsoid at `origin`; NED metres. Exact."""

    def __init__(self, origin: GeodeticPoint) -> None:
        self.origin = origin
        lat, lon = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
        self._sin_lat, self._cos_lat = math.sin(lat), math.cos(lat)
        self._sin_lon, self._cos_lon = math.sin(lon), math.cos(lon)
        self._ecef = _ecef_from_geodetic(origin)

    def geodetic_from_ned(self, ned_m: Vector3) -> GeodeticPoint:
        """Where the point `ned_m` of this plane is on the ellipsoid."""
        north, east, down = ned_m
        radial = -self._sin_lat * north - self._cos_lat * down
        x = self._ecef[0] + radial * self._cos_lon - self._sin_lon * east
        y = self._ecef[1] + radial * self._sin_lon + self._cos_lon * east
        z = self._ecef[2] + self._cos_lat * north - self._sin_lat * down
        return _geodetic_from_ecef(x, y, z)

    def ned_from_geodetic(self, point: GeodeticPoint) -> Vector3:
        """`point` seen from this plane's origin."""
        x, y, z = _ecef_from_geodetic(point)
        dx, dy, dz = x - self._ecef[0], y - self._ecef[1], z - self._ecef[2]
        radial = dx * self._cos_lon + dy * self._sin_lon
        north = -self._sin_lat * radial + self._cos_lat * dz
        east = -self._sin_lon * dx + self._cos_lon * dy
        return north, east, -self._cos_lat * radial - self._sin_lat * dz


def _ecef_from_geodetic(point: GeodeticPoint) -> Vector3:
    lat, lon = math.radians(point.lat_deg), math.radians(point.lon_deg)
    sin_lat, cos_lat = math.sin(lat), math.cos(lat)
    normal = _A / math.sqrt(1.0 - _E2 * sin_lat * sin_lat)
    radial = (normal + point.alt_m) * cos_lat
    return (
        radial * math.cos(lon),
        radial * math.sin(lon),
        (normal * (1.0 - _E2) + point.alt_m) * sin_lat,
    )


def _geodetic_from_ecef(x: float, y: float, z: float) -> GeodeticPoint:
    """Bowring's formula: one pass is good to nanometres near the ground."""
    radial = math.hypot(x, y)
    beta = math.atan2(z * _A, radial * _B)
    sin_b, cos_b = math.sin(beta), math.cos(beta)
    lat = math.atan2(z + _EP2 * _B * sin_b**3, radial - _E2 * _A * cos_b**3)
    sin_lat, cos_lat = math.sin(lat), math.cos(lat)
    normal = _A / math.sqrt(1.0 - _E2 * sin_lat * sin_lat)
    alt = radial * cos_lat + z * sin_lat - _A * _A / normal
    return GeodeticPoint(math.degrees(lat), math.degrees(math.atan2(y, x)), alt)
