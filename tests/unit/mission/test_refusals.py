"""Every refusal names the file, the line, the field, what is wrong and what would be allowed; all
of them at once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import load, loads
from tests.unit.mission.example import TEXT, edited, in_metres, problems, without_section

# (what is replaced, by what, line, field, part of what is wrong, part of what would be allowed)
REFUSALS = {
    "unknown field": ("unit_m: 5", "unit: 5", 4, "unit", "did you mean unit_m?", "unit_m"),
    "unknown inner field": ("  r_in: 0.5", "  rin: 0.5", 9, "law.rin", "did you mean r_in?", "r_in"),
    "unknown far field": ("  agent_lost: land", "  colour: red", 30, "policies.colour", "unknown field", "agent_lost"),
    "unknown step": ("- land\n", "- loiter: {}\n", 28, "step 5", 'unknown step "loiter"; did you mean hold?', "takeoff"),
    "unknown word step": ("- land\n", "- loiter\n", 28, "step 5", 'unknown step "loiter"; did you mean hold?', "takeoff, form, hold, move, follow, rotate, scale, barrier, return, land, split"),
    "unknown kind": ("kind: ring", "kind: rind", 16, "shapes.ring.kind", '"rind"', "ring"),
    "kind by another word": ("kind: ring", "kind: hexagon", 16, "shapes.ring.kind", "did you mean ring?", "ring"),
    "field by another word": ("height_m: 10", "altitude: 10", 24, "step 1, takeoff.altitude", "did you mean height_m?", "height_m"),
    "step in capitals": ("- land\n", "- LAND\n", 28, "step 5", "did you mean land?", "land"),
    "step without its fields": ("hold: {duration_s: 10}", "hold", 26, "step 3", "hold lacks its fields", "duration_s"),
    "name with a space": ("name: trio", "name: my trio", 2, "name", "did you mean my-trio?", "no space"),
    "name of another alphabet": ("name: trio", "name: über uns", 2, "name", "did you mean uber-uns?", "A-Z"),
    "name of no letters": ("name: trio", "name: ☃", 2, "name", '"☃" is not allowed', "such as hexagon"),
    "no kind": ("kind: ring, ", "", 16, "shapes.ring.kind", "is missing", "ring"),
    "missing field": ("  r_out: 1.5\n", "", 6, "law.r_out", "is missing", "number above 0"),
    "missing in a list": ("{id: 2, start: [0, 3]}", "{id: 2}", 13, "agents#2.start", "is missing", "[north, east]"),
    "wrong version": ("version: 1", "version: 2", 1, "version", "2", "1"),
    "text for a number": ("unit_m: 5", "unit_m: five", 4, "unit_m", '"five" is text', "number from 0.1 to 1000"),
    "quoted number": ("unit_m: 5", 'unit_m: "5"', 4, "unit_m", "no quotes", "number from"),
    "number with a unit": ("r: 4.5", "r: 4.5 m", 7, "law.r", "no unit", "number above 0"),
    "decimal comma": ("r: 4.5", "r: 4,5", 7, "law.r", "plain decimal digits", "number above 0"),
    "octal": ("id: 1, sysid: 1,", "id: 1, sysid: 010,", 33, "fleet.agents#1.sysid", '"010" is text', "1 to 250"),
    "sexagesimal": ("duration_s: 10", "duration_s: 1:30", 26, "step 3, hold.duration_s", '"1:30" is text', "above 0"),
    "truth value": ("unit_m: 5", "unit_m: true", 4, "unit_m", "truth value", "number"),
    "nothing": ("unit_m: 5", "unit_m:", 4, "unit_m", "empty", "number"),
    "list for a section": ("policies:\n  agent_lost: land", "policies: []", 29, "policies", "list", "mapping"),
    "mapping for a list": ("[0, 3]", "{n: 0}", 13, "agents#2.start", "mapping", "list of 2 numbers"),
    "three coordinates": ("[0, 3]", "[0, 3, 10]", 13, "agents#2.start", "has 3 entries", "list of 2 numbers"),
    "one coordinate": ("[0, 3]", "[0]", 13, "agents#2.start#2", "is missing", "number from"),
    "not a number": ("alt_m: 584", "alt_m: .nan", 3, "origin.alt_m", ".nan is not a finite", "-500 to 9000"),
    "infinite": ("r: 4.5", "r: .inf", 7, "law.r", ".inf is not a finite", "number above 0"),
    "overflow": ("r: 4.5", "r: 1e999", 7, "law.r", ".inf is not a finite", "number above 0"),
    "nan in a list": ("- [0, 2]", "- [0, .nan]", 21, "shapes.row.offsets#2#2", ".nan", "number from"),
    "exchanged with the longitude": ("-35.36, lon_deg: 149.16", "149.16, lon_deg: -35.36", 3, "origin.lat_deg", "are lat_deg and lon_deg (-35.36) exchanged?", "from -89 to 89"),
    "units of 1e-7 degrees": ("-35.36", "-353600000", 3, "origin.lat_deg", "out of range; in degrees: -35.36?", "from -89 to 89"),
    "no place": ("lat_deg: -35.36, lon_deg: 149.16", "lat_deg: 0, lon_deg: 0", 3, "origin", "0, 0 lies in the Atlantic", "of the field"),
    "pole": ("-35.36", "89.5", 3, "origin.lat_deg", "89.5 is out of range", "from -89 to 89"),
    "no space after a -": ("  - form: {shape: ring}", "  -form: {shape: ring}", 25, "(whole file)", "-form has no space after the -", "- form:"),
    "IPv6": ("udpout:10.0.0.1:14550", "udpout:[::1]:14550", 33, "fleet.agents#1.endpoint", "IPv4 only", "udpout"),
    "latitude": ("-35.36", "-95", 3, "origin.lat_deg", "-95 is out of range", "from -89 to 89"),
    "height": ("height_m: 10", "height_m: 1000", 24, "step 1, takeoff.height_m", "out of range", "1 to 120"),
    "sysid too high": ("sysid: 2", "sysid: 251", 34, "fleet.agents#2.sysid", "251 is out of range", "1 to 250"),
    "sysid too low": ("sysid: 2", "sysid: 0", 34, "fleet.agents#2.sysid", "0 is out of range", "1 to 250"),
    "id too high": ("{id: 2, start", "{id: 65536, start", 13, "agents#2.id", "65536", "1 to 65535"),
    "id too low": ("{id: 2, start", "{id: 0, start", 13, "agents#2.id", "0 is out of range", "1 to 65535"),
    "fractional id": ("{id: 2, start", "{id: 2.5, start", 13, "agents#2.id", "not a whole", "whole number"),
    "autopilot": ("px4", "pixhawk", 35, "fleet.agents#3.autopilot", '"pixhawk"', "ardupilot, px4"),
    "policy": ("agent_lost: land", "agent_lost: on", 30, "policies.agent_lost", '"on"', "continue, hold, land"),
    "endpoint": ('"udpout:10.0.0.2:14550"', "10.0.0.2", 34, "fleet.agents#2.endpoint", '"10.0.0.2"', "udpout:"),
    "vehicle beside an endpoint": ('"udpout:10.0.0.2:14550"', '"udpout:10.0.0.2:14550", vehicle: simulated', 34, "fleet.agents#2.vehicle", "has an endpoint already, udpout:", "vehicle or endpoint"),
    "vehicle of another autopilot": ("autopilot: px4", "autopilot: px4, vehicle: arducopter", 35, "fleet.agents#3.vehicle", "vehicle arducopter is no px4", "autopilot: ardupilot, or none"),
    "unknown vehicle": ("autopilot: px4", "vehicle: gazebo", 35, "fleet.agents#3.vehicle", '"gazebo"', "simulated, arducopter, px4"),
    "endpoint's port": ("0.2:14550", "0.2:99999", 34, "fleet.agents#2.endpoint", "port 99999", "1 to 65535"),
    "mesh endpoint": ("tcp/10.0.0.2:7447", "10.0.0.2:7447", 34, "fleet.agents#2.mesh", '"10.0.0.2', "tcp/"),
    "name": ("name: trio", "name: ../trio", 2, "name", '"../trio"', "A-Z, a-z, 0-9, - and _ (no space; at most 40)"),
    "invisible letter": ("name: trio", 'name: "tr\u200bio"', 2, "name", '"tr\\u200bio" is not allowed; did you mean trio?', "A-Z"),
    "shape's name": ("  row:", "  a row:", 17, "shapes.a row", "can't be a name; did you mean a-row?", "A-Z"),
    "form as a word": ("form: {shape: ring}", "form: ring", 25, "step 2, form", '"ring" is text', "mapping of shape, on_timeout"),
    "step too far left": ("form: {shape: ring}", "form:\n    shape: ring", 26, "step 2, shape", "it is a field of form: indent it further", "form"),
    "no agents": (TEXT[TEXT.index("  - {id: 1, start") : TEXT.index("shapes:")], "  []\n", 11, "agents", "0 entries", ""),
    "same key twice": ("tick_s: 0.05", "unit_m: 6", 5, "unit_m", "given twice (first at trio.yaml:4)", "once"),
    "same inner key twice": ("r_out: 1.5", "r: 1.5", 8, "law.r", "given twice (first at trio.yaml:7)", "once"),
    "list as a key": ("tick_s: 0.05", "[1, 2]: 0.05", 5, "(whole file)", "field's name", "word"),
    "tag": ("name: trio", "name: !!python/name:os.system trio", 2, "name", "YAML tag", "no tags"),
    "tag on a section": ("law:", "law: !!omap", 6, "law", "YAML tag", "no tags"),
    "tag on a list": ("offsets:\n", "offsets: !!set\n", 19, "shapes.row.offsets", "YAML tag", "no tags"),
    "r_in >= r_out": ("r_in: 0.5", "r_in: 1.5", 9, "law.r_in", "1.5 is not below r_out", "below law.r_out = 1.5"),
    "r_out >= r": ("r: 4.5", "r: 1.5", 8, "law.r_out", "1.5 is not below r", "below law.r = 1.5"),
    "delta_l": ("kappa: 20", "delta_l: 1.9", 10, "law.delta_l", "1.9 is out of range", "from 2"),
    "kappa * tick": ("kappa: 20", "kappa: 21", 10, "law.kappa", "is 1.05", "at most 1 / tick_s = 20"),
    "same id": ("{id: 2, start", "{id: 1, start", 13, "agents#2.id", "1 is taken by agents#1", "own"),
    "same fleet id": ("{id: 2, sysid", "{id: 1, sysid", 34, "fleet.agents#2.id", "taken by fleet.agents#1", "one"),
    "same sysid": ("sysid: 2", "sysid: 1", 34, "fleet.agents#2.sysid", "1 is taken by fleet.agents#1", "own"),
    "same implied sysid": ("id: 2, sysid: 2", "id: 2, sysid: 3", 35, "fleet.agents#3.sysid", "3 is taken", "own"),
    "same endpoint": ("10.0.0.2:14550", "10.0.0.1:14550", 34, "fleet.agents#2.endpoint", "taken by", "own"),
    "same mesh": ("tcp/10.0.0.2", "tcp/10.0.0.1", 34, "fleet.agents#2.mesh", "taken by fleet.agents#1", "own"),
    "not in the fleet": ("id: 3, sysid: 3", "id: 4, sysid: 3", 14, "agents#3.id", "no entry in the fleet", "1, 2, 4"),
    "starts on one spot": ("[0, 3]", "[0.1, 0.2]", 13, "agents#2.start", "agents 1 and 2 start 0.2236", "0.5 units (2.5 m)"),
    "start far away": ("[0, 3]", "[0, 3000]", 13, "agents#2.start", "3000 units (15000 m) from the origin", "1000 units (5000 m)"),
    "not connected": ("[0, 3]", "[0, 5]", 11, "agents", "law.r = 4.5 units (22.5 m) it falls into {1, 3} and {2}", "law.r of 5 units (25 m) or more (agents 1 and 2)"),
    "slots too close": ("side: 2", "side: 1.2", 16, "shapes.ring", "slots 1 and 2 of 3 are 1.2 units (6 m) apart", "1.5 units"),
    "slots at r_out": ("side: 2", "side: 1.5", 16, "shapes.ring", "slots", "more than law.r_out"),
    "offsets too close": ("- [0, 4]", "- [0, 3]", 22, "shapes.row.offsets#3", "slots 2 and 3 of 3 are 1 units", "more than"),
    "too few slots": ("count: 3", "count: 2", 16, "shapes.ring.count", "2 slots for 3 agents: too few", "3 slots"),
    "too many slots": ("count: 3", "count: 4", 16, "shapes.ring.count", "4 slots for 3 agents: too many", "3 slots"),
    "too few offsets": ("      - [0, 4]\n", "", 19, "shapes.row.offsets", "2 slots for 3 agents: too few", "3 slots"),
    "ring without size": (", side: 2", "", 16, "shapes.ring", "neither side nor radius", "one of side, radius"),
    "ring with two sizes": ("side: 2", "side: 2, radius: 2", 16, "shapes.ring", "both side and radius", "one of"),
    "unknown shape": ("shape: ring", "shape: rign", 25, "step 2, form.shape", "did you mean ring?", "one of ring, row"),
    "land first": ("  - takeoff: {height_m: 10}\n", "", 24, "step 1", "form before takeoff", "takeoff as the first"),
    "takeoff twice": ("hold: {duration_s: 10}", "takeoff: {height_m: 5}", 26, "step 3", "in the air", "first step only"),
    "after land": ("  - land\n", "  - land\n  - land\n", 28, "step 5", "steps after land", "land as the last step only"),
    "no land": ("  - land\n", "", 27, "step 4", "the mission ends with form", "land or return as the last step"),
    "hold before form": ("form: {shape: ring}", "hold: {duration_s: 5}", 25, "step 2", "without a formation", "form step"),
    "two kinds in a step": ("form: {shape: ring}", "{form: {shape: ring}, land: {}}", 25, "step 2", "not one step", "one of"),
    "no kind of step": ("form: {shape: ring}", "{}", 25, "step 2", "not one step", "exactly one of"),
    "takeoff timeout": ("height_m: 10", "height_m: 10, timeout_s: 9", 24, "step 1, takeoff.timeout_s", "9 s", "above 10"),
    "form timeout": ("timeout_s: 60", "timeout_s: 5", 27, "step 4, form.timeout_s", "5 s is over", "above 5"),
    "hold timeout": ("duration_s: 10", "duration_s: 10, timeout_s: 8", 26, "step 3, hold.timeout_s", "8 s", "above 10"),
    "land timeout": ("- land\n", "- land: {timeout_s: 6}\n", 28, "step 5, land.timeout_s", "6 s is over", "above 6.66"),
    "return timeout": ("- land\n", "- return: {timeout_s: 6}\n", 28, "step 5, return.timeout_s", "6 s is over", "above 6.66"),
    "rotate timeout": ("hold: {duration_s: 10}", "rotate: {angle_deg: 90, speed_mps: 1, timeout_s: 9}", 26, "step 3, rotate.timeout_s", "9 s is over", "above 11"),
    "move timeout": ("hold: {duration_s: 10}", "move: {by: [0, 10], timeout_s: 20}", 26, "step 3, move.timeout_s", "20 s is over", "above 22"),
    "shape beyond the fence": ("policies:", "fence: {polygon: [[-1, -0.5], [-1, 3.5], [5, 3.5], [5, -0.5]]}\npolicies:", 27, "step 4, form", "would be outside the geofence at 5.0 m north, -5.0 m east", "inside fence.polygon"),
    "scaled beyond the fence": ("  - form: {shape: row, timeout_s: 60}\n  - land\n", "  - scale: {factor: 3}\n  - land\nfence: {polygon: [[-1, -1], [-1, 5], [5, 5], [5, -1]]}\n", 27, "step 4, scale", "would be outside the geofence at", "inside fence.polygon"),
    "fence that crosses itself": ("policies:", "fence: {polygon: [[-9, -9], [9, 9], [-9, 9], [9, -9]]}\npolicies:", 29, "fence.polygon", "corners 1 and 3 cross", "in order"),
    "fence around nothing": ("policies:", "fence: {polygon: [[-9, -9], [0, 0], [9, 9]]}\npolicies:", 29, "fence.polygon", "no area", "around a field"),
    "CSV that is not there": ("kind: ring, count: 3, side: 2", "kind: csv, path: none.csv", 16, "shapes.ring.path", "none.csv can't be read", "a CSV file"),
    "no space but one that looks so": ("unit_m: 5", "unit_m:\u00a05", 4, "(whole file)", "a name without a colon and a space after it", "name: value"),
    "bracket left open": ("[0, 3]}", "[0, 3}", 13, "(whole file)", "a [ is not closed, or a comma is missing (it begins in line 13)", "well-formed"),
    "tab": ("  r: 4.5", "\tr: 4.5", 7, "(whole file)", "YAML: ", "spaces, not tabs"),
    "quote left open": ("name: trio", "name: 'trio", 2, "(whole file)", "a quote is not closed (it begins in line 2)", "well-formed"),
    "list entry too far left": ("  - form: {shape: ring}", " - form: {shape: ring}", 25, "(whole file)", "line 25 is indented by 1, its siblings by 2", "one indentation"),
    "list entry too far right": ("  - {id: 2, start", "   - {id: 2, start", 13, "(whole file)", "line 13 is indented by 3, its siblings by 2", "one indentation"),
    "field too far left": ("  r_out: 1.5", " r_out: 1.5", 8, "(whole file)", "line 8 is indented by 1, its siblings by 2", "one indentation"),
    "bad indent": ("  r_out: 1.5", "   r_out: 1.5", 8, "(whole file)", "line 8 is indented by 3, its siblings by 2", "one indentation"),
    "list without its name": ("steps:\n", "", 23, "(whole file)", "a list entry (-) stands among fields", "a line such as 'steps:' above it"),
    "colon without a name": ("  ring: {", "  : {", 16, "(whole file)", "a ':' without a name before it", "name: value"),
    "bracket too many": ("kappa: 20", "kappa: 20\ntick: }", 11, "(whole file)", "a value is missing", "a value"),
    "misspelt section": ("shapes:", "shaeps:", 15, "shaeps", "did you mean shapes?", "agents, fence"),
    "colon within a text": ("name: trio", "name: trio: two", 2, "(whole file)", "a ':' stands where no field can begin", "quotes"),
    "two documents": ("tick_s: 0.05", "---", 5, "(whole file)", "YAML: ", "well-formed"),
    "alias": ("unit_m: 5", "unit_m: *five", 4, "(whole file)", "aliases", "the value itself"),
    "control character": ("unit_m: 5", "unit_m: 5\x07", 4, "(whole file)", "character", "printable"),
    "no way": ("form: {shape: ring}", "form: {shape: ring}\n  - move: {speed_mps: 1}", 26, "step 3, move", "no way to go", "one of to, along, by"),
    "two ways": ("form: {shape: ring}", "form: {shape: ring}\n  - move: {to: [1, 1], by: [1, 1]}", 26, "step 3, move", "to and by", "one of to, along, by"),
    "too fast a move": ("form: {shape: ring}", "form: {shape: ring}\n  - move: {to: [1, 1], speed_mps: 9}", 26, "step 3, move.speed_mps", "faster", "limits.speed_mps = 5"),
    "too far a move": ("form: {shape: ring}", "form: {shape: ring}\n  - move: {to: [2000, 1]}", 26, "step 3, move", "10000 m from the origin", "5000 m"),
    "too narrow": ("form: {shape: ring}", "form: {shape: ring}\n  - scale: {factor: 0.5}", 26, "step 3, scale.factor", "brings slots to 1 units", "law.r_out"),
    "no angle": ("form: {shape: ring}", "form: {shape: ring}\n  - rotate: {speed_mps: 1}", 26, "step 3, rotate.angle_deg", "is missing", "a number"),
    "early return": ("form: {shape: ring}", "form: {shape: ring}\n  - return", 26, "step 3", "steps after return", "as the last step only"),
    "bad policy": ("form: {shape: ring}", "form: {shape: ring}\n  - hold: {duration_s: 1, on_timeout: explode}", 26, "step 3, hold.on_timeout", "explode", "land"),
    "bad link": ("form: {shape: ring}", "form: {shape: ring}\n  - form: {shape: ring, neighbours: [[1, 9]]}", 26, "step 3, form.neighbours#1", "is no link", "1, 2, 3"),
    "cut graph": ("form: {shape: ring}", "form: {shape: ring}\n  - form: {shape: ring, neighbours: [[1, 2]]}", 26, "step 3, form.neighbours", "{1, 2} and {3}", "links"),
    "zone: neither": ("  trust: keys", "  trust: keys\nzones:\n  x: {ceiling_m: 20}", 38, "zones.x", "neither polygon nor circle", "circle and radius"),
    "zone: both": ("  trust: keys", "  trust: keys\nzones:\n  x: {circle: [20, 20], radius: 1, polygon: [[9, 9], [9, 10], [10, 9]]}", 38, "zones.x", "both polygon and circle", "polygon, or circle"),
    "zone: no radius": ("  trust: keys", "  trust: keys\nzones:\n  x: {circle: [20, 20]}", 38, "zones.x.radius", "is missing", "circle and radius"),
    "zone: no circle": ("  trust: keys", "  trust: keys\nzones:\n  x: {radius: 2}", 38, "zones.x.circle", "is missing", "circle and radius"),
    "zone: crossing": ("  trust: keys", "  trust: keys\nzones:\n  x: {polygon: [[20, 20], [30, 30], [30, 20], [20, 30]]}", 38, "zones.x.polygon", "the edges after corners 1 and 3 cross", "corners in order"),
    "zone: flat": ("  trust: keys", "  trust: keys\nzones:\n  x: {polygon: [[20, 20], [30, 30], [40, 40]]}", 38, "zones.x.polygon", "has no area", "corners around a place"),
    "zone: heights": ("  trust: keys", "  trust: keys\nzones:\n  x: {circle: [20, 20], radius: 1, floor_m: 9, ceiling_m: 9}", 38, "zones.x.ceiling_m", "9 m is not above floor_m", "above 9"),
    "zone: clearance": ("  trust: keys", "  trust: keys\nzones:\n  x: {circle: [20, 20], radius: 1, clearance_m: 0}", 38, "zones.x.clearance_m", "0 is out of range", "0.1 to 100"),
    "target: adsb: '000000'": ("  - land\n", "  - follow: {target: boat, duration_s: 20}\n  - land\ntargets: {boat: {adsb: '000000'}}\n", 30, "targets.boat.adsb", "no aircraft", "not all 0"),
    "target: adsb: a1b2c3, along: [[0, 0], [0, 9]]": ("  - land\n", "  - follow: {target: boat, duration_s: 20}\n  - land\ntargets: {boat: {adsb: a1b2c3, along: [[0, 0], [0, 9]]}}\n", 30, "targets.boat", "has adsb and along", "or none"),
    "target: agent: 9": ("  - land\n", "  - follow: {target: boat, duration_s: 20}\n  - land\ntargets: {boat: {agent: 9}}\n", 30, "targets.boat.agent", "no agent 9", "one of 1, 2, 3"),
    "target: speed_mps: 2": ("  - land\n", "  - follow: {target: boat, duration_s: 20}\n  - land\ntargets: {boat: {speed_mps: 2}}\n", 30, "targets.boat.speed_mps", "that is played", "with along"),
    "target: agent: 2": ("  - land\n", "  - follow: {target: boat, duration_s: 20}\n  - land\ntargets: {boat: {agent: 2}}\n", 28, "step 5, follow.target", "the others do as policies.agent_lost says: land", ": continue"),
    "target: height_m: 30, above_m: 100": ("  - land\n", "  - follow: {target: boat, duration_s: 20, above_m: 100}\n  - land\ntargets: {boat: {height_m: 30}}\n", 28, "step 5, follow.above_m", "over the fence's top", "from 2 to 88 m"),
    "target: height_m: -30, above_m: 10": ("  - land\n", "  - follow: {target: boat, duration_s: 20, above_m: 10}\n  - land\ntargets: {boat: {height_m: -30}}\n", 28, "step 5, follow.above_m", "too near the ground", "from 32 to 148 m"),
    "target: height_m: 0, speed_mps: 12": ("  - land\n", "  - follow: {target: boat, duration_s: 20, speed_mps: 12}\n  - land\ntargets: {boat: {height_m: 0}}\n", 28, "step 5, follow.speed_mps", "faster than the vehicles", "at most"),
    "target: height_m: 0, timeout_s: 15": ("  - land\n", "  - follow: {target: boat, duration_s: 20, timeout_s: 15}\n  - land\ntargets: {boat: {height_m: 0}}\n", 28, "step 5, follow.timeout_s", "is over before", "above 20"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSALS.values(), ids=REFUSALS)
def test_a_mistake_is_reported_at_its_place(case: tuple[str, str, int, str, str, str]) -> None:
    old, new, line, field, what, allowed = case
    found = problems(edited((old, new)))
    (it,) = (
        problem
        for problem in found
        if (problem.where, problem.field) == (f"trio.yaml:{line}", field)
    )
    assert what in it.what
    assert allowed in it.allowed
    assert it.allowed
    assert len(found) <= 2, "one mistake should not call up a crowd"


# In a file in metres (what is replaced, by what, part of the answer); r 22.5, r_out 7.5, r_in 2.5.
IN_METRES = {
    "starts": ("[0, 15]", "[0, 1]", "agents 1 and 2 start 1 m apart; allowed: at least law.r_in = 2.5 m"),
    "far start": ("[0, 15]", "[0, 6000]", "is 6000 m from the origin; allowed: at most 5000 m"),
    "not connected": ("[0, 15]", "[0, 28]", "law.r = 22.5 m it falls into {1, 3} and {2}; allowed: law.r of 28 m or more (agents 1 and 2)"),
    "slots": ("side: 10", "side: 6", "are 6 m apart (and 2 more pairs); allowed: more than law.r_out = 7.5 m: side above 7.5"),
    "radii": ("r_out: 7.5", "r_out: 25", "law.r_out: 25 is not below r; allowed: below law.r = 22.5"),
    "factor": ("hold: {duration_s: 10}", "scale: {factor: 0.5}", "0.5 brings slots to 5 m; allowed: above 0.75: more than law.r_out = 7.5 m"),
}  # fmt: skip


@pytest.mark.parametrize("case", IN_METRES.values(), ids=IN_METRES)
def test_a_file_in_metres_is_answered_in_metres(case: tuple[str, str, str]) -> None:
    old, new, answer = case
    text = in_metres()
    assert old in text
    said = [str(problem) for problem in problems(text.replace(old, new))]
    assert any(answer in each for each in said), said
    assert "units" not in "".join(said)


@given(st.integers(2, 40), st.integers(2, 40), st.sampled_from(["units", "metres"]))
def test_the_range_that_is_said_to_be_enough_is_enough(north: int, east: int, lengths: str) -> None:
    """Also where it is no round number: the diagonal of the starts."""
    text = edited(("unit_m: 5", f"unit_m: 7\nlengths: {lengths}"), ("[0, 3]", f"[{north}, {east}]"))
    text = text.replace("r_out: 1.5", "r_out: 1.4").replace("kappa: 20", "kappa: 19")
    try:
        loads(text)
    except MissionError as error:
        (range_,) = re.findall(r"law.r of ([0-9.]+) ", str(error))
        loads(text.replace("  r: 4.5", f"  r: {range_}"))


@pytest.mark.parametrize("section", ["version", "name", "origin", "law", "agents", "steps"])
def test_a_missing_section_is_named(section: str) -> None:
    (problem,) = problems(without_section(section))
    assert (problem.where, problem.field, problem.what) == ("trio.yaml:1", section, "is missing")


def test_all_mistakes_at_once_in_the_order_of_the_file() -> None:
    text = edited(
        ("unit_m: 5", "unit_m: five"),
        ("tick_s: 0.05", "tick: 0.05\nversion: 1"),
        ("r_in: 0.5", "r_in: 2"),
        ("count: 3", "count: 2"),
        ("shape: ring", "shape: rung"),
        ("  - land\n", ""),
        ("sysid: 2", "sysid: 1"),
    )
    found = [(int(problem.where.split(":")[1]), problem.field) for problem in problems(text)]
    assert found == [
        (4, "unit_m"),
        (5, "tick"),
        (6, "version"),
        (10, "law.r_in"),
        (26, "step 2, form.shape"),
        (28, "step 4"),
        (34, "fleet.agents#2.sysid"),
    ]


def test_a_refusal_escapes_control_characters() -> None:
    """A name or value of the file can't command the terminal that shows the refusal."""
    evil = '"\\e[2J\\u009b"'
    for old, new in (("  row:", f"  {evil}:"), ("name: trio", f"name: {evil}")):
        for problem in problems(edited((old, new))):
            assert str(problem).isprintable()


def test_an_id_that_is_no_sysid_needs_a_fleet() -> None:
    text = without_section("fleet").replace("{id: 3,", "{id: 300,")
    (problem,) = problems(text)
    assert (problem.where, problem.field) == ("trio.yaml:14", "agents#3.id")
    assert "fleet section" in problem.allowed
    (problem,) = problems(
        edited(("{id: 3, start", "{id: 300, start"), ("{id: 3, sysid: 3,", "{id: 300,"))
    )
    assert (problem.where, problem.field, problem.allowed) == (
        "trio.yaml:35",
        "fleet.agents#3",
        "sysid: 1 to 250",
    )


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "is empty"),
        (b"# nothing\n", "is empty"),
        (b"- 1\n", "is a list"),
        (b"hello\n", "is text"),
        (b"\xff\xfe\x00", "is not text"),
        (b"version: 1\nname: p\xe4r\n", "mission.yaml:2: (whole file): is not text"),
        (b"#" * 4_000_001, "too large"),
        (b"[" * 5000, "nested too deeply"),
        (b"a: " + b"9" * 5000, "unknown field"),
    ],
    ids=lambda shown: shown if isinstance(shown, str) else "",
)
def test_files_that_are_no_missions(tmp_path: Path, content: bytes, what: str) -> None:
    path = tmp_path / "mission.yaml"
    path.write_bytes(content)
    with pytest.raises(MissionError, match=r"mission\.yaml") as caught:
        load(path)
    assert what in str(caught.value)


def test_files_that_are_not_there(tmp_path: Path) -> None:
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(MissionError, match="can't be read") as caught:
            load(path)
        assert caught.value.problems[0].where == str(path)
        assert caught.value.exit_code == 2
