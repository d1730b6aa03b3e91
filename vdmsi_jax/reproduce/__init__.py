"""The paper's experiments, made again with the test vehicle, as plain results."""

from .closed_loop import ClosedLoop as ClosedLoop
from .course import COURSES as COURSES
from .course import Course as Course
from .identification import Identification as Identification
from .logs import SHIPPED as SHIPPED
from .logs import TRIMS as TRIMS
from .logs import Trim as Trim
from .open_loop import OpenLoop as OpenLoop
from .reproduce import Experiments as Experiments
from .reproduce import reproduce as reproduce
