"""The tangent plane against an independent route (arc lengths along the ellipsoid), and its round
trip."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.frames import geodetic_from_ned, ned_from_geodetic
from swarm_ctl.core.model.plan import Geodetic

CANBERRA = Geodetic(-35.363262, 149.165237, 584.0)

origins = st.builds(
    Geodetic, st.floats(-90, 90), st.floats(-180, 180, exclude_min=True), st.floats(-500, 9000)
)
offsets = st.tuples(st.floats(-5000, 5000), st.floats(-5000, 5000), st.floats(-500, 500))


@given(origins, offsets)
def test_there_and_back_is_where_one_started(
    origin: Geodetic, ned_m: tuple[float, float, float]
) -> None:
    back = ned_from_geodetic(geodetic_from_ned(ned_m, origin), origin)
    assert back == pytest.approx(ned_m, abs=1e-6)


@given(origins)
def test_the_origin_is_zero(origin: Geodetic) -> None:
    assert ned_from_geodetic(origin, origin) == (0.0, 0.0, 0.0)


@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3))
def test_small_offsets_follow_the_radii_of_curvature(
    lat: float, lon: float, dlat: float, dlon: float
) -> None:
    """Within 111 m the exact plane and the textbook's meridian and prime-vertical radii agree to 5
    cm."""
    a, e2 = 6378137.0, 0.00669437999014
    s = math.sin(math.radians(lat))
    meridian = a * (1 - e2) / (1 - e2 * s * s) ** 1.5
    parallel = a / math.sqrt(1 - e2 * s * s) * math.cos(math.radians(lat))
    north, east, down = ned_from_geodetic(
        Geodetic(lat + dlat, lon + dlon, 0.0), Geodetic(lat, lon, 0.0)
    )
    assert north == pytest.approx(meridian * math.radians(dlat), abs=0.05)
    assert east == pytest.approx(parallel * math.radians(dlon), abs=0.05)
    assert -1e-8 <= down <= 0.01  # coordinates of 6,400 km are rounded to 1e-9 m each


@pytest.mark.parametrize(
    ("point", "ned_m"),
    [
        # One quarter of the way round the equator, and a pole: known from the ellipsoid's axes
        # alone.
        (Geodetic(0.0, 90.0, 0.0), (0.0, 6378137.0, 6378137.0)),
        (Geodetic(90.0, 0.0, 0.0), (6356752.314245, 0.0, 6378137.0)),
        (Geodetic(0.0, 0.0, 100.0), (0.0, 0.0, -100.0)),
    ],
)
def test_places_known_from_the_axes(point: Geodetic, ned_m: tuple[float, float, float]) -> None:
    origin = Geodetic(0.0, 0.0, 0.0)
    assert ned_from_geodetic(point, origin) == pytest.approx(ned_m, abs=1e-5)
    assert ned_from_geodetic(geodetic_from_ned(ned_m, origin), origin) == pytest.approx(
        ned_m, abs=1e-5
    )


def test_signs_north_east_down() -> None:
    north, east, down = (
        ned_from_geodetic(
            Geodetic(CANBERRA.lat_deg + dlat, CANBERRA.lon_deg + dlon, CANBERRA.alt_m + dalt),
            CANBERRA,
        )
        for dlat, dlon, dalt in ((1e-4, 0, 0), (0, 1e-4, 0), (0, 0, -1))
    )
    assert north == pytest.approx((11.095, 0, 0), abs=0.01)
    assert east == pytest.approx((0, 9.090, 0), abs=0.01)
    assert down == pytest.approx((0, 0, 1), abs=1e-6)


def test_across_the_date_line() -> None:
    north, east, _ = ned_from_geodetic(Geodetic(0.0, -179.9999, 0.0), Geodetic(0.0, 179.9999, 0.0))
    assert (north, east) == pytest.approx((0.0, 22.264), abs=0.001)
