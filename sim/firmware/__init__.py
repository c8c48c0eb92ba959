"""Autopilot personas: pure state machines from MAVLink messages to demands on the vehicle's
motion."""
