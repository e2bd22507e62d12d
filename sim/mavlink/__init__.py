"""A simulated MAVLink vehicle: an autopilot as a bridge meets it on the wire, without one.

`autopilot.Autopilot.step(now, messages) -> messages` is the pure vehicle; `vehicle.MavlinkVehicle` adds the
wire (bytes in, frames out, with faults), `serve` the sockets of a process, `served.Served` those of a test.
"""
