"""The experiment that tells two models apart with the fewest trials."""
