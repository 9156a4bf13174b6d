"""Vehicles that nobody tuned on: drawn from a seed, flown by `planted`'s integrator, hiding something or nothing.

Nothing of sysid, sitl or gcs is imported but in `asking`, where the diagnosis is asked. A flight follows from its seed
alone.
"""
