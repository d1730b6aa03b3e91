"""System identification of vehicle actuators and the simulation that uses it."""
