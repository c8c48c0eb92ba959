"""The moving picture of the README shows what it was given, in a form that browsers animate."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from tests.unit.docs.flight_picture import Sample, draw
from tests.unit.docs.pages import DOCS

SVG = "{http://www.w3.org/2000/svg}"
FLIGHT = [
    Sample(0.25 * k, ((0.0, 0.5 * k), (8.0, 0.0)), "form row" if k else "takeoff")
    for k in range(40)
]


def check(text: str, count: int) -> None:
    """Each drone moves, and the times of each animation rise from 0 to 1."""
    root = ET.fromstring(text)  # noqa: S314 - our own file
    moves = list(root.iter(f"{SVG}animateTransform"))
    assert len(moves) == count
    for move in moves:
        times = [float(time) for time in move.attrib["keyTimes"].split(";")]
        assert times == sorted(times)
        assert (times[0], times[-1]) == (0, 1)
        assert len(move.attrib["values"].split(";")) == len(times)


def test_a_drawn_flight_moves() -> None:
    text = draw(FLIGHT, 2.5, "two drones")
    check(text, 2)
    assert "closest pair 8.0 m" in text
    assert "form row" in text


def test_the_picture_in_the_repository_moves_and_names_its_mission() -> None:
    text = (DOCS / "pictures" / "flight.svg").read_text()
    check(text, 12)
    assert "missions/letters.yaml" in text
