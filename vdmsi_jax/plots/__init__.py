"""Figures: each function takes finished results and returns one matplotlib figure."""

from .dynamics import responses as responses
from .orders import order_grid as order_grid
from .paths import paths as paths
from .paths import translation_error as translation_error
from .residuals import residuals as residuals
from .signals import channels as channels
from .signals import fitted as fitted
from .style import to_svg as to_svg
