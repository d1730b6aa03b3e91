"""Reports: pages as data, and what they say of finished results."""
