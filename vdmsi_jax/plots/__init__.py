"""Figures: each function takes finished results and returns one matplotlib figure."""

from .diagnosis import budget as budget
from .diagnosis import diagnosis as diagnosis
from .diagnosis import gains as gains
from .diagnosis import paths_before_after as paths_before_after
from .dynamics import responses as responses
from .orders import order_grid as order_grid
from .overlays import on_path as on_path
from .overlays import overlay as overlay
from .overlays import residual_against as residual_against
from .paper import courses as courses
from .paper import navigated as navigated
from .paper import navigation as navigation
from .paper import open_loop as open_loop
from .paper import step_inputs as step_inputs
from .paper import vdm_rules as vdm_rules
from .paths import paths as paths
from .paths import translation_error as translation_error
from .remains import innovations as innovations
from .residuals import residuals as residuals
from .signals import channels as channels
from .signals import fitted as fitted
from .style import to_svg as to_svg
