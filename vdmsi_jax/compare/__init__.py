"""Measured, VDM, VDM-SI and the extended model side by side: responses, paths, and where they
part."""

from ._compare import compare as compare
from ._compare import identified as identified
from ._files import simulation_document as simulation_document
from ._files import write_trajectories as write_trajectories
from ._nouns import SUCCESSFUL as SUCCESSFUL
from ._nouns import Comparison as Comparison
from ._nouns import PoseErrors as PoseErrors
from ._nouns import Prediction as Prediction
from ._nouns import Score as Score
from ._nouns import has_pose as has_pose
