"""Identification: from commands and responses to transfer functions PxZy with their uncertainty."""

from vdmsi_jax.identify.identify import identify as identify
from vdmsi_jax.identify.result import Fit as Fit
from vdmsi_jax.identify.result import OrderGrid as OrderGrid
