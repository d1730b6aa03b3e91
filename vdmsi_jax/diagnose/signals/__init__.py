"""What logs hold before any model: runs, noise and its colour, disturbances, contradictions."""
