"""The paper's experiments, made again, and what lies beyond them."""
