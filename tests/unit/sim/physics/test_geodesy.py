"""The tangent plane against its definition."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_sim.physics.geodesy import GeodeticPoint, TangentPlane

origins = st.builds(GeodeticPoint, st.floats(-85, 85), st.floats(-180, 180), st.floats(-100, 5000))
offsets = st.tuples(st.floats(-5000, 5000), st.floats(-5000, 5000), st.floats(-500, 500))


@given(origin=origins, ned=offsets)
def test_there_and_back(origin: GeodeticPoint, ned: tuple[float, float, float]) -> None:
    plane = TangentPlane(origin)
    assert plane.ned_from_geodetic(plane.geodetic_from_ned(ned)) == pytest.approx(ned, abs=1e-5)


@given(origin=origins)
def test_small_steps_are_the_ellipsoid_s_radii_of_curvature(origin: GeodeticPoint) -> None:
    """Meridian radius to the north, prime vertical to the east, at the origin's height."""
    e2 = 0.00669437999014
    sin_lat = math.sin(math.radians(origin.lat_deg))
    normal = 6378137.0 / math.sqrt(1 - e2 * sin_lat**2)
    meridian = normal * (1 - e2) / (1 - e2 * sin_lat**2)
    there = TangentPlane(origin).geodetic_from_ned((10.0, 20.0, -5.0))
    north = math.radians(there.lat_deg - origin.lat_deg) * (meridian + origin.alt_m)
    turn = math.remainder(there.lon_deg - origin.lon_deg, 360.0)
    east = math.radians(turn) * (normal + origin.alt_m) * math.cos(math.radians(origin.lat_deg))
    assert (north, east, there.alt_m - origin.alt_m) == pytest.approx((10.0, 20.0, 5.0), abs=2e-3)
