"""Autopilot personas: state machines from MAVLink messages to demands on a motion. Pure."""
