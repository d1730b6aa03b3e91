"""Models on disk: versioned JSON, checked when it is read, never code.

A plant may have `effects`, a vehicle a `body`, and channels `sensors`. An effect is told by its
`cause`, its `form` where it has several, its `parameters` in the units of `vdmsi_jax.effects` (a
limit as its inverse; what is not given is off), and its `constants`.
"""

from ._model import IDENTIFY as IDENTIFY
from ._model import MODEL as MODEL
from ._model import Model as Model
from ._model import Plant as Plant
from ._model import geometry as geometry
from ._model import load_model as load_model
from ._model import save_model as save_model
