"""Reads YAML strictly and keeps the line of every value, so that a problem names its place.

Scalars follow YAML 1.2's core schema without its exotic number forms: `on`, `yes`, `010`, `1_000`,
`1:30` and dates are text (YAML 1.1 converts them), and `1e3` is a number.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from swarm_ctl.errors import MissionError
from swarm_ctl.files import read_bytes
from swarm_ctl.mission.input.document import Document, Place, dotted, problem_at

MOST_ENTRIES = {
    "agents": 250,
    "steps": 1000,
    "offsets": 1000,
    "up_m": 1000,
    "along": 200,
    "polygon": 200,
}
"""Of the lists of a file, by field, at most, as the schema says; told before all are parsed."""
_MOST_ENTRIES = 31_125
"""Of any other list, or mapping: the pairs of 250 agents."""
_MOST_NODES = 250_000
"""Values in a file at most: 250 agents with all pairs and fifty shapes, slot by slot."""


class _TooManyError(Exception):
    def __init__(self, mark: yaml.Mark, field: str, what: str, allowed: str) -> None:
        self.line, self.field, self.what, self.allowed = mark.line + 1, field, what, allowed


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers = {}  # noqa: RUF012 (PyYAML declares it on the instance)
    _field = ""
    _nodes = 0

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.composer.ComposerError(None, None, "aliases (*name) are not supported", mark)
        self._count(parent, mark)
        outer = self._field
        if isinstance(index, ScalarNode):  # the name of the field whose value this is
            self._field = str(index.value)
        node = super().compose_node(parent, index)
        self._field = outer
        return node

    def _count(self, parent: Node | None, mark: yaml.Mark) -> None:
        self._nodes += 1
        if self._nodes > _MOST_NODES:
            what = f"the file has more than {_MOST_NODES} values"
            raise _TooManyError(mark, dotted(()), what, "fewer")
        if not isinstance(parent, SequenceNode | MappingNode):
            return
        most = MOST_ENTRIES.get(self._field, _MOST_ENTRIES)
        if len(parent.value) >= most:
            what, allowed = f"has more than {most} entries", f"at most {most} entries"
            raise _TooManyError(mark, self._field or dotted(()), what, allowed)


_MOST_DIGITS = 300
"""A whole number of more is read as a float, which may be infinite: it is told as such, and no
arithmetic overflows."""
_TAG = "tag:yaml.org,2002:"
_MOST_BYTES = 4_000_000
"""Twice what 250 agents with a hundred shapes, slot by slot, need; more takes seconds to parse."""
for _name, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?(0|[1-9][0-9]*)", "-+0123456789"),
    ("float", r"[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?", "-+.0123456789"),
    ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", "-+."),
):
    _Loader.add_implicit_resolver(_TAG + _name, re.compile(f"(?:{_pattern})$"), list(_first))


class _Dumper(yaml.SafeDumper):
    yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers


def write(data: Any) -> str:
    """Plain data as YAML that `parse` reads back as it was."""
    return yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True
    )


def read(path: Path, *, what: str = "mission", also: Sequence[str] = ()) -> Document:
    """Read a YAML file; MissionError if it can't be read or parsed at all, or is another kind of
    file than `what`, and than those that it may `also` be."""
    try:
        data = read_bytes(path, _MOST_BYTES)
    except OSError as error:
        if error.errno == errno.EFBIG:
            allowed = f"at most {_MOST_BYTES / 1e6:g} MB"
            raise _refuse(f"{path}:1", "the file is too large", allowed) from error
        reason = error.strerror or str(error)
        raise _refuse(str(path), f"can't be read: {reason}", f"a readable {what} file") from error
    known = foreign(data[:65_536].decode("utf-8", "replace"))
    if known == _PLAN:
        raise _other(path, known, what, f"{_PLAN} is flown by swarm-ctl agent")
    if known:
        raise _other(path, known, what, "`swarm-ctl missions copy hexagon` makes one to begin with")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise _refuse(
            f"{path}:{line}", f"is not text: {error.reason} at byte {error.start}", "UTF-8 text"
        ) from error
    document = parse(text, str(path))
    if (own := kind_of(document.data)) and own not in (what, *also):
        raise _other(path, f"a {own}", what, _USES[own])
    return document


def kind_of(data: Any) -> str:
    """Which of the files of ours has such fields at its top; '' where that is not sure."""
    names = set(data) if isinstance(data, dict) else set()
    if "steps" in names:
        return "mission"
    for kind, own, of_missions in _OURS:
        if own in names and not names & of_missions:
            entries = data[own] if isinstance(data[own], tuple) else ()
            start = any(isinstance(entry, dict) and "start" in entry for entry in entries)
            return "" if start else kind
    return ""


def nodes(text: str) -> Node | None:
    """The YAML nodes of a text that `parse` accepts, with their positions in it."""
    found: Node | None = yaml.compose(text, Loader=_Loader)
    return found


def parse(text: str, name: str) -> Document:
    """Parse YAML text; problems call it `name`. MissionError if it is not YAML."""
    try:
        node = yaml.compose(text, Loader=_Loader)
        document = Document(name)
        if node is None:
            raise _refuse(f"{name}:1", "is empty", "a mapping of fields to values")
        document.data = _Converter(document).convert(node, ())
    except _TooManyError as error:
        found = problem_at(f"{name}:{error.line}", error.field, error.what, error.allowed)
        raise MissionError((found,)) from None
    except yaml.MarkedYAMLError as error:
        raise _syntax(error, text, name) from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        character = f"character {error.character!r}"
        raise _refuse(
            f"{name}:{line}", f"YAML: {character} ({error.reason})", "printable text"
        ) from error
    except RecursionError as error:
        raise _refuse(
            f"{name}:1", "is nested too deeply", "a few levels of mappings and lists"
        ) from error
    return document


_ENTRY_AMONG_FIELDS = (
    "a list entry (-) stands among fields",
    "a line such as 'steps:' above it, or the indentation of its siblings",
)
_FIELD_AMONG_ENTRIES = (
    "a field stands among list entries",
    "a - in front of it, or the indentation of the fields that it belongs to",
)
_IN_WORDS = {
    "mapping values are not allowed": (
        "a ':' stands where no field can begin",
        "a field on a line of its own, or quotes around a text that has ': '",
    ),
    "could not find expected ':'": ("a name without a colon and a space after it", "name: value"),
    "expected the node content": ("a value is missing", "a value, or no field"),
    "block mapping.*found ('-'|'<block sequence start>')": _ENTRY_AMONG_FIELDS,
    "block collection.*found ('\\?'|'<block mapping start>')": _FIELD_AMONG_ENTRIES,
    r"found '[,}\]]'": ("a { or [ is missing before this", "well-formed YAML"),
    "found ':'": ("a ':' without a name before it", "name: value"),
    r"aliases \(\*name\)": ("aliases (*name) are not supported", "the value itself, written out"),
    "expected <block end>": ("text stands where none can be", "name: value, or - and an entry"),
}
"""PyYAML's messages as patterns, with what is wrong, and what is allowed."""
_UNCLOSED = {
    "while parsing a flow mapping": "a { is not closed, or a comma is missing",
    "while parsing a flow sequence": "a [ is not closed, or a comma is missing",
    "while scanning a quoted scalar": "a quote is not closed",
}
"""PyYAML's contexts in words."""


def _syntax(error: yaml.MarkedYAMLError, text: str, name: str) -> MissionError:
    """What is no YAML, in the words of the one who wrote it."""
    mark, since = error.problem_mark or error.context_mark, error.context_mark
    what = " ".join(part for part in (error.context, error.problem) if part)
    if since and ("expected ':'" in what or "quoted" in what):
        mark = since  # PyYAML notices later
    where = f"{name}:{mark.line + 1}" if mark else name
    if "'\\t'" in what:
        return _refuse(where, f"YAML: {what}", "spaces, not tabs, in front of a field")
    if since and error.context in _UNCLOSED:
        opened = f"{_UNCLOSED[error.context]} (it begins in line {since.line + 1})"
        return _refuse(where, f"YAML: {opened}", "well-formed YAML")
    line = text.splitlines()[mark.line] if mark and mark.line < text.count("\n") + 1 else ""
    if stuck := re.match(r"\s*-([A-Za-z_]+):", line):
        return _refuse(where, f"YAML: -{stuck[1]} has no space after the -", f"- {stuck[1]}:")
    if mark and (indented := misindented(text, mark.line + 1)):
        return _refuse(where, f"YAML: {indented}", "one indentation for all of a list or section")
    for pattern, (said, allowed) in _IN_WORDS.items():
        if re.search(pattern, what):
            return _refuse(where, f"YAML: {said}", allowed)
    return _refuse(where, f"YAML: {what}", "well-formed YAML")


def _other(path: Path, known: str, what: str, hint: str) -> MissionError:
    return _refuse(f"{path}:1", f"this is {known}, no {what}", f"a {what} file; {hint}")


def _refuse(where: str, what: str, allowed: str) -> MissionError:
    return MissionError((problem_at(where, dotted(()), what, allowed),))


class _Converter:
    """Converts nodes to plain data; notes lines and duplicate keys in the document."""

    def __init__(self, document: Document) -> None:
        self._document = document

    def convert(self, node: Node, place: Place) -> Any:
        # The line of a mapping's entry is its key's, noted before; other nodes have their own.
        self._document.wheres.setdefault(place, self._where(node))
        if isinstance(node, MappingNode):
            self._untagged(node, place, "map")
            return self._mapping(node, place)
        if isinstance(node, SequenceNode):
            self._untagged(node, place, "seq")
            return tuple(self.convert(item, (*place, k)) for k, item in enumerate(node.value))
        return self._scalar(node, place)

    def _mapping(self, node: MappingNode, place: Place) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, ScalarNode):
                what = "a list or mapping can't be a field's name"
                self._note(key_node, place, what, "a plain word")
                continue
            key = key_node.value
            inner = (*place, key)
            if key in result:
                first = self._document.where(inner)
                self._note(key_node, inner, f"is given twice (first at {first})", "each field once")
                continue
            self._document.wheres[inner] = self._where(key_node)
            result[key] = self.convert(value_node, inner)
        return result

    def _scalar(self, node: Node, place: Place) -> Any:
        text, tag = node.value, node.tag.removeprefix(_TAG)
        try:
            if tag == "bool":
                return text.lower() == "true"
            if tag == "int":
                return int(text) if len(text) <= _MOST_DIGITS else float(text)
            if tag == "float":
                return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        except ValueError:
            return text
        self._untagged(node, place, "str", "null")
        return None if tag == "null" else text

    def _untagged(self, node: Node, place: Place, *plain: str) -> None:
        if node.tag.removeprefix(_TAG) not in plain:
            self._note(node, place, f"has the YAML tag {node.tag!r}", "no tags")

    def _where(self, node: Node) -> str:
        return f"{self._document.name}:{node.start_mark.line + 1}"

    def _note(self, node: Node, place: Place, what: str, allowed: str) -> None:
        self._document.problems.append(problem_at(self._where(node), dotted(place), what, allowed))


_USES: Final = {
    "mission": "swarm-ctl run flies a mission, and a scenario names it in `mission`",
    "scenario": "swarm-ctl run and swarm-ctl fuzz --replay fly a scenario",
    "fleet": "a fleet is named by --fleet, or by `fleet` in a mission",
    "study": "swarm-ctl study flies a study",
}
"""What each kind of file of ours is for."""
_OURS: Final = (
    ("scenario", "mission", {"agents", "shapes", "origin", "law"}),
    ("study", "missions", {"agents", "shapes", "origin"}),
    ("fleet", "agents", {"name", "shapes", "origin", "law"}),
)
"""A kind of file, a field that it has, and fields that say it is a mission without its steps."""
_PLAN: Final = "a plan file"
_KINDS: Final = (
    ("PK\x03\x04", "", "a zip archive (a Skybrush show or a .kmz)"),
    ("QGC WPL", "", "a waypoint file (QGC WPL)"),
    ("<", "<kml", "a KML file"),
    ("<", "<gpx", "a GPX file"),
    ("<", "", "an XML file"),
    ("{", '"fileType"', "a QGroundControl plan"),
    ("{", '"Feature', "a GeoJSON file"),
    ("{", '"schema_version"', _PLAN),
    ("# Onboard parameters", "", "a parameter file of an autopilot"),
    ("", "\nrobot_types:", "a crazyflies.yaml (Crazyswarm2)"),
)
"""How a file begins, what its beginning has, and what to call it; the first that fits."""


def foreign(head: str) -> str:
    """What the file with this beginning is, if another program made it: `a KML file`; else ''."""
    begins = head.lstrip("\ufeff \t\r\n")
    for start, has, name in _KINDS:
        if begins.startswith(start) and has in f"\n{begins}":
            return name
    first, second = [*begins.splitlines()[:2], "", ""][:2]
    table = not begins.startswith(("[", "{", "-")) and not set(first) & set(":#")
    if table and any(first.count(mark) == second.count(mark) > 1 for mark in ",;\t"):
        return "a CSV table"
    return ""


_ENTRY = re.compile(r"(?P<indent> *)(?P<dash>- +|-$)?(?P<rest>.*)")


class _Level(NamedTuple):
    indent: int
    dash: bool
    """Its lines are entries of a list."""


def misindented(text: str, number: int) -> str:
    """What is wrong with the indentation of line `number` (from 1) of a text that is no YAML: in
    words, with what its siblings have; '' where its indentation is sound."""
    levels, opens = list[_Level](), True
    lines = text.splitlines()[:number]
    for line in lines[:-1]:
        if line.strip() and not line.lstrip().startswith("#"):
            levels, opens = _after(levels, line), _opens(line)
    if not lines or not (line := lines[-1]).strip():
        return ""
    found = _level(line)
    deeper = [level for level in levels if level.indent > found.indent]
    same = [level for level in levels if level.indent == found.indent]
    alike = [level for level in levels if level.dash == found.dash]
    if same or not alike or (not deeper and opens):
        return ""
    sibling = min(alike, key=lambda level: (abs(level.indent - found.indent), -level.indent))
    return f"line {number} is indented by {found.indent}, its siblings by {sibling.indent}"


def _level(line: str) -> _Level:
    found = _ENTRY.match(line)
    return _Level(len(found["indent"]), bool(found["dash"])) if found else _Level(0, False)


def _after(levels: list[_Level], line: str) -> list[_Level]:
    """The levels that are open after a line."""
    own = _level(line)
    kept = [level for level in levels if level.indent < own.indent]
    kept.append(own)
    found = _ENTRY.match(line)
    if found and found["dash"] and re.match(r"[\w-]+:( |$)", found["rest"]):
        kept.append(_Level(own.indent + len(found["dash"]), False))
    return kept


def _opens(line: str) -> bool:
    """Whether what follows may be indented further."""
    return line.partition(" #")[0].rstrip().endswith((":", "-", "|", ">"))
