"""What remains when the causes are in: kinds of error that have a family and no name."""
