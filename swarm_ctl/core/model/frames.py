"""Between the globe and the common frame: the local tangent plane (north, east, down) at an origin,
on WGS-84.

The plane is the exact one (by way of earth-centred coordinates), not a flat-earth scaling:
nanometres of rounding at any distance. `alt_m` stands for the height above the ellipsoid; taking
heights above mean sea level instead, as autopilots report them, leaves a scale error of geoid
height over earth radius (at most 1.7e-5: 1 cm at 600 m). Both directions share it, so a round trip
is exact and all agents of one origin agree.

A plane leaves the earth: at distance d a point of the same altitude lies d^2 / (2 * 6.37e6 m)
further down (0.8 mm at 100 m, 2 m at 5 km).
"""

from __future__ import annotations

import math
from functools import lru_cache

from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.vehicle import Vector3

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
_E2 = FLATTENING * (2 - FLATTENING)
_SEMI_MINOR_M = SEMI_MAJOR_M * (1 - FLATTENING)
_EP2 = _E2 / (1 - _E2)

_Matrix = tuple[Vector3, Vector3, Vector3]


def ned_from_geodetic(point: Geodetic, origin: Geodetic) -> Vector3:
    """(north, east, down) [m] of `point` in the tangent plane at `origin`."""
    (x0, y0, z0), rows = _plane(origin)
    x, y, z = _ecef(point)
    x, y, z = x - x0, y - y0, z - z0
    (nx, ny, nz), (ex, ey, ez), (dx, dy, dz) = rows
    return nx * x + ny * y + nz * z, ex * x + ey * y + ez * z, dx * x + dy * y + dz * z


def geodetic_from_ned(ned_m: Vector3, origin: Geodetic) -> Geodetic:
    """The point at (north, east, down) [m] in the tangent plane at `origin`; the inverse of
    `ned_from_geodetic`."""
    (x0, y0, z0), (n, e, d) = _plane(origin)
    x, y, z = (n[k] * ned_m[0] + e[k] * ned_m[1] + d[k] * ned_m[2] for k in range(3))
    return _geodetic(x0 + x, y0 + y, z0 + z)


@lru_cache(maxsize=64)
def _plane(origin: Geodetic) -> tuple[Vector3, _Matrix]:
    """The origin in earth-centred coordinates [m], and the unit vectors north, east, down there."""
    lat, lon = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
    sin_lat, cos_lat, sin_lon, cos_lon = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    north = (-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
    east = (-sin_lon, cos_lon, 0.0)
    down = (-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat)
    return _ecef(origin), (north, east, down)


def _ecef(point: Geodetic) -> Vector3:
    """Earth-centred, earth-fixed coordinates [m]."""
    lat, lon = math.radians(point.lat_deg), math.radians(point.lon_deg)
    sin_lat, cos_lat = math.sin(lat), math.cos(lat)
    prime_vertical = SEMI_MAJOR_M / math.sqrt(1 - _E2 * sin_lat * sin_lat)
    across = (prime_vertical + point.alt_m) * cos_lat
    return (
        across * math.cos(lon),
        across * math.sin(lon),
        (prime_vertical * (1 - _E2) + point.alt_m) * sin_lat,
    )


def _geodetic(x: float, y: float, z: float) -> Geodetic:
    """Bowring's method; two rounds are exact to rounding for heights within +-100 km of the
    ellipsoid."""
    across = math.hypot(x, y)
    reduced = math.atan2(z * SEMI_MAJOR_M, across * _SEMI_MINOR_M)
    lat = 0.0
    for _ in range(2):
        lat = math.atan2(
            z + _EP2 * _SEMI_MINOR_M * math.sin(reduced) ** 3,
            across - _E2 * SEMI_MAJOR_M * math.cos(reduced) ** 3,
        )
        reduced = math.atan2((1 - FLATTENING) * math.sin(lat), math.cos(lat))
    sin_lat, cos_lat = math.sin(lat), math.cos(lat)
    # Valid at the poles too, where across / cos(lat) is not.
    surface = SEMI_MAJOR_M * math.sqrt(1 - _E2 * sin_lat * sin_lat)
    return Geodetic(
        math.degrees(lat), math.degrees(math.atan2(y, x)), across * cos_lat + z * sin_lat - surface
    )
