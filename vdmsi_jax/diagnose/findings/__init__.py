"""From causes that are in a model to what is said of them: names, weight, budget, detectability."""
