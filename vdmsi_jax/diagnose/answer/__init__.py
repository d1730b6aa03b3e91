"""What is told: findings and scores as data, as words, and as the document `diagnosis.json`."""
