"""What a vehicle is told."""

import equinox as eqx
from jaxtyping import Array, Float

from vdmsi_jax.data.record import Record
from vdmsi_jax.errors import InputError
from vdmsi_jax.models.plant import refuse_no_period
from vdmsi_jax.parameters import floats


class Commands(eqx.Module):
    """What a vehicle is told, row by row, each row held until the next.

    Attributes:
        v_cmd: velocity command, m/s.
        delta_cmd: steering command, road-wheel angle, rad.
        dt: sample period, s.
        t0: time of the first row, s.
        since: time of the first row since the run began, s, for what changes as a run goes on.
        way: travelled since the run began at the first row, m, likewise.
        session: time of the session at which the run began, s, as `Record.session`.

    Raises ValueError where the commands differ in shape or have fewer than two rows, or where `dt`
    is not more than zero.
    """

    v_cmd: Float[Array, "*batch N"] = eqx.field(converter=floats)
    delta_cmd: Float[Array, "*batch N"] = eqx.field(converter=floats)
    dt: Float[Array, ""] = eqx.field(converter=floats)
    t0: Float[Array, ""] = eqx.field(converter=floats, default=0.0)
    since: Float[Array, ""] = eqx.field(converter=floats, default=0.0)
    way: Float[Array, ""] = eqx.field(converter=floats, default=0.0)
    session: Float[Array, ""] = eqx.field(converter=floats, default=0.0)

    def __check_init__(self):
        if self.v_cmd.shape != self.delta_cmd.shape or self.v_cmd.shape[-1] < 2:
            raise ValueError(
                "v_cmd and delta_cmd need one shape with at least two rows; "
                f"got {self.v_cmd.shape} and {self.delta_cmd.shape}"
            )
        refuse_no_period(self.dt)

    @staticmethod
    def of(record: Record) -> "Commands":
        """The commands of a record without gaps.

        Raises:
            InputError: it has no `v_cmd` or `delta_cmd`, or more than one segment.
        """
        if len(record.segments) != 1:
            problem = f"has {len(record.segments)} segments, and a simulation cannot cross a gap"
            mend = "simulate record.select([segment]) for each of record.segments"
            raise InputError(record.source, "segments", problem, mend)
        v_cmd, delta_cmd = record["v_cmd"], record["delta_cmd"]
        return Commands(v_cmd, delta_cmd, record.dt, record.t[0], session=record.session)
