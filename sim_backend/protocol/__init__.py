"""Devices as their wires see them: simulators that speak each device's protocol, byte for byte, over loopback.

``sim_backend.protocol.X`` simulates the device that ``drivers.X`` drives. ``make(name, config, wires)`` takes the same Config
as the driver and answers at the address written there; what the device would measure comes through ``wires``.
"""
