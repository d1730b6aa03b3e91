"""Simulate vehicles: `simulate(vehicle, commands)`, one or many, exactly or with a solver."""

from vdmsi_jax.models.commands import Commands as Commands
from vdmsi_jax.simulate._arcs import Arcs as Arcs
from vdmsi_jax.simulate._given import as_commands as as_commands
from vdmsi_jax.simulate._given import as_vehicle as as_vehicle
from vdmsi_jax.simulate._nouns import RESULTS as RESULTS
from vdmsi_jax.simulate._nouns import AbstractMethod as AbstractMethod
from vdmsi_jax.simulate._nouns import Start as Start
from vdmsi_jax.simulate._nouns import Trajectory as Trajectory
from vdmsi_jax.simulate._quadrature import Quadrature as Quadrature
from vdmsi_jax.simulate._rest import at_rest as at_rest
from vdmsi_jax.simulate._rest import resting_command as resting_command
from vdmsi_jax.simulate._simulate import simulate as simulate
from vdmsi_jax.simulate._simulate import simulate_many as simulate_many
from vdmsi_jax.simulate._solver import Solver as Solver
