"""A plant with causes in it: laid out, simulated, fitted, and screened for more of them."""
