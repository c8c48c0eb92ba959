"""Foxglove's well-known messages as it reads them from JSON: its names, its fields
(https://docs.foxglove.dev/docs/sdk/schemas). Lengths in metres, z up, angles as quaternions."""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.rows import row


@row
class Time:
    """Unix time; of a lifetime, how long."""

    sec: int = 0
    nsec: int = 0


@row
class Vector3:
    """East, north, up."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@row
class Quaternion:
    """A rotation; none by default."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@row
class Pose:
    """Place and rotation in the frame of the entity."""

    position: Vector3 = Vector3()
    orientation: Quaternion = Quaternion()


@row
class Color:
    """Each 0..1."""

    r: float
    g: float
    b: float
    a: float


@row
class KeyValuePair:
    """A word about an entity."""

    key: str
    value: str


@row
class LocationFix:
    """A vehicle on the map."""

    timestamp: Time
    frame_id: str
    latitude: float
    longitude: float
    altitude: float
    position_covariance: tuple[float, ...]
    """3 x 3, row by row; east, north, up."""
    position_covariance_type: int
    velocity: Vector3
    color: Color


@row
class FrameTransform:
    """Where a frame is."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion = Quaternion()


@row
class FrameTransforms:
    """Of all vehicles at one time."""

    transforms: tuple[FrameTransform, ...]


@row
class ArrowPrimitive:
    """Points along x of its pose."""

    pose: Pose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: Color


@row
class CubePrimitive:
    """A box."""

    pose: Pose
    size: Vector3
    color: Color


@row
class SpherePrimitive:
    """An ellipsoid."""

    pose: Pose
    size: Vector3
    color: Color


@row
class CylinderPrimitive:
    """A disc, where it is flat."""

    pose: Pose
    size: Vector3
    bottom_scale: float
    top_scale: float
    color: Color


LINE_STRIP: Final = 0
LINE_LIST: Final = 2


@row
class LinePrimitive:
    """A line, or a list of them; `thickness` in pixels where it is `scale_invariant`."""

    type: int
    pose: Pose
    thickness: float
    scale_invariant: bool
    points: tuple[Vector3, ...]
    color: Color
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


@row
class TriangleListPrimitive:
    """Unused, and a part of every entity."""

    pose: Pose
    points: tuple[Vector3, ...]
    color: Color
    colors: tuple[Color, ...]
    indices: tuple[int, ...]


@row
class TextPrimitive:
    """A label."""

    pose: Pose
    billboard: bool
    font_size: float
    scale_invariant: bool
    color: Color
    text: str


@row
class ModelPrimitive:
    """Unused, and a part of every entity."""

    pose: Pose
    scale: Vector3
    color: Color
    override_color: bool
    url: str
    media_type: str
    data: str


@row
class SceneEntity:
    """Things that are drawn together, replaced by the next entity of that id."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time = Time()
    frame_locked: bool = True
    metadata: tuple[KeyValuePair, ...] = ()
    arrows: tuple[ArrowPrimitive, ...] = ()
    cubes: tuple[CubePrimitive, ...] = ()
    spheres: tuple[SpherePrimitive, ...] = ()
    cylinders: tuple[CylinderPrimitive, ...] = ()
    lines: tuple[LinePrimitive, ...] = ()
    triangles: tuple[TriangleListPrimitive, ...] = ()
    texts: tuple[TextPrimitive, ...] = ()
    models: tuple[ModelPrimitive, ...] = ()


@row
class SceneEntityDeletion:
    """Unused: an entity without content is replaced, or lives its lifetime."""

    timestamp: Time
    type: int
    id: str


@row
class SceneUpdate:
    """What a 3-D panel shows of a topic."""

    entities: tuple[SceneEntity, ...]
    deletions: tuple[SceneEntityDeletion, ...] = ()


@row
class Log:
    """A line of the log."""

    timestamp: Time
    level: int
    """2 info, 3 warning, 4 error."""
    message: str
    name: str
    file: str = ""
    line: int = 0
