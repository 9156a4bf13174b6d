"""Vehicles that nobody tuned on: drawn from a seed, flown by `planted`'s integrator, something hidden in them or nothing.

Nothing of sysid, sitl or gcs is imported but in `asking`, where the diagnosis is asked. A flight follows from its seed
alone.
"""
