"""Vehicles over MAVLink 2: `VehicleLink` (`link.py`) translates between the wire and
`core.model.vehicle`."""
